//! An aircraft at the other end of a UDP socket, in a thread of its own: it takes missions over a link with losses and delays, flies them, and takes
//! pictures as they say.

use std::collections::BTreeMap;
use std::net::{SocketAddr, UdpSocket};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use mavlink::{MavHeader, MavlinkReader, write_v2_msg};
use overfly::autopilot::dialect::*;
use overfly::autopilot::{Address, MavMessage};
use rand_chacha::ChaCha8Rng;
use rand_core::{Rng, SeedableRng};

use super::{AIRCRAFT, Manner, Model};

/// Metres of a degree of latitude, near enough for a small block.
const DEGREE_M: f64 = 111_195.0;
/// Speed in flight, m/s: tests do not wait for a drone of usual speed.
pub const SPEED_MPS: f64 = 20.0;
const STEP: Duration = Duration::from_millis(20);

/// What a test can look at and change.
#[derive(Debug, Default)]
pub struct Control {
    pub model: Model,
    /// The radio is off.
    pub is_silent: bool,
    pub is_flying: bool,
    pub is_ended: bool,
    /// Latitude and longitude, degrees, and height above the take-off place, m.
    pub place: [f64; 3],
    /// Images that were taken, and orders that came.
    pub images: usize,
    pub orders: Vec<MavCmd>,
    /// The order that came last, with its third number, which tells modes apart.
    last_order: Option<(MavCmd, f32)>,
    /// The longest that it has stood still on a mission, steps.
    pub longest_stand: usize,
    pub is_armed: bool,
    pub speed_mps: f64,
}

pub struct Aircraft {
    pub control: Arc<Mutex<Control>>,
    thread: Option<JoinHandle<()>>,
}

impl Aircraft {
    /// Speaks to an address; `loss` messages of 1000 are lost on either way.
    pub fn start(to: SocketAddr, manner: Manner, place: [f64; 3], loss: u64) -> Self {
        let control =
            Arc::new(Mutex::new(Control { model: Model::new(manner), place, speed_mps: SPEED_MPS, ..Control::default() }));
        let shared = Arc::clone(&control);
        let thread = std::thread::spawn(move || fly(&shared, to, loss));
        Self { control, thread: Some(thread) }
    }

    pub fn with<T>(&self, look: impl FnOnce(&mut Control) -> T) -> T {
        look(&mut self.control.lock().unwrap())
    }

    /// Takes off, as if its pilot had said so.
    pub fn take_off(&self) {
        self.with(|control| (control.is_armed, control.is_flying) = (true, true));
    }
}

impl Drop for Aircraft {
    fn drop(&mut self) {
        self.control.lock().unwrap_or_else(std::sync::PoisonError::into_inner).is_ended = true;
        self.thread.take().map(JoinHandle::join);
    }
}

struct Radio {
    socket: UdpSocket,
    to: SocketAddr,
    random: ChaCha8Rng,
    loss: u64,
    sequence: u8,
    /// Messages that are under way.
    late: BTreeMap<(Duration, u64), Vec<u8>>,
    sent: u64,
}

impl Radio {
    fn send(&mut self, message: &MavMessage, now: Duration) {
        if self.random.next_u64() % 1000 < self.loss {
            return;
        }
        let header = MavHeader { system_id: AIRCRAFT.system.into(), component_id: AIRCRAFT.component, sequence: self.sequence };
        self.sequence = self.sequence.wrapping_add(1);
        let mut bytes = Vec::new();
        write_v2_msg(&mut bytes, header, message).unwrap();
        self.sent += 1;
        let delay = Duration::from_millis(self.random.next_u64() % 8);
        self.late.insert((now + delay, self.sent), bytes);
    }

    fn deliver(&mut self, now: Duration, is_silent: bool) {
        let later = self.late.split_off(&(now, u64::MAX));
        for bytes in std::mem::replace(&mut self.late, later).into_values().filter(|_| !is_silent) {
            let _ = self.socket.send_to(&bytes, self.to);
        }
    }

    fn heard(&mut self) -> Vec<(Address, MavMessage)> {
        let mut datagram = [0; 2048];
        let mut heard = Vec::new();
        while let Ok(count) = self.socket.recv(&mut datagram) {
            let mut reader = MavlinkReader::new(&datagram[..count]);
            while let Ok((header, message)) = reader.read_any_message::<MavMessage>() {
                if self.random.next_u64() % 1000 >= self.loss {
                    heard.push((Address { system: header.system_id as u8, component: header.component_id }, message));
                }
            }
        }
        heard
    }
}

fn fly(shared: &Mutex<Control>, to: SocketAddr, loss: u64) {
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.set_read_timeout(Some(Duration::from_millis(2))).unwrap();
    let random = ChaCha8Rng::seed_from_u64(7);
    let mut radio = Radio { socket, to, random, loss, sequence: 0, late: BTreeMap::new(), sent: 0 };
    let began = Instant::now();
    let (mut step, mut flown_m, mut spacing_m, mut stood) = (0u32, 0.0, 0.0, 0);
    loop {
        let now = began.elapsed();
        let heard = radio.heard();
        let mut control = shared.lock().unwrap();
        if control.is_ended {
            return;
        }
        let control = &mut *control;
        radio.deliver(now, control.is_silent);
        if !control.is_silent {
            for (from, message) in heard {
                obey(control, from, &message, now, &mut radio);
            }
        }
        for message in control.model.tick(now) {
            radio.send(&message, now);
        }
        if now < STEP * step {
            continue;
        }
        step += 1;
        let before = control.place;
        if control.is_flying {
            move_on(control, now, &mut radio, &mut flown_m, &mut spacing_m);
            stood = if control.place == before { stood + 1 } else { 0 };
            control.longest_stand = control.longest_stand.max(stood);
        }
        tell(control, before, step, now, &mut radio);
    }
}

