//! Surface samples (paper, section 4.1): points with normals and areas, structure by structure.
//!
//! The samples of a structure depend on that structure, the spacing and the seed alone, so that an edit elsewhere never moves
//! them. Only [`Sample::exposed`] looks at the neighbours.

use std::collections::HashMap;
use std::ops::Range;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use crate::scene::differences::Differences;
use crate::scene::solid::area_m2;
use crate::scene::{Bounds, Scene, Shape, Structure, StructureId, Triangle};
use crate::stop::{Part, StopToken};

/// A point on a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    pub position: Point3<f64>,
    /// Unit normal, outwards.
    pub normal: Vector3<f64>,
    /// Surface that the sample stands for, mm^2.
    pub area_mm2: u64,
    /// Index of the structure in the scene.
    pub structure: u32,
    /// Whether the sample lies on the outside of the scene, neither in a neighbour nor in the ground.
    pub exposed: bool,
}

/// How the surface is sampled. Pinned when a scene is loaded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sampling {
    /// One sample stands for the square of this, m.
    pub spacing_m: f64,
    pub seed: u64,
    /// How far in front of a sample its surroundings are tested, m.
    pub offset_m: f64,
}

/// The spacing at which about `target` samples are exposed, m: 0 when nothing of the scene is; `None` when stopped.
pub fn choose_spacing_m(scene: &Scene, target: u32, seed: u64, offset_m: f64, stop: &StopToken) -> Option<f64> {
    let area = scene_area_m2(scene);
    let target = f64::from(target.max(1));
    // A first pass over the whole surface tells which share of it is exposed; the number of samples goes with 1 / spacing^2.
    let trial = Sampling { spacing_m: (area / target).sqrt(), seed, offset_m };
    if !(trial.spacing_m > 0.0 && trial.spacing_m.is_finite()) {
        return Some(0.0);
    }
    let exposed = Sampler::new(trial).sample(scene, stop)?.iter().filter(|sample| sample.exposed).count();
    Some(trial.spacing_m * (exposed as f64 / target).sqrt())
}

/// The samples of structures that were sampled before. They depend on their structure alone, so that an edit elsewhere leaves them
/// valid; only exposure is found anew.
#[derive(Debug)]
pub struct Sampler {
    sampling: Sampling,
    made: Mutex<HashMap<StructureId, Made>>,
}

type Made = (Arc<Structure>, Arc<Vec<Sample>>);

/// The samples of a structure in an earlier scene.
struct Kept<'k> {
    samples: &'k [Sample],
    /// Nothing near has come or gone, so that the same ones are exposed.
    is_exposure_known: bool,
}

impl Sampler {
    pub fn new(sampling: Sampling) -> Self {
        Self { sampling, made: Mutex::default() }
    }

    /// About how many samples a surface of such an area will have.
    pub fn estimate(&self, surface_m2: f64) -> f64 {
        surface_m2 / (self.sampling.spacing_m * self.sampling.spacing_m)
    }

    pub fn sampling(&self) -> &Sampling {
        &self.sampling
    }

    /// All samples of the scene, in the order of its structures; `None` when stopped.
    pub fn sample(&self, scene: &Scene, stop: &StopToken) -> Option<Vec<Sample>> {
        let bounds: Vec<Bounds> = scene.structures.iter().map(|structure| structure.bounds()).collect();
        stop.begin(Part::Survey, scene.structures.len() as u64);
        self.sampled(scene, &bounds, |_| None, stop)
    }

    /// The same of a scene that differs from an earlier one, whose samples are `before`, structure by structure: only those of new structures
    /// are made, and only where structures came or went is it looked at anew which are exposed. `bounds` are those of the structures.
    pub fn sample_after(
        &self,
        scene: &Scene,
        differences: &Differences,
        before: &Samples,
        bounds: &[Bounds],
        stop: &StopToken,
    ) -> Option<Vec<Sample>> {
        let is_near = |index: usize| move |changed: &Bounds| are_near(&bounds[index], changed, self.sampling.offset_m);
        let known = |index: usize| {
            let samples = before.of_structure(differences.kept[index]?);
            Some(Kept { samples, is_exposure_known: !differences.boxes().any(is_near(index)) })
        };
        self.sampled(scene, bounds, known, stop)
    }

