//! `overfly fly`.

use clap::Args;

use super::Reach;
use super::course::CourseArgs;
use super::export::AutopilotChoice;
use crate::autopilot::link::Place;
use crate::cli::values::{self, Meters3};

#[derive(Debug, Args)]
#[command(
    after_help = "PLAN is the name of a scene that the daemon has loaded and planned, or a plan.json. The plan goes up as a mission: take-off, the way to its first \
    waypoint, the waypoints with speed, camera trigger and gimbal, and the way home. Nothing is armed or started without --start. With a loaded scene the \
    daemon is told how far the flight has come, and each newer plan takes the place of the mission in flight: from the next waypoint on that has not \
    changed, or where the aircraft is nearest to a path that begins at its pose. Where a change of the scene leaves no flight, the aircraft is told to hold.\n\n\
    Ctrl-C ends this program; the autopilot flies on by itself. The take-off place is where the aircraft stands unless --home says otherwise. The ways out and home keep \
    above all waypoints, above all that stands in the scene, and out of its no-fly zones; the scene is what --scene gives, or for a plan.json the file that it was made on. Edits \
    of a loaded scene are not in that file: the waypoints keep clear of what they bring, the ways out and home know nothing of it. Without a \
    scene the take-off place is taken to lie at its zero, the lowest ground: over hilly ground give --scene, or --home LAT,LON,ALT. An \
    aircraft that is far from a newer path holds (not one that was in the air when this program started), climbs above everything, flies \
    across and comes down where a leg of it begins.\n\n\
    With --json each line is an object with the key `event`: found, note, uploading, uploaded, joined, far_off, superseded, again, kept, progress, link_lost, link_back, \
    obeyed, disobeyed, mode, said, infeasible, daemon_lost, daemon_back, daemon_refused, and at the end uploaded_only, flown, landed or stopped.\n\nExamples:\n  \
    overfly fly town --link udpin:0.0.0.0:14540\n  \
    overfly fly flights/town/plan.json --link serial:/dev/ttyACM0:57600 --upload-only\n  \
    overfly fly town --link tcp:127.0.0.1:5760 --autopilot ardupilot --home 51.912,4.467 --start\n  \
    overfly fly flights/town/plan.json --dry-run --autopilot px4"
)]
pub struct FlyArgs {
    /// Name of a loaded scene, or a plan.json
    #[arg(value_name = "NAME|PLAN.json")]
    pub plan: String,
    /// Where the autopilot is: udp:HOST:PORT (speak first), udpin:HOST:PORT (listen), tcp:HOST:PORT or serial:DEVICE:BAUD
    #[arg(long, value_name = "LINK", required_unless_present = "dry_run")]
    pub link: Option<Place>,
    /// System id of the aircraft, 1 to 255 [default: that of the first autopilot that is heard]
    #[arg(long, value_name = "ID", value_parser = clap::value_parser!(u8).range(1..))]
    pub system: Option<u8>,
    /// Kind of the autopilot [default: as its heartbeat says; with --dry-run px4]
    #[arg(long, value_enum, value_name = "KIND")]
    pub autopilot: Option<AutopilotChoice>,
    /// Print the mission's items, and do not touch a link
    #[arg(long)]
    pub dry_run: bool,
    /// Arm the aircraft after the upload and let it fly: it takes off
    #[arg(long)]
    pub start: bool,
    /// End when the mission is up
    #[arg(long)]
    pub upload_only: bool,
    /// Do not let the aircraft hold when a change of the scene leaves no flight; it is only said
    #[arg(long)]
    pub no_hold: bool,
    /// Which sortie of a plan that takes more than one battery, from 1
    #[arg(long, value_name = "N", default_value_t = 1, allow_negative_numbers = true, value_parser = values::count)]
    pub sortie: u32,
    #[command(flatten)]
    pub course: CourseArgs,
    /// For a loaded scene: the flight has to end so many seconds after the aircraft was armed; newer plans are made for what is left
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, value_parser = values::seconds)]
    pub air_time: Option<f64>,
    /// For a loaded scene: where newer plans have to end, metres east, north, up in the scene's local frame
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    pub landing: Option<Meters3>,
    /// How long to wait for the first heartbeat, s
    #[arg(long, value_name = "SECONDS", default_value_t = 30.0, allow_negative_numbers = true, value_parser = values::seconds)]
    pub wait: f64,
    /// How long to wait for the link when it was lost, s
    #[arg(long, value_name = "SECONDS", default_value_t = 600.0, allow_negative_numbers = true, value_parser = values::seconds)]
    pub lost: f64,
    #[command(flatten)]
    pub reach: Reach,
}
