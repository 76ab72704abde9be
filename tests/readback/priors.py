"""What reconstruction software and maps read: COLMAP by pycolmap, PLY and GLB by plyfile and pygltflib, tables, KML and GeoJSON."""

import csv
import json
import math

import geojson
import numpy
import plyfile
import pycolmap
import pygltflib
from lxml import etree

from flights import angles

# The client rounds to six decimals where it is not told otherwise.
geojson.geometry.DEFAULT_PRECISION = 12

KML = {"k": "http://www.opengis.net/kml/2.2"}


def check(flight, differences):
    check_tables(flight, differences)
    check_maps(flight, differences)
    if flight.rig != "panoramic":
        check_colmap(flight, differences)
        check_footprints(flight, differences)
    check_coverage(flight, differences)


def check_colmap(flight, differences):
    model = pycolmap.Reconstruction()
    model.read_text(str(flight.path("town-colmap")))
    names = picture_names(flight)
    images = {image.name: image for image in model.images.values()}
    differences.check(sorted(images) == sorted(names), f"COLMAP has {len(images)} images instead of {len(names)}")
    for name, planned in zip(names, flight.plan["images"]):
        image = images[name]
        position = numpy.array(planned["position_m"])
        direction, up = numpy.array(planned["direction"]), numpy.array(planned["up"])
        differences.near(numpy.linalg.norm(image.projection_center() - position), 0.0, 1e-6, f"COLMAP, {name}: place")
        camera = model.cameras[image.camera_id]
        half = [math.tan(math.radians(fov) / 2.0) for fov in planned["fov_deg"]]
        right = numpy.cross(direction, up)
        # The middle and the upper right corner of the image.
        for u, v, pixel in [(0.0, 0.0, (camera.width / 2, camera.height / 2)), (half[0], half[1], (camera.width, 0))]:
            found = image.project_point(position + 30.0 * (direction + u * right + v * up))
            differences.check(found is not None and numpy.linalg.norm(numpy.array(found) - pixel) < 1e-3 * camera.width, f"COLMAP, {name}: {found} instead of {pixel}")
    print(f"  town-colmap: poses and pinholes of {len(names)} images in {len(model.cameras)} cameras, by pycolmap")


def picture_names(flight):
    counts, names = {}, []
    for image in flight.plan["images"]:
        counts[image["camera"]] = counts.get(image["camera"], 0) + 1
        names.append(f"{image['camera']}_{counts[image['camera']]:06}.jpg")
    return names


def check_tables(flight, differences):
    rows = list(csv.DictReader(flight.path("town-images.csv").open()))
    names = picture_names(flight)
    differences.check([row["image"] for row in rows] == names, "town-images.csv: names")
    for row, image in zip(rows, flight.plan["images"]):
        east, north = flight.enu(float(row["lat_deg"]), float(row["lon_deg"]))
        x, y, z = image["position_m"]
        differences.near(math.hypot(east - x, north - y), 0.0, 0.002, f"town-images.csv: place of {row['image']}")
        differences.near(float(row["z_m"]), z, 1e-3, f"town-images.csv: height of {row['image']}")
        differences.check(row["selected"] == str(int(image["selected"])), f"town-images.csv: selection of {row['image']}")
    waypoints = list(csv.DictReader(flight.path("town-waypoints.csv").open()))
    differences.check(len(waypoints) == len(flight.plan["waypoints"]), f"town-waypoints.csv: {len(waypoints)} rows")
    for name, label, axes in [("realitycapture", "#name", ("x", "y", "alt")), ("metashape", "label", ("longitude", "latitude", "altitude"))]:
        rows = list(csv.DictReader(flight.path(f"town-{name}.csv").open()))
        differences.check([row[label] for row in rows] == names, f"town-{name}.csv: names")
        for row, image in zip(rows, flight.plan["images"]):
            east, north = flight.enu(float(row[axes[1]]), float(row[axes[0]]))
            x, y, z = image["position_m"]
            differences.near(math.hypot(east - x, north - y), 0.0, 0.002, f"town-{name}.csv: place of {row[label]}")
            differences.near(float(row[axes[2]]) - flight.ground_m, z, 1e-3, f"town-{name}.csv: height of {row[label]}")
            if flight.rig == "panoramic":
                differences.check("yaw" not in row, f"town-{name}.csv: a panorama has no yaw")
                continue
            # Turned from straight down with the top of the image to the north: pitch about its right side, then yaw about the vertical.
            yaw, pitch = (math.radians(float(row[key])) for key in ("yaw", "pitch"))
            view = (math.sin(pitch) * math.sin(yaw), math.sin(pitch) * math.cos(yaw), -math.cos(pitch))
            top = (math.cos(pitch) * math.sin(yaw), math.cos(pitch) * math.cos(yaw), math.sin(pitch))
            differences.near(math.dist(view, image["direction"]), 0.0, 1e-4, f"town-{name}.csv: view of {row[label]}")
            differences.near(math.dist(top, image["up"]), 0.0, 1e-4, f"town-{name}.csv: top of {row[label]}")
    print(f"  tables, RealityCapture and Metashape: {len(names)} images each, {len(waypoints)} waypoints")


