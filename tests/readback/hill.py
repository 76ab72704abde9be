"""A flight over a hill: heights above the ground in every format that has them, held against the ground that the scene was made of.

The scene is a point cloud that is made here, so that the height of its ground is a formula. The program simplifies the ground; it says by how much at most.
"""

import json
import math
import struct
import zipfile

import numpy
import pyproj
from fastkml import kml
from fastkml.enums import AltitudeMode
from litchi_wp.waypoint import Waypoint as LitchiWaypoint
from lxml import etree
from pymavlink import mavwp

import missions
from flights import run

SIDE_M = 360.0
EAST, NORTH = 499400.0, 4797200.0
# The program's ground and the formula's differ by no more than this, m.
GROUND_TOLERANCE_M = 1.2
# An aircraft that keeps to its heights above this ground is no farther from the straight legs, m.
FOLLOW_TOLERANCE_M = 0.5 + 2 * GROUND_TOLERANCE_M
NAMES = {"k": "http://www.opengis.net/kml/2.2", "w": "http://www.dji.com/wpmz/1.0.2"}


def ground_m(east, north):
    """Above mean sea level: a round hill of 40 m in the middle of the scene."""
    share = math.hypot(east - EAST - SIDE_M / 2, north - NORTH - SIDE_M / 2) / 150.0
    return 20.0 + 40.0 * 0.5 * (1.0 + math.cos(math.pi * min(share, 1.0)))


def write_cloud(path):
    """LAS 1.2, format 1, in EPSG:25830: ground everywhere, and houses of 8 m on the slopes."""
    axis = numpy.arange(0.1, SIDE_M, 0.5)
    x, y = (grid.ravel() for grid in numpy.meshgrid(axis, axis))
    share = numpy.minimum(numpy.hypot(x - SIDE_M / 2, y - SIDE_M / 2) / 150.0, 1.0)
    z = 20.0 + 20.0 * (1.0 + numpy.cos(math.pi * share))
    roofs = []
    for west, south in [(90.0, 90.0), (230.0, 120.0), (160.0, 240.0)]:
        inside = (x > west) & (x < west + 20.0) & (y > south) & (y < south + 20.0)
        roofs.append(numpy.stack([x[inside], y[inside], numpy.full(inside.sum(), z[inside].max() + 8.0)]))
    is_house = numpy.repeat([False, True], [x.size, sum(roof.shape[1] for roof in roofs)])
    x, y, z = numpy.concatenate([numpy.stack([x, y, z]), *roofs], axis=1)
    points = numpy.zeros((x.size, 28), dtype=numpy.uint8)
    for axis_index, values in enumerate((x, y, z)):
        points[:, 4 * axis_index : 4 * axis_index + 4] = numpy.round(values * 1000.0).astype("<i4").view(numpy.uint8).reshape(-1, 4)
    points[:, 14], points[:, 15] = 0x11, numpy.where(is_house, 6, 2)
    keys = struct.pack("<16H", 1, 1, 0, 3, 1024, 0, 1, 1, 1025, 0, 1, 1, 3072, 0, 1, 25830)
    record = bytearray(54) + keys
    record[2:17], record[18:22] = b"LASF_Projection", struct.pack("<HH", 34735, len(keys))
    head = bytearray(227)
    head[:4], head[24], head[25], head[104] = b"LASF", 1, 2, 1
    head[94:104] = struct.pack("<HII", 227, 227 + len(record), 1)
    head[105:111] = struct.pack("<HI", 28, x.size)
    head[131:227] = struct.pack("<12d", 0.001, 0.001, 0.001, EAST, NORTH, 0.0, EAST + SIDE_M, EAST, NORTH + SIDE_M, NORTH, z.max(), z.min())
    path.write_bytes(bytes(head) + bytes(record) + points.tobytes())


