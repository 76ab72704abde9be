//! After Smith et al. 2018: views from a dense set of candidates, chosen by the sum over pairs that see a sample, then a tour.
//!
//! Candidates are all viewpoints of the field in all view directions, and towards the nearest sample. The value of a set of views is the sum
//! over the capturable samples of area times reconstructability up to a target. It is not submodular (a first view of a sample has no pair),
//! so gains are kept exactly: each candidate position knows its pair sums with the views chosen so far.

use rayon::prelude::*;

use super::pairs::{PairModel, Quality, UNIT};
use super::shots::{Sight, aimed, framed_indices, sights_at};
use super::tally::Tally;
use super::{BaselineError, Reporter, check_rig, flight, found, proximity};
use crate::camera::Pose;
use crate::search::{Problem, Progress};
use crate::settings::BaselineSettings;
use crate::stop::StopToken;
use crate::trajectory::route::Found;

const NAME: &str = "smith";

/// A position with the views that may be taken there; at most one of them is.
struct Site {
    sights: Vec<Sight>,
    /// Each with the places in `sights` of the samples that it frames.
    views: Vec<(Pose, Vec<u32>)>,
    /// Pair sums of each sight with the chosen views.
    links: Vec<Quality>,
}

/// Views and their value while they are chosen.
struct Choice<'a> {
    sites: Vec<Site>,
    tally: Tally<'a>,
    model: &'a PairModel,
    /// For each sample the sites in whose sights it is, with its place there.
    seeing: Vec<Vec<(u32, u32)>>,
    /// Sites nearer to a site than images may be to each other, and those to which a view may move.
    too_near: Vec<Vec<u32>>,
    neighbours: Vec<Vec<u32>>,
    /// The chosen view of each site, and how many views are too near to it.
    chosen: Vec<Option<u32>>,
    blocked: Vec<u32>,
}

/// Plans a flight. A stop ends the choice of views; those chosen so far are flown.
pub fn fly(
    problem: &Problem,
    settings: &BaselineSettings,
    seed: u64,
    stop: &StopToken,
    on_progress: &mut dyn FnMut(&Progress),
) -> Result<Found, BaselineError> {
    check_rig(problem, NAME)?;
    let mut report = Reporter::new(on_progress);
    report.tell(0);
    let model = PairModel::new(problem.disks.range_m());
    let target = (settings.smith_target * UNIT as f64).round() as Quality;
    let mut choice = Choice::new(problem, &model, target);
    let goal = share(choice.tally.most(), settings.smith_share_percent);
    choice.grow(problem, goal, stop, &mut report);
    for round in 0..settings.smith_rounds {
        if stop.is_stopped() {
            break;
        }
        let is_better = choice.improve(stop);
        let is_smaller = choice.prune(goal);
        report.tell_views(50 + 30 * (round + 1) / settings.smith_rounds, problem, choice.poses().iter());
        if !is_better && !is_smaller {
            break;
        }
    }
    let views = choice.poses();
    if views.is_empty() {
        return Err(BaselineError::NoView { method: NAME });
    }
    let route = flight::through(problem, &views, settings, seed, stop, &mut report);
    found(route, stop)
}

/// A share of a value, percent.
fn share(value: u64, percent: f64) -> u64 {
    (value as f64 * percent / 100.0) as u64
}

impl<'a> Choice<'a> {
    fn new(problem: &'a Problem, model: &'a PairModel, target: Quality) -> Self {
        let sites: Vec<Site> = (0..problem.field.viewpoints.len()).into_par_iter().map(|j| site(problem, j)).collect();
        let mut seeing = vec![Vec::new(); problem.field.samples.len()];
        for (index, site) in sites.iter().enumerate() {
            for (place, sight) in site.sights.iter().enumerate() {
                seeing[sight.sample as usize].push((index as u32, place as u32));
            }
        }
        let positions: Vec<_> = problem.field.viewpoints.iter().map(|row| row.position_m.into()).collect();
        let spacing_m = problem.spacing.least_leg_m;
        let near_m = 2.0 * problem.field.facts.lattice_spacing_m;
        Self {
            tally: Tally::new(model, &problem.areas_mm2, reachable(model, &sites, &seeing, target)),
            model,
            seeing,
            too_near: proximity::within(&positions, spacing_m),
            neighbours: proximity::within(&positions, near_m),
            chosen: vec![None; sites.len()],
            blocked: vec![0; sites.len()],
            sites,
        }
    }

