//! What can be said of changes of a scene.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::Reach;
use crate::cli::values::{self, Meters2, Meters3, Outline};

const EDIT_HELP: &str = "\
ID is a structure's name, or its id in hexadecimal; `overfly status SCENE` lists both, and the no-fly zones.

A shape is one of three. Straight walls: --outline and --height. A mesh: --mesh with an OBJ file, metres in the scene's local frame, z from the ground up;
all its objects become one structure. An obstacle, as a sensor on board reports it: --centre and --size of an upright box, which flights keep clear of
and which hides what is behind it, but which nobody wants to capture.

FILE of a batch is JSON, a list of edits that are made in this order as one revision, or not at all:
  [{\"raise\": {\"structure\": \"hall\", \"by_m\": 3}}, {\"remove\": {\"structure\": \"shed\"}},
   {\"add\": {\"name\": \"crane\", \"shape\": {\"prism\": {\"outline_m\": [[0,0],[8,0],[8,8]], \"top_m\": 60}}}},
   {\"add\": {\"name\": \"hook\", \"shape\": {\"obstacle\": {\"centre_m\": [9,9,40], \"size_m\": [2,2,4], \"yaw_deg\": 30}}}},
   {\"replace\": {\"structure\": \"inn\", \"shape\": {\"mesh\": {\"vertices_m\": [[0,0,0],[9,0,0],[0,9,9]], \"triangles\": [[0,1,2]]}}}},
   {\"move\": {\"structure\": \"inn\", \"by_m\": [2,-1]}}, {\"lower\": {\"structure\": \"tower\", \"by_m\": 2}},
   {\"add-zone\": {\"name\": \"pad\", \"outline_m\": [[0,0],[8,0],[8,8]], \"floor_m\": 0, \"ceiling_m\": 80}}, {\"remove-zone\": {\"name\": \"yard\"}}]

Examples:
  overfly edit town raise 8f02ac51a0b3c4d5 --by 15
  overfly edit town move crane --by -12.5,4
  overfly edit town add --name crane --outline \"0,0 8,0 8,8 0,8\" --height 60
  overfly edit town add --name hook --centre 9,9,40 --size 2,2,4 --yaw 30
  overfly edit town replace hall --mesh hall-as-built.obj
  overfly edit town add-zone --name pad --outline \"0,0 30,0 30,30\" --ceiling 80
  overfly edit town batch changes.json
  overfly edit town remove crane --out flights/town";

#[derive(Debug, Args)]
#[command(after_help = EDIT_HELP)]
pub struct EditArgs {
    /// Name of the loaded scene
    pub scene: String,
    #[command(subcommand)]
    pub change: Change,
    /// Folder for plan.json, plan.svg, run.json and plan.html of the new plan
    #[arg(long, value_name = "DIR", global = true)]
    pub out: Option<PathBuf>,
    /// Return as soon as the edit is made, without the new plan
    #[arg(long, global = true, conflicts_with = "out")]
    pub no_wait: bool,
    /// Domain of the daemon [default: overfly]
    #[arg(long, value_name = "NAME", global = true, env = "OVERFLY_DOMAIN", hide_env_values = true)]
    pub domain: Option<String>,
}

#[derive(Debug, Clone, Subcommand)]
pub enum Change {
    /// Make a structure taller
    Raise {
        /// Name or hexadecimal id of the structure
        id: String,
        /// How much, m
        #[arg(long, value_name = "M", allow_negative_numbers = true, value_parser = values::metres)]
        by: f64,
    },
    /// Make a structure lower; 1 m must remain
    Lower {
        /// Name or hexadecimal id of the structure
        id: String,
        /// How much, m
        #[arg(long, value_name = "M", allow_negative_numbers = true, value_parser = values::metres)]
        by: f64,
    },
    /// Take a structure away
    Remove {
        /// Name or hexadecimal id of the structure
        id: String,
    },
    /// Put up a new structure: straight walls, a mesh, or an obstacle
    Add {
        /// Its name
        #[arg(long)]
        name: String,
        #[command(flatten)]
        shape: ShapeArgs,
    },
    /// Give a structure another shape under its name
    Replace {
        /// Name or hexadecimal id of the structure
        id: String,
        #[command(flatten)]
        shape: ShapeArgs,
    },
    /// Shift a structure
    Move {
        /// Name or hexadecimal id of the structure
        id: String,
        /// Metres east and north
        #[arg(long, value_name = "DX,DY", allow_hyphen_values = true)]
        by: Meters2,
    },
    /// Bar a zone: flights do not enter it
    AddZone {
        /// Its name
        #[arg(long)]
        name: String,
        /// Corners of the outline, m east and north, which must not cross itself: "x,y x,y x,y ..."
        #[arg(long, value_name = "CORNERS", allow_hyphen_values = true)]
        outline: Outline,
        /// Where it begins, m above the ground
        #[arg(long, value_name = "M", default_value_t = 0.0, allow_negative_numbers = true, value_parser = values::metres)]
        floor: f64,
        /// Where it ends, m above the ground [default: it has no ceiling]
        #[arg(long, value_name = "M", allow_negative_numbers = true, value_parser = values::metres)]
        ceiling: Option<f64>,
    },
    /// Open a no-fly zone of the scene again
    RemoveZone {
        /// Its name
        name: String,
    },
    /// Make the edits of a file together, or none of them
    Batch {
        /// JSON: a list of edits, see below
        file: PathBuf,
    },
}

/// One of three shapes.
#[derive(Debug, Clone, Args)]
pub struct ShapeArgs {
    /// Corners of the outline of straight walls, m east and north: "x,y x,y x,y ..."
    #[arg(long, value_name = "CORNERS", allow_hyphen_values = true, requires = "height", required_unless_present_any = ["mesh", "centre"])]
    pub outline: Option<Outline>,
    /// Height of the walls, m
    #[arg(long, value_name = "M", allow_negative_numbers = true, value_parser = values::metres, requires = "outline")]
    pub height: Option<f64>,
    /// Where the walls begin, m above the ground
    #[arg(long, value_name = "M", default_value_t = 0.0, allow_negative_numbers = true, value_parser = values::metres)]
    pub base: f64,
    /// OBJ file with a mesh, m in the scene's local frame
    #[arg(long, value_name = "FILE", conflicts_with_all = ["outline", "height", "base", "centre"])]
    pub mesh: Option<PathBuf>,
    /// Middle of an obstacle, m east, north and up
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, requires = "size", conflicts_with_all = ["outline", "height", "base"])]
    pub centre: Option<Meters3>,
    /// Sides of the obstacle, m: the first and second level, the third upright
    #[arg(long, value_name = "DX,DY,DZ", requires = "centre")]
    pub size: Option<Meters3>,
    /// How far the first side is turned from east, degrees counter-clockwise seen from above [default: 0]
    #[arg(long, value_name = "DEGREES", allow_negative_numbers = true, value_parser = values::metres, requires = "centre")]
    pub yaw: Option<f64>,
}

#[derive(Debug, Args)]
#[command(
    after_help = "The file must be a newer version of the one that the scene was loaded from: the same format, for CityJSON the same reference system. It is \
    put into the frame of the loaded scene, wherever its own middle is. Structures and zones become those of the file; structures that edits have added or \
    changed become as the file says, too. Obstacles, and zones that edits have added, stay.\n\nExamples:\n  \
    overfly update town town-2.geojson --dry-run\n  overfly update town town-2.geojson --out flights/town"
)]
pub struct UpdateArgs {
    /// Name of the loaded scene
    pub scene: String,
    /// The new version of its file
    pub file: PathBuf,
    /// Only for a GeoTIFF surface model: the model of its ground, as for `overfly load`
    #[arg(long, value_name = "FILE")]
    pub dtm: Option<PathBuf>,
    /// Only print what differs
    #[arg(long, conflicts_with_all = ["out", "no_wait"])]
    pub dry_run: bool,
    /// Folder for plan.json, plan.svg, run.json and plan.html of the new plan
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Return as soon as the scene is changed, without the new plan
    #[arg(long, conflicts_with = "out")]
    pub no_wait: bool,
    #[command(flatten)]
    pub reach: Reach,
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;
    use crate::cli::arguments::{Arguments, Command};

    fn change(words: &[&str]) -> Option<Change> {
        let line = [&["overfly", "edit", "town"], words].concat();
        match Arguments::try_parse_from(line).ok()?.command {
            Command::Edit(edit) => Some(edit.change),
            _ => None,
        }
    }

    #[test]
    fn options_of_an_edit_may_stand_behind_the_change() {
        let line = ["overfly", "edit", "town", "move", "crane", "--by", "-1,2", "--out", "d", "--domain", "x", "--json"];
        let arguments = Arguments::try_parse_from(line).unwrap();
        let Command::Edit(edit) = arguments.command else { panic!("another command") };
        assert!(arguments.json && edit.out == Some("d".into()) && edit.domain.as_deref() == Some("x"));
        assert!(matches!(edit.change, Change::Move { by: Meters2([-1.0, 2.0]), .. }));
    }

    #[test]
    fn a_shape_is_one_of_three() {
        let walls = ["--outline", "0,0 8,0 8,8", "--height", "9"];
        let mesh = ["--mesh", "a.obj"];
        let obstacle = ["--centre", "-1,2,3", "--size", "1,1,1", "--yaw", "-30"];
        for shape in [&walls[..], &mesh, &obstacle] {
            assert!(change(&[&["add", "--name", "a"], shape].concat()).is_some(), "{shape:?}");
            assert!(change(&[&["replace", "a"], shape].concat()).is_some(), "{shape:?}");
        }
        for shape in [
            &[][..],
            &walls[..2],
            &walls[2..],
            &obstacle[..2],
            &obstacle[2..4],
            &[&walls[..], &mesh].concat(),
            &[&walls[..], &obstacle].concat(),
            &[&mesh[..], &obstacle].concat(),
        ] {
            assert!(change(&[&["replace", "a"], shape].concat()).is_none(), "{shape:?}");
        }
    }
}
