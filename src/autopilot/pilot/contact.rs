//! Who is there, and whether the link holds.

use std::time::Duration;

use super::{MOST_OTHERS, Pilot, SILENCE, Vehicle, Work};
use crate::autopilot::dialect::{COMMAND_LONG_DATA, HEARTBEAT_DATA, MavAutopilot, MavCmd, MavModeFlag, MavState, MavType};
use crate::autopilot::follow::Progress;
use crate::autopilot::notice::{End, Notice, PilotError};
use crate::autopilot::{Address, MavMessage};
use crate::mission::mav_items::Autopilot;

impl Pilot {
    pub(super) fn on_heartbeat(&mut self, from: Address, heartbeat: &HEARTBEAT_DATA, now: Duration) {
        let is_armed = heartbeat.base_mode.contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED);
        match &mut self.vehicle {
            None => self.meet(from, heartbeat, is_armed, now),
            Some(vehicle) if vehicle.address == from => {
                let silent = now.saturating_sub(vehicle.heard);
                let was_armed = std::mem::replace(&mut vehicle.is_armed, is_armed);
                vehicle.heard = now;
                if std::mem::take(&mut vehicle.is_lost) {
                    self.notices.push(Notice::LinkBack { silent });
                    self.ask_for_messages();
                }
                self.see_mode(heartbeat.custom_mode);
                if was_armed && !is_armed && self.progress.as_ref().is_some_and(Progress::is_under_way) {
                    self.end(Ok(End::Landed));
                }
            }
            Some(_) => {}
        }
    }

    /// A first heartbeat: of the aircraft, or of somebody else.
    fn meet(&mut self, from: Address, heartbeat: &HEARTBEAT_DATA, is_armed: bool, now: Duration) {
        let is_autopilot =
            heartbeat.autopilot != MavAutopilot::MAV_AUTOPILOT_INVALID && heartbeat.mavtype != MavType::MAV_TYPE_GCS;
        if !is_autopilot || self.options.system.is_some_and(|system| system != from.system) {
            if !self.others.contains(&from) && self.others.len() < MOST_OTHERS {
                self.others.push(from);
            }
            return;
        }
        let kind = self.options.autopilot.or(match heartbeat.autopilot {
            MavAutopilot::MAV_AUTOPILOT_PX4 => Some(Autopilot::Px4),
            MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA => Some(Autopilot::ArduPilot),
            _ => None,
        });
        let Some(autopilot) = kind else {
            return self.end(Err(PilotError::Kind { vehicle: from, code: heartbeat.autopilot as u8 }));
        };
        self.vehicle = Some(Vehicle {
            address: from,
            autopilot,
            found: now,
            heard: now,
            is_armed,
            is_lost: false,
            mode: None,
            is_on_mission: None,
        });
        self.notices.push(Notice::Found { vehicle: from, autopilot, is_armed });
        self.ask_for_messages();
    }

    fn see_mode(&mut self, mode: u32) {
        let Some(vehicle) = &mut self.vehicle else { return };
        let is_mission = match vehicle.autopilot {
            // Main mode AUTO, sub mode MISSION.
            Autopilot::Px4 => [(mode >> 16) & 0xff, mode >> 24] == [4, 4],
            Autopilot::ArduPilot => mode == 3,
        };
        let is_under_way = self.progress.as_ref().is_some_and(Progress::is_under_way);
        let has_turned = vehicle.mode.replace(mode).is_some_and(|was| was != mode);
        let has_changed = vehicle.is_on_mission.replace(is_mission).is_some_and(|was| was != is_mission);
        if has_changed && is_under_way {
            self.notices.push(Notice::Mode { is_mission, mode });
        }
        // One that has held flies on without an order of ours: its pilot has decided.
        if self.held.is_some() && self.has_obeyed() {
            match (has_changed, is_mission) {
                (true, true) => self.let_go("its pilot flies on along the one before"),
                // From holding to something else; what it holds in is the first such mode.
                (false, false) if has_turned => self.let_go("its pilot has taken over"),
                _ => {}
            }
        }
    }

    pub(super) fn watch_link(&mut self, vehicle: Vehicle, now: Duration) {
        let silent = now.saturating_sub(vehicle.heard);
        if silent >= self.options.lost {
            return self.end(Err(PilotError::Lost { seconds: silent.as_secs_f64() }));
        }
        if silent < SILENCE || vehicle.is_lost {
            return;
        }
        if let Some(vehicle) = &mut self.vehicle {
            vehicle.is_lost = true;
        }
        self.notices.push(Notice::LinkLost { silent });
        // Whatever was on its way begins anew.
        if !matches!(self.work, Work::Idle) {
            self.clears |= matches!(self.work, Work::Uploading { .. });
            self.work = Work::Idle;
            self.attempt = 0;
        }
    }

    pub(super) fn nobody(&self) -> PilotError {
        let remedy = match self.options.system {
            Some(_) if !self.others.is_empty() => "give the aircraft's system id with `--system`, or see that it is on",
            _ => "see that it is on, and that `--link` names the end it speaks to (`udpin:` to listen, `udp:` to speak first)",
        };
        PilotError::NoVehicle { seconds: self.options.wait.as_secs_f64(), others: self.others.clone(), remedy }
    }

    /// Asks for the messages that the flight is followed by; an autopilot that does not know the command sends what it sends.
    fn ask_for_messages(&mut self) {
        // GLOBAL_POSITION_INT and MISSION_CURRENT, microseconds apart.
        for (id, interval_us) in [(33.0, 200_000.0), (42.0, 500_000.0)] {
            let Some(vehicle) = self.vehicle else { return };
            self.out.push(MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
                param1: id,
                param2: interval_us,
                command: MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
                target_system: vehicle.address.system,
                target_component: vehicle.address.component,
                ..COMMAND_LONG_DATA::DEFAULT
            }));
        }
    }
}

pub(super) fn heartbeat() -> MavMessage {
    MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        custom_mode: 0,
        mavtype: MavType::MAV_TYPE_ONBOARD_CONTROLLER,
        autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
        base_mode: MavModeFlag::empty(),
        system_status: MavState::MAV_STATE_ACTIVE,
        mavlink_version: 3,
    })
}
