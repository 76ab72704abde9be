"""Plans made with the program under test, and what their files must say.

Places are brought back into the plan's local frame with PROJ, which is not what the program uses.
"""

import json
import math
import subprocess

import pyproj

RIGS = ["phantom4-rtk", "m300-oblique", "panoramic"]
# A no-fly zone well beside the block: it must become a geofence. Few samples: the coverage models are looked at for their form.
SETTINGS = """
[quality]
samples = 400
[[flight.no_fly]]
name = "aside"
outline_m = [[400.0, 400.0], [450.0, 400.0], [450.0, 450.0]]
floor_m = 0.0
ceiling_m = 500.0
"""


GROUND_M = 12.5


class Differences:
    """What was compared, and what did not agree."""

    def __init__(self):
        self.found = 0

    def check(self, holds, what):
        if not holds:
            self.found += 1
            print(f"  DIFFERENCE: {what}")

    def near(self, found, expected, tolerance, what):
        self.check(abs(found - expected) <= tolerance, f"{what}: {found} instead of {expected} (+- {tolerance})")

    def turned(self, found_deg, expected_deg, tolerance_deg, what):
        turn = (found_deg - expected_deg + 540.0) % 360.0 - 180.0
        self.check(abs(turn) <= tolerance_deg, f"{what}: {found_deg} instead of {expected_deg} degrees")


class Flight:
    """A plan, its exports, and its waypoints as the files must have them."""

    def __init__(self, binary, folder, rig):
        self.binary, self.folder, self.rig = binary, folder / rig, rig
        scene, settings = folder / "town.geojson", folder / "settings.toml"
        if not scene.exists():
            settings.write_text(SETTINGS)
            run(binary, "generate", "--seed", "7", "--extent", "150,150", "--buildings", "12", "--out", scene)
            # Ground above zero, so that relative and absolute heights differ.
            town = json.loads(scene.read_text())
            town["overfly_origin"]["alt_m"] = GROUND_M
            scene.write_text(json.dumps(town))
        few = ["--samples", "200", "--viewpoints", "250", "--iterations", "5", "--config", settings]
        run(binary, "plan", scene, "--rig", rig, *few, "--out", self.folder)
        self.plan = json.loads((self.folder / "plan.json").read_text())
        origin = self.plan["scene"]["origin"]
        self.ground_m = origin["alt_m"]
        if self.ground_m != GROUND_M:
            raise SystemExit(f"ERROR: the plan's ground lies at {self.ground_m} m and not at {GROUND_M} m as that of its scene")
        self.to_enu = pyproj.Transformer.from_pipeline(
            "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84 +step +proj=topocentric +ellps=WGS84 "
            f"+lon_0={origin['lon_deg']} +lat_0={origin['lat_deg']} +h_0={origin['alt_m']}"
        )
        # One sortie tells how long two have to be.
        whole = self.export("whole", "--to", "csv", "--to", "qgc")
        most = sum(sortie["duration_s"] for sortie in whole["sorties"])
        self.sortie_s = 0.7 * most
        self.files = self.export("all", "--to", "all", "--sortie-time", str(self.sortie_s))
        self.ardupilot = self.export("ardupilot", "--to", "qgc", "--autopilot", "ardupilot", "--sortie-time", str(self.sortie_s))
        self.absolute = self.export("absolute", "--to", "qgc", "--to", "ardupilot", "--altitude", "absolute", "--sortie-time", str(self.sortie_s))

    def export(self, name, *words):
        settings = self.folder.parent / "settings.toml"
        folder = self.folder / name
        return json.loads(run(self.binary, "export", self.folder / "plan.json", "--out", folder, "--config", settings, *words, "--json"))

    def path(self, name, folder="all"):
        return self.folder / folder / name

    def enu(self, lat_deg, lon_deg):
        """East and north in the plan's local frame."""
        east, north, _ = self.to_enu.transform(lon_deg, lat_deg, self.ground_m)
        return east, north

    def sortie_waypoints(self, sortie):
        first, last = sortie["first_waypoint"], sortie["last_waypoint"]
        return list(enumerate(self.plan["waypoints"]))[first : last + 1]

    def takeoff_z_m(self):
        return self.files["home"]["alt_m"] - self.ground_m

    def height_m(self, waypoint):
        """Above the take-off place."""
        return waypoint["position_m"][2] - self.takeoff_z_m()

    def view(self, waypoint):
        """Azimuth and pitch of a camera on a gimbal, degrees; None for other rigs."""
        if self.rig != "phantom4-rtk":
            return None
        return angles(waypoint["direction"])

    def compare_heading(self, differences, found_deg, view, tolerance_deg, what):
        # Straight down every heading will do.
        if view[1] > -89.9:
            differences.turned(found_deg, view[0], tolerance_deg, what)

    def compare_place(self, differences, lat_deg, lon_deg, height_m, waypoint, what, tolerance_m=0.02):
        east, north = self.enu(lat_deg, lon_deg)
        x, y, _ = waypoint["position_m"]
        differences.near(math.hypot(east - x, north - y), 0.0, tolerance_m, f"{what}: distance on the ground")
        differences.near(height_m, self.height_m(waypoint), 0.01, f"{what}: height")


def angles(direction):
    x, y, z = direction
    return math.degrees(math.atan2(x, y)) % 360.0, math.degrees(math.atan2(z, math.hypot(x, y)))


def run(binary, *words):
    done = subprocess.run([str(binary), *map(str, words)], capture_output=True, text=True)
    if done.returncode != 0:
        raise SystemExit(f"ERROR: {binary} {' '.join(map(str, words))} ended with {done.returncode}: {done.stdout}{done.stderr}")
    return done.stdout
