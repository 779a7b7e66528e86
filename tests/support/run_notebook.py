"""Runs notebooks as plain Python, all of their cells, with less of what takes long.

`python run_notebook.py` reads the name of a script from each line, runs it, and answers by a line of JSON: what it
has printed, and why it failed. One process for all saves the libraries and programs that each would load.

What is less stands in `SHORTER`, `OPTIONS`, `ONCE` and `less_of_studies`. The executed copies beside the scripts are
made of the whole.
"""

import json
import os
import sys
from collections.abc import Mapping
from contextlib import redirect_stdout
from dataclasses import fields, replace
from io import StringIO
from pathlib import Path
from traceback import format_exc
from types import SimpleNamespace
from typing import Any

import matplotlib
import numpy as np
from matplotlib import pyplot

import ident

OPTIONS: Mapping[str, Mapping[str, Any]] = {
    "fit": {"starts": 2},
    "plan": {"starts": 2},
    "sample": {"steps": 500, "starts": 2, "walkers": 20},
    "design": {"starts": 1, "no_curve": True, "rate": 100.0, "phases": "file"},
    "motion": {"time": 27.0},
    "simulate": {"phases": "file"},
}
"""Options by the function that takes them; scripts look at no simulations but those with the phases of the file."""
SHORTER: Mapping[str, tuple[tuple[str, str], ...]] = {
    "02_what_to_measure_next": (("print(ident.check(arm, both))", "print(both.name)"),),
    "03_the_posterior_of_the_papers_robot": (
        ("list(taken_as_right.medians)", '[name for name in taken_as_right.medians if name.startswith("joint")]'),
        ("ident.sample(arm, table_1)", 'ident.sample(arm, table_1, discrepancy={"frequency": 0.1, "deflection": 0.1})'),
    ),
    "04_the_vibrating_arm": (
        ("covariance, 40))", "covariance, 8))"),
        ("window, 40)", "window, 8)"),
        ("np.arange(13.8, 14.35, 0.04)", "np.arange(13.8, 14.35, 0.2)"),
    ),
    "06_the_remedy": (('"2.5x", 21)', '"2.5x", 11)'), ("(*ends, 21)", "(*ends, 11)")),
    "07_a_fleet": (
        ("generate(robots)", "generate(robots, 8, 1, seed=1)"),
        ('"robot200.csv"', '"robot008.csv"'),
        ('tuple(m for m in campaign if m.kind == "frequency")[:4]', "tuple(campaign)"),
    ),
    "08_three_cures": (
        (
            '"runs" / "runs.csv", arm_file)',
            '"mujoco" / "runs.csv", arm_file, ident.SourceOptions(hold_out=("run8.csv",), peak=9.5))',
        ),
        (
            'change={JOINT: ("1x", "2x")}, limit=LIMIT',
            'change={f"joint{j}.k_tors": ("0.5x", "2x") for j in (1, 2, 3)}, limit=0.4, dwell=2.0',
        ),
    ),
}
"""What is put in the place of what in a script: fewer draws, values and robots, and what a notebook has already."""
ONCE = ("sample", "source", "design")
"""What is not computed again of the same arm with the same options."""


def shorter(name: str, text: str) -> str:
    """Return the text of a script with less to compute, each of its replacements exactly once."""
    for old, new in SHORTER.get(name, ()):
        assert text.count(old) == 1, f"{name}: {old}"
        text = text.replace(old, new)
    return text


def with_options(name: str) -> None:
    """Give a function of the front door the options of `OPTIONS`, whatever a script says."""
    whole, known = getattr(ident, name), dict[str, Any]()  # with what is given, so that no other has its id
    kind = getattr(ident, f"{name.capitalize()}Options")

    def less(*arguments: Any, **more: Any) -> Any:
        given = [*arguments, *([more.pop("options")] if "options" in more else [])]
        place = next((i for i, each in enumerate(given) if isinstance(each, kind)), None)
        said = replace(given.pop(place) if place is not None else kind(), **OPTIONS.get(name, {}))
        named = {each.name: more.pop(each.name) for each in fields(kind) if each.name in more}
        options = replace(said, **named)
        key = repr([getattr(each, "sha256", "") or (each if isinstance(each, Path) else id(each)) for each in given])
        key += repr((more, options))
        found = known[key] if key in known else (given, whole(*given, options=options, **more))
        if name in ONCE:
            known[key] = found
        return found[1]

    setattr(ident, name, less)


def less_of_studies() -> None:
    """Leave out what no script shows: a design's sensitivities, its verification, and what further runs would tell.

    Designs are found to three digits, and motions have one size, as by the fixture `one_size` of the tests.
    """
    from ident.studies.cause import source_study as source
    from ident.vibrate import design, design_search, linear, sweep

    search = design_search.minimize
    design_search.minimize = lambda *given, options, **more: search(*given, options=options | {"ftol": 1e-4}, **more)
    sweep.sensitivities = lambda *_, **__: SimpleNamespace(amplitude=np.zeros(3))
    design.verify = lambda evaluator, place, *_: SimpleNamespace(after=place)
    source.FURTHER = (10.0,)
    linear.PIECES, linear.FEWEST = 8192, 96


def run(path: Path) -> dict[str, str]:
    """Run a script, with the settings of figures that it would find alone."""
    pyplot.close("all")
    matplotlib.rc_file_defaults()
    matplotlib.use("Agg")
    failed = ""
    with redirect_stdout(StringIO()) as printed:
        try:
            text = shorter(path.stem, path.read_text(encoding="utf-8"))
            exec(compile(text, str(path), "exec"), {"__name__": "__main__"})
        except (Exception, SystemExit):
            failed = format_exc()
    return {"printed": printed.getvalue(), "failed": failed}


def main() -> None:
    """Run what is asked for; what other processes print goes to where errors go."""
    for name in {*OPTIONS, *ONCE}:
        with_options(name)
    less_of_studies()
    with os.fdopen(os.dup(1), "w") as answers:
        os.dup2(2, 1)
        for line in sys.stdin:
            print(json.dumps(run(Path(line.strip()))), file=answers, flush=True)


if __name__ == "__main__":
    main()
