//! Where a flight starts, and where its camera looks there.

use nalgebra::{Point3, Unit, Vector3};
use rayon::prelude::*;

use super::{PlanError, PlanOptions};
use crate::camera::{Pose, Targets};
use crate::coverage::Information;
use crate::search::Problem;
use crate::stop::StopToken;

/// The given start if it is safe, else the viewpoint; the given view, else the direction: whatever alone captures the most information,
/// so that the tree begins where there is something to see.
pub fn start_pose(problem: &Problem, options: &PlanOptions, stop: &StopToken) -> Result<Pose, PlanError> {
    if let Some(position) = options.start_m
        && let Some(cause) = problem.free.obstruction_at(&position)
    {
        let position = format!("{}, {}, {}", position.x, position.y, position.z);
        return Err(PlanError::Start { position, cause });
    }
    let positions = match options.start_m {
        Some(position) => vec![position],
        None => problem.field.viewpoints.iter().map(|row| row.position_m.into()).collect(),
    };
    let directions = options.start_view.map_or_else(|| problem.rig.pose_directions(), |view| vec![Some(view)]);
    let alone = |(index, position): (usize, &Point3<f64>)| {
        let gains = (!stop.is_abandoned()).then(|| gains_alone(problem, *position, &directions))?;
        // Of equal gains the first one.
        let (direction, gain) = gains.into_iter().enumerate().rev().max_by_key(|&(_, gain)| gain)?;
        Some((gain, std::cmp::Reverse(index), direction))
    };
    let best = positions.par_iter().enumerate().map(alone).collect::<Option<Vec<_>>>().ok_or(PlanError::Abandoned)?;
    let (_, index, direction) = best.into_iter().max().expect("there is a position");
    Ok(Pose { position: positions[index.0], direction: directions[direction] })
}

/// The direction in which a camera on a gimbal gains most by itself at a position; of equal ones the first.
pub fn best_direction(problem: &Problem, position: &Point3<f64>) -> Unit<Vector3<f64>> {
    let directions = problem.rig.pose_directions();
    let gains = gains_alone(problem, *position, &directions);
    let best = gains.into_iter().enumerate().rev().max_by_key(|&(_, gain)| gain);
    best.and_then(|(index, _)| directions[index]).unwrap_or(-Vector3::z_axis())
}

/// What a view in each direction gains by itself at a position.
fn gains_alone(problem: &Problem, position: Point3<f64>, directions: &[Option<Unit<Vector3<f64>>>]) -> Vec<Information> {
    let (mut targets, mut worths) = (Targets::default(), Vec::new());
    for (i, mask) in problem.sighted(&position) {
        targets.push(&problem.frames[i].position);
        worths.push(u64::from(mask.count_ones()) * problem.areas_mm2[i]);
    }
    let gain = |&direction: &Option<Unit<Vector3<f64>>>| {
        let frusta = problem.rig.frusta(&Pose { position, direction });
        let mut marks = vec![frusta.is_none(); worths.len()];
        frusta.iter().flatten().for_each(|view| view.mark_framed(&targets, &mut marks));
        worths.iter().zip(marks).filter(|(_, is_framed)| *is_framed).map(|(worth, _)| worth).sum()
    };
    directions.iter().map(gain).collect()
}
