//! The paper's tables and figures, computed anew: flights are planned and evaluated, and each table is printed with the paper's own rows.
//!
//! One part is one table or figure, in a file of its own; [`study`] holds what they share. Everything here is a function of settings,
//! scenes and seeds, but for [`Reproduction::times`].

mod chart;
mod convergence;
mod equal;
mod fig10;
mod fig9;
mod figures;
mod growth;
pub mod json;
pub mod markdown;
mod matched;
mod paper;
mod pareto;
mod planning_time;
mod refined;
mod sight;
mod site;
mod statistics;
mod study;
mod sweep;
mod table;
mod table1;
mod table2;
mod table3;
mod table4;
mod table5;

pub use chart::Drawing;
pub use matched::{Grid, Matched, Rival, completeness_percent, match_completeness, match_goal};
pub use site::Site;
pub use statistics::Spread;
pub use study::Watch;
pub use table::{Cell, Row, Source, Table};

use self::study::Study;
use crate::camera::RigError;
use crate::field::FieldError;
use crate::scene::{Scene, generate_block, ny1_size};
use crate::settings::Settings;

/// Fixed seeds are 1, 2, ... up to this many.
pub const MOST_SEEDS: u32 = 100;

/// Sizes of a quick run: samples and viewpoints of a field, iterations of a search, samples of a truth, kicks of a tour.
const QUICK: [u32; 5] = [150, 200, 30, 400, 5];

/// Rounds of a refined flight, whatever the settings say: the usual number is one that a user waits for.
const REFINED_ROUNDS: u32 = 1600;
const QUICK_ROUNDS: u32 = 6;

/// A table or figure that can be asked for alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    Table1,
    Table2,
    Table3,
    Table4,
    Table5,
    /// Flights of equal Completeness, as the paper's figures of merit want them.
    Equal,
    /// The same of refined flights.
    EqualRefined,
    Fig9,
    Fig10,
    Convergence,
    /// Time against Completeness of all methods.
    Pareto,
    Times,
    /// The refinement against the paper's search in the same time.
    Refined,
    /// How far cameras see, which the paper leaves open.
    Sight,
    Sweep,
    /// How a field grows with the area.
    Growth,
}

impl Part {
    /// All parts, in the order in which they are reported.
    pub const ALL: [Self; 16] = [
        Self::Table1,
        Self::Table2,
        Self::Table3,
        Self::Table4,
        Self::Table5,
        Self::Equal,
        Self::EqualRefined,
        Self::Fig9,
        Self::Fig10,
        Self::Convergence,
        Self::Pareto,
        Self::Times,
        Self::Refined,
        Self::Sight,
        Self::Sweep,
        Self::Growth,
    ];

    pub fn name(self) -> &'static str {
        match self {
            Self::Table1 => "table1",
            Self::Table2 => "table2",
            Self::Table3 => "table3",
            Self::Table4 => "table4",
            Self::Table5 => "table5",
            Self::Equal => "equal",
            Self::EqualRefined => "equal-refined",
            Self::Fig9 => "fig9",
            Self::Fig10 => "fig10",
            Self::Convergence => "convergence",
            Self::Pareto => "pareto",
            Self::Times => "times",
            Self::Refined => "refined",
            Self::Sight => "sight",
            Self::Sweep => "sweep",
            Self::Growth => "growth",
        }
    }

    /// The part called `name`.
    pub fn parse(name: &str) -> Result<Self, ReproductionError> {
        Self::ALL.into_iter().find(|part| part.name() == name).ok_or_else(|| ReproductionError::UnknownPart(name.to_owned()))
    }

    /// What is done when nothing is asked for by name: all of the paper, without what varies constants that it leaves open, and without what goes beyond it and
    /// takes hours.
    pub fn of_the_paper() -> Vec<Self> {
        Self::ALL
            .into_iter()
            .filter(|part| !matches!(part, Self::EqualRefined | Self::Sight | Self::Sweep | Self::Growth))
            .collect()
    }

    fn names() -> String {
        Self::ALL.map(Self::name).join(", ")
    }
}

