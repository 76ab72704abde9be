//! A new version of a scene's file turned into changes of the scene.

use std::sync::Arc;

use geo::{LineString, MultiPolygon, Polygon};

use super::proxy::{NoFlyZone, Scene, Shape, Structure, ZoneSource};

/// Corners that differ by less were written with other digits, m.
const SAME_M: f64 = 1e-3;

/// What a new version changes, by names in the order of the scenes.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Changes {
    pub structures: Changed,
    pub zones: Changed,
}

/// Names of what is new, gone, or another than before under the same name.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Changed {
    pub added: Vec<String>,
    pub removed: Vec<String>,
    pub changed: Vec<String>,
}

/// Why a scene cannot become what the file says. It is unchanged.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum UpdateError {
    #[error(
        "the file has a structure {name:?}, and scene {scene:?} has an obstacle of that name, which no file takes away: remove it first with `overfly \
         edit {scene} remove {name:?}`"
    )]
    Obstacle { scene: String, name: String },
    #[error(
        "the file has a no-fly zone {name:?}, and an edit has added one of that name to scene {scene:?}, which no file takes away: remove it first with \
         `overfly edit {scene} remove-zone {name:?}`"
    )]
    Zone { scene: String, name: String },
}

impl Changes {
    /// Whether both versions are the same.
    pub fn is_empty(&self) -> bool {
        self.structures.is_empty() && self.zones.is_empty()
    }
}

impl Changed {
    fn is_empty(&self) -> bool {
        self.added.is_empty() && self.removed.is_empty() && self.changed.is_empty()
    }
}

impl Scene {
    /// This scene with the structures and zones of `file`, a newer version of its file in the same frame. Obstacles and the zones that edits have added
    /// stay: no file takes them away. What is the same in both is shared with this scene, also a structure that was only rounded otherwise.
    pub fn updated(&self, file: &Scene) -> Result<(Scene, Changes), UpdateError> {
        let (structures, of_structures) = self.updated_structures(file)?;
        let (zones, of_zones) = self.updated_zones(file)?;
        let scene = Scene { structures, zones, ..self.clone() };
        Ok((scene, Changes { structures: of_structures, zones: of_zones }))
    }

    fn updated_structures(&self, file: &Scene) -> Result<(Vec<Arc<Structure>>, Changed), UpdateError> {
        let mut changed = Changed::default();
        let mut structures = Vec::with_capacity(file.structures.len());
        for new in &file.structures {
            match self.structure(new.id) {
                Some(old) if !old.is_captured() && new.is_captured() => {
                    return Err(UpdateError::Obstacle { scene: self.name.clone(), name: new.name.clone() });
                }
                Some(old) if is_same(&old.shape, &new.shape) => structures.push(Arc::clone(old)),
                other => {
                    let names = if other.is_some() { &mut changed.changed } else { &mut changed.added };
                    names.push(new.name.clone());
                    structures.push(Arc::clone(new));
                }
            }
        }
        for old in self.structures.iter().filter(|old| file.structure(old.id).is_none()) {
            if old.is_captured() || old.terrain().is_some() {
                changed.removed.push(old.name.clone());
            } else {
                structures.push(Arc::clone(old));
            }
        }
        structures.sort_by_key(|structure| structure.id);
        Ok((structures, changed))
    }

    fn updated_zones(&self, file: &Scene) -> Result<(Vec<NoFlyZone>, Changed), UpdateError> {
        let mut changed = Changed::default();
        let of_name = |zones: &[NoFlyZone], name: &str| zones.iter().find(|zone| zone.name == name).cloned();
        for new in &file.zones {
            match of_name(&self.zones, &new.name) {
                Some(old) if old.source == ZoneSource::Edit => {
                    return Err(UpdateError::Zone { scene: self.name.clone(), name: new.name.clone() });
                }
                Some(old) if old == *new => {}
                Some(_) => changed.changed.push(new.name.clone()),
                None => changed.added.push(new.name.clone()),
            }
        }
        let (edited, of_file): (Vec<_>, Vec<_>) = self.zones.iter().cloned().partition(|zone| zone.source == ZoneSource::Edit);
        let gone = of_file.into_iter().filter(|old| of_name(&file.zones, &old.name).is_none());
        changed.removed.extend(gone.map(|zone| zone.name));
        Ok((file.zones.iter().cloned().chain(edited).collect(), changed))
    }
}

