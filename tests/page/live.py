"""Uses the live page as people do: in a browser, against a real daemon.

    python3 -m venv target/page
    target/page/bin/pip install -r tests/page/requirements.txt
    target/page/bin/python tests/page/live.py target/release/overfly [--shots FOLDER] [--scene FILE]

Prints what was tried and how long new paths took from a click, and ends with 1 when something is not as it should be.
"""

import argparse
import contextlib
import json
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import TimeoutError as Late

from browser import DRIVER, browser

PATIENCE_MS = 60_000


class Daemon:
    """A daemon with one scene, in a domain of its own."""

    def __init__(self, binary, folder):
        self.binary, self.folder, self.domain = binary, folder, f"page-{os.getpid()}"
        self.start()

    def start(self):
        words = [self.binary, "serve", "--until-stdin-ends", "--domain", self.domain]
        log = open(self.folder / "daemon.log", "ab")
        self.process = subprocess.Popen(words, stdin=subprocess.PIPE, stderr=log, cwd=self.folder)
        while self.run("status", check=False).returncode != 0:
            if self.process.poll() is not None:
                sys.exit(f"the daemon has ended: {(self.folder / 'daemon.log').read_text()}")
            time.sleep(0.05)

    def run(self, *words, check=True):
        command = [self.binary, *words, "--domain", self.domain, "--json"]
        return subprocess.run(command, capture_output=True, text=True, cwd=self.folder, check=check)

    def load_and_plan(self, scene):
        self.run("load", str(scene), "--name", "town")
        self.run("plan", "town", "--rig", "phantom4-rtk", "--budget", "1")

    def structures(self):
        return json.loads(self.run("status", "town").stdout)["structures"]

    def heights(self):
        return {one["name"]: one["top_m"] for one in self.structures()}

    def revision(self):
        scenes = json.loads(self.run("status").stdout)["scenes"]
        return next(scene["revision"] for scene in scenes if scene["name"] == "town")

    def kill(self):
        self.process.kill()
        self.process.wait()

    def end(self):
        self.process.stdin.close()
        self.process.wait()


class Trial:
    """What was tried, and what was not as it should be."""

    def __init__(self, shots):
        self.shots, self.wrong = shots, []

    def check(self, is_right, what):
        print(f"  {'ok' if is_right else 'WRONG'}: {what}")
        if not is_right:
            self.wrong.append(what)

    def shot(self, page, name):
        if self.shots:
            page.screenshot(path=str(self.shots / f"live-{name}.png"))


def live(page):
    return page.evaluate("() => ({ ...document.getElementById('live').dataset })")


def wait_for(page, condition):
    """Waits until a condition holds for what the live part says of itself."""
    script = f"() => {{ const live = document.getElementById('live').dataset; return {condition}; }}"
    try:
        page.wait_for_function(script, timeout=PATIENCE_MS)
    except Late:
        sys.exit(f"WRONG: {condition} does not come: {live(page)}\n{page.locator('#live').inner_text()}")


def idle(page):
    """Until the search of the edit before is over."""
    wait_for(page, "live.phase === 'idle'")


def place_of(page, name):
    """Where on the canvas a click meets a structure, found as a person does: by looking; None where it is hidden."""
    canvas = page.locator("#canvas").bounding_box()
    for row in range(2, 19):
        for column in range(2, 19):
            x, y = canvas["x"] + canvas["width"] * column / 20, canvas["y"] + canvas["height"] * row / 20
            if page.evaluate("([x, y]) => document.elementFromPoint(x, y)?.id", [x, y]) != "canvas":
                continue
            page.mouse.click(x, y)
            picked = live(page).get("picked")
            if picked and (name is None or picked == name):
                return picked
    return None


