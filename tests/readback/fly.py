"""Uploads a plan with `overfly fly` to a vehicle that pymavlink plays, over a link with losses, and downloads it from there with MAVSDK: what MAVSDK
reads is compared with what `overfly fly --dry-run` says, item by item.

    python3 -m venv target/readback
    target/readback/bin/pip install -r tests/readback/requirements.txt
    target/readback/bin/python tests/readback/fly.py target/release/overfly

Prints what was compared, and ends with 1 when something differs or a client is missing.
"""

import argparse
import json
import math
import os
import pathlib
import random
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time

os.environ["MAVLINK20"] = "1"

# Messages that are lost on either way during the upload, of 1.
LOSS = 0.05
HOME = "52.0116,4.3571"
PATIENCE_S = 60


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


class Vehicle(threading.Thread):
    """The vehicle's side of the mission protocol, by pymavlink, towards one station."""

    def __init__(self, mavutil, port, autopilot, mission, loss):
        super().__init__(daemon=True)
        self.mavlink = mavutil.mavlink
        self.link = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}", source_system=1, source_component=1, dialect="ardupilotmega")
        self.autopilot = autopilot
        self.mission = mission
        self.random = random.Random(7)
        self.loss = loss
        self.wanted = None
        self.arriving = []
        self.partner = None
        self.asked = 0.0
        self.lost = 0
        self.is_ended = False

    def is_lost(self):
        is_lost = self.random.random() < self.loss
        self.lost += is_lost
        return is_lost

    def ask(self):
        self.asked = time.monotonic()
        if not self.is_lost():
            self.link.mav.mission_request_int_send(*self.partner, len(self.arriving), self.mavlink.MAV_MISSION_TYPE_MISSION)

    def confirm(self):
        if not self.is_lost():
            self.link.mav.mission_ack_send(*self.partner, self.mavlink.MAV_MISSION_ACCEPTED, self.mavlink.MAV_MISSION_TYPE_MISSION)

    def run(self):
        beat = 0.0
        while not self.is_ended:
            now = time.monotonic()
            if now - beat > 0.3:
                beat = now
                self.link.mav.heartbeat_send(self.mavlink.MAV_TYPE_QUADROTOR, self.autopilot, 0, 0, self.mavlink.MAV_STATE_STANDBY)
            if self.wanted is not None and now - self.asked > 0.25:
                self.ask()
            message = self.link.recv_match(blocking=True, timeout=0.02)
            if message is not None and not self.is_lost():
                self.hear(message)

    def hear(self, message):
        kind = message.get_type()
        partner = (message.get_srcSystem(), message.get_srcComponent())
        if kind == "MISSION_COUNT" and message.mission_type == 0:
            self.partner, self.wanted, self.arriving = partner, message.count, []
            self.ask()
        elif kind == "MISSION_ITEM_INT" and partner == self.partner:
            if self.wanted is None:
                self.confirm()
            elif message.seq == len(self.arriving):
                self.arriving.append(message)
                if len(self.arriving) < self.wanted:
                    self.ask()
                else:
                    self.mission[:] = self.arriving
                    self.wanted = None
                    self.confirm()
        elif kind == "MISSION_REQUEST_LIST":
            count = len(self.mission) if message.mission_type == 0 else 0
            self.link.mav.mission_count_send(*partner, count, message.mission_type)
        elif kind in ("MISSION_REQUEST_INT", "MISSION_REQUEST") and message.seq < len(self.mission):
            item = self.mission[message.seq]
            self.link.mav.mission_item_int_send(
                *partner, item.seq, item.frame, item.command, item.current, item.autocontinue,
                item.param1, item.param2, item.param3, item.param4, item.x, item.y, item.z, item.mission_type,
            )

    def end(self):
        self.is_ended = True
        self.join(5)
        self.link.close()


def overfly(binary, *words):
    done = subprocess.run([binary, *words, "--json"], capture_output=True, text=True, timeout=600)
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    if done.returncode != 0:
        sys.exit(f"ERROR: overfly {' '.join(words)}: {lines[-1:]} {done.stderr}")
    return lines