/// Why there is no reproduction.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ReproductionError {
    #[error("there is no part {0:?}; known parts: {known}", known = Part::names())]
    UnknownPart(String),
    #[error("the scene {site} is missing; give the folder that holds it with `--scenes`")]
    NoScene { site: &'static str },
    #[error("the reproduction was stopped")]
    Stopped,
    #[error(transparent)]
    Field(FieldError),
    #[error("a structure of a generated city cannot be edited: {0}")]
    Edit(String),
    #[error(transparent)]
    Rig(#[from] RigError),
}

impl From<FieldError> for ReproductionError {
    fn from(error: FieldError) -> Self {
        if error == FieldError::Stopped { Self::Stopped } else { Self::Field(error) }
    }
}

/// What is to be reproduced.
#[derive(Clone, Debug, PartialEq)]
pub struct Order {
    pub parts: Vec<Part>,
    /// Seeds 1 to this.
    pub seeds: u32,
    pub effort: Effort,
    pub settings: Settings,
}

/// How much is computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effort {
    /// The sizes of the settings, on the block of NY-1's size.
    Full,
    /// One seed, a small block and small sizes: whether everything runs, nothing else.
    Quick,
}

/// Tables in the order of the parts, and their charts.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reproduction {
    pub tables: Vec<Table>,
    pub drawings: Vec<Drawing>,
    /// What differs from machine to machine.
    pub times: Vec<Table>,
}

/// Reproduces what is ordered. `scenes` are the real ones that were found; a table says which it lacks.
pub fn reproduce(order: &Order, scenes: Vec<(Site, Scene)>, watch: Watch) -> Result<Reproduction, ReproductionError> {
    let mut settings = order.settings.clone();
    settings.refine.rounds = REFINED_ROUNDS;
    let (mut seeds, mut block) = (order.seeds.clamp(1, MOST_SEEDS), ny1_size());
    if order.effort == Effort::Quick {
        [
            settings.surface.samples,
            settings.field.viewpoints,
            settings.search.iterations,
            settings.quality.samples,
            settings.baseline.tour_kicks,
        ] = QUICK;
        (settings.baseline.smith_rounds, settings.baseline.zhou_rounds, settings.refine.rounds) = (1, 1, QUICK_ROUNDS);
        (seeds, block) = (1, site::quick_block());
    }
    let scenes = std::iter::once((Site::Ny1, generate_block(&block))).chain(scenes).collect();
    let mut study = Study::new(settings, order.effort, seeds, scenes, watch);
    let mut found = Reproduction::default();
    for part in Part::ALL.into_iter().filter(|part| order.parts.contains(part)) {
        study.step(part.name())?;
        add(&mut found, part, &mut study)?;
    }
    Ok(found)
}

fn add(found: &mut Reproduction, part: Part, study: &mut Study) -> Result<(), ReproductionError> {
    match part {
        Part::Table1 => found.tables.push(table1::table(study)?),
        Part::Table2 => found.tables.extend(table2::tables(study)?),
        Part::Table3 => found.tables.push(table3::table(study)?),
        Part::Table4 => found.tables.push(table4::table(study)?),
        Part::Table5 => found.tables.push(table5::table(study)?),
        Part::Equal => found.tables.push(equal::table(study)?),
        Part::EqualRefined => found.tables.push(equal::refined_table(study)?),
        Part::Fig9 => add_figure(found, fig9::figure(study)?),
        Part::Fig10 => add_figure(found, fig10::figure(study)?),
        Part::Convergence => add_figure(found, convergence::figure(study)?),
        Part::Pareto => add_figure(found, pareto::figure(study)?),
        Part::Times => found.times.push(planning_time::table(study)?),
        Part::Refined => found.times.push(refined::table(study)?),
        Part::Sight => found.tables.push(sight::table(study)?),
        Part::Sweep => found.tables.push(sweep::table(study)?),
        Part::Growth => {
            let (table, drawing) = growth::figure(study)?;
            found.times.push(table);
            found.drawings.push(drawing);
        }
    }
    Ok(())
}

fn add_figure(found: &mut Reproduction, (table, drawing): (Table, Drawing)) {
    found.tables.push(table);
    found.drawings.push(drawing);
}