/// Whether two shapes have the same corners, as near as a file tells them.
fn is_same(a: &Shape, b: &Shape) -> bool {
    let near = |a: f64, b: f64| (a - b).abs() <= SAME_M;
    match (a, b) {
        (
            Shape::Prism { footprint: of_a, base_m: base_a, top_m: top_a },
            Shape::Prism { footprint: of_b, base_m: base_b, top_m: top_b },
        ) => {
            let rings = |footprint: &MultiPolygon<f64>| -> Vec<LineString<f64>> {
                let of_polygon = |polygon: &Polygon<f64>| [&[polygon.exterior().clone()], polygon.interiors()].concat();
                footprint.iter().flat_map(of_polygon).collect()
            };
            let same_ring = |(a, b): (&LineString<f64>, &LineString<f64>)| {
                a.0.len() == b.0.len() && a.0.iter().zip(&b.0).all(|(a, b)| near(a.x, b.x) && near(a.y, b.y))
            };
            let (of_a, of_b) = (rings(of_a), rings(of_b));
            near(*base_a, *base_b) && near(*top_a, *top_b) && of_a.len() == of_b.len() && of_a.iter().zip(&of_b).all(same_ring)
        }
        (Shape::Mesh { triangles: a }, Shape::Mesh { triangles: b }) => {
            let corners = a.iter().flatten().zip(b.iter().flatten());
            a.len() == b.len() && corners.into_iter().all(|(a, b)| (a - b).amax() <= SAME_M)
        }
        _ => a == b,
    }
}

#[cfg(test)]
mod tests {
    use geo::polygon;
    use nalgebra::Point3;

    use super::*;
    use crate::scene::edit::Edit;
    use crate::scene::{BlockSettings, generate_block, read, read_anchored, to_geojson};
    use crate::settings::Settings;

    fn edited(scene: &Scene, edits: &[Edit]) -> Scene {
        let limits = Settings::default().proxy;
        edits.iter().fold(scene.clone(), |scene, edit| scene.edited(edit, &limits).expect("it can be made").0)
    }

    fn zone(name: &str) -> Edit {
        let outline = polygon![(x: 0.0, y: 0.0), (x: 20.0, y: 0.0), (x: 0.0, y: 20.0)].into();
        let zone = NoFlyZone { name: name.into(), outline, floor_m: 10.0, ceiling_m: f64::MAX, source: ZoneSource::Edit };
        Edit::AddZone { zone }
    }

    fn obstacle(name: &str) -> Edit {
        Edit::Add { name: name.into(), shape: Shape::obstacle_box(Point3::new(5.0, 5.0, 9.0), [2.0, 3.0, 4.0], 0.5) }
    }

    /// A scene as it is read back from its file.
    fn of_file(scene: &Scene) -> Scene {
        read("block.geojson", to_geojson(scene).as_bytes(), &Settings::default().proxy).unwrap().0
    }