def single(value):
    """As a float of 32 bits; None for a number that is left to the autopilot."""
    return None if value is None or math.isnan(value) else struct.unpack("f", struct.pack("f", value))[0]


def row(command, frame, params, x, y, z):
    return (command, frame, tuple(single(param) for param in params), x, y, single(z))


def compare(what, expected, found):
    if len(expected) != len(found):
        return [f"{what}: {len(found)} items instead of {len(expected)}"]
    pairs = enumerate(zip(expected, found))
    return [f"{what}: item {seq} is {got} instead of {wanted}" for seq, (wanted, got) in pairs if wanted != got]


def of_wire(item):
    params = [item.param1, item.param2, item.param3, item.param4]
    return row(item.command, item.frame, params, item.x, item.y, item.z)


def downloaded(mission, autopilot, mavutil):
    """The mission as MAVSDK reads it from a vehicle that has it."""
    import mavsdk
    from mavsdk.plugins.mission_raw import MissionRaw

    port = free_port()
    vehicle = Vehicle(mavutil, port, autopilot, mission, 0.0)
    vehicle.start()
    station = mavsdk.Mavsdk(mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION))
    try:
        station.add_any_connection(f"udpin://127.0.0.1:{port}")
        system = station.first_autopilot(15.0)
        if system is None:
            sys.exit("ERROR: MAVSDK does not find the vehicle")
        items = MissionRaw(system).download_mission()
        items = items[1] if isinstance(items, tuple) else items
        return [of_wire(item) for item in items]
    finally:
        station.destroy()
        vehicle.end()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("binary", type=pathlib.Path, help="the program under test")
    binary = str(parser.parse_args().binary.resolve())
    try:
        import mavsdk  # noqa: F401
        from pymavlink import mavutil
    except ImportError as error:
        sys.exit(f"ERROR: {error}; install the clients with `pip install pymavlink mavsdk`")
    kinds = {"px4": mavutil.mavlink.MAV_AUTOPILOT_PX4, "ardupilot": mavutil.mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA}
    differences = []
    with tempfile.TemporaryDirectory() as folder:
        town, out = os.path.join(folder, "town.geojson"), os.path.join(folder, "flight")
        overfly(binary, "generate", "--seed", "7", "--extent", "130,130", "--buildings", "9", "--out", town)
        sizes = ["--samples", "150", "--viewpoints", "200", "--iterations", "10"]
        overfly(binary, "plan", town, "--rig", "phantom4-rtk", "--out", out, *sizes)
        plan = os.path.join(out, "plan.json")
        for name, autopilot in kinds.items():
            options = ["--home", HOME, "--sortie-time", "3000"]
            shown = overfly(binary, "fly", plan, "--dry-run", "--autopilot", name, *options)[0]["items"]
            expected = [row(item["command"], item["frame"], item["params"], item["x"], item["y"], item["z"]) for item in shown]
            mission, port = [], free_port()
            vehicle = Vehicle(mavutil, port, autopilot, mission, LOSS)
            vehicle.start()
            try:
                lines = overfly(binary, "fly", plan, "--link", f"udpin:127.0.0.1:{port}", "--upload-only", "--wait", "20", *options)
            finally:
                vehicle.end()
            events = [line["event"] for line in lines]
            if events[-1] != "uploaded_only" or lines[0].get("autopilot") != name:
                differences.append(f"{name}: {events}")
            differences += compare(f"{name}, pymavlink", expected, [of_wire(item) for item in mission])
            differences += compare(f"{name}, MAVSDK", expected, downloaded(mission, autopilot, mavutil))
            print(f"{name}: {len(expected)} items by pymavlink ({vehicle.lost} messages lost) and by MAVSDK")
    for difference in differences:
        print("DIFFERS:", difference)
    sys.exit(1 if differences else 0)


if __name__ == "__main__":
    main()
