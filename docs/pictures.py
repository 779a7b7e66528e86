"""Make the pictures and printed answers of the commands' pages anew: `python docs/pictures.py [COMMAND ...]`.

Runs the examples of `docs/commands/COMMAND.md` as they stand there, by this Python's ident, and keeps in
`docs/pictures/` what the page's own command prints, and the figure that the page shows.
All takes some minutes.
"""

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image

HERE = Path(__file__).parent
sys.path.append(str(HERE.parent / "tests" / "support"))

from examples import examples  # noqa: E402

PICTURES = HERE / "pictures"
FIGURES = {
    "fit": "table1.fit.png",
    "profile": "campaign.profile.png",
    "sample": "campaign.sample.posterior.png",
    "validate": "campaign.validate.png",
    "plan": "table1.plan.png",
    "compare": "campaign-after_a_year.compare.png",
    "fleet": "robots.fleet.png",
    "resonance": "arm.extend-10.resonance.png",
    "simulate": "arm.extend-10.simulate.png",
    "spectrum": "arm.extend-10.spectrum.png",
    "triage": "runs.triage.png",
    "source": "runs.source.png",
    "balance": "arm.extend-10.balance.png",
    "joint": "a-b-c.joint.png",
    "sweep": "arm.extend-10.joint1.k_tors+bracket.com.x+speed.sweep.png",
    "motion": "arm.extend-10.motion.png",
    "design": "arm.extend-10.design.png",
    "variants": "arm-campaign.fit.variants.png",
    "show": "arm.show.png",
    "modal": "hammer.modal.modes2.png",
}
"""The figure that a page shows, by command."""
PAGES = {
    "diagnose": ("campaign.diagnose.html", (1000, 1400)),
    "explore": ("arm.explore.html#joint1.k_tors=180000", (1280, 1640)),
}
"""Pages that commands write, shown as a browser of a size shows them."""
STATIC = {"explore": "arm.explore.html"}
"""Pages that the manual has as they are, to look at before anything is installed."""
LONG = ("diagnose",)
"""Commands whose examples the tests only show, as they take minutes."""
WIDEST, MOST, COLORS = 1400, 120_000, 256


def main(commands: list[str]) -> None:
    """Run each page's examples in a folder of their own, and keep what they show."""
    for page in sorted((HERE / "commands").glob("*.md")):
        command = page.stem
        shows = f"pictures/{command}." in page.read_text(encoding="utf-8")
        if shows and (not commands or command in commands):
            with tempfile.TemporaryDirectory() as folder:
                (Path(folder) / "data").symlink_to(HERE.parent / "data")
                make(command, page, Path(folder))


def make(command: str, page: Path, folder: Path) -> None:
    """Write what a page shows of its command."""
    answer = ""
    for example in examples(page):
        if example.language == "python" and not answer and command not in LONG:  # makes what the command reads
            subprocess.run([sys.executable, "-c", example.text], cwd=folder, env=environment(), check=True)
        runs = example.language == "sh" and (command in LONG or not example.shown_only)
        for words in example.commands if runs else []:
            printed = run(words, folder)
            if words[1] == command and not answer:
                answer = printed
    (PICTURES / f"{command}.txt").write_text(answer, encoding="utf-8")
    picture = PICTURES / f"{command}.png"
    if command in STATIC:
        (HERE / "static" / STATIC[command]).write_bytes((folder / "out" / STATIC[command]).read_bytes())
    if command in PAGES:
        photograph(folder / "out", *PAGES[command], picture)
    elif command in FIGURES:
        picture.write_bytes((folder / "out" / FIGURES[command]).read_bytes())
    if picture.exists():
        shrink(picture)
    print(f"{command}: {len(answer)} characters, {picture.stat().st_size if picture.exists() else 0} bytes", flush=True)


def run(words: list[str], folder: Path) -> str:
    """Return what a command prints."""
    command = [sys.executable, "-m", "ident", *words[1:]]
    done = subprocess.run(command, cwd=folder, env=environment(), stdout=subprocess.PIPE, text=True, check=True)
    return re.sub(r"[ \t]+$", "", done.stdout, flags=re.MULTILINE)


def environment() -> dict[str, str]:
    """Return the environment in which this ident is found."""
    return os.environ | {"PYTHONPATH": str(HERE.parent)}


def photograph(folder: Path, page: str, size: tuple[int, int], picture: Path) -> None:
    """Write the top of a page as Chromium shows it."""
    import shutil

    from browser import FLAGS, NAMES
    from playwright.sync_api import sync_playwright

    program = next(filter(None, map(shutil.which, NAMES)))
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=program, args=list(FLAGS))
        view = chromium.new_page(viewport={"width": size[0], "height": size[1]}, reduced_motion="reduce")
        view.goto(f"{folder.resolve().as_uri()}/{page}")
        view.wait_for_timeout(1500)
        view.screenshot(path=str(picture))
        chromium.close()


def shrink(picture: Path) -> None:
    """Make a picture small: few colours, those that are seldom included, and no wider than a page."""
    with Image.open(picture) as opened:
        image = opened.convert("RGB")
    if image.width > WIDEST:
        image = image.resize((WIDEST, round(image.height * WIDEST / image.width)), Image.Resampling.LANCZOS)
    colors = COLORS
    while True:
        image.quantize(colors, Image.Quantize.MAXCOVERAGE, kmeans=8, dither=Image.Dither.NONE).save(
            picture, optimize=True
        )
        if picture.stat().st_size < MOST or colors <= 8:
            return
        colors //= 2


if __name__ == "__main__":
    main(sys.argv[1:])