    /// Adds the view of the largest gain until the value reaches `goal`, or no view gains anything.
    fn grow(&mut self, problem: &Problem, goal: u64, stop: &StopToken, report: &mut Reporter) {
        let everywhere: Vec<u32> = (0..self.sites.len() as u32).collect();
        let mut best: Vec<(u64, u32)> = everywhere.par_iter().map(|&site| self.best_of_site(site)).collect();
        let mut taken = 0u32;
        // A first view has no pair and no value yet: even a stopped choice has one.
        while self.tally.value() < goal && (taken == 0 || !stop.is_stopped()) {
            let open = (0..best.len()).filter(|&site| self.is_open(site as u32));
            let Some(site) = open.max_by_key(|&site| (best[site].0, std::cmp::Reverse(site))) else { break };
            let (gain, view) = best[site];
            if gain == 0 {
                break;
            }
            self.take(site as u32, view);
            let touched = self.sites_seeing(&self.sights_of(site as u32, view));
            let fresh: Vec<(u64, u32)> = touched.par_iter().map(|&site| self.best_of_site(site)).collect();
            touched.into_iter().zip(fresh).for_each(|(site, fresh)| best[site as usize] = fresh);
            taken += 1;
            if taken.is_multiple_of(32) {
                let done = 50.0 * self.tally.value() as f64 / goal.max(1) as f64;
                report.tell_views(done as u32, problem, self.poses().iter());
            }
        }
    }

    /// Moves each view to the neighbouring candidate of the largest gain; says whether any moved.
    fn improve(&mut self, stop: &StopToken) -> bool {
        let before = self.tally.value();
        let mut moved = false;
        for site in 0..self.sites.len() as u32 {
            let Some(view) = self.chosen[site as usize].filter(|_| !stop.is_stopped()) else { continue };
            self.drop(site);
            let stay = self.gain(site, view);
            let around = self.neighbours[site as usize].iter().copied().chain([site]).filter(|&site| self.is_open(site));
            let candidates =
                around.flat_map(|site| (0..self.sites[site as usize].views.len() as u32).map(move |view| (site, view)));
            let best = candidates
                .map(|(site, view)| (self.gain(site, view), site, view))
                .fold((stay, site, view), |best, other| if other.0 > best.0 { other } else { best });
            moved |= (best.1, best.2) != (site, view);
            self.take(best.1, best.2);
        }
        moved && self.tally.value() > before
    }

    /// Leaves out views that matter least as long as the value stays at `goal`; says whether there were any.
    fn prune(&mut self, goal: u64) -> bool {
        let mut pruned = false;
        loop {
            let loss =
                |site: u32| self.chosen[site as usize].map(|view| (self.tally.loss(site, &self.sights_of(site, view)), site));
            let least = (0..self.sites.len() as u32).into_par_iter().filter_map(loss).min();
            match least {
                Some((loss, site)) if loss == 0 || self.tally.value().saturating_sub(loss) >= goal => self.drop(site),
                _ => return pruned,
            }
            pruned = true;
        }
    }

    fn poses(&self) -> Vec<Pose> {
        let pose = |(site, view): (usize, &Option<u32>)| view.map(|view| self.sites[site].views[view as usize].0);
        self.chosen.iter().enumerate().filter_map(pose).collect()
    }

    /// Whether a view may be taken there.
    fn is_open(&self, site: u32) -> bool {
        self.chosen[site as usize].is_none() && self.blocked[site as usize] == 0
    }

    fn sights_of(&self, site: u32, view: u32) -> Vec<Sight> {
        let site = &self.sites[site as usize];
        site.views[view as usize].1.iter().map(|&place| site.sights[place as usize]).collect()
    }

    /// Sites that see a sample of these.
    fn sites_seeing(&self, sights: &[Sight]) -> Vec<u32> {
        let mut is_touched = vec![false; self.sites.len()];
        for sight in sights {
            self.seeing[sight.sample as usize].iter().for_each(|&(site, _)| is_touched[site as usize] = true);
        }
        (0..self.sites.len() as u32).filter(|&site| is_touched[site as usize]).collect()
    }

