//! COLMAP's text model (<https://colmap.github.io/format.html>) as a prior: cameras as pinholes, poses of the images in the plan's local frame, and no points.

use std::fmt::Write;

use nalgebra::{Rotation3, UnitQuaternion};

use super::pictures::{pictures, world_to_camera};
use crate::quality::Which;
use crate::trajectory::plan::Plan;

/// The three files of a model, by their names.
pub type Model = [(&'static str, Vec<u8>); 3];

/// The model; `None` for a rig that takes panoramas, which are no pinholes.
pub fn to_files(plan: &Plan, which: Which) -> Option<Model> {
    let mut cameras = "# overfly: PINHOLE WIDTH HEIGHT FX FY CX CY, pixels\n".to_owned();
    for (index, camera) in plan.cameras.iter().enumerate() {
        let lens = camera.intrinsics.as_ref()?;
        let [width, height] = lens.pixels;
        let focal = [0, 1].map(|side| lens.focal_mm / lens.sensor_mm[side] * f64::from(lens.pixels[side]));
        let [fx, fy] = focal;
        let [cx, cy] = lens.pixels.map(|pixels| f64::from(pixels) / 2.0);
        writeln!(cameras, "{} PINHOLE {width} {height} {fx} {fy} {cx} {cy}", index + 1).expect("memory takes everything");
    }
    let mut images =
        "# overfly: QW QX QY QZ TX TY TZ of the local frame (east, north, up, m) in the camera's, camera, name; a second line for no points\n"
            .to_owned();
    for (index, picture) in pictures(plan, which).iter().enumerate() {
        let rotation = Rotation3::from_matrix_unchecked(world_to_camera(picture.image)?);
        let q = UnitQuaternion::from_rotation_matrix(&rotation);
        let t = -(rotation * picture.image.position_m.coords);
        let camera = picture.image.camera + 1;
        writeln!(
            images,
            "{} {:.12} {:.12} {:.12} {:.12} {:.9} {:.9} {:.9} {camera} {}\n",
            index + 1,
            q.w,
            q.i,
            q.j,
            q.k,
            t.x,
            t.y,
            t.z,
            picture.name
        )
        .expect("memory takes everything");
    }
    let points = "# overfly: no points yet\n".to_owned();
    Some([("cameras.txt", cameras.into_bytes()), ("images.txt", images.into_bytes()), ("points3D.txt", points.into_bytes())])
}
