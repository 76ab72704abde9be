//! An aircraft that is told to hold, and what ends that.

use geo::polygon;

use super::*;
use crate::autopilot::command::OrderError;
use crate::scene::{BlockSettings, NoFlyZone, ZoneSource, generate_block};
use crate::settings::Settings;

fn far_away() -> Arc<Plan> {
    plan(&[[150.0, 200.0, 30.0], [250.0, 200.0, 30.0], [250.0, 260.0, 30.0]])
}

#[test]
fn a_path_far_away_is_reached_over_everything() {
    let (old, far) = (plan(&corners(0.0)), far_away());
    let mut field = Field::on_the_way(options(), &old);
    field.fly(6, &far, Some((5, 0)));
    field.run(3.0);
    assert_eq!(field.commands, [HOLD], "it holds");
    assert!(
        field.notices.iter().any(|notice| matches!(notice, Notice::FarOff { off_m } if *off_m > 190.0)),
        "{:?}",
        field.notices
    );
    assert_eq!(field.joined(), None, "and nothing is uploaded while it moves");
    (field.position.vx, field.position.vy) = (20, 0);
    field.run(3.0);
    assert_eq!((field.joined(), field.commands.last()), (Some((6, 0)), Some(&FLY)), "{:?}", field.notices);
    // Up where it is, across, and down to the beginning of the leg, with the camera off.
    let frame = crate::frame::LocalFrame { origin: far.scene.origin };
    let way = &field.mission[field.current..=field.item_of(&far, 0)];
    assert_eq!((way[0].command, way[0].param1), (MavCmd::MAV_CMD_DO_SET_CAM_TRIGG_DIST, 0.0));
    let places = way.iter().filter(|item| item.command == MavCmd::MAV_CMD_NAV_WAYPOINT).map(|item| {
        let place = crate::frame::Geodetic { lat_deg: f64::from(item.x) * 1e-7, lon_deg: f64::from(item.y) * 1e-7, alt_m: 3.5 };
        let at = frame.local_from_geodetic(&place).unwrap();
        [at.x.round(), at.y.round(), f64::from(item.z).round()]
    });
    assert_eq!(places.collect::<Vec<_>>(), [[170.0, 1.0, 40.0], [150.0, 200.0, 40.0], [150.0, 200.0, 30.0]]);
}

#[test]
fn without_a_flight_it_holds_and_goes_on_when_there_is_one_again() {
    let (old, bent) = (plan(&corners(0.0)), plan(&corners(30.0)));
    let mut field = Field::new(options());
    field.place(&old, [0.0, 0.0, 0.0]);
    field.fly(5, &old, None);
    field.run(2.0);
    field.pilot.hold();
    field.run(1.0);
    assert!(field.commands.is_empty(), "on the ground there is nothing to hold");
    field.head_to(&old, 4, [170.0, 1.0, 40.0]);
    field.pilot.hold();
    field.pilot.hold();
    field.run(1.0);
    assert_eq!(field.commands, [HOLD], "PX4 loiters");
    field.fly(6, &bent, Some((5, 7)));
    field.run(2.0);
    assert_eq!(field.commands, [HOLD, FLY], "and flies on");
}

#[test]
fn a_hold_while_a_mission_is_set_stays() {
    let (old, bent) = (plan(&corners(0.0)), plan(&corners(30.0)));
    let mut field = Field::on_the_way(options(), &old);
    field.ignores_set = true;
    field.fly(6, &bent, Some((5, 7)));
    field.run(0.5);
    assert!(field.notices.iter().any(|notice| matches!(notice, Notice::Uploaded { epoch: 6, .. })) && field.joined().is_none());
    field.pilot.hold();
    field.ignores_set = false;
    field.run(4.0);
    assert_eq!((field.joined(), &field.commands[..]), (Some((6, 4)), &[HOLD][..]), "{:?}", field.notices);
    field.fly(7, &old, None);
    field.run(2.0);
    assert_eq!(field.commands, [HOLD, FLY], "a newer plan ends it");
}

#[test]
fn an_aircraft_on_its_way_out_holds_as_well() {
    let (old, bent) = (plan(&corners(0.0)), plan(&corners(30.0)));
    let mut field = Field::new(options());
    field.place(&old, [0.0, 0.0, 0.0]);
    field.fly(5, &old, None);
    field.run(2.0);
    field.is_armed = true;
    field.place(&old, [0.0, 0.0, 20.0]);
    field.run(1.0);
    field.pilot.hold();
    field.run(1.0);
    assert_eq!(field.commands, [HOLD]);
    field.fly(6, &bent, None);
    field.run(2.0);
    assert_eq!(field.commands, [HOLD, FLY], "{:?}", field.notices);
}

#[test]
fn a_plan_that_does_not_go_up_leaves_no_aircraft_hovering_for_it() {
    let (old, far) = (plan(&corners(0.0)), far_away());
    let mut field = Field::on_the_way(options(), &old);
    (field.rejects, field.position.vy) = (true, 0);
    field.fly(6, &far, Some((5, 0)));
    field.run(3.0);
    assert_eq!((&field.commands[..], field.kept()), (&[HOLD, FLY][..], vec![(6, false)]), "{:?}", field.notices);
    // Where there is no flight it is another matter.
    field.pilot.hold();
    field.run(1.0);
    field.fly(7, &far, Some((5, 0)));
    field.run(3.0);
    assert_eq!((&field.commands[2..], field.kept().last()), (&[HOLD][..], Some(&(7, true))), "{:?}", field.notices);
    field.rejects = false;
    field.fly(8, &far, Some((5, 0)));
    field.run(3.0);
    assert_eq!((field.joined(), &field.commands[3..]), (Some((8, 0)), &[FLY][..]));
}