    /// Gain of a view: what its pairs add, and for samples that no view sees yet the promise of pairs to come.
    fn gain(&self, site: u32, view: u32) -> u64 {
        let site = &self.sites[site as usize];
        let gain = |&place: &u32| {
            let sight = &site.sights[place as usize];
            let is_unseen = self.tally.is_unseen(sight.sample);
            let links = if is_unseen { self.model.promise(&sight.ray) } else { site.links[place as usize] };
            self.tally.worth(sight.sample, links)
        };
        site.views[view as usize].1.iter().map(gain).sum()
    }

    fn best_of_site(&self, site: u32) -> (u64, u32) {
        let views = 0..self.sites[site as usize].views.len() as u32;
        views.map(|view| (self.gain(site, view), view)).fold((0, 0), |best, other| if other.0 > best.0 { other } else { best })
    }

    fn take(&mut self, site: u32, view: u32) {
        let sights = self.sights_of(site, view);
        self.tally.add(site, &sights);
        self.link(site, &sights, |links, quality| *links += quality);
        self.chosen[site as usize] = Some(view);
        self.too_near[site as usize].iter().for_each(|&other| self.blocked[other as usize] += 1);
    }

    fn drop(&mut self, site: u32) {
        let Some(view) = self.chosen[site as usize].take() else { return };
        let sights = self.sights_of(site, view);
        self.tally.remove(site, &sights);
        self.link(site, &sights, |links, quality| *links -= quality);
        self.too_near[site as usize].iter().for_each(|&other| self.blocked[other as usize] -= 1);
    }

    /// Changes the pair sums of all other sites that see the samples of a view.
    fn link(&mut self, site: u32, sights: &[Sight], change: impl Fn(&mut Quality, Quality)) {
        for sight in sights {
            for &(other, place) in self.seeing[sight.sample as usize].iter().filter(|(other, _)| *other != site) {
                let other = &mut self.sites[other as usize];
                let quality = self.model.quality(&other.sights[place as usize].ray, &sight.ray);
                change(&mut other.links[place as usize], quality);
            }
        }
    }
}

/// The candidates at a viewpoint of the field: all view directions, and towards the nearest sample.
fn site(problem: &Problem, viewpoint: usize) -> Site {
    let position = problem.field.viewpoints[viewpoint].position_m.into();
    let sights = sights_at(problem, &position);
    let nearest = sights.iter().min_by(|a, b| a.ray.distance_m.total_cmp(&b.ray.distance_m));
    let towards = nearest.and_then(|sight| aimed(&problem.rig, &position, &problem.frames[sight.sample as usize].position));
    let directions =
        if problem.rig.has_gimbal() { problem.view_directions.iter().copied().map(Some).collect() } else { vec![None] };
    let poses = directions.into_iter().chain(towards.map(Some)).map(|direction| Pose { position, direction });
    let poses: Vec<Pose> = poses.collect();
    let framed = |sights: &[Sight]| poses.iter().map(|pose| framed_indices(problem, pose, sights)).collect::<Vec<_>>();
    // What no candidate frames is not within reach.
    let mut is_framed = vec![false; sights.len()];
    framed(&sights).iter().flatten().for_each(|&place| is_framed[place as usize] = true);
    let sights: Vec<Sight> =
        sights.into_iter().zip(is_framed).filter(|(_, is_framed)| *is_framed).map(|(sight, _)| sight).collect();
    let framed = framed(&sights);
    let views = poses.into_iter().zip(framed).filter(|(_, framed)| !framed.is_empty()).collect();
    Site { links: vec![0; sights.len()], sights, views }
}

/// The reconstructability of each sample that all sites together reach, up to the target.
fn reachable(model: &PairModel, sites: &[Site], seeing: &[Vec<(u32, u32)>], target: Quality) -> Vec<Quality> {
    let sum = |seeing: &Vec<(u32, u32)>| {
        let rays: Vec<_> = seeing.iter().map(|&(site, place)| sites[site as usize].sights[place as usize].ray).collect();
        let mut sum = 0;
        for (index, ray) in rays.iter().enumerate() {
            sum += rays[..index].iter().map(|other| model.quality(ray, other)).sum::<Quality>();
            if sum >= target {
                return target;
            }
        }
        sum
    };
    seeing.par_iter().map(sum).collect()
}
