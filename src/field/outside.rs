//! The viewpoints that a drone can get to.

use std::sync::Arc;

use super::strips::{Strip, Viewpoints};
use super::viewpoints::{Cell, Lattice};
use crate::scene::free_space::FreeSpace;

/// A site: its strip, and its place in that.
type Place = (usize, usize);

/// Only the viewpoints that can be reached from the open sky: a hall is free space too, but no drone gets in.
///
/// A viewpoint with nothing above it is outside. Another one is, when a chain of safe legs between neighbouring cells leads to
/// one that is; these are few, under bridges and overhangs.
pub fn outside(free: &FreeSpace, lattice: &Lattice, strips: &[Arc<Strip>]) -> Viewpoints {
    // Strips of open sites alone have no flags.
    let flags = |strip: &Arc<Strip>| (!strip.is_open()).then(|| strip.sites().iter().map(|site| site.is_open).collect());
    let mut is_outside: Vec<Option<Vec<bool>>> = strips.iter().map(flags).collect();
    let is_out = |flags: &[Option<Vec<bool>>], (strip, site): Place| flags[strip].as_ref().is_none_or(|flags| flags[site]);
    let site_of = |(strip, site): Place| &strips[strip].sites()[site];
    let neighbours = |place: Place| {
        let [x, y, z] = site_of(place).cell;
        let offsets = (0..27).map(|k| [k / 9 - 1, k / 3 % 3 - 1, k % 3 - 1]);
        let find = |cell: Cell| {
            let strip = Strip::find(strips, cell[0])?;
            Some((strip, strips[strip].sites().binary_search_by_key(&cell, |site| site.cell).ok()?))
        };
        offsets.filter_map(|[i, j, k]| find([x + i, y + j, z + k])).collect::<Vec<Place>>()
    };
    let joins = |a, b| free.is_leg_safe(&site_of(a).viewpoint.position, &site_of(b).viewpoint.position);
    let hidden = |(strip, flags): (usize, &Option<Vec<bool>>)| {
        let sites = flags.iter().flatten().enumerate().filter(|(_, is_out)| !**is_out);
        sites.map(|(site, _)| (strip, site)).collect::<Vec<_>>()
    };
    let covered: Vec<Place> = is_outside.iter().enumerate().flat_map(hidden).collect();
    let leads_out = |&u: &Place| neighbours(u).iter().any(|&v| is_out(&is_outside, v) && joins(u, v));
    let mut queue: Vec<Place> = covered.into_iter().filter(leads_out).collect();
    while let Some(u) = queue.pop() {
        let Some(flags) = &mut is_outside[u.0] else { continue };
        if std::mem::replace(&mut flags[u.1], true) {
            continue;
        }
        queue.extend(neighbours(u).into_iter().filter(|&v| !is_out(&is_outside, v) && joins(u, v)));
    }
    let reached = |(strip, flags): (&Arc<Strip>, &Option<Vec<bool>>)| match flags {
        Some(flags) if flags.contains(&false) => {
            let sites = strip.sites().iter().zip(flags).filter(|(_, is_out)| **is_out);
            Strip::new(sites.map(|(site, _)| *site).collect(), lattice.tile_grid())
        }
        _ => Some(Arc::clone(strip)),
    };
    Viewpoints::new(strips.iter().zip(&is_outside).filter_map(reached).collect())
}
