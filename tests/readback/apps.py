"""Missions for the drones' own apps: DJI's WPML read with djikmz, Litchi's CSV with litchi-wp."""

import contextlib
import io
import zipfile

import xmltodict
from djikmz.model.action_group import ActionGroup
from djikmz.model.kml import KML
from djikmz.model.waypoint import Waypoint as DjiWaypoint
from litchi_wp.waypoint import Waypoint as LitchiWaypoint
from lxml import etree

NAMES = {"k": "http://www.opengis.net/kml/2.2", "w": "http://www.dji.com/wpmz/1.0.2"}


def check(flight, differences):
    for sortie in flight.files["sorties"]:
        check_dji(flight, sortie, differences)
        check_litchi(flight, sortie, differences)


def check_dji(flight, sortie, differences):
    name = f"town-{sortie['number']}.kmz"
    archive = zipfile.ZipFile(flight.path(name))
    differences.check(archive.testzip() is None and archive.namelist() == ["wpmz/template.kml", "wpmz/waylines.wpml"], f"{name}: {archive.namelist()}")
    template, waylines = (archive.read(part) for part in archive.namelist())
    check_template(flight, sortie, template, name, differences)
    root = etree.fromstring(waylines)
    marks = root.findall(".//k:Placemark", NAMES)
    expected = flight.sortie_waypoints(sortie)
    differences.check(len(marks) == len(expected) + 2, f"{name}: {len(marks)} placemarks for {len(expected)} waypoints")
    points, dampings, groups = [], [], []
    parsed = xmltodict.parse(waylines, force_list=("Placemark", "wpml:actionGroup"))["kml"]["Document"]["Folder"]["Placemark"]
    for k, mark in enumerate(parsed):
        groups += mark.pop("wpml:actionGroup", [])
        read = DjiWaypoint.from_dict(mark)
        differences.check(read.waypoint_id == k, f"{name}: placemark {k} has the index {read.waypoint_id}")
        height = float(mark["wpml:executeHeight"])
        east, north = flight.enu(read.latitude, read.longitude)
        points.append((east, north, height))
        dampings.append(read.turn_param.waypoint_turn_damping_dist or 0.0)
        differences.check(0.0 < read.speed <= 15.0, f"{name}: speed {read.speed}")
        if 0 < k <= len(expected):
            index, waypoint = expected[k - 1]
            flight.compare_place(differences, read.latitude, read.longitude, height, waypoint, f"{name}: waypoint {index}", tolerance_m=0.002)
            view = flight.view(waypoint)
            if view is not None:
                flight.compare_heading(differences, read.heading_param.waypoint_heading_angle, view, 0.01, f"{name}: heading of waypoint {index}")
            else:
                differences.check(str(read.heading_param.waypoint_heading_mode) == "followWayline", f"{name}: heading of waypoint {index}")
        else:
            differences.near(height, flight.files["transit_m"], 0.01, f"{name}: height of transit")
    for k in range(len(points) - 1):
        leg = sum((a - b) ** 2 for a, b in zip(points[k], points[k + 1])) ** 0.5
        differences.check(leg > dampings[k] + dampings[k + 1], f"{name}: the leg of {leg} m from {k} has dampings {dampings[k]} and {dampings[k + 1]} m")
    ids = [int(group["wpml:actionGroupId"]) for group in groups]
    differences.check(ids == list(range(len(groups))), f"{name}: ids of action groups")
    # djikmz wants no group's id to exceed the index of its waypoint, of which DJI knows nothing.
    groups = [ActionGroup.from_dict({**group, "wpml:actionGroupId": "0"}) for group in groups]
    check_groups(flight, groups, expected, name, differences)
    print(f"  {name}: {len(expected)} waypoints and {len(groups)} action groups, by djikmz")


