"""Opens pages of plans in a browser and holds them to what they promise.

    python check.py target/release/overfly
"""

import io
import json
import os
import sys
import traceback
from pathlib import Path

from axe_playwright_python.sync_playwright import Axe
from PIL import Image

from browser import Program, Shown, browser

CAPTURED = (38, 115, 178)


def make_pages(program):
    """A block and its plan by one camera; the same after three edits; a plan without its scene."""
    program.run("generate", "--seed", 3, "--extent", "160,160", "--buildings", 14, "--out", "block.geojson")
    block = json.loads((program.folder / "block.geojson").read_text())
    names = [feature["properties"]["id"] for feature in block["features"]]
    block["features"][0]["properties"]["height"] += 12
    block["features"].pop(1)
    block["features"].append(json.loads(json.dumps(block["features"][3])))
    block["features"][-1]["properties"]["id"] = "shed"
    ring = block["features"][-1]["geometry"]["coordinates"][0]
    block["features"][-1]["geometry"]["coordinates"][0] = [[lon + 0.0031, lat] for lon, lat, *_ in ring]
    (program.folder / "edited.geojson").write_text(json.dumps(block))
    size = ["--rig", "phantom4-rtk", "--samples", 500, "--viewpoints", 500, "--iterations", 4]
    plan = program.run("plan", "block.geojson", *size, "--out", "before")
    program.run("plan", "edited.geojson", *size, "--out", "after")
    compared = program.run("view", "after/plan.json", "before/plan.json", "--no-open")["files"]
    assert compared == ["after/plan-vs-before.html"], compared
    (program.folder / "alone").mkdir()
    (program.folder / "alone/plan.json").write_bytes((program.folder / "before/plan.json").read_bytes())
    program.run("view", "alone/plan.json", "--no-open")
    return {"plan": plan, "first": names[0], "count": len(names)}


def it_loads_from_a_file_and_asks_for_nothing(running, folder, made):
    shown = Shown(running, folder / "before/plan.html")
    shown.settle()
    state = shown.state()
    assert shown.complaints == [], shown.complaints
    assert shown.requests == [shown.file] or set(shown.requests) <= {shown.file, "data:,"}, shown.requests
    assert state["has_picture"] and state["structures"] == made["count"], state
    assert abs(state["duration_s"] - made["plan"]["profile_s"]) < 0.05
    heading = shown.page.inner_text("#figures")
    assert f"{made['plan']['coverage_percent']:.1f} %" in heading and f"{made['plan']['images']}" in heading, heading
    shown.close()


def an_idle_page_draws_nothing(running, folder, made):
    shown = Shown(running, folder / "before/plan.html")
    shown.page.wait_for_timeout(400)
    before = shown.state()["frames"]
    shown.page.wait_for_timeout(900)
    assert shown.state()["frames"] == before
    shown.page.evaluate("overfly.look({ ...overfly.view(), azimuth: 100 })")
    shown.settle()
    assert shown.state()["frames"] > before
    shown.close()