class Hill:
    def __init__(self, binary, folder):
        self.folder = folder
        folder.mkdir(parents=True, exist_ok=True)
        write_cloud(folder / "hill.las")
        few = ["--samples", "200", "--viewpoints", "250", "--iterations", "5", "--rig", "phantom4-rtk"]
        run(binary, "plan", folder / "hill.las", *few, "--out", folder)
        self.plan = json.loads((folder / "plan.json").read_text())
        words = ["--to", "qgc", "--to", "ardupilot", "--to", "litchi", "--to", "dji", "--to", "kml"]
        altitude = ["--altitude", "terrain", "--autopilot", "ardupilot", "--sortie-time", "80000"]
        answer = run(binary, "export", folder / "plan.json", *words, *altitude, "--out", folder / "missions", "--json")
        self.answer = json.loads(answer)
        self.to_grid = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:25830", always_xy=True)
        self.zero_m = self.plan["scene"]["origin"]["alt_m"]

    def path(self, name):
        return self.folder / "missions" / name

    def ground_at(self, lat_deg, lon_deg):
        return ground_m(*self.to_grid.transform(lon_deg, lat_deg))

    def check(self, differences, lat_deg, lon_deg, above_ground_m, z_m, what):
        expected = self.zero_m + z_m - self.ground_at(lat_deg, lon_deg)
        differences.near(above_ground_m, expected, GROUND_TOLERANCE_M, f"{what}: height above the ground")


def check(binary, folder, differences):
    hill = Hill(binary, folder)
    waypoints = [waypoint["position_m"][2] for waypoint in hill.plan["waypoints"]]
    check_ardupilot(hill, differences)
    check_litchi(hill, waypoints, differences)
    check_dji(hill, waypoints, differences)
    check_kml(hill, waypoints, differences)
    differences.check(any("terrain data" in note for note in hill.answer["notes"]), f"no word on the aircraft's own terrain: {hill.answer['notes']}")


def check_ardupilot(hill, differences):
    name = "hill-1.waypoints"
    loader = mavwp.MAVWPLoader()
    items = [loader.wp(k) for k in range(loader.load(str(hill.path(name))))]
    client = missions.Client(missions.ARDUPILOT)
    imported = client.missions.import_mission_planner_mission_from_string(hill.path(name).read_text()).mission_items[1:]
    of_plan = client.missions.import_qgroundcontrol_mission_from_string(hill.path("hill-1.plan").read_text()).mission_items
    client.close()
    differences.check([item.frame for item in imported] == [item.frame for item in items], f"{name}: frames by MAVSDK and pymavlink")
    differences.check([item.frame for item in of_plan[1:]] == [item.frame for item in items[1:]], "hill-1.plan: frames by MAVSDK")
    places = [item for item in items[1:] if item.command == missions.WAYPOINT]
    level = [item for item in places if item.frame == 3]
    followed = [item for item in places if item.frame == 10]
    differences.check(len(level) + len(followed) == len(places) and len(level) >= 3, f"{name}: frames {sorted({item.frame for item in places})}")
    differences.check(items[1].command == missions.TAKEOFF and items[1].frame == 3, f"{name}: take-off in frame {items[1].frame}")
    # The aircraft that keeps to heights above this ground, against the straight legs of the plan: stop for stop, and all the way between.
    stops = hill.plan["waypoints"]
    found = check_followed(hill, [(item.x, item.y, item.z) for item in followed], 0.0, name, differences)
    differences.check(len(followed) > len(stops), f"{name}: {len(followed)} waypoints above the ground of {len(stops)}: the hill divides no leg")
    print(f"  {name}: {len(stops)} waypoints and {len(followed) - len(stops)} between them, no more than {found:.2f} m off the legs, by pymavlink and MAVSDK")


def check_followed(hill, places, corner_m, what, differences):
    """Places (latitude, longitude, height above the ground) lie on the path, at corners no farther from it than `corner_m`, and whoever
    follows the ground between them stays near the straight lines. Returns how far off these it comes."""
    found = 0
    for index, (lat, lon, above_m) in enumerate(places):
        off_m = distance_to_path(hill, lat, lon, above_m + hill.ground_at(lat, lon) - hill.zero_m)
        differences.check(off_m < GROUND_TOLERANCE_M + corner_m + 0.1, f"{what}: place {index} is {off_m:.2f} m off the path")
    for index, (before, after) in enumerate(zip(places, places[1:])):
        straight_m = [above_m + hill.ground_at(lat, lon) for lat, lon, above_m in (before, after)]
        for step in range(1, 20):
            share = step / 20
            lat, lon, above_m = (a + (b - a) * share for a, b in zip(before, after))
            off_m = above_m + hill.ground_at(lat, lon) - straight_m[0] - (straight_m[1] - straight_m[0]) * share
            differences.check(abs(off_m) < FOLLOW_TOLERANCE_M, f"{what}: behind place {index} it is {off_m:.2f} m off the leg")
            found = max(found, abs(off_m))
    return found


