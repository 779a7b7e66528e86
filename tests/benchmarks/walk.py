"""How often a run crosses from one room of ident into another, each step of the studies one; and between files.

    PYTHONPATH=TREE python tests/benchmarks/walk.py [STUDY ...]

TREE is the checkout whose package is walked through; an older one may be of another layout. The data are those of this
checkout. What is left out is the ground, which every file calls: errors, units, texts, files, compiled programs.
"""

import argparse
import contextlib
import sys
import threading
from inspect import CO_OPTIMIZED
from pathlib import Path

import ident

PACKAGE, DATA = Path(ident.__file__).parent, Path(__file__).parents[2] / "data" / "lcd_arm"
ARM, TABLE1, CAMPAIGN, HAMMER = (DATA / name for name in ("arm.toml", "table1.csv", "campaign.csv", "hammer"))


def small_diagnosis():
    try:
        from ident.studies.cure.effort import DiagnosisEffort
    except ImportError:
        from ident.assess.effort import DiagnosisEffort
    numbers = {"steps": 500, "draws": 30, "band_draws": 4, "assessment_draws": 10, "values": 5, "screened": 4}
    few = DiagnosisEffort(**numbers, speeds=(0.5, 1.25), iterations=2)
    return ident.diagnose(ARM, CAMPAIGN, ident.DiagnoseOptions(speed=100.0, dwell=0.2, limit=1.3, effort=few))


RUNS = {
    "predict": lambda: ident.predict(ARM),
    "fit": lambda: ident.fit(ARM, TABLE1),
    "simulate": lambda: ident.simulate(ARM, ident.SimulateOptions(speed=100.0)),
    "diagnose": small_diagnosis,
    "modal": lambda: ident.modal_test(HAMMER),
    "source": lambda: ident.source(DATA / "runs" / "runs.csv", ARM),
    "motion": lambda: ident.motion(ARM, ident.MotionOptions(limit=0.3)),
}


def pairs(run):
    """Return the pairs of files of one run, of all its threads."""
    seen = set()

    def note(frame, event, _):
        if event == "call" and frame.f_back is not None:
            codes = frame.f_back.f_code, frame.f_code
            if all(code.co_flags & CO_OPTIMIZED for code in codes):  # functions: no bodies of modules and classes
                seen.add(tuple(code.co_filename for code in codes))

    threading.setprofile(note)
    sys.setprofile(note)
    try:
        run()
    finally:
        sys.setprofile(None)
        threading.setprofile(None)
    rooms = [tuple(Path(name) for name in pair) for pair in seen]
    return {(a, b) for a, b in rooms if a != b and above_ground(a) and above_ground(b)}


def above_ground(path):
    return path.is_relative_to(PACKAGE) and path.parent != PACKAGE


def room(path):
    """A folder of the package, or of a step of its studies."""
    parts = path.relative_to(PACKAGE).parts[:-1]
    return "/".join(parts[:2] if parts[0] == "studies" else parts[:1])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("study", nargs="*", default=RUNS)
    for study in parser.parse_args().study:
        with contextlib.redirect_stdout(sys.stderr):
            found = pairs(RUNS[study])
        files = {path for pair in found for path in pair}
        rooms = {(a, b) for a, b in (tuple(map(room, pair)) for pair in found) if a != b}
        print(f"{study:9s} {len(rooms):3d} pairs of rooms, {len(found):4d} of {len(files):3d} files", flush=True)
