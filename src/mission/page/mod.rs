//! `plan.html`: a plan as one page that needs nothing else. The scene in three dimensions, the flight through it, and when which part of the surface
//! is captured.
//!
//! A page is made in two steps: [`data`] writes down what there is to see (format [`FORMAT`]), [`html`] puts it into a file with the program that shows it. A
//! program that has a page open already sends it new data alone.

mod bytes;
mod compose;
mod flight;
mod scene3d;
mod sighted;

use serde::Serialize;

pub use self::compose::{Live, data_of, html};
pub use self::flight::{Flight, flight};
pub use self::scene3d::Scene3d;
pub use self::sighted::Sighted;

/// Version of the format of a page's data, its first key.
pub const FORMAT: &str = "overfly-page/1";

#[derive(Serialize)]
struct Data<'a> {
    format: &'static str,
    version: &'static str,
    scenes: Vec<&'a Scene3d>,
    surfaces: Vec<&'a sighted::Surface>,
    flights: Vec<Placed<'a>>,
}

/// A flight with the places of what it shares with others.
#[derive(Serialize)]
struct Placed<'a> {
    scene: usize,
    surface: Option<usize>,
    #[serde(flatten)]
    flight: &'a Flight,
}

/// The data of a page: a scene and the flights through it, one or two of them. Flights with a scene of their own ([`Flight::through`]) bring it along; scenes and
/// surfaces that are the same stand there once.
///
/// The bytes are JSON without the character `<`, so that nothing in a name can end the script element that holds them.
pub fn data(scene: &Scene3d, flights: &[Flight]) -> Vec<u8> {
    let (mut scenes, mut surfaces) = (vec![scene], Vec::new());
    let mut placed = Vec::new();
    for flight in flights {
        let own = flight.own_scene().unwrap_or(scene);
        placed.push(Placed {
            scene: place(&mut scenes, own),
            surface: flight.surface().map(|surface| place(&mut surfaces, surface)),
            flight,
        });
    }
    let data = Data { format: FORMAT, version: env!("CARGO_PKG_VERSION"), scenes, surfaces, flights: placed };
    let json = serde_json::to_string(&data).expect("the entries have string keys and no failing serialiser");
    // Outside of strings JSON has no such character.
    json.replace('<', "\\u003c").into_bytes()
}

/// Where an equal one stands; appended where there is none.
fn place<'a, T: PartialEq>(all: &mut Vec<&'a T>, one: &'a T) -> usize {
    all.iter().position(|other| *other == one).unwrap_or_else(|| {
        all.push(one);
        all.len() - 1
    })
}

#[cfg(test)]
mod tests;
