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
        picture.quantize(colours, dither=Image.Dither.NONE).save(file, optimize=True)
        if Path(file).stat().st_size < MOST_BYTES:
            return
    raise SystemExit(f"{file} has {Path(file).stat().st_size} bytes")


def main():
    program, folder = Program(sys.argv[1]), Path(sys.argv[2])
    scenes = Path(os.environ.get("OVERFLY_SCENES", Path(__file__).parents[3] / "shared/scenes")).resolve()
    program.run("plan", scenes / "delfshaven/delfshaven.city.json", "--rig", "phantom4-rtk", "--iterations", 40, "--out", "delfshaven")
    program.run("plan", scenes / "marunouchi/buildings.geojson", "--rig", "m300-oblique", "--iterations", 40, "--out", "marunouchi")
    program.run("demo", "--out", "demo")
    with browser() as running:
        shown = Shown(running, program.folder / "delfshaven/plan.html", SIZE, color_scheme="light")
        shown.page.evaluate("overfly.look({ azimuth: 24, elevation: 27, target: [5, -10, 6], distance: 330 })")
        shown.press("c", "c", *["Shift+ArrowRight"] * 70)
        save(shown, folder / "page-plan.png")
        shown = Shown(running, program.folder / "demo/replan-vs-plan.html", SIZE, color_scheme="light")
        shown.press(*["Shift+ArrowRight"] * 12)
        save(shown, folder / "page-compare.png")
        shown = Shown(running, program.folder / "marunouchi/plan.html", SIZE, color_scheme="dark")
        shown.page.evaluate("overfly.look({ azimuth: 62, elevation: 24, target: [0, 0, 40], distance: 900 })")
        shown.press("c", "c", *["Shift+ArrowRight"] * 220)
        save(shown, folder / "page-dark.png")
    program.close()


main()
