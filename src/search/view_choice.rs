//! The view direction at the end of a leg (section 5.4): "the view vector that maximizes the information gain of the waypoint over its
//! parent, i.e., Eq. (3)".

use nalgebra::Point3;

use super::cover::Cover;
use super::leg::image_poses;
use super::problem::Problem;
use crate::camera::Pose;
use crate::coverage::{Information, Mask};

/// Memory of the choice, kept between uses so that nothing is allocated on the hot path.
#[derive(Debug)]
pub struct ViewChoice {
    /// What the images of the leg could add in the best of directions, image by image.
    sights: Vec<Sight>,
    /// Where the sights of each image end.
    ends: Vec<usize>,
    /// New cells by sample, all zero between uses, and the samples where they are not.
    fresh: Vec<Mask>,
    touched: Vec<u32>,
}

/// A sample that an image would see if it framed it.
#[derive(Clone, Copy, Debug)]
struct Sight {
    target: Point3<f64>,
    /// Cells that the path does not cover yet.
    cells: Mask,
    area_mm2: u64,
    sample: u32,
}

impl ViewChoice {
    pub fn new(samples: usize) -> Self {
        Self { sights: Vec::new(), ends: Vec::new(), fresh: vec![0; samples], touched: Vec::new() }
    }

    /// Of the discretised directions, and the one that the view has already, that of the largest gain over the leg; the earlier one of
    /// two equals. Only directions for which `fits` holds come into question. `None` when there is none, or when the gain is not worth it.
    pub fn choose(
        &mut self,
        problem: &Problem,
        from: &Pose,
        covered: &Cover,
        to: &Point3<f64>,
        fits: &dyn Fn(&Pose) -> bool,
        is_worth: &dyn Fn(Information) -> bool,
    ) -> Option<(Pose, Information)> {
        self.look(problem, from, covered, to);
        // No direction gains more than a rig that sees in all directions.
        if !is_worth(self.gain_of_all()) {
            return None;
        }
        let unturned = from.direction.filter(|direction| !problem.view_directions.contains(direction));
        let candidates = problem.view_directions.iter().copied().chain(unturned);
        let mut best: Option<(Pose, Information)> = None;
        for end in candidates.map(|direction| Pose { position: *to, direction: Some(direction) }).filter(|end| fits(end)) {
            let gained = self.gain(problem, from, &end);
            if best.is_none_or(|(_, most)| gained > most) {
                best = Some((end, gained));
            }
        }
        best.filter(|&(_, gained)| is_worth(gained))
    }

    fn look(&mut self, problem: &Problem, from: &Pose, covered: &Cover, to: &Point3<f64>) {
        self.sights.clear();
        self.ends.clear();
        let places = problem.places();
        let end = Pose { position: *to, direction: from.direction };
        for pose in image_poses(&problem.rig, from, &end, problem.spacing) {
            for (i, mask) in problem.sighted(&pose.position) {
                let cells = mask & !covered.cells(places, i);
                if cells != 0 {
                    let (target, area_mm2) = (problem.frames[i].position, problem.areas_mm2[i]);
                    self.sights.push(Sight { target, cells, area_mm2, sample: i as u32 });
                }
            }
            self.ends.push(self.sights.len());
        }
    }

    fn gain_of_all(&mut self) -> Information {
        let gained = add_all(&self.sights, &mut self.fresh, &mut self.touched);
        self.forget();
        gained
    }

    fn gain(&mut self, problem: &Problem, from: &Pose, end: &Pose) -> Information {
        let mut gained = 0;
        let mut start = 0;
        for (pose, &stop) in image_poses(&problem.rig, from, end, problem.spacing).zip(&self.ends) {
            let frusta = problem.rig.frusta(&pose).expect("a camera on a gimbal has a frustum");
            let framed = self.sights[start..stop].iter().filter(|sight| frusta[0].frames(&sight.target));
            gained += add_all(framed, &mut self.fresh, &mut self.touched);
            start = stop;
        }
        self.forget();
        gained
    }

    fn forget(&mut self) {
        self.touched.drain(..).for_each(|i| self.fresh[i as usize] = 0);
    }
}

/// Area-weighted cells that the sights add to `fresh`.
fn add_all<'s>(sights: impl IntoIterator<Item = &'s Sight>, fresh: &mut [Mask], touched: &mut Vec<u32>) -> Information {
    let mut gained = 0;
    for sight in sights {
        let held = &mut fresh[sight.sample as usize];
        if *held == 0 {
            touched.push(sight.sample);
        }
        gained += u64::from((sight.cells & !*held).count_ones()) * sight.area_mm2;
        *held |= sight.cells;
    }
    gained
}
