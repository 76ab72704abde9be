//! The units of the objective rest on the generated scene of NY-1's published size.

mod support;

use overfly::scene::{generate_block, ny1_size};
use overfly::settings::Settings;

#[test]
fn the_reference_area_of_the_settings_is_that_of_the_generated_scene() {
    let settings = Settings::default();
    let snapshot = support::snapshot(&support::session(generate_block(&ny1_size()), &settings));
    let measured = snapshot.field().facts.reference_area_m2;
    let assumed = settings.objective.reference_area_m2;
    assert!((measured / assumed - 1.0).abs() < 0.02, "the scene has {measured} m^2 exposed, the settings say {assumed}");
}