def the_slider_moves_the_drone_along_the_plan(running, folder, made):
    shown = Shown(running, folder / "before/plan.html")
    plan = json.loads((folder / "before/plan.json").read_text())
    for row in plan["trajectory"][:: max(1, len(plan["trajectory"]) // 7)]:
        time_s = round(row["time_s"], 1)
        shown.page.evaluate("(time) => { slider.value = time; slider.dispatchEvent(new Event('input')); }", time_s)
        state = shown.state()
        apart = sum((a - b) ** 2 for a, b in zip(state["drone_m"], row["position_m"])) ** 0.5
        assert abs(state["time_s"] - time_s) < 0.051 and apart < 1.0, (state, row)
    last = next(image for image in reversed(plan["images"]) if image["time_s"] <= state["time_s"] + 0.01)
    assert abs(plan["images"][state["images"][-1]]["time_s"] - last["time_s"]) < 0.01
    shown.press("End")
    state = shown.state()
    assert abs(state["captured_percent"] - plan["metrics"]["coverage_percent"]) < 1e-4, state
    shown.press("Home")
    assert shown.state()["captured_percent"] < 20
    shown.close()


def the_keyboard_reaches_time_and_camera(running, folder, made):
    shown = Shown(running, folder / "before/plan.html", reduced_motion="no-preference")
    shown.press("Home", "ArrowRight", "ArrowRight", "Shift+ArrowRight")
    assert abs(shown.state()["time_s"] - 12) < 0.2, shown.state()
    shown.press("]")
    at = shown.state()
    assert at["time_s"] > 12 and at["images"], at
    shown.press("Space")
    assert shown.state()["is_playing"] and shown.state()["coverage"] == "now"
    shown.page.wait_for_timeout(500)
    shown.press("Space")
    later = shown.state()
    assert not later["is_playing"] and later["time_s"] > at["time_s"] + 1, later
    modes = []
    for _ in range(3):
        shown.press("c")
        modes.append(shown.state()["coverage"])
    assert sorted(modes) == ["final", "now", "off"], modes
    shown.press("f")
    assert shown.state()["frusta"] == "all"
    shown.page.focus("#canvas")
    before = shown.page.evaluate("overfly.view()")
    shown.press("ArrowLeft", "ArrowUp", "+")
    after = shown.page.evaluate("overfly.view()")
    assert after["azimuth"] > before["azimuth"] + 3 and after["elevation"] > before["elevation"] + 2, (before, after)
    assert after["distance"] < before["distance"] and shown.state()["time_s"] == later["time_s"]
    # Everything that can be used is reached by the tabulator key.
    shown.page.evaluate("document.activeElement.blur()")
    reached = set()
    for _ in range(60):
        shown.press("Tab")
        reached.add(shown.page.evaluate("document.activeElement.id || document.activeElement.name || document.activeElement.dataset.layer || document.activeElement.tagName"))
    for wanted in ["canvas", "home", "measure", "theme", "coverage", "colour", "frusta", "play", "slider", "rate", "SUMMARY"]:
        assert wanted in reached, (wanted, reached)
    shown.close()


def charts_jump(running, folder, made):
    shown = Shown(running, folder / "before/plan.html")
    box = shown.page.locator("#charts").bounding_box()
    shown.page.mouse.click(box["x"] + 96 + (box["width"] - 96 - 62) / 2, box["y"] + 20)
    state = shown.state()
    assert abs(state["time_s"] - state["duration_s"] / 2) < 0.02 * state["duration_s"], state
    shown.close()


def structures_tell_of_themselves_and_places_are_measured(running, folder, made):
    shown = Shown(running, folder / "before/plan.html")
    shown.page.evaluate("overfly.onPick((picked) => { window.pickedNow = picked; })")
    target = shown.page.evaluate(
        "(name) => { const all = JSON.parse(document.getElementById('data').textContent).scenes[0].structures; return all.find((one) => one.name === name); }",
        made["first"],
    )
    spot = shown.page.evaluate(
        """(id) => {
            const stage = overfly.stage();
            for (let y = 40; y < stage.canvas.clientHeight; y += 9) {
                for (let x = 20; x < stage.canvas.clientWidth - 250; x += 9) {
                    if (overfly.at(x, y)?.structure?.id === id) return [x, y];
                }
            }
            return null;
        }""",
        target["id"],
    )
    assert spot, "the first structure is to be seen"
    canvas = shown.page.locator("#canvas").bounding_box()
    shown.page.mouse.move(canvas["x"] + spot[0], canvas["y"] + spot[1])
    shown.settle()
    shown.settle()
    tip = shown.page.inner_text("#tip")
    height = target["top_m"] - target["base_m"]
    assert made["first"] in tip and f"{height:.1f} m tall" in tip and "from the drone" in tip and "% captured" in tip, tip
    # No structure is nearer to the path than the plan says, and one of them is as near, but for what stands on the ground.
    nearest = shown.page.evaluate("overfly.nearest()")
    clearance = made["plan"]["clearance_m"]
    assert clearance - 0.02 < nearest, (nearest, clearance)
    shown.page.mouse.click(canvas["x"] + spot[0], canvas["y"] + spot[1])
    assert shown.page.evaluate("pickedNow.id") == target["id"] and shown.state()["picked"] == target["id"]
    shown.press("m")
    shown.page.mouse.click(canvas["x"] + spot[0], canvas["y"] + spot[1])
    shown.page.mouse.click(canvas["x"] + 30, canvas["y"] + canvas["height"] - 120)
    measured = shown.state()["measured"]
    assert measured and abs(measured["horizontal"] ** 2 + measured["vertical"] ** 2 - measured["distance"] ** 2) < 1e-3, measured
    assert "apart" in shown.page.inner_text("#say")
    assert shown.complaints == [], shown.complaints
    shown.close()


def two_plans_are_compared(running, folder, made):
    shown = Shown(running, folder / "after/plan-vs-before.html")
    assert shown.state()["plan"] == "both" and shown.state()["coverage"] == "difference"
    text = shown.page.inner_text("#compare")
    assert "1 new, 1 gone, 1 changed" in text, text
    for row in ["Captured", "Length", "Time", "Images", "Only this one"]:
        assert row in text, (row, text)
    ends = []
    for _ in range(2):
        shown.press("a")
        shown.press("End")
        ends.append((shown.state()["plan"], shown.state()["drone_m"], shown.state()["structures"]))
    assert [end[0] for end in ends] == [0, 1] and ends[0][1] != ends[1][1], ends
    shown.page.check("#plan-both", force=True)
    assert shown.state()["plan"] == "both" and shown.complaints == [], shown.complaints
    shown.close()


def new_data_keep_camera_and_time(running, folder, made):
    shown = Shown(running, folder / "before/plan.html")
    shown.press("End", "ArrowLeft")
    shown.page.evaluate("overfly.look({ ...overfly.view(), azimuth: 77 })")
    other = (folder / "after/plan.html").read_text().split('<script id="data" type="application/json">')[1].split("</script>")[0]
    before = shown.state()
    shown.page.evaluate("(text) => overfly.show(JSON.parse(text))", other)
    after = shown.state()
    assert abs(after["time_s"] / after["duration_s"] - before["time_s"] / before["duration_s"]) < 0.01
    assert after["duration_s"] != before["duration_s"]
    assert abs(shown.page.evaluate("overfly.view().azimuth") - 77) < 0.1 and shown.complaints == []
    held = lambda: shown.page.evaluate("overfly.stage().renderer.info.memory.geometries")
    shown.settle()
    before = held()
    for _ in range(4):
        shown.page.evaluate("(text) => overfly.show(JSON.parse(text))", other)
        shown.settle()
    assert held() == before, (before, held(), "what was shown before is freed")
    shown.close()


def a_plan_without_its_scene_says_so(running, folder, made):
    shown = Shown(running, folder / "alone/plan.html")
    shown.settle()
    assert "--scene" in shown.page.inner_text("#notes") and shown.state()["coverage"] == "off"
    assert shown.complaints == [], shown.complaints
    shown.close()


def light_and_dark_follow_the_system_and_the_switch(running, folder, made):
    paper = {}
    for scheme in ["light", "dark"]:
        shown = Shown(running, folder / "before/plan.html", color_scheme=scheme)
        assert shown.state()["theme"] == scheme
        paper[scheme] = shown.page.evaluate("getComputedStyle(document.body).backgroundColor")
        shown.press("t")
        assert shown.state()["theme"] != scheme
        shown.close()
    assert paper["light"] != paper["dark"]


def little_motion_is_respected(running, folder, made):
    shown = Shown(running, folder / "before/plan.html", reduced_motion="reduce")
    shown.press("Space")
    shown.page.wait_for_timeout(400)
    assert shown.state()["time_s"] == 0
    shown.page.wait_for_timeout(1100)
    assert shown.state()["time_s"] >= 19
    shown.close()


def nobody_is_kept_out(running, folder, made):
    for file, scheme in [("before/plan.html", "light"), ("after/plan-vs-before.html", "dark")]:
        shown = Shown(running, folder / file, color_scheme=scheme)
        shown.page.evaluate("document.getElementById('structures-table').open = true")
        shown.settle()
        found = Axe().run(shown.page).response["violations"]
        grave = [(one["id"], [node["html"][:120] for node in one["nodes"]][:4]) for one in found if one["impact"] in ("serious", "critical")]
        assert grave == [], (file, grave)
        shown.close()


def the_picture_shows_town_path_and_sky(running, folder, made):
    shown = Shown(running, folder / "before/plan.html", color_scheme="light")
    shown.settle()
    picture = Image.open(io.BytesIO(shown.page.locator("#canvas").screenshot())).convert("RGB")
    width, height = picture.size
    seen = picture.crop((0, 0, width - 240, height))
    pixels = list(zip(*[iter(seen.tobytes())] * 3))
    share = lambda holds: sum(map(holds, pixels)) / len(pixels)
    near = lambda pixel, colour: max(abs(a - b) for a, b in zip(pixel, colour)) < 14
    assert len(set(pixels)) > 300, "it is not blank"
    assert 0.01 < share(lambda pixel: near(pixel, CAPTURED)) < 0.5, "captured surface"
    assert 0.002 < share(lambda pixel: pixel[0] > 210 and pixel[2] < 120 and pixel[1] < 190), "path"
    walls = lambda pixel: max(pixel) - min(pixel) < 22 and pixel[0] >= pixel[2] and 120 < pixel[0] < 226
    assert 0.02 < share(walls), "buildings"
    top = seen.crop((0, 0, seen.width, 8)).resize((1, 1)).getpixel((0, 0))
    assert top[2] > top[0] + 8, f"sky: {top}"
    shown.close()


def it_works_on_a_narrow_screen(running, folder, made):
    shown = Shown(running, folder / "before/plan.html", size=(390, 780))
    assert shown.page.evaluate("document.documentElement.scrollWidth <= innerWidth + 1"), "nothing sticks out"
    shown.close()


def without_webgl_charts_and_table_are_left(folder, made):
    with browser(draws=False) as running:
        shown = Shown(running, folder / "before/plan.html")
        assert not shown.state()["has_picture"]
        assert shown.page.is_visible("#fallback") and "hardware acceleration" in shown.page.inner_text("#fallback")
        shown.press("End")
        assert shown.state()["captured_percent"] > 20
        assert shown.page.locator("#charts path.line").count() == 3
        assert shown.page.locator("#structures-table tbody tr").count() == made["count"]
        found = Axe().run(shown.page).response["violations"]
        assert not [one["id"] for one in found if one["impact"] in ("serious", "critical")]
        shown.close()


def a_real_town_is_small_and_soon_there(running, program):
    scenes = Path(os.environ.get("OVERFLY_SCENES", Path(__file__).parents[3] / "shared/scenes")).resolve()
    scene = scenes / "delfshaven/delfshaven.city.json"
    if not scene.is_file():
        print(f"skipped: no real scene at {scene} (set OVERFLY_SCENES)")
        return
    program.run("plan", scene, "--iterations", 6, "--out", "delfshaven")
    file = program.folder / "delfshaven/plan.html"
    assert file.stat().st_size < 3_000_000, file.stat().st_size
    times = []
    for _ in range(3):
        shown = Shown(running, file)
        times.append(shown.state()["first_frame_ms"])
        shown.close()
    print(f"delfshaven: {file.stat().st_size / 1e6:.2f} MB, first frame after {min(times):.0f} ms (of {', '.join(f'{time:.0f}' for time in times)})")
    # Interactive within a second is the goal, which a busy machine misses; a page that takes five has something wrong with it.
    assert min(times) < 5000, times


CHECKS = [
    it_loads_from_a_file_and_asks_for_nothing,
    an_idle_page_draws_nothing,
    the_slider_moves_the_drone_along_the_plan,
    the_keyboard_reaches_time_and_camera,
    charts_jump,
    structures_tell_of_themselves_and_places_are_measured,
    two_plans_are_compared,
    new_data_keep_camera_and_time,
    a_plan_without_its_scene_says_so,
    light_and_dark_follow_the_system_and_the_switch,
    little_motion_is_respected,
    nobody_is_kept_out,
    the_picture_shows_town_path_and_sky,
    it_works_on_a_narrow_screen,
]


def main():
    program = Program(sys.argv[1])
    made = make_pages(program)
    failed = 0

    def check(name, *arguments):
        nonlocal failed
        try:
            globals()[name](*arguments)
            print(f"ok: {name.replace('_', ' ')}")
        except Exception:  # noqa: BLE001 (a check that fails must not hide the others)
            failed += 1
            print(f"FAILED: {name.replace('_', ' ')}")
            traceback.print_exc()

    with browser() as running:
        for one in CHECKS:
            check(one.__name__, running, program.folder, made)
        check("a_real_town_is_small_and_soon_there", running, program)
    check("without_webgl_charts_and_table_are_left", program.folder, made)
    program.close()
    print(f"{len(CHECKS) + 2 - failed} passed, {failed} failed")
    sys.exit(1 if failed else 0)


main()
