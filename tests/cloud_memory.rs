//! Point clouds are read from where they lie: a large one takes no more memory than a small one.

mod program;
mod scene_files;

use std::process::Stdio;
use std::time::Duration;

use program::Place;
use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};
use scene_files::las;

/// Points of the large cloud, of 28 bytes each, and of the small one.
const MANY: usize = 2_500_000;
const FEW: usize = 50_000;
/// What a large cloud may take more than a small one: buffers, and what the system does as it likes.
const MOST_MORE_KB: u64 = 12_000;

/// Flat ground with a house, and everything that can be random at random, so that packing saves little.
fn cloud(count: usize, is_packed: bool) -> Vec<u8> {
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let point = |_| {
        let mut point = [0u8; 28];
        random.fill_bytes(&mut point[12..25]);
        let mut digit = |most: u64| (random.next_u64() % most) as i32;
        let (x, y) = (digit(60_000), digit(60_000));
        let is_house = (10_000..30_000).contains(&x) && (20_000..40_000).contains(&y);
        let z = if is_house { 13_000 } else { 5_000 };
        for (axis, value) in [x, y, z].into_iter().enumerate() {
            point[4 * axis..4 * axis + 4].copy_from_slice(&value.to_le_bytes());
        }
        (point[14], point[15]) = (0x11, if is_house { 6 } else { 2 });
        point
    };
    las::las(&(0..count).map(point).collect::<Vec<_>>(), is_packed)
}

/// The most memory that `overfly inspect` has had, kB, as long as it could be looked at.
fn peak_kb(place: &Place, name: &str) -> u64 {
    let mut child = place.command(&["inspect", name]).stdout(Stdio::null()).spawn().unwrap();
    let mut peak_kb = 0;
    loop {
        let status = std::fs::read_to_string(format!("/proc/{}/status", child.id())).unwrap_or_default();
        let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        peak_kb = line.and_then(|line| line.trim().trim_end_matches(" kB").parse().ok()).unwrap_or(0).max(peak_kb);
        if let Some(status) = child.try_wait().unwrap() {
            assert!(status.success(), "{name}");
            return peak_kb;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn a_large_cloud_takes_no_more_memory_than_a_small_one() {
    let place = Place::new();
    for (ending, is_packed) in [("las", false), ("laz", true)] {
        let [few, many] = [("few", FEW), ("many", MANY)].map(|(name, count)| {
            let name = format!("{name}.{ending}");
            std::fs::write(place.path(&name), cloud(count, is_packed)).unwrap();
            name
        });
        let bytes = std::fs::metadata(place.path(&many)).unwrap().len();
        assert!(bytes > 2 * 1000 * MOST_MORE_KB, "{bytes} bytes would prove nothing");
        let (of_few, of_many) = (peak_kb(&place, &few), peak_kb(&place, &many));
        assert!(of_few > 1000 && of_many < of_few + MOST_MORE_KB, "{many}, {bytes} bytes: {of_many} kB, {few}: {of_few} kB");
    }
}
