"""MAVLink missions, read with MAVSDK's importers and pymavlink, and uploaded to a vehicle that takes missions as MAVLink says."""

import json
import math
import socket
import threading
import time

import mavsdk
from mavsdk.logging import LogLevel, log_subscribe
from mavsdk.plugins.mission_raw import MissionRaw
from pymavlink import mavutil, mavwp

PX4, ARDUPILOT = mavutil.mavlink.MAV_AUTOPILOT_PX4, mavutil.mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
TAKEOFF, WAYPOINT, RTL, SPEED, YAW, MOUNT, TRIGGER, GIMBAL = 22, 16, 20, 178, 115, 205, 206, 1000


# MAVSDK tells whatever it does; what is wrong it raises.
log_subscribe(lambda level, message, file, line: level < LogLevel.WARN)


class Vehicle(threading.Thread):
    """Says that it is there, and asks for each item of a mission that is offered."""

    def __init__(self, autopilot):
        super().__init__(daemon=True)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = probe.getsockname()[1]
        self.autopilot, self.items, self.ends = autopilot, {}, False
        self.link = mavutil.mavlink_connection(f"udpout:127.0.0.1:{self.port}", source_system=1, source_component=1, dialect="common")

    def run(self):
        beat, expected, count = 0.0, None, 0
        while not self.ends:
            if time.monotonic() - beat > 0.3:
                beat = time.monotonic()
                self.link.mav.heartbeat_send(2, self.autopilot, 0, 0, 4)
            try:
                message = self.link.recv_match(blocking=True, timeout=0.1)
            except ConnectionError:
                continue
            if message is None:
                continue
            kind, system, component = message.get_type(), message.get_srcSystem(), message.get_srcComponent()
            if kind == "MISSION_COUNT":
                self.items, expected, count = {}, 0, message.count
            elif kind == "MISSION_ITEM_INT" and message.seq == expected:
                self.items[message.seq], expected = message, expected + 1
            elif kind == "COMMAND_LONG":
                self.link.mav.command_ack_send(message.command, mavutil.mavlink.MAV_RESULT_UNSUPPORTED)
                continue
            else:
                continue
            if expected < count:
                self.link.mav.mission_request_int_send(system, component, expected, message.mission_type)
            else:
                self.link.mav.mission_ack_send(system, component, mavutil.mavlink.MAV_MISSION_ACCEPTED, message.mission_type)


class Client:
    """MAVSDK with a vehicle of an autopilot."""

    def __init__(self, autopilot):
        self.vehicle = Vehicle(autopilot)
        self.mavsdk = mavsdk.Mavsdk(mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION))
        self.mavsdk.add_any_connection(f"udpin://127.0.0.1:{self.vehicle.port}")
        self.vehicle.start()
        system = self.mavsdk.first_autopilot(15.0)
        if system is None:
            raise SystemExit("ERROR: MAVSDK does not see the vehicle, so that its importers cannot be asked")
        self.missions = MissionRaw(system)

    def close(self):
        self.missions.destroy()
        self.vehicle.ends = True
        self.mavsdk.destroy()


def check(flight, differences):
    for autopilot, folder in [(PX4, "all"), (ARDUPILOT, "ardupilot"), (PX4, "absolute")]:
        client = Client(autopilot)
        for sortie in flight.files["sorties"]:
            text = flight.path(f"town-{sortie['number']}.plan", folder).read_text()
            imported = client.missions.import_qgroundcontrol_mission_from_string(text)
            # For ArduPilot the importer puts the take-off place before all items.
            items = imported.mission_items[1:] if autopilot == ARDUPILOT else imported.mission_items
            compared = check_items(flight, sortie, items, autopilot, folder, differences)
            check_json(flight, json.loads(text), len(items), folder, differences)
            differences.check(len(imported.geofence_items) == 3, f"geofence of {len(imported.geofence_items)} corners instead of 3")
            differences.check(len(imported.rally_items) == 1, f"{len(imported.rally_items)} rally points instead of one")
            client.missions.upload_mission(imported.mission_items)
            received = [client.vehicle.items[k] for k in sorted(client.vehicle.items)]
            check_uploaded(imported.mission_items, received, differences)
            print(f"  town-{sortie['number']}.plan ({folder}): {compared} waypoints of {len(items)} items, imported by MAVSDK and uploaded")
        client.close()
    client = Client(ARDUPILOT)
    for folder in ["all", "absolute"]:
        for sortie in flight.files["sorties"]:
            check_waypoints(flight, sortie, client, folder, differences)
    client.close()


