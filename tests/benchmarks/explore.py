"""How fast the explorer's page is in headless Chromium: `python tests/benchmarks/explore.py [--seconds 4]`.

For the paper's arm and a random six-axis arm: first paint, and frames a second while a stiffness slider is dragged
to and fro, one input event before each frame, with the mode swinging.
"""

import argparse
import os
import shutil
import sys
import tempfile
from pathlib import Path

import jax
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))

from arms import lcd_arm, random_arm
from browser import FLAGS, NAMES
from playwright.sync_api import Page, sync_playwright

from ident.arm.arm import Arm

DRAG = """(seconds) => new Promise((done) => {
    const slider = document.querySelectorAll('#controls fieldset:nth-of-type(2) input')[1], begin = performance.now();
    let frames = 0, slowest = 0, last = begin;
    const step = (now) => {
        frames += 1;
        slowest = Math.max(slowest, now - last);
        last = now;
        if (now - begin > 1000 * seconds) return done({ rate: 1000 * frames / (now - begin), slowest });
        slider.value = 1.5 * Math.sin((now - begin) / 300);
        slider.dispatchEvent(new Event('input'));
        requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
})"""
PAINT = "performance.getEntriesByName('first-paint')[0].startTime"
REPEATS = 5


def measure(name: str, arm: Arm, seconds: float) -> None:
    """Print what the page of an arm takes."""
    from ident.studies.look.explore import explore

    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        path = explore(arm).save(Path(folder))[0]
        program = next(filter(None, map(shutil.which, NAMES)))
        chromium = playwright.chromium.launch(executable_path=program, args=list(FLAGS))
        paints, rates, slowest, size = [], [], 0.0, path.stat().st_size
        for _ in range(REPEATS):
            page = opened(chromium, path)
            paints.append(page.evaluate(PAINT))
            drag = page.evaluate(DRAG, seconds)
            rates.append(drag["rate"])
            slowest = max(slowest, drag["slowest"])
            page.close()
        chromium.close()
    print(
        f"{name}: {size / 1e3:.0f} kB, first paint {np.median(paints):.0f} ms (at most {max(paints):.0f}),"
        f" {np.median(rates):.0f} frames a second (at least {min(rates):.0f}), the slowest {slowest:.0f} ms"
    )


def opened(chromium: object, path: Path) -> Page:
    """Return the page, open and at rest."""
    page = chromium.new_page(viewport={"width": 1280, "height": 900})
    page.goto(path.resolve().as_uri())
    page.wait_for_timeout(1000)
    return page


def main() -> None:
    """Measure both arms."""
    jax.config.update("jax_enable_x64", True)
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=4.0)
    seconds = parser.parse_args().seconds
    print(f"load of the machine {os.getloadavg()[0]:.1f}, {len(os.sched_getaffinity(0))} cores")
    measure("the paper's arm", lcd_arm(), seconds)
    measure("a six-axis arm", random_arm(np.random.default_rng(0), 6), seconds)


if __name__ == "__main__":
    main()