fn obey(control: &mut Control, from: Address, message: &MavMessage, now: Duration, radio: &mut Radio) {
    for answer in control.model.hear(from, message, now) {
        radio.send(&answer, now);
    }
    let MavMessage::COMMAND_LONG(command) = message else { return };
    match command.command {
        MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL => return,
        MavCmd::MAV_CMD_COMPONENT_ARM_DISARM => control.is_armed = true,
        // Sub mode LOITER.
        MavCmd::MAV_CMD_DO_SET_MODE => control.is_flying = command.param3 != 3.0,
        _ => {}
    }
    // Whose answer was lost on the way gives an order again.
    let order = (command.command, command.param3);
    if control.last_order.replace(order) != Some(order) || command.confirmation == 0 {
        control.orders.push(command.command);
    }
    let ack = COMMAND_ACK_DATA {
        command: command.command,
        target_system: from.system,
        target_component: from.component,
        ..COMMAND_ACK_DATA::DEFAULT
    };
    radio.send(&MavMessage::COMMAND_ACK(ack), now);
}

/// Flies on for one step.
fn move_on(control: &mut Control, now: Duration, radio: &mut Radio, flown_m: &mut f64, spacing_m: &mut f64) {
    while let Some(item) = control.model.mission.get(control.model.current) {
        let goal = match item.command {
            MavCmd::MAV_CMD_NAV_TAKEOFF => [control.place[0], control.place[1], f64::from(item.z)],
            MavCmd::MAV_CMD_NAV_WAYPOINT => [f64::from(item.x) * 1e-7, f64::from(item.y) * 1e-7, f64::from(item.z)],
            MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH => return,
            MavCmd::MAV_CMD_DO_SET_CAM_TRIGG_DIST => {
                (*spacing_m, *flown_m) = (f64::from(item.param1), f64::from(item.param1));
                control.model.current += 1;
                continue;
            }
            _ => {
                control.model.current += 1;
                continue;
            }
        };
        let east_m = DEGREE_M * goal[0].to_radians().cos();
        let way = [(goal[0] - control.place[0]) * DEGREE_M, (goal[1] - control.place[1]) * east_m, goal[2] - control.place[2]];
        let way_m = way.iter().map(|part| part * part).sum::<f64>().sqrt();
        let step_m = control.speed_mps * STEP.as_secs_f64();
        if way_m > step_m {
            (0..3).for_each(|axis| control.place[axis] += (goal[axis] - control.place[axis]) * step_m / way_m);
            *flown_m += step_m;
            if *spacing_m > 0.0 && *flown_m >= *spacing_m {
                *flown_m -= *spacing_m;
                control.images += 1;
                radio.send(&image(control), now);
            }
            return;
        }
        control.place = goal;
        let seq = control.model.current as u16;
        radio.send(&MavMessage::MISSION_ITEM_REACHED(MISSION_ITEM_REACHED_DATA { seq }), now);
        control.model.current += 1;
    }
}

fn image(control: &Control) -> MavMessage {
    let [lat, lon, up_m] = control.place;
    MavMessage::CAMERA_IMAGE_CAPTURED(CAMERA_IMAGE_CAPTURED_DATA {
        lat: (lat * 1e7).round() as i32,
        lon: (lon * 1e7).round() as i32,
        relative_alt: (up_m * 1000.0) as i32,
        image_index: control.images as i32,
        capture_result: MavBool::MAV_BOOL_TRUE,
        ..CAMERA_IMAGE_CAPTURED_DATA::DEFAULT
    })
}

/// Says where it is, and that it is there.
fn tell(control: &Control, before: [f64; 3], step: u32, now: Duration, radio: &mut Radio) {
    if step.is_multiple_of(10) {
        let armed = if control.is_armed { MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED } else { MavModeFlag::empty() };
        let heartbeat = HEARTBEAT_DATA {
            custom_mode: 0x0404_0000,
            mavtype: MavType::MAV_TYPE_QUADROTOR,
            autopilot: MavAutopilot::MAV_AUTOPILOT_PX4,
            base_mode: armed,
            system_status: MavState::MAV_STATE_ACTIVE,
            mavlink_version: 3,
        };
        radio.send(&MavMessage::HEARTBEAT(heartbeat), now);
        radio.send(&control.model.mission_current(), now);
    }
    if step.is_multiple_of(4) {
        let [lat, lon, up_m] = control.place;
        let cmps =
            |axis: usize, scale_m: f64| ((control.place[axis] - before[axis]) * scale_m / STEP.as_secs_f64() * 100.0) as i16;
        let position = GLOBAL_POSITION_INT_DATA {
            lat: (lat * 1e7).round() as i32,
            lon: (lon * 1e7).round() as i32,
            relative_alt: (up_m * 1000.0) as i32,
            vx: cmps(0, DEGREE_M),
            vy: cmps(1, DEGREE_M * lat.to_radians().cos()),
            vz: -cmps(2, 1.0),
            ..GLOBAL_POSITION_INT_DATA::DEFAULT
        };
        radio.send(&MavMessage::GLOBAL_POSITION_INT(position), now);
    }
}