    /// The samples of a scene, of some of whose structures they are known.
    fn sampled<'k>(
        &self,
        scene: &Scene,
        bounds: &[Bounds],
        known: impl Fn(usize) -> Option<Kept<'k>>,
        stop: &StopToken,
    ) -> Option<Vec<Sample>> {
        let reach_m = self.sampling.offset_m;
        let known: Vec<Option<Kept>> = (0..scene.structures.len()).map(known).collect();
        let is_settled = |index: usize| known[index].as_ref().is_some_and(|known| known.is_exposure_known);
        let looked_at = |index: usize| {
            if stop.is_stopped() {
                return None;
            }
            let anew = || self.of_structure(&scene.structures[index]).to_vec();
            let mut samples = known[index].as_ref().map_or_else(anew, |known| known.samples.to_vec());
            let neighbours = neighbours(scene, bounds, index, reach_m);
            samples.iter_mut().for_each(|sample| sample.exposed = is_exposed(sample, &neighbours, reach_m));
            stop.advance(1);
            Some(samples)
        };
        let open: Vec<usize> = (0..known.len()).filter(|&index| !is_settled(index)).collect();
        let fresh = open.into_par_iter().map(looked_at).collect::<Option<Vec<_>>>()?;
        let settled = known.iter().flatten().filter(|known| known.is_exposure_known).map(|known| known.samples.len());
        let mut samples = Vec::with_capacity(settled.chain(fresh.iter().map(Vec::len)).sum());
        let mut fresh = fresh.into_iter();
        for (index, known) in known.iter().enumerate() {
            let first = samples.len();
            match known {
                Some(known) if known.is_exposure_known => samples.extend_from_slice(known.samples),
                _ => samples.extend(fresh.next().into_iter().flatten()),
            }
            samples[first..].iter_mut().for_each(|sample: &mut Sample| sample.structure = index as u32);
        }
        self.lock().retain(|id, _| scene.structure(*id).is_some());
        Some(samples)
    }

    fn of_structure(&self, structure: &Arc<Structure>) -> Arc<Vec<Sample>> {
        if let Some((known, samples)) = self.lock().get(&structure.id)
            && Arc::ptr_eq(known, structure)
        {
            return Arc::clone(samples);
        }
        let samples = Arc::new(sample_structure(structure, &self.sampling));
        self.lock().insert(structure.id, (Arc::clone(structure), Arc::clone(&samples)));
        samples
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<StructureId, Made>> {
        // The map is whole at every moment that a thread could have panicked in.
        self.made.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The samples of one structure, all marked exposed; obstacles and terrain have none.
///
/// The surface is cut into small triangles, these are put into an order in which neighbours follow one another (by facing, then
/// along a space-filling curve), and every A/n of the summed area one of them is taken: an even spread without random clumps.
pub fn sample_structure(structure: &Structure, sampling: &Sampling) -> Vec<Sample> {
    if !structure.is_captured() {
        return Vec::new();
    }
    let pieces = ordered_pieces(structure, sampling.spacing_m);
    let area: f64 = pieces.iter().map(area_m2).sum();
    if area <= 0.0 {
        return Vec::new();
    }
    let count = (area / (sampling.spacing_m * sampling.spacing_m)).round().max(1.0);
    let step = area / count;
    let area_mm2 = (step * 1e6).round().max(1.0) as u64;
    let mut next = step * unit_hash(sampling.seed ^ structure.id.0);
    let mut passed = 0.0;
    let mut samples = Vec::with_capacity(count as usize);
    for piece in &pieces {
        passed += area_m2(piece);
        while next < passed {
            next += step;
            let position = centroid(piece);
            let normal = normal(piece);
            samples.extend(outward_normals(structure, &position, normal, sampling.offset_m).map(|normal| Sample {
                position,
                normal,
                area_mm2,
                structure: 0,
                exposed: true,
            }));
        }
    }
    samples
}

/// The outward sides at a point of the surface: one for a solid, both for a sheet, none inside of a solid.
fn outward_normals(
    structure: &Structure,
    position: &Point3<f64>,
    normal: Vector3<f64>,
    offset_m: f64,
) -> impl Iterator<Item = Vector3<f64>> + use<> {
    let (front, back) = match structure.shape {
        Shape::Prism { .. } | Shape::Obstacle { .. } | Shape::Terrain(_) => (true, false),
        Shape::Mesh { .. } => {
            (!structure.contains(&(position + normal * offset_m)), !structure.contains(&(position - normal * offset_m)))
        }
    };
    front.then_some(normal).into_iter().chain(back.then_some(-normal))
}

fn is_exposed(sample: &Sample, neighbours: &[(Bounds, &Structure)], offset_m: f64) -> bool {
    let in_front = sample.position + sample.normal * offset_m;
    let buried = |(bounds, neighbour): &(Bounds, &Structure)| bounds.contains(&in_front) && neighbour.contains(&in_front);
    in_front.z > 0.0 && !neighbours.iter().any(buried)
}

/// All samples of a scene, with the first one of each structure.
#[derive(Clone, Debug)]
pub struct Samples {
    pub samples: Vec<Sample>,
    /// One more than there are structures: the last one is where all end.
    firsts: Vec<usize>,
}

impl Samples {
    /// `samples` in the order of the structures, of which there are so many.
    pub fn new(samples: Vec<Sample>, structures: usize) -> Self {
        let mut counts = vec![0; structures + 1];
        samples.iter().for_each(|sample| counts[sample.structure as usize + 1] += 1);
        let firsts = counts
            .iter()
            .scan(0, |first, count| {
                *first += count;
                Some(*first)
            })
            .collect();
        Self { samples, firsts }
    }

    pub fn range(&self, structure: usize) -> Range<usize> {
        self.firsts[structure]..self.firsts[structure + 1]
    }

    pub fn of_structure(&self, structure: usize) -> &[Sample] {
        &self.samples[self.range(structure)]
    }
}

/// Whether two boxes come as near to each other as samples are tested in front of the surface.
fn are_near(own: &Bounds, other: &Bounds, reach_m: f64) -> bool {
    (0..3).all(|i| other.min[i] - reach_m <= own.max[i] && own.min[i] - reach_m <= other.max[i])
}

/// The structures whose boxes come near that of structure `index`, with their boxes.
fn neighbours<'a>(scene: &'a Scene, bounds: &[Bounds], index: usize, reach_m: f64) -> Vec<(Bounds, &'a Structure)> {
    let near = |other: &Bounds| are_near(&bounds[index], other, reach_m);
    let others = bounds.iter().zip(&scene.structures).enumerate();
    others
        .filter(|(i, (other, _))| *i != index && near(other))
        .map(|(_, (other, structure))| (*other, structure.as_ref()))
        .collect()
}

/// Small triangles of the surface in sampling order.
fn ordered_pieces(structure: &Structure, spacing_m: f64) -> Vec<Triangle> {
    let mut pieces = Vec::new();
    for triangle in structure.triangles() {
        cut(triangle, spacing_m, &mut pieces);
    }
    let low = structure.bounds().min;
    let key = |piece: &Triangle| (facing(&normal(piece)), morton((centroid(piece) - low) / (spacing_m * 0.5)));
    pieces.sort_by_cached_key(key);
    pieces
}

/// Halves the longest edge until a piece is well below the area of one sample.
fn cut(triangle: Triangle, spacing_m: f64, pieces: &mut Vec<Triangle>) {
    let area = area_m2(&triangle);
    if area <= 0.0 || !area.is_finite() {
        return;
    }
    let [a, b, c] = triangle;
    let edges = [(b - a).norm_squared(), (c - b).norm_squared(), (a - c).norm_squared()];
    let longest = edges[0].max(edges[1]).max(edges[2]);
    if area * 4.0 <= spacing_m * spacing_m && (longest <= spacing_m * spacing_m || area * 400.0 <= spacing_m * spacing_m) {
        pieces.push(triangle);
        return;
    }
    let [a, b, c] = if longest == edges[0] {
        [a, b, c]
    } else if longest == edges[1] {
        [b, c, a]
    } else {
        [c, a, b]
    };
    let middle = nalgebra::center(&a, &b);
    cut([a, middle, c], spacing_m, pieces);
    cut([middle, b, c], spacing_m, pieces);
}

fn scene_area_m2(scene: &Scene) -> f64 {
    let captured = scene.structures.iter().filter(|structure| structure.is_captured());
    captured.flat_map(|structure| structure.triangles()).map(|triangle| area_m2(&triangle)).sum()
}

fn normal([a, b, c]: &Triangle) -> Vector3<f64> {
    (b - a).cross(&(c - a)).normalize()
}

fn centroid([a, b, c]: &Triangle) -> Point3<f64> {
    Point3::from((a.coords + b.coords + c.coords) / 3.0)
}

/// The axis, with its sign, that a normal is nearest to: 0 to 5.
fn facing(normal: &Vector3<f64>) -> u8 {
    let axis = normal.iamax();
    2 * axis as u8 + u8::from(normal[axis] < 0.0)
}

/// Position along a Morton curve over cells of unit size, 21 bits an axis.
fn morton(cell: Vector3<f64>) -> u64 {
    let spread = |v: f64| {
        let bits = v.clamp(0.0, 2_097_151.0) as u64;
        (0..21).fold(0u64, |spread, i| spread | (bits >> i & 1) << (3 * i))
    };
    spread(cell.x) | spread(cell.y) << 1 | spread(cell.z) << 2
}

/// A number in 0..1 from a key (the finaliser of SplitMix64).
pub(crate) fn unit_hash(key: u64) -> f64 {
    let mut z = key.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^= z >> 31;
    (z >> 11) as f64 / (1u64 << 53) as f64
}