def check_maps(flight, differences):
    root = etree.fromstring(flight.path("town.kml").read_bytes())
    folders = root.findall(".//k:Folder", KML)
    counts = [len(folder.findall("k:Placemark", KML)) for folder in folders]
    differences.check(counts == [len(flight.plan["waypoints"]), len(flight.plan["images"])], f"town.kml: {counts} placemarks")
    for mark, waypoint in zip(folders[0].findall("k:Placemark", KML), flight.plan["waypoints"]):
        lon, lat, height = map(float, mark.find(".//k:coordinates", KML).text.split(","))
        east, north = flight.enu(lat, lon)
        x, y, z = waypoint["position_m"]
        differences.near(math.dist((east, north, height), (x, y, z)), 0.0, 0.003, f"town.kml: {mark.find('k:name', KML).text}")
    collection = geojson.loads(flight.path("town.geojson").read_text())
    differences.check(collection.is_valid, f"town.geojson: {collection.errors()}")
    kinds = [feature["properties"]["kind"] for feature in collection["features"]]
    differences.check(kinds.count("waypoint") == len(flight.plan["waypoints"]) and kinds.count("image") == len(flight.plan["images"]), "town.geojson: features")
    waypoints = [feature for feature in collection["features"] if feature["properties"]["kind"] == "waypoint"]
    for feature, waypoint in zip(waypoints, flight.plan["waypoints"]):
        lon, lat, alt = feature["geometry"]["coordinates"]
        east, north = flight.enu(lat, lon)
        differences.near(math.dist((east, north, alt - flight.ground_m), waypoint["position_m"]), 0.0, 0.003, f"town.geojson: waypoint {feature['properties']['waypoint']}")
        if waypoint["direction"]:
            differences.turned(feature["properties"]["azimuth_deg"], angles(waypoint["direction"])[0], 1e-6, "town.geojson: azimuth")
    print(f"  town.kml and town.geojson: {len(waypoints)} waypoints and {kinds.count('image')} images")


def check_footprints(flight, differences):
    collection = geojson.loads(flight.path("town-footprints.geojson").read_text())
    differences.check(len(collection["features"]) == len(flight.plan["images"]), "town-footprints.geojson: features")
    shown = 0
    for feature, image in zip(collection["features"], flight.plan["images"]):
        if feature["geometry"] is None:
            continue
        shown += 1
        polygon = geojson.Polygon(feature["geometry"]["coordinates"])
        differences.check(polygon.is_valid, f"town-footprints.geojson: {polygon.errors()}")
        direction, up = numpy.array(image["direction"]), numpy.array(image["up"])
        half = [math.tan(math.radians(fov) / 2.0) for fov in image["fov_deg"]]
        for lon, lat in feature["geometry"]["coordinates"][0]:
            to_corner = numpy.array([*flight.enu(lat, lon), 0.0]) - image["position_m"]
            depth = to_corner @ direction
            sides = [abs(to_corner @ numpy.cross(direction, up)) / half[0] / depth, abs(to_corner @ up) / half[1] / depth]
            differences.check(depth > 0.0 and max(sides) < 1.0 + 1e-4, f"{feature['properties']['name']}: a corner outside of the image")
            differences.check(feature["properties"]["clipped"] or max(sides) > 1.0 - 1e-3, f"{feature['properties']['name']}: a corner within the image")
    print(f"  town-footprints.geojson: {shown} of {len(collection['features'])} images show ground, each within its image")


def check_coverage(flight, differences):
    vertices = plyfile.PlyData.read(str(flight.path("town-coverage.ply")))["vertex"]
    captured = int(vertices["captured"].sum())
    differences.check(0 < captured < len(vertices.data), f"town-coverage.ply: {captured} of {len(vertices.data)} captured")
    normals = numpy.stack([vertices["nx"], vertices["ny"], vertices["nz"]], axis=1)
    differences.near(float(numpy.abs(numpy.linalg.norm(normals, axis=1) - 1.0).max()), 0.0, 1e-5, "town-coverage.ply: normals")
    model = pygltflib.GLTF2().load(str(flight.path("town-coverage.glb")))
    accessor = model.accessors[model.meshes[0].primitives[0].attributes.POSITION]
    view = model.bufferViews[accessor.bufferView]
    data = model.binary_blob()[view.byteOffset : view.byteOffset + view.byteLength]
    places = numpy.frombuffer(data, dtype="<f4").reshape(-1, 3)
    differences.check(len(places) == accessor.count == 6 * len(vertices.data), f"town-coverage.glb: {accessor.count} corners for {len(vertices.data)} samples")
    middles = places.reshape(-1, 6, 3).mean(axis=1)
    points = numpy.stack([vertices["x"], vertices["z"], -vertices["y"]], axis=1)
    differences.near(float(numpy.linalg.norm(middles - points, axis=1).max()), 0.02, 0.001, "town-coverage.glb: discs and points")
    differences.check(numpy.allclose(places.min(axis=0), accessor.min) and numpy.allclose(places.max(axis=0), accessor.max), "town-coverage.glb: bounds")
    print(f"  town-coverage: {captured} of {len(vertices.data)} samples captured, by plyfile and pygltflib")