def distance_to_path(hill, lat_deg, lon_deg, z_m):
    origin = hill.plan["scene"]["origin"]
    east, north = hill.to_grid.transform(lon_deg, lat_deg)
    at = numpy.array([east, north, z_m])
    points = []
    for waypoint in hill.plan["waypoints"]:
        points.append(numpy.array([*to_grid_of(hill, origin, waypoint["position_m"])]))
    best = math.inf
    for a, b in zip(points, points[1:]):
        along = b - a
        share = min(max(float((at - a) @ along) / max(float(along @ along), 1e-12), 0.0), 1.0)
        best = min(best, float(numpy.linalg.norm(at - a - along * share)))
    return best


def to_grid_of(hill, origin, position_m):
    if not hasattr(hill, "from_enu"):
        hill.from_enu = pyproj.Transformer.from_pipeline(
            "+proj=pipeline +step +inv +proj=topocentric +ellps=WGS84 "
            f"+lon_0={origin['lon_deg']} +lat_0={origin['lat_deg']} +h_0={origin['alt_m']} +step +inv +proj=cart +ellps=WGS84 "
            "+step +proj=unitconvert +xy_in=rad +xy_out=deg"
        )
    lon, lat, _ = hill.from_enu.transform(*position_m)
    return (*hill.to_grid.transform(lon, lat), position_m[2])


def check_litchi(hill, waypoints, differences):
    name = "hill-1-litchi.csv"
    rows = [LitchiWaypoint.from_line(line) for line in hill.path(name).read_text().splitlines()[1:]]
    followed = [row for row in rows if row.altitude.mode.value == 1]
    differences.check(len(followed) == len(waypoints), f"{name}: {len(followed)} rows above the ground for {len(waypoints)} waypoints")
    for index, (row, z_m) in enumerate(zip(followed, waypoints)):
        hill.check(differences, row.lat, row.lon, row.altitude.value, z_m, f"{name}: waypoint {index}")
    print(f"  {name}: {len(followed)} waypoints above the ground, by litchi-wp")


def check_dji(hill, waypoints, differences):
    name = "hill-1.kmz"
    archive = zipfile.ZipFile(hill.path(name))
    template, waylines = (etree.fromstring(archive.read(f"wpmz/{part}")) for part in ("template.kml", "waylines.wpml"))
    differences.check(template.findtext(".//w:heightMode", None, NAMES) == "aboveGroundLevel", f"{name}: heightMode")
    differences.check(waylines.findtext(".//w:executeHeightMode", None, NAMES) == "relativeToStartPoint", f"{name}: executeHeightMode")
    marks = template.findall(".//k:Placemark", NAMES)
    flown = waylines.findall(".//k:Placemark", NAMES)
    home_m = hill.answer["home"]["alt_m"]
    counts = f"{len(marks)} placemarks in the template and {len(flown)} in the waylines for {len(waypoints)} waypoints"
    differences.check(len(marks) == len(flown) > len(waypoints), f"{name}: {counts}")
    for index, (mark, other) in enumerate(zip(marks, flown)):
        lon, lat = (float(part) for part in mark.findtext(".//k:coordinates", None, NAMES).split(","))
        above_ground, above_home = float(mark.findtext("w:height", None, NAMES)), float(other.findtext("w:executeHeight", None, NAMES))
        differences.near(above_ground + hill.ground_at(lat, lon), above_home + home_m, GROUND_TOLERANCE_M, f"{name}: placemark {index}")
    print(f"  {name}: {len(marks)} placemarks above the ground and above the take-off place, by lxml")


def check_kml(hill, waypoints, differences):
    document = kml.KML.parse(hill.path("hill.kml"))
    placemarks = {mark.name: mark for mark in walk(document) if isinstance(mark, kml.Placemark)}
    for index, z_m in enumerate(waypoints):
        mark = placemarks[f"waypoint {index}"]
        differences.check(mark.kml_geometry.altitude_mode == AltitudeMode.relative_to_ground, f"hill.kml: {mark.name}: altitude mode")
        lon, lat, height = mark.geometry.coords[0]
        hill.check(differences, lat, lon, height, z_m, f"hill.kml: {mark.name}")
    line = [(lat, lon, height) for lon, lat, height in placemarks["path"].geometry.coords]
    corner_m = max(waypoint["deviation_m"] for waypoint in hill.plan["waypoints"])
    found = check_followed(hill, line, corner_m, "hill.kml: path", differences)
    print(f"  hill.kml: {len(placemarks)} placemarks and a path of {len(line)} places, no more than {found:.2f} m off the legs, by fastkml")


def walk(element):
    for child in getattr(element, "features", []):
        yield child
        yield from walk(child)
