//! `plan.svg`: the plan on one sheet. A view from above and one from the south, to one scale; buildings by height, walls by the share of
//! their samples that the plan captures, the path by time.

mod charts;
mod colour;
mod distribution;
pub(in crate::mission) mod flight;
mod heading;
mod legend;
mod pen;
mod plain_view;
pub mod quality;
mod relief;
pub mod scene_view;
mod sheet;
mod side_view;
pub mod strip;
mod thin;
mod top_view;
mod views;
pub mod walls;

use overfly_table::FieldTable;
use svg::Document;

use self::pen::Anchor;
use self::sheet::{MARGIN, Sheet, WIDTH};
use crate::scene::Terrain;
use crate::trajectory::plan::Plan;

/// Why a plan cannot be drawn on a field.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SvgError {
    #[error(
        "the plan was made on another field (revision {plan_revision}, {plan_samples} samples) than the one to draw \
         (revision {field_revision}, {field_samples} samples); fetch both again"
    )]
    OtherField { plan_revision: u64, plan_samples: usize, field_revision: u64, field_samples: usize },
}

/// Whether a plan was made on a field, sample for sample.
pub fn check(field: &FieldTable, plan: &Plan) -> Result<(), SvgError> {
    if plan.cells.len() != field.samples.len()
        || plan.ceilings.len() != field.samples.len()
        || plan.scene.revision != field.facts.revision
    {
        return Err(SvgError::OtherField {
            plan_revision: plan.scene.revision,
            plan_samples: plan.cells.len(),
            field_revision: field.facts.revision,
            field_samples: field.samples.len(),
        });
    }
    Ok(())
}

/// The file's content. `field` is the field of the plan's scene revision: outlines, samples and what can be captured come from it. The ground is drawn where its
/// terrain is known, which a field does not hold.
pub fn to_bytes(field: &FieldTable, terrain: Option<&Terrain>, plan: &Plan) -> Result<Vec<u8>, SvgError> {
    check(field, plan)?;
    let sheet = Sheet::of(field, plan);
    let tallies = walls::tally(field, plan);
    let path = flight::timed_path(plan);
    let document = Document::new()
        .set("viewBox", (0, 0, WIDTH as u32, sheet.height.ceil() as u32))
        .set("width", WIDTH)
        .set("height", sheet.height.ceil())
        .set("font-family", pen::FONT)
        .add(legend::gradients())
        .add(pen::rectangle([0.0, 0.0], [WIDTH, sheet.height.ceil()], colour::PAPER))
        .add(heading::draw(plan))
        .add(top_view::draw(&sheet, field, terrain, &tallies, plan, &path))
        .add(legend::scale_bar(&sheet))
        .add(side_view::draw(&sheet, field, terrain, plan, &path))
        .add(legend::draw(&sheet, field, plan))
        .add(footer(&sheet, terrain, plan));
    Ok(format!("{document}\n").into_bytes())
}

/// What the coordinates mean.
fn footer(sheet: &Sheet, terrain: Option<&Terrain>, plan: &Plan) -> svg::node::element::Text {
    let frame = match plan.scene.origin {
        Some(origin) => format!("Metres east and north of {:.6}° N, {:.6}° E (WGS84).", origin.lat_deg, origin.lon_deg),
        None => "Metres east and north in the scene's own frame.".to_owned(),
    };
    let meaning = "A sample is captured when the images see enough of the hemisphere over it, by exact rays.";
    let ground = terrain.map_or("", |_| " Brown lines: ground of one height, m above its lowest place.");
    pen::quiet_text([MARGIN, sheet.height - 28.0], 12.0, Anchor::Start, &format!("{frame} {meaning}{ground}"))
}
