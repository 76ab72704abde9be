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
# A real town can be looked at after that.
GOAL_MS = 1000


class Skipped(Exception):
    """What a check needs is not there."""


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
    program.run("view", "before/plan.json", "before/plan.json", "--no-open", "--out", "same.html")
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
    plan = json.loads((folder / "before/plan.json").read_text())
    lowest = min(row["position_m"][2] for row in plan["trajectory"])
    # Distances are taken every two metres of the path.
    assert min(nearest, lowest) < clearance + 0.3, (nearest, lowest, clearance)
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


# Samples of the shown plan, and those that only A and only B captures.
DIFFERING = """() => {
    const found = { A: 0, B: 0, all: 0 };
    overfly.stage().scene.traverse((part) => part.geometry?.attributes.shares?.array.forEach((value, k) => {
        if (k % 12 !== 2) return;
        found.all += 1;
        if (value !== 0) found[value > 0 ? 'A' : 'B'] += 1;
    }));
    return found;
}"""


def colours_and_words_mean_the_same_whichever_plan_is_shown(running, folder, made):
    shown = Shown(running, folder / "after/plan-vs-before.html")
    told, only = [], []
    for _ in range(2):
        shown.press("a")
        shown.settle()
        words = shown.page.evaluate("[...document.querySelectorAll('#overlay .changed')].map((label) => label.textContent).sort()")
        told.append((words, shown.page.inner_text("#coverage-legend")))
        only.append(shown.page.evaluate(DIFFERING)["BA"[len(only) == 0]])
    assert told[0] == told[1] and any("shed: new" in word for word in told[0][0]), told
    assert min(only) > 0, only
    shown.close()


def plans_that_capture_the_same_do_not_differ(running, folder, made):
    shown = Shown(running, folder / "same.html")
    rows = shown.page.inner_text("#compare")
    assert "Only this one" in rows and rows.count("0 m²") == 2, rows
    shown.close()
    # An edit changes what is seen around it, and not the rest of the town.
    shown = Shown(running, folder / "after/plan-vs-before.html")
    shown.press("a")
    found = shown.page.evaluate(DIFFERING)
    assert 0 < found["A"] + found["B"] < 0.5 * found["all"], found
    shown.close()


def a_picked_structure_stays_picked_while_it_is_there(running, folder, made):
    shown = Shown(running, folder / "before/plan.html")
    shown.page.evaluate("window.whole = JSON.parse(document.getElementById('data').textContent)")
    # The last one, so that what is left has no structure with its number.
    last = shown.page.evaluate("overfly.pick(whole.scenes[0].structures.at(-1).id), overfly.state().picked")
    assert last and shown.page.evaluate("whole.scenes[0].structures.at(-1).name") in shown.page.inner_text("#where")
    shown.page.evaluate(
        """() => {
            const less = structuredClone(whole);
            const gone = less.scenes[0].structures.pop();
            const bytes = (text) => Uint8Array.from(atob(text), (one) => one.charCodeAt(0));
            less.scenes[0].triangles = btoa(String.fromCharCode(...bytes(less.scenes[0].triangles).slice(0, -12 * gone.triangles)));
            overfly.show(less);
        }"""
    )
    assert shown.state()["picked"] is None and shown.state()["structures"] == made["count"] - 1
    shown.page.evaluate("overfly.show(whole)")
    assert shown.state()["picked"] == last and shown.complaints == [], shown.complaints
    shown.close()


MESHES = """() => {
    const found = [];
    overfly.stage().scene.traverse((part) => part.geometry?.attributes.color && found.push([part.uuid, part.geometry.attributes.color.version]));
    return found;
}"""


def what_has_not_changed_is_not_made_again(running, folder, made):
    shown = Shown(running, folder / "before/plan.html")
    before = shown.page.evaluate(MESHES)
    assert len(before) == 1, before
    shown.press("s")
    assert shown.state()["colour"] == "time" and shown.page.evaluate(MESHES) == before, "only the path has other colours"
    shown.page.evaluate("{ const data = JSON.parse(document.getElementById('data').textContent); data.scenes[0].revision = 2; overfly.show(data); }")
    assert shown.page.evaluate(MESHES)[0][0] == before[0][0], "the same scene in another revision"
    shaders = lambda: shown.page.evaluate("overfly.stage().renderer.info.programs.map((one) => one.id).sort().join()")
    shown.settle()
    compiled = shaders()
    shown.page.evaluate("{ const data = JSON.parse(document.getElementById('data').textContent); data.scenes[0].name = 'other'; overfly.show(data); }")
    shown.settle()
    assert shown.page.evaluate(MESHES)[0][0] != before[0][0] and shaders() == compiled, "another scene, and no shader is compiled anew"
    shown.close()


def what_moves_is_drawn_coarsely_and_sharply_at_rest(running, folder, made):
    shown = Shown(running, folder / "before/plan.html")
    shown.page.wait_for_timeout(600)
    width = lambda: shown.page.evaluate("document.getElementById('canvas').width / document.getElementById('canvas').clientWidth")
    assert width() == 1, width()
    turned = """new Promise((done) => {
        let left = 6;
        const turn = () => { overfly.stage().turn(2, 0); left -= 1; left ? requestAnimationFrame(turn) : done(); };
        turn();
    })"""
    shown.page.evaluate(turned)
    assert width() < 0.7, width()
    shown.page.wait_for_timeout(600)
    assert width() == 1, width()
    shown.close()