def check_json(flight, plan, count, folder, differences):
    """What an importer passes over."""
    items = plan["mission"]["items"]
    differences.check(len(items) == count, f"{len(items)} items in the file, {count} imported")
    differences.check([item["doJumpId"] for item in items] == list(range(1, len(items) + 1)), "doJumpId does not count from 1")
    mode = 2 if folder == "absolute" else 1
    for item in items:
        keys = {"Altitude", "AltitudeMode", "AMSLAltAboveTerrain"} & item.keys()
        has_place = item["command"] in (TAKEOFF, WAYPOINT)
        differences.check(len(keys) == (3 if has_place else 0), f"item {item['doJumpId']} has the keys {keys}")
        differences.check(not has_place or item["AltitudeMode"] == mode, f"item {item['doJumpId']} has AltitudeMode {item.get('AltitudeMode')}")
    home = plan["mission"]["plannedHomePosition"]
    expected = flight.files["home"]
    differences.check(home == [expected["lat_deg"], expected["lon_deg"], expected["alt_m"]], f"home is {home} instead of {expected}")
    differences.check(plan["mission"]["firmwareType"] == (3 if folder == "ardupilot" else 12), "firmwareType")


def check_items(flight, sortie, items, autopilot, folder, differences):
    """A mission as it is carried out: what is set when each waypoint is reached."""
    is_absolute = folder == "absolute"
    lift_m = flight.files["home"]["alt_m"] if is_absolute else 0.0
    commands = [item.command for item in items]
    differences.check(commands[0] == TAKEOFF and commands[-1] == RTL, f"commands are {commands[0]}..{commands[-1]}")
    waypoints = [k for k, command in enumerate(commands) if command == WAYPOINT]
    expected = flight.sortie_waypoints(sortie)
    differences.check(len(waypoints) == len(expected) + 3, f"{len(waypoints)} waypoints instead of {len(expected)} and three in transit")
    for k in [0, waypoints[0], *waypoints[-2:]]:
        differences.near(items[k].z - lift_m, flight.files["transit_m"], 0.01, f"item {k}: height of transit")
    state, k = {}, 0
    for index, waypoint in expected:
        what = f"{folder}, waypoint {index}"
        position = waypoints[1 + index - expected[0][0]]
        for item in items[k:position]:
            state[item.command] = item
        k = position
        item = items[position]
        differences.check(item.frame == (0 if is_absolute else 3), f"{what}: frame {item.frame}")
        flight.compare_place(differences, item.x * 1e-7, item.y * 1e-7, item.z - lift_m, waypoint, what, tolerance_m=0.03)
        is_end = index in (sortie["first_waypoint"], sortie["last_waypoint"])
        differences.near(item.param2, 0.5 if is_end or waypoint["deviation_m"] == 0.0 else waypoint["deviation_m"], 1e-5, f"{what}: acceptance radius")
        differences.check(SPEED in state and state[SPEED].param1 == 1.0 and 0.0 < state[SPEED].param2 <= 30.0, f"{what}: no speed over the ground")
        view = flight.view(waypoint)
        if view is None:
            differences.check(GIMBAL not in state and MOUNT not in state, f"{what}: a gimbal is set")
            continue
        pitch = view[1]
        if autopilot == PX4:
            differences.near(state[GIMBAL].param1, pitch, 0.51, f"{what}: gimbal pitch")
            flight.compare_heading(differences, state[GIMBAL].param2, view, 0.51, f"{what}: gimbal yaw")
            differences.check(state[GIMBAL].x & 16 == 16, f"{what}: gimbal flags {state[GIMBAL].x}")
            flight.compare_heading(differences, item.param4, view, 0.01, f"{what}: heading")
        else:
            differences.near(state[MOUNT].param1, pitch, 0.51, f"{what}: mount pitch")
            differences.check(state[MOUNT].z == 2.0, f"{what}: mount mode {state[MOUNT].z}")
            flight.compare_heading(differences, state[YAW].param1, view, 0.51, f"{what}: yaw")
    triggers = [item for item in items if item.command == TRIGGER]
    differences.check(triggers and triggers[0].param1 > 0.0 and triggers[0].param3 == 1.0, "the sortie begins without a trigger")
    differences.check(triggers and triggers[-1].param1 == 0.0, "the trigger is not stopped")
    return len(expected)


