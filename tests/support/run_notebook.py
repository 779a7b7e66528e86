"""Runs notebooks as plain Python, all of their cells, with less of what takes long.

`python run_notebook.py` reads the name of a script from each line, runs it, and answers by a line of JSON: what it
has printed, and why it failed. One process for all saves the libraries and programs that each would load.

What is less stands in `SHORTER` and `OPTIONS`. The executed copies beside the scripts are made of the whole.
"""

import json
import os
import sys
from collections.abc import Mapping
from contextlib import redirect_stdout
from dataclasses import replace
from io import StringIO
from pathlib import Path
from traceback import format_exc
from typing import Any

import matplotlib
from matplotlib import pyplot

import ident

OPTIONS: Mapping[str, Mapping[str, Any]] = {
    "fit": {"starts": 2},
    "plan": {"starts": 2},
    "sample": {"steps": 500, "starts": 2},
    "design": {"starts": 1, "no_curve": True},
    "simulate": {"phases": "file"},
}
"""Options by the function that takes them; scripts look at no simulations but those with the phases of the file."""
SHORTER: Mapping[str, tuple[tuple[str, str], ...]] = {
    "04_the_vibrating_arm": (("covariance, 40))", "covariance, 8))"), ("window, 40)", "window, 8)")),
    "06_the_remedy": (('"2.5x", 21)', '"2.5x", 11)'), ("(*ends, 21)", "(*ends, 11)")),
    "07_a_fleet": (("generate(robots)", "generate(robots, 8, 1, seed=1)"), ('"robot200.csv"', '"robot008.csv"')),
}
"""What is put in the place of what in a script: fewer draws, values and robots."""


def shorter(name: str, text: str) -> str:
    """Return the text of a script with less to compute, each of its replacements exactly once."""
    for old, new in SHORTER.get(name, ()):
        assert text.count(old) == 1, f"{name}: {old}"
        text = text.replace(old, new)
    return text


def with_options(name: str) -> None:
    """Give a function of the front door the options of `OPTIONS`, whatever a script says."""
    whole = getattr(ident, name)
    kind = getattr(ident, f"{name.capitalize()}Options")

    def less(*arguments: Any, **more: Any) -> Any:
        given = [*arguments, *([more.pop("options")] if "options" in more else [])]
        place = next((i for i, each in enumerate(given) if isinstance(each, kind)), None)
        options = replace(given.pop(place) if place is not None else kind(), **OPTIONS[name])
        return whole(*given, options=options, **more)

    setattr(ident, name, less)


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
    for name in OPTIONS:
        with_options(name)
    with os.fdopen(os.dup(1), "w") as answers:
        os.dup2(2, 1)
        for line in sys.stdin:
            print(json.dumps(run(Path(line.strip()))), file=answers, flush=True)


if __name__ == "__main__":
    main()