def odd_times_do_not_hang_the_page(running, folder, made):
    shown = Shown(running, folder / "before/plan.html")
    shown.page.evaluate(
        """() => {
            window.odd = (time, duration) => {
                const data = JSON.parse(document.getElementById('data').textContent);
                const [flight] = data.flights;
                const text = (bytes) => Array.from(bytes, (byte) => String.fromCharCode(byte)).join('');
                const pack = (values) => btoa(text(new Uint8Array(Float32Array.from(values).buffer)));
                const count = 3000;
                const all = (times, value) => pack(Array(times * count).fill(value));
                flight.path = { count, times_s: all(1, time), speeds_mps: all(1, 1), positions_m: all(3, 20) };
                flight.duration_s = duration;
                overfly.show(data);
            };
        }"""
    )
    for time, duration in [(0, 0), (0, 300_000), (1e38, 1e300), ("Infinity", 1e300)]:
        shown.page.evaluate("([time, duration]) => odd(Number(time), duration)", [time, duration])
        assert 0 < shown.page.locator("#charts text.time").count() < 20, duration
    shown.page.evaluate("odd(0, 100.04)")
    shown.press("End")
    assert shown.page.evaluate("Number(slider.max) >= 100.04 && overfly.state().time_s === 100.04")
    assert shown.complaints == [], shown.complaints
    shown.close()


HILL = """() => {
    const data = JSON.parse(document.getElementById('data').textContent);
    const [scene] = data.scenes;
    const bytes = (text) => Uint8Array.from(atob(text), (one) => one.charCodeAt(0));
    const pack = (old, added) => btoa([...bytes(old), ...new Uint8Array(added.buffer)].map((byte) => String.fromCharCode(byte)).join(''));
    const first = bytes(scene.corners).length / 12;
    scene.corners = pack(scene.corners, Float32Array.from([-400, -400, 30, 400, -400, 30, 400, 400, 30, -400, 400, 30]));
    scene.triangles = pack(scene.triangles, Uint32Array.from([0, 1, 2, 0, 2, 3].map((corner) => first + corner)));
    const ring = [[50, 50], [90, 50], [90, 90]];
    scene.zones = [{ name: 'closed', floor_m: 10, ceiling_m: 60, rings: [ring], area: pack('', Float32Array.from(ring.flat())) }];
    scene.structures.push({ id: '1', name: 'terrain', kind: 'terrain', base_m: 30, top_m: 30, triangles: 2 });
    scene.is_exact = false;
    overfly.show(data);
}"""


def heights_over_hills_say_from_where_they_count(running, folder, made):
    shown = Shown(running, folder / "before/plan.html")
    shown.page.evaluate(HILL)
    label = shown.page.evaluate("overfly.stage().labels.find((one) => one.element.textContent.startsWith('closed')).at[2]")
    assert abs(label - 90) < 1e-3, f"a zone counts from the ground below: {label}"
    assert "over lowest" in shown.page.text_content("#charts")
    notes = shown.page.inner_text("#notes")
    assert "Structures are drawn as their outlines from base to top" in notes, notes
    assert shown.complaints == [], shown.complaints
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
        raise Skipped(f"no real scene at {scene} (set OVERFLY_SCENES)")
    program.run("plan", scene, "--iterations", 6, "--out", "delfshaven")
    file = program.folder / "delfshaven/plan.html"
    assert file.stat().st_size < 3_000_000, file.stat().st_size
    times = []
    for _ in range(3):
        shown = Shown(running, file)
        times.append(shown.state()["first_frame_ms"])
        shown.close()
    print(f"delfshaven: {file.stat().st_size / 1e6:.2f} MB, first frame after {min(times):.0f} ms (of {', '.join(f'{time:.0f}' for time in times)})")
    # A busy machine misses the goal; a page that takes three times as long has something wrong with it.
    if min(times) > GOAL_MS:
        print(f"the goal of {GOAL_MS} ms is missed")
    assert min(times) < 3 * GOAL_MS, times


CHECKS = [
    it_loads_from_a_file_and_asks_for_nothing,
    an_idle_page_draws_nothing,
    the_slider_moves_the_drone_along_the_plan,
    the_keyboard_reaches_time_and_camera,
    charts_jump,
    structures_tell_of_themselves_and_places_are_measured,
    two_plans_are_compared,
    colours_and_words_mean_the_same_whichever_plan_is_shown,
    plans_that_capture_the_same_do_not_differ,
    a_picked_structure_stays_picked_while_it_is_there,
    what_has_not_changed_is_not_made_again,
    what_moves_is_drawn_coarsely_and_sharply_at_rest,
    odd_times_do_not_hang_the_page,
    heights_over_hills_say_from_where_they_count,
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
    failed, skipped = 0, 0

    def check(name, *arguments):
        nonlocal failed, skipped
        try:
            globals()[name](*arguments)
            print(f"ok: {name.replace('_', ' ')}")
        except Skipped as why:
            skipped += 1
            print(f"skipped: {name.replace('_', ' ')}: {why}")
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
    print(f"{len(CHECKS) + 2 - failed - skipped} passed, {failed} failed, {skipped} skipped")
    sys.exit(1 if failed else 0)


main()
