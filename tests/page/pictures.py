"""Draws the README's pictures of pages, by the program itself.

    python pictures.py target/release/overfly tests/pictures
"""

import os
import sys
from pathlib import Path

from PIL import Image

from browser import Program, Shown, browser

SIZE = (1400, 860)
# A picture in the README is no larger, bytes.
MOST_BYTES = 300_000


def save(shown, file):
    shown.settle()
    shown.page.wait_for_timeout(300)
    shown.page.screenshot(path=file)
    picture = Image.open(file).convert("RGB")
    for colours in (256, 128, 64, 40):
        picture.quantize(colours, method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(file, optimize=True)
        if Path(file).stat().st_size < MOST_BYTES:
            return
    raise SystemExit(f"{file} has {Path(file).stat().st_size} bytes")


def go(shown, mode, share):
    """To a share of the flight, with the surface in a mode."""
    shown.page.check(f"[data-layer=coverage][value={mode}]")
    shown.page.evaluate("(share) => { slider.value = share * slider.max; slider.dispatchEvent(new Event('input')); }", share)


def main():
    program, folder = Program(sys.argv[1]), Path(sys.argv[2])
    scenes = Path(os.environ.get("OVERFLY_SCENES", Path(__file__).parents[3] / "shared/scenes")).resolve()
    scene = scenes / "delfshaven/delfshaven.city.json"
    program.run("plan", scene, "--iterations", 60, "--out", "one")
    program.run("plan", scene, "--rig", "m300-oblique", "--iterations", 20, "--out", "five")
    program.run("demo", "--out", "demo")
    with browser() as running:
        shown = Shown(running, program.folder / "one/plan.html", SIZE, color_scheme="light")
        shown.page.evaluate("overfly.look({ azimuth: 24, elevation: 27, target: [5, -10, 6], distance: 330 })")
        go(shown, "now", 0.72)
        save(shown, folder / "page-plan.png")
        shown = Shown(running, program.folder / "demo/replan-vs-plan.html", SIZE, color_scheme="light")
        shown.page.evaluate("overfly.look({ azimuth: 10, elevation: 38, target: [0, 25, 10], distance: 235 })")
        go(shown, "difference", 0.3)
        save(shown, folder / "page-compare.png")
        shown = Shown(running, program.folder / "five/plan.html", SIZE, color_scheme="dark")
        shown.page.evaluate("overfly.look({ azimuth: 40, elevation: 26, target: [10, 0, 8], distance: 300 })")
        go(shown, "now", 0.55)
        save(shown, folder / "page-dark.png")
    program.close()


main()