def click_raises(page, daemon, trial, times):
    before = daemon.revision()
    picked = place_of(page, None)
    trial.check(bool(picked), f"a click picks a building: {picked}")
    heights = daemon.heights()
    page.locator("#live-by").fill("15")
    idle(page)
    page.get_by_role("button", name="Raise").click()
    wait_for(page, "live.edit === 'shown'")
    state = live(page)
    trial.check(int(state["revision"]) == before + 1, f"the page shows revision {state['revision']}")
    after = daemon.heights()
    trial.check(abs(after[picked] - heights[picked] - 15) < 1e-6, f"{picked} is taller by 15 m")
    text = page.locator("#live").inner_text()
    trial.check(f"{picked} is raised by 15 m: new path after" in text, "the page says what was done and how long it took")
    times.append(float(state["latencyMs"]))
    return picked


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("binary", type=pathlib.Path, help="the program under test")
    parser.add_argument("--shots", type=pathlib.Path, help="folder for pictures of the page")
    parser.add_argument("--scene", type=pathlib.Path, help="scene file [default: a generated block]")
    parser.add_argument("--clicks", type=int, default=3, help="how many edits are timed")
    arguments = parser.parse_args()
    if arguments.shots:
        arguments.shots.mkdir(parents=True, exist_ok=True)
    trial = Trial(arguments.shots)
    with tempfile.TemporaryDirectory() as temporary, browser() as running:
        folder = pathlib.Path(temporary)
        daemon = Daemon(arguments.binary.resolve(), folder)
        scene = arguments.scene.resolve() if arguments.scene else folder / "town.geojson"
        if not arguments.scene:
            subprocess.run([daemon.binary, "generate", "--seed", "5", "--extent", "200,200", "--buildings", "24", "--out", scene], check=True)
        try:
            print("a scene without a plan:")
            daemon.run("load", str(scene), "--name", "bare")
            with served(daemon, "bare") as address:
                unplanned(running, address, daemon, trial)
            daemon.load_and_plan(scene)
            with served(daemon, "town") as address:
                try_all(running, address, daemon, scene, trial, arguments.clicks)
        finally:
            daemon.end()
    if trial.wrong:
        sys.exit(f"{len(trial.wrong)} things are not as they should be")


@contextlib.contextmanager
def served(daemon, scene):
    """The address of the live page of a scene."""
    words = [daemon.binary, "watch", scene, "--html", "0", "--json", "--domain", daemon.domain]
    server = subprocess.Popen(words, stdout=subprocess.PIPE, text=True, cwd=daemon.folder)
    try:
        yield json.loads(server.stdout.readline())["address"]
    finally:
        server.kill()
        server.wait()


def listen(page, said):
    """Notes what the browser has to complain about."""
    def hear(message):
        if message.type == "error" and DRIVER not in message.text:
            said.append(f"{message.text} ({message.location['url']})")

    page.on("console", hear)
    page.on("pageerror", lambda error: said.append(str(error)))


def unplanned(running, address, daemon, trial):
    """Whatever is pressed on a page that has nothing to show yet, nothing breaks, and buildings can be edited by name."""
    page = running.new_context(viewport={"width": 1360, "height": 850}).new_page()
    said = []
    listen(page, said)
    page.goto(address)
    wait_for(page, "live.revision === '1'")
    for key in ["c", "f", "s", "w", "m", "r", "v", "a", "p", " ", "[", "]", "Home", "End", "ArrowRight"]:
        page.keyboard.press(key)
    for one in ["#home", "#above", "#measure"]:
        page.locator(one).click()
    canvas = page.locator("#canvas").bounding_box()
    page.mouse.click(canvas["x"] + canvas["width"] / 3, canvas["y"] + canvas["height"] / 2)
    page.mouse.move(canvas["x"] + canvas["width"] / 2, canvas["y"] + canvas["height"] / 2)
    page.focus("#canvas")
    for key in ["Enter", "ArrowLeft", "+"]:
        page.keyboard.press(key)
    name = page.locator("#live-names option").first.get_attribute("value")
    page.locator("#live-search").fill(name)
    page.keyboard.press("Enter")
    trial.check(live(page)["picked"] == name, f"{name} is chosen by its name")
    page.get_by_role("button", name="Raise").click()
    wait_for(page, "live.edit === 'made' && live.revision === '2'")
    # The voice of the timeline is half a second late.
    page.wait_for_timeout(700)
    trial.check(page.evaluate("overfly.state()")["structures"] == 0, "the page says that nothing is shown")
    daemon.run("plan", "bare", "--rig", "phantom4-rtk", "--iterations", "20")
    wait_for(page, "live.epoch !== ''")
    page.wait_for_function("() => overfly.state().coverage === 'final'", timeout=PATIENCE_MS)
    trial.check(page.evaluate("overfly.state()")["picked"] is not None, f"the first plan is shown, with {name} picked")
    trial.check(said == [], f"the browser has nothing to complain about: {said}")
    page.context.close()