#[test]
fn nobody_holds_for_a_path_that_cannot_be_reached() {
    let mut scene = generate_block(&BlockSettings { extent_m: [130.0, 130.0], buildings: 9, ..Default::default() });
    let z = scene.bounds().unwrap().max.z + 8.0;
    // Over the aircraft, which flies below.
    let outline = polygon![(x: -510.0, y: -10.0), (x: -490.0, y: -10.0), (x: -490.0, y: 10.0), (x: -510.0, y: 10.0)].into();
    scene.zones.push(NoFlyZone {
        name: "roof".to_owned(),
        outline,
        floor_m: z + 1.0,
        ceiling_m: f64::MAX,
        source: ZoneSource::Edit,
    });
    let free = crate::scene::free_space::FreeSpace::new(&scene, &Settings::default().flight).unwrap();
    let over = |corners: &[[f64; 3]]| {
        let mut plan = fixture::plan("panoramic", corners);
        plan.scene.origin = scene.frame.origin;
        Arc::new(plan)
    };
    let old = over(&[[-560.0, 0.0, z], [-530.0, 0.0, z], [-470.0, 0.0, z], [-440.0, 0.0, z]]);
    let far = over(&[[-560.0, 200.0, z], [-440.0, 200.0, z], [-440.0, 260.0, z]]);
    let mut field = Field::new(PilotOptions { free: Some(Arc::new(free)), ..options() });
    field.place(&old, [-560.0, 0.0, 0.0]);
    field.fly(5, &old, None);
    field.run(2.0);
    field.head_to(&old, 2, [-500.0, 0.0, z]);
    field.fly(6, &far, Some((5, 0)));
    field.run(3.0);
    assert_eq!((&field.commands[..], field.kept()), (&[][..], vec![(6, false)]), "{:?}", field.notices);
    assert!(
        matches!(field.notices.last(), Some(Notice::Kept { why, .. }) if why.contains("the climb from where the aircraft is"))
    );
}

#[test]
fn an_aircraft_that_does_not_hold_is_never_at_rest() {
    let (old, far) = (plan(&corners(0.0)), far_away());
    let mut field = Field::on_the_way(options(), &old);
    field.refuses_hold = true;
    field.fly(6, &far, Some((5, 0)));
    field.run(15.0);
    assert_eq!((&field.commands[..], field.kept(), field.joined()), (&[HOLD][..], vec![(6, false)], None), "{:?}", field.notices);
    assert!(field.pilot.outcome().is_none());

    // One whose pilot lets it fly on neither.
    let mut field = Field::on_the_way(options(), &old);
    field.fly(6, &far, Some((5, 0)));
    field.run(1.0);
    field.mode = LOITER;
    field.run(1.0);
    field.mode = MISSION;
    field.run(15.0);
    assert_eq!((&field.commands[..], field.kept(), field.joined()), (&[HOLD][..], vec![(6, false)], None), "{:?}", field.notices);
}

#[test]
fn a_mission_that_is_there_is_followed_even_where_its_item_cannot_be_set() {
    let (old, bent) = (plan(&corners(0.0)), plan(&corners(30.0)));
    let mut field = Field::on_the_way(options(), &old);
    field.ignores_set = true;
    field.fly(6, &bent, Some((5, 7)));
    field.run(60.0);
    assert_eq!(field.pilot.progress().unwrap().mission.epoch, 6);
    let told = field.notices.iter().any(|notice| matches!(notice, Notice::Disobeyed(OrderError::NotCurrent { .. })));
    assert!(told && field.kept().is_empty() && field.pilot.outcome().is_none(), "{:?}", field.notices);
}

/// Position control by hand, as PX4 numbers it.
const BY_HAND: u32 = 3 << 16;

#[test]
fn an_aircraft_in_its_pilots_hands_gets_no_orders() {
    let (old, far) = (plan(&corners(0.0)), far_away());
    let mut field = Field::on_the_way(options(), &old);
    field.mode = BY_HAND;
    field.run(1.0);
    field.pilot.hold();
    field.fly(6, &far, Some((5, 0)));
    field.run(15.0);
    assert_eq!((&field.commands[..], field.joined()), (&[][..], None), "{:?}", field.notices);
    field.mode = MISSION;
    field.run(3.0);
    assert_eq!((&field.commands[..], field.joined()), (&[HOLD][..], None), "given back, it holds for the path far away");
}

#[test]
fn an_aircraft_that_is_taken_over_while_it_holds_is_not_let_fly() {
    let (old, far) = (plan(&corners(0.0)), far_away());
    for is_far in [true, false] {
        let mut field = Field::on_the_way(options(), &old);
        if is_far {
            field.fly(6, &far, Some((5, 0)))
        } else {
            field.pilot.hold()
        }
        field.run(1.0);
        field.mode = LOITER;
        field.run(1.0);
        field.mode = BY_HAND;
        field.run(1.0);
        field.fly(7, &plan(&corners(30.0)), Some((5, 7)));
        field.run(15.0);
        assert_eq!(field.commands, [HOLD], "{is_far}: {:?}", field.notices);
    }
}