def check_groups(flight, groups, expected, name, differences):
    pitches, photographs = {}, 0
    for group in groups:
        for action in group.actions:
            kind = str(action.action_type)
            if kind == "gimbalRotate":
                pitches[group.start_waypoint_id] = action.gimbal_pitch_rotate_angle
            elif kind == "gimbalEvenlyRotate":
                pitches[group.end_waypoint_id] = action.pitch_rotate_angle
            elif kind == "takePhoto":
                photographs += 1
                differences.check(str(group.trigger.type) == "multipleDistance" and group.trigger.param > 0.0, f"{name}: trigger {group.trigger}")
    differences.check(photographs > 0, f"{name}: no photographs")
    pitch = None
    for k, (index, waypoint) in enumerate(expected):
        pitch = pitches.get(k + 1, pitches.get(0, pitch) if k == 0 else pitch)
        view = flight.view(waypoint)
        if view is None:
            differences.check(pitch is None, f"{name}: the gimbal is pitched at waypoint {index}")
        else:
            differences.near(pitch, view[1], 0.2, f"{name}: pitch at waypoint {index}")


def check_template(flight, sortie, template, name, differences):
    """djikmz has another name for `gimbalPitchMode` than DJI, and takes no more than one action group from a waypoint: these are looked at in the waylines."""
    root = etree.fromstring(template)
    for mark in root.findall(".//k:Placemark", NAMES):
        for group in mark.findall("w:actionGroup", NAMES):
            mark.remove(group)
    mode = root.find(".//w:gimbalPitchMode", NAMES)
    differences.check(mode is not None and mode.text == "usePointSetting", f"{name}: gimbalPitchMode")
    mode.tag = mode.tag.replace("gimbalPitchMode", "globalGimbalPitchMode")
    # djikmz prints what it reads.
    with contextlib.redirect_stdout(io.StringIO()):
        read = KML.from_xml(etree.tostring(root))
    expected = flight.sortie_waypoints(sortie)
    differences.check(len(read.waypoints) == len(expected) + 2, f"{name}: {len(read.waypoints)} waypoints in the template")
    for (index, waypoint), point in zip(expected, read.waypoints[1:]):
        flight.compare_place(differences, point.latitude, point.longitude, point.height, waypoint, f"{name}: template, waypoint {index}", tolerance_m=0.002)
        if flight.view(waypoint) is not None:
            differences.near(point.gimbal_pitch_angle, flight.view(waypoint)[1], 0.01, f"{name}: template, pitch of waypoint {index}")
    differences.check(str(read.mission_config.finish_action) == "goHome", f"{name}: finishAction")
    differences.near(read.mission_config.take_off_height, flight.files["transit_m"], 0.01, f"{name}: takeOffSecurityHeight")


def check_litchi(flight, sortie, differences):
    name = f"town-{sortie['number']}-litchi.csv"
    header, *lines = flight.path(name).read_text().splitlines()
    differences.check(len(header.split(",")) == 46, f"{name}: {len(header.split(','))} columns")
    expected = flight.sortie_waypoints(sortie)
    differences.check(len(lines) == len(expected) + 2, f"{name}: {len(lines)} rows for {len(expected)} waypoints")
    rows = [LitchiWaypoint.from_line(line) for line in lines]
    for (index, waypoint), row in zip(expected, rows[1:]):
        what = f"{name}: waypoint {index}"
        flight.compare_place(differences, row.lat, row.lon, row.altitude.value, waypoint, what, tolerance_m=0.002)
        differences.check(row.speed > 0.0, f"{what}: speed {row.speed}")
        view = flight.view(waypoint)
        differences.check(row.gimbal.mode.value == (2 if view else 0), f"{what}: gimbal mode {row.gimbal.mode}")
        if view:
            flight.compare_heading(differences, row.heading, view, 0.01, f"{what}: heading")
            differences.near(row.gimbal.pitchangle, view[1], 0.01, f"{what}: pitch")
    differences.check(any(row.photo.distance_interval > 0.0 for row in rows[1:-1]), f"{name}: no photographs")
    differences.check(rows[0].photo.distance_interval == rows[-1].photo.distance_interval == -1.0, f"{name}: photographs in transit")
    print(f"  {name}: {len(expected)} waypoints, by litchi-wp")
