"""The numbers of every study on the shipped data, kept before a redesign and compared after each of its steps.

`python tests/benchmarks/golden.py keep FOLDER [--short] [--only TEXT]` writes them at full precision, and
`python tests/benchmarks/golden.py compare FOLDER [--short] [--only TEXT]` computes them again: exit status 1 where a
number differs by more than 1e-9, relative to itself or to a thousandth of its column's largest, or a sampled one by
more than four Monte Carlo standard errors. `--short` takes some five minutes, all of it half an hour.
"""

import argparse
import json
import runpy
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

import ident
from ident.studies.repetition import differences

DATA = Path(__file__).parents[2] / "data"
LCD, SIX = DATA / "lcd_arm", DATA / "six_axis"
ARM, CAMPAIGN, TABLE1 = LCD / "arm.toml", LCD / "campaign.csv", LCD / "table1.csv"
SIX_ARM, SIX_CAMPAIGN = SIX / "arm.xml", SIX / "campaign.csv"
POSTURES, SIX_POSTURES = ((0, 0, 0), (30, -60, 30)), ((0, -60, 90, 0, 30, 0),)
VARY = {"joint1.k_tors": (1.35e6, 5.4e6)}
POINTS = 200
"""Points of the chain, the last ones, at which the log density is kept."""
SHOWN = 10
"""Differences of a case that are printed."""

Rows = Sequence[Mapping[str, Any]]
Case = Callable[[], Any]


@cache
def fitted(arm: Path, campaign: Path) -> Any:
    """Return a fit that several cases stand on."""
    return ident.fit(arm, campaign)


@cache
def hammer() -> Any:
    """Return the modes of the shipped hammer test."""
    return ident.modal_test(LCD / "hammer", LCD / "hammer" / "channels.csv", LCD / "hammer" / "arm.toml")


@cache
def chain() -> Any:
    """Return a chain of 500 steps."""
    return ident.sample(ARM, CAMPAIGN, steps=500)


def fleet() -> Any:
    """Return the fits of 12 robots, one of them with a fault."""
    with tempfile.TemporaryDirectory() as folder:
        runpy.run_path(str(DATA / "fleet" / "generate.py"))["generate"](folder, robots=12, faulty=1)
        return ident.fleet(folder)


@cache
def simulated() -> Any:
    """Return the vibration of the shipped arm."""
    return ident.simulate(ARM, limit=0.5)


def log_density(folder: Path, keep: bool) -> Rows:
    """Return the log density of the shipped campaign's posterior at the last points of a chain that are kept."""
    from ident.inference.posterior import posterior

    points = folder / "points.npy"
    if keep:
        np.save(points, chain().sample.sample.theta.reshape(-1, len(chain().draws))[-POINTS:])
    at = posterior(fitted(ARM, CAMPAIGN).fit.problem).evaluate(np.load(points).T)
    return [{"log_density": float(value)} for value in at.log_density]


def vibration() -> Rows:
    """Return the vibration of the end point at every time [m]."""
    return [dict(zip("xyz", map(float, u), strict=True)) for u in np.asarray(simulated().vibration).reshape(3, -1).T]


CASES: dict[str, tuple[bool, Case]] = {
    "predict": (True, lambda: ident.predict(ARM, posture=POSTURES, load="glass")),
    "predict six": (True, lambda: ident.predict(SIX_ARM, posture=SIX_POSTURES)),
    "predict ur10": (True, lambda: ident.predict(DATA / "ur10" / "arm.urdf", posture=SIX_POSTURES)),
    "check table1": (True, lambda: ident.check(ARM, TABLE1)),
    "check campaign": (True, lambda: ident.check(ARM, CAMPAIGN)),
    "check six": (False, lambda: ident.check(SIX_ARM, SIX_CAMPAIGN)),
    "fit table1": (True, lambda: fitted(ARM, TABLE1)),
    "fit campaign": (True, lambda: fitted(ARM, CAMPAIGN)),
    "fit six": (True, lambda: fitted(SIX_ARM, SIX_CAMPAIGN)),
    "fit robust": (False, lambda: ident.fit(ARM, CAMPAIGN, robust="huber")),
    "fit hammer": (False, lambda: ident.fit(LCD / "hammer" / "arm.toml", hammer().campaign)),
    "modal": (False, hammer),
    "profile": (False, lambda: ident.profile(ARM, CAMPAIGN)),
    "validate": (False, lambda: ident.validate(ARM, CAMPAIGN)),
    "plan": (False, lambda: ident.plan(ARM, CAMPAIGN)),
    "compare": (False, lambda: ident.compare(fitted(ARM, CAMPAIGN), fitted(ARM, LCD / "after_a_year.csv"))),
    "fleet": (False, fleet),
    "sample": (False, chain),
    "resonance": (True, lambda: ident.resonance(ARM, fit=fitted(ARM, CAMPAIGN))),
    "simulate": (True, simulated),
    "vibration": (True, vibration),
    "simulate fit": (False, lambda: ident.simulate(ARM, fit=fitted(ARM, CAMPAIGN))),
    "spectrum": (False, lambda: ident.spectrum(simulated())),
    "sweep": (False, lambda: ident.sweep(ARM, vary=VARY)),
    "design": (
        False,
        lambda: ident.design(ARM, limit=0.4, change={f"joint{j}.k_tors": ("0.5x", "2x") for j in (1, 2, 3)}),
    ),
    "diagnose": (False, lambda: ident.diagnose(ARM, CAMPAIGN)),
}


def table(case: Case) -> dict[str, Rows]:
    """Return the rows of a case, or why there are none, and the Monte Carlo standard errors of its numbers."""
    try:
        result = case()
    except ident.IdentError as error:
        result = [{"refused": str(error)}]
    rows, errors = (result, ()) if isinstance(result, list) else (result.table(), result.standard_errors())
    return {"rows": rows, "errors": errors}


def plain(value: Any) -> Any:
    """Return a value as JSON has it, numbers as Python's."""
    return json.loads(
        json.dumps(value, default=lambda v: v.tolist() if isinstance(v, np.generic | np.ndarray) else str(v))
    )


def compared(file: Path, new: dict[str, Rows]) -> int:
    """Print how a case differs from what was kept, and return in how many numbers."""
    old = json.loads(file.read_text(encoding="utf-8"))
    found = list(differences(old["rows"], plain(new["rows"]), old["errors"]))
    for each in islice(found, SHOWN):
        print(f"    row {each.row}, {each.column}: {each.before!r} before, {each.now!r} now")
    return len(found)


def main() -> None:
    """Keep or compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("keep", "compare"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--short", action="store_true", help="the cases of five minutes")
    parser.add_argument("--only", default="", help="cases with this text in their names")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    density = {"log density": (True, lambda: log_density(options.folder, options.what == "keep"))}
    differing = 0
    for name, (short, case) in (CASES | density).items():
        if options.only not in name or (options.short and not short):
            continue
        start, file = time.perf_counter(), options.folder / f"{name.replace(' ', '_')}.json"
        if options.what == "compare" and not file.exists():
            print(f"{name}: not kept")
            continue
        print(f"{name} ...", end=" ", flush=True)
        new = table(case)
        print(f"{time.perf_counter() - start:.0f} s")
        if options.what == "keep":
            file.write_text(json.dumps(plain(new)), encoding="utf-8")
        else:
            differing += bool(compared(file, new))
    sys.exit(f"{differing} cases differ" if differing else 0)


if __name__ == "__main__":
    main()
