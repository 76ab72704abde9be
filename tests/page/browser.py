"""A headless Chromium that draws by software, and pages in it."""

import contextlib
import json
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from playwright.sync_api import sync_playwright

QUIET = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking"]
QUIET += ["--disable-component-update", "--disable-sync"]
DRAWING = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
# What the graphics driver says about its own speed is none of the page's affair.
DRIVER = "GL Driver Message"


def chromium():
    found = os.environ.get("CHROMIUM") or shutil.which("chromium") or shutil.which("chromium-browser")
    if not found:
        raise SystemExit("chromium is missing: install it with your system's packages, or name it in CHROMIUM")
    return found


@contextlib.contextmanager
def browser(draws=True):
    with sync_playwright() as playwright:
        arguments = QUIET + (DRAWING if draws else ["--disable-3d-apis"])
        running = playwright.chromium.launch(executable_path=chromium(), args=arguments)
        yield running
        running.close()


class Shown:
    """A page from a file, with all that it complained of and all that it asked for."""

    def __init__(self, running, file, size=(1280, 800), **context):
        self.context = running.new_context(viewport={"width": size[0], "height": size[1]}, **context)
        self.page = self.context.new_page()
        self.complaints, self.requests = [], []
        self.page.on("console", lambda said: self.hear(said))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.file = Path(file).resolve().as_uri()
        self.page.goto(self.file)
        self.page.wait_for_function("window.overfly?.state && (!overfly.state().has_picture || overfly.state().frames > 0)")

    def hear(self, said):
        if said.type in ("error", "warning") and DRIVER not in said.text:
            self.complaints.append(said.text)

    def state(self):
        return self.page.evaluate("overfly.state()")

    def press(self, *keys):
        for key in keys:
            self.page.keyboard.press(key)

    def settle(self):
        """Until what is due has been drawn."""
        self.page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")

    def close(self):
        self.context.close()


class Program:
    """The program, and a folder for what it writes."""

    def __init__(self, binary):
        self.binary = str(Path(binary).resolve())
        self.folder = Path(tempfile.mkdtemp(prefix="overfly-page-"))

    def run(self, *words):
        done = subprocess.run([self.binary, *map(str, words), "--json"], cwd=self.folder, capture_output=True, text=True, check=False)
        answer = json.loads(done.stdout)
        if done.returncode != 0:
            raise RuntimeError(f"overfly {' '.join(map(str, words))}: {answer}")
        return answer

    def close(self):
        shutil.rmtree(self.folder)