def check_waypoints(flight, sortie, client, folder, differences):
    name = f"town-{sortie['number']}.waypoints"
    path = flight.path(name, folder)
    text = path.read_text()
    differences.check("nan" not in text.lower(), f"{name}: nan")
    rows = [line.split("\t") for line in text.splitlines()[1:]]
    differences.check(all(len(row) == 12 for row in rows), f"{name}: fields")
    decimals = min(len(row[column].split(".")[1]) for row in rows for column in (8, 9))
    differences.check(decimals >= 8, f"{name}: {decimals} decimals")
    loader = mavwp.MAVWPLoader()
    count = loader.load(str(path))
    # For ArduPilot the importer puts the take-off place before all rows, also before the one that the file has.
    imported = client.missions.import_mission_planner_mission_from_string(text).mission_items[1:]
    differences.check(count == len(imported) == len(rows), f"{name}: {count} items by pymavlink, {len(imported)} by MAVSDK, {len(rows)} rows")
    for k, item in enumerate(imported):
        other = loader.wp(k)
        pairs = [(item.command, other.command), (item.frame, other.frame), (item.param1, other.param1), (item.param2, other.param2)]
        pairs += [(item.param3, other.param3), (item.param4, other.param4), (item.z, other.z)]
        differences.check(all(math.isclose(a, b, rel_tol=1e-5, abs_tol=1e-5) for a, b in pairs), f"{name}: item {k}: {item} and {other}")
        if item.command in (TAKEOFF, WAYPOINT):
            differences.check(abs(item.x * 1e-7 - other.x) < 1.1e-7 and abs(item.y * 1e-7 - other.y) < 1.1e-7, f"{name}: item {k}: place")
    home = flight.files["home"]
    differences.near(loader.wp(0).x, home["lat_deg"], 1e-8, f"{name}: latitude of the take-off place")
    differences.near(loader.wp(0).y, home["lon_deg"], 1e-8, f"{name}: longitude of the take-off place")
    compared = check_items(flight, sortie, imported[1:], ARDUPILOT, folder, differences)
    print(f"  {name} ({folder}): {compared} waypoints of {count} items, by MAVSDK and pymavlink")


def check_uploaded(sent, received, differences):
    differences.check(len(sent) == len(received), f"{len(received)} of {len(sent)} items reached the vehicle")
    for k, (a, b) in enumerate(zip(sent, received)):
        same = (a.command, a.frame, a.x, a.y) == (b.command, b.frame, b.x, b.y)
        numbers = [(a.param1, b.param1), (a.param2, b.param2), (a.param3, b.param3), (a.param4, b.param4), (a.z, b.z)]
        equal = all(x == y or (math.isnan(x) and math.isnan(y)) for x, y in numbers)
        differences.check(same and equal, f"item {k} was uploaded as {b} instead of {a}")