def try_all(running, address, daemon, scene, trial, clicks):
    context = running.new_context(viewport={"width": 1360, "height": 850})
    page, other = context.new_page(), context.new_page()
    said = []
    for one in (page, other):
        listen(one, said)
    print("the plan that is there:")
    page.goto(address)
    wait_for(page, "live.revision === '1'")
    trial.check(live(page)["phase"] == "idle", "the page is live")
    trial.shot(page, "first")

    print("edits:")
    times = []
    page.bring_to_front()
    for _ in range(clicks):
        picked = click_raises(page, daemon, trial, times)
    trial.shot(page, "raised")
    print(f"  click to new path on the page: {', '.join(f'{ms:.0f}' for ms in times)} ms, median {statistics.median(times):.0f} ms")

    print("without a pointer:")
    other.goto(address)
    wait_for(other, f"live.revision === '{daemon.revision()}'")
    trial.check(True, "a page that comes late shows the newest revision")
    page.bring_to_front()
    by_name(page, daemon, trial, picked)
    by_keyboard(page, daemon, trial, picked)
    wait_for(other, f"live.revision === '{daemon.revision()}'")
    trial.check(True, f"the other page shows revision {daemon.revision()} as well")
    print("what the daemon refuses:")
    page.locator("#live-by").fill("400")
    page.get_by_role("button", name="Lower").click()
    wait_for(page, "live.edit === 'refused'")
    text = page.locator("#live [role=alert]", has_text="Not done").inner_text()
    trial.check(len(text) > 20, f"the page says why: {text}")
    trial.shot(page, "refused")
    accessible(page, trial)

    print("a daemon that is lost:")
    # An edit that the daemon has taken, and of which no path will come.
    page.evaluate("() => { window.asked = fetch; window.fetch = async () => new Response('{\"revision\": 1e6, \"replan_follows\": true}'); }")
    page.get_by_role("button", name="Raise").click()
    wait_for(page, "live.edit === 'waiting'")
    daemon.kill()
    wait_for(page, "live.phase === 'lost'")
    page.evaluate("() => { window.fetch = asked; }")
    ended = live(page)["edit"] == "lost" and "replanning…" not in page.locator("#live").inner_text()
    trial.check(ended, "an edit that waited for a path does not any more")
    trial.check("daemon lost, reconnecting" in page.locator("#live").inner_text(), "the page says so")
    trial.shot(page, "lost")
    daemon.start()
    wait_for(page, "live.phase === 'unloaded'")
    daemon.load_and_plan(scene)
    wait_for(page, "live.phase === 'idle' && live.revision === '1' && live.epoch !== ''")
    trial.check("not been planned" not in page.locator("#live").inner_text(), "it goes on by itself when the scene is back")
    click_raises(page, daemon, trial, times)
    # Of the refused edit browsers tell by themselves.
    others = [text for text in said if "409" not in text]
    trial.check(others == [], f"the browser has nothing to complain about: {others}")


def by_name(page, daemon, trial, clicked):
    """Of two buildings, one clicked and then another one found by its name, edits mean the second, however many paths come in between."""
    before = daemon.heights()
    name = next(one for one in before if one != clicked)
    page.locator("#live-search").fill(name)
    page.keyboard.press("Enter")
    page.locator("#live-by").fill("4")
    for _ in range(2):
        idle(page)
        revision = daemon.revision()
        page.keyboard.press("Enter")
        wait_for(page, f"Number(live.revision) > {revision} && live.edit === 'shown'")
    focused = page.evaluate("() => document.activeElement.id")
    trial.check(focused == "live-by", f"the focus stays where it is typed: {focused}")
    after = daemon.heights()
    changed = {one: round(after[one] - before[one], 6) for one in after if after[one] != before[one]}
    by = float(page.locator("#live-by").input_value())
    trial.check(changed == {name: 2 * by}, f"of all buildings {name} is taller, by twice {by} m: {changed}")


def by_keyboard(page, daemon, trial, name):
    """Finds a building by its name, removes it and puts it back, with keys alone."""
    count, revision = len(daemon.structures()), daemon.revision()
    page.locator("#live-search").fill("")
    page.keyboard.type(name)
    page.keyboard.press("Enter")
    focused = page.evaluate("() => document.activeElement.id")
    trial.check(focused == "live-by" and live(page)["picked"] == name, f"{name} is found by its name")
    for _ in range(3):
        page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    wait_for(page, f"Number(live.revision) >= {revision + 1} && live.edit === 'shown'")
    trial.check(len(daemon.structures()) == count - 1, f"{name} is removed")
    if "cannot be put back from here" in page.locator("#live").inner_text():
        # A mesh, as every building of a city model is.
        trial.check(page.get_by_role("button", name=f"Put {name} back").count() == 0, f"nobody offers to put {name} back")
        page.locator("#live-search").fill(next(iter(daemon.heights())))
        page.keyboard.press("Enter")
        return
    page.get_by_role("button", name=f"Put {name} back").focus()
    # Meanwhile the daemon goes from state to state.
    idle(page)
    page.keyboard.press("Enter")
    wait_for(page, f"Number(live.revision) >= {revision + 2} && live.edit === 'shown'")
    trial.check(len(daemon.structures()) == count, f"{name} is back")
    page.locator("#live-search").fill(name)
    page.keyboard.press("Enter")


def accessible(page, trial):
    """No serious finding of axe-core with the panel open."""
    violations = Axe().run(page).response["violations"]
    serious = [f"{one['id']}: {one['nodes'][0]['html'][:120]}" for one in violations if one["impact"] in ("serious", "critical")]
    trial.check(serious == [], f"axe finds nothing serious with the panel open: {serious}")


if __name__ == "__main__":
    main()