    #[test]
    fn a_new_version_of_the_file_changes_what_differs_and_shares_the_rest() {
        let settings = Settings::default().proxy;
        let block = generate_block(&BlockSettings { buildings: 9, extent_m: [130.0, 130.0], ..Default::default() });
        let (old, report) = read("block.geojson", to_geojson(&block).as_bytes(), &settings).unwrap();
        let ids: Vec<_> = old.structures.iter().map(|structure| structure.id).collect();
        let shed = Shape::Prism {
            footprint: polygon![(x: 90.0, y: 0.0), (x: 95.0, y: 0.0), (x: 95.0, y: 9.0)].into(),
            base_m: 0.0,
            top_m: 4.0,
        };
        let version = edited(
            &old,
            &[
                Edit::Raise { id: ids[2], by_m: 5.0 },
                Edit::Remove { id: ids[4] },
                Edit::Add { name: "shed".into(), shape: shed },
                zone("heliport"),
            ],
        );
        // The box around the structures is another one by now, and so would be the origin; the anchor keeps it.
        let text = to_geojson(&version).replace("overfly_origin", "other_origin");
        let (new, _) = read_anchored("block.geojson", text.as_bytes(), &settings, &report.anchor.unwrap()).unwrap();
        assert_eq!(new.frame, old.frame);

        let loaded = edited(&old, &[obstacle("drone"), zone("playground")]);
        let (updated, changes) = loaded.updated(&new).unwrap();
        let name = |index: usize| old.structures[index].name.clone();
        let expected = Changed { added: vec!["shed".into()], removed: vec![name(4)], changed: vec![name(2)] };
        assert_eq!(changes.structures, expected);
        assert_eq!(changes.zones, Changed { added: vec!["heliport".into()], ..Changed::default() });
        assert!(updated.structures.is_sorted_by(|a, b| a.id < b.id));
        assert!(updated.find("drone").is_some(), "no file takes an obstacle away");
        let zones: Vec<&str> = updated.zones.iter().map(|zone| zone.name.as_str()).collect();
        assert_eq!(zones, ["heliport", "playground"]);
        for index in [0, 1, 3] {
            assert!(Arc::ptr_eq(&old.structures[index], updated.structure(ids[index]).unwrap()));
        }
        let (again, nothing) = updated.updated(&new).unwrap();
        assert!(nothing.is_empty() && again == updated);
    }

    #[test]
    fn what_edits_have_added_is_not_replaced_by_a_file() {
        let file = of_file(&generate_block(&BlockSettings { buildings: 4, extent_m: [80.0, 80.0], ..Default::default() }));
        let name = file.structures[1].name.clone();
        let without = edited(&file, &[Edit::Remove { id: file.structures[1].id }]);
        let loaded = edited(&without, &[obstacle(&name)]);
        assert!(matches!(loaded.updated(&file), Err(UpdateError::Obstacle { .. })));
        let barred = edited(&file, &[zone("pad")]);
        let of_file = Scene { zones: of_file(&barred).zones, ..file.clone() };
        assert!(matches!(barred.updated(&of_file), Err(UpdateError::Zone { .. })));
        // A zone of the file goes with the file.
        let (updated, changes) = of_file.updated(&file).unwrap();
        assert_eq!((updated.zones.len(), changes.zones.removed), (0, vec!["pad".to_owned()]));
    }

    #[test]
    fn a_file_that_cannot_be_put_into_the_frame_is_refused() {
        let settings = Settings::default().proxy;
        let block = generate_block(&BlockSettings { buildings: 4, extent_m: [80.0, 80.0], ..Default::default() });
        let text = to_geojson(&block);
        let anchor = read("block.geojson", text.as_bytes(), &settings).unwrap().1.anchor.unwrap();
        let obj = "v 0 0 0\nv 9 0 0\nv 0 9 9\nf 1 2 3\n";
        let error = read_anchored("a.obj", obj.as_bytes(), &settings, &anchor).unwrap_err().to_string();
        assert!(error.contains("an OBJ file") && error.contains("overfly load"), "{error}");
        let anchor = read("a.obj", obj.as_bytes(), &settings).unwrap().1.anchor.unwrap();
        assert!(read_anchored("block.geojson", text.as_bytes(), &settings, &anchor).is_err());
        let far = "v 1000000 0 0\nv 1000009 0 0\nv 1000000 9 9\nf 1 2 3\n";
        let error = read_anchored("a.obj", far.as_bytes(), &settings, &anchor).unwrap_err().to_string();
        assert!(error.contains("km away"), "{error}");
    }
}
