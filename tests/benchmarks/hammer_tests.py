"""Labels and stiffnesses of synthetic hammer tests: `python tests/benchmarks/hammer_tests.py [--tests 200] [--only N]`.

Each test is the paper's arm with stiffnesses drawn by 20 % about its file's, unknown to the fit, in two postures; in
the second one the two lowest modes are some percents apart. Two accelerometers along y and z, hits at the tip along
both, five of each, noise of 1 to 5 % of each frequency response; the responses are those of the equations of motion,
linearised, with their dampers. Counted: wrong names given with certainty, modes without a certain name, and, by
`ident.fit` with all its starts, tests in doubt and the 95 % intervals that it shows in the others; from frequencies and
damping ratios alone and with shapes as data.
"""

import argparse
import json
import pickle
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np
from scipy.stats import binom, chi2, norm
from timing import commit, machine

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))
from shaken import PLACES, hammered, shaken

from ident.arm.arm import Arm
from ident.arm.parts import Point
from ident.description.file import ArmFile, read_arm
from ident.errors import IdentError
from ident.identify.modal_analysis import ModalAnalysis, modal_analysis
from ident.identify.mode_names import Measured, label_modes
from ident.identify.problem import pose
from ident.identify.unknowns import Unknowns, stiffness_parameters
from ident.inference.search import solve
from ident.measure import OWN_WEIGHT, Campaign
from ident.modal.modes import Modes, modes_of, together
from ident.modal.poles import mac
from ident.studies.measuring.modal_campaign import IdentifiedModes, modal_campaign
from ident.studies.stiffness.fit import FitOptions, fit

DATA = Path(__file__).parents[2] / "data" / "lcd_arm"
POSTURES = tuple(tuple(np.radians(a) * np.array([1.0, -2.0, 1.0])) for a in (0.0, 60.0))
SPREAD = 0.2


@dataclass(frozen=True)
class Test:
    """A test of one posture, as far as a campaign asks."""

    frf: object
    posture: tuple[float, ...]
    load: object = OWN_WEIGHT
    drives: str = "brake"


def measured(true: Arm, rng: np.random.Generator, kept: Path | None) -> tuple[float, list[Modes]]:
    """Return noise and modes of a test in both postures, as far as names and fits ask; from a file if it is there."""
    if kept and kept.exists():
        return pickle.loads(kept.read_bytes())
    noise = rng.uniform(0.01, 0.05)
    modes = together([modes_of(hammered(shaken(true, q), noise, rng)) for q in POSTURES])
    light = [replace(each, diagram=None, frf=replace(each.frf, hits=each.frf.hits[:1])) for each in modes]
    if kept:
        kept.write_bytes(pickle.dumps((noise, light)))
    return noise, light


def one_test(
    file: ArmFile, parameters, truth: np.ndarray, rng: np.random.Generator, kept: Path | None, fitted: Callable
) -> dict:
    """Return what comes of a test: names given, wrong and withheld, and how far fitted values are off."""
    true = file.arm.replace(parameters.by_path(np.asarray(parameters.values(truth))))
    noise, modes = measured(true, rng, kept)
    labels = label_modes(file.arm, [Measured(*pair) for pair in zip(POSTURES, modes, strict=True)], parameters)
    names = {"given": 0, "wrong": 0, "doubtful": 0}
    for q, each, own in zip(POSTURES, modes, labels, strict=True):
        known = modal_analysis(true, q, modes=8)
        for i, given in enumerate(own.given):
            meant = known.labels[meant_mode(each, i, known)]
            names["given" if given else "doubtful"] += 1
            names["wrong"] += int(given is not None and given != meant)
    tests = [Test(each.frf, q) for each, q in zip(modes, POSTURES, strict=True)]
    identified = [IdentifiedModes(*pair) for pair in zip(modes, labels, strict=True)]
    found = {"noise": noise, "misfit": [each.misfit for each in modes], **names}
    for way, shapes in (("poles", False), ("shapes", True)):
        found[way] = fitted(file, modal_campaign("test", tests, identified, shapes=shapes), parameters.names, truth)
    return found


def meant_mode(modes: Modes, i: int, known: ModalAnalysis) -> int:
    """Return which of the true arm's modes one is: of those within 5 % in frequency the one that moves like it most."""
    names = [point.name for point in known.arm.points]
    moved = np.array([np.array(p.direction) @ known.modes.motion[:, names.index(p.point)] for p in PLACES])
    alike = mac(modes.shape[:, [i]], moved.astype(complex))[0]
    near = abs(np.log(known.modes.frequency / modes.frequency[i]))
    return int(np.argmax(np.where(near < max(0.05, near.min() + 1e-9), alike, -1.0)))


def fitted(file: ArmFile, campaign: Campaign, names: tuple[str, ...], truth: np.ndarray) -> dict:
    """Return what `ident fit` says of a campaign, beside the truth: a minute of CPU and more, most of it compiling."""
    result = fit(file, campaign, FitOptions(no_explain=True))
    own = result.fit.problem.parameters
    order = [own.names.index(name) for name in names]
    off = result.fit.best.theta[order] - truth
    covariance = result.fit.information.covariance[np.ix_(order, order)]
    low, high = np.log([result.intervals[name] for name in names]).T
    return {
        "inside": ((low < truth) & (truth < high)).tolist(),
        "shown": [result.supported[name] for name in names],
        "off": off.tolist(),
        "sd": np.sqrt(np.diag(covariance)).tolist(),
        "joint": float(off @ np.linalg.solve(covariance, off)),
        "p": result.fit.p_value,
        "doubts": list(result.doubts),
    }


def searched(file: ArmFile, campaign: Campaign, names: tuple[str, ...], truth: np.ndarray) -> dict:
    """Return the better end of two searches, from the file's values and from the truth, and the linear intervals there.

    In doubt are data with a chi-squared above its 99.9 %.
    """
    problem = pose(file.arm, campaign).problem
    own = problem.parameters
    order = [own.names.index(name) for name in names]
    true = np.asarray(own.theta(own.column("start")), copy=True)
    true[order] = truth
    ends = [solve(problem, start) for start in (np.asarray(own.theta(own.column("start"))), true)]
    end = min(ends, key=lambda end: np.nan_to_num(float(end.cost), nan=np.inf))
    residuals, slope = problem.weigh(np.asarray(end.predicted), np.asarray(end.jacobian), np.asarray(end.theta))
    data = residuals[: len(problem.kinds)]
    off = np.asarray(end.theta)[order] - truth
    covariance = np.linalg.inv(slope.T @ slope)[np.ix_(order, order)]
    sd, p = np.sqrt(np.diag(covariance)), float(chi2.sf(data @ data, len(data) - len(own.names)))
    return {
        "inside": (np.abs(off) < norm.ppf(0.975) * sd).tolist(),
        "shown": [p > 0.001] * len(off),
        "off": off.tolist(),
        "sd": sd.tolist(),
        "joint": float(off @ np.linalg.solve(covariance, off)),
        "p": p,
        "doubts": [] if p > 0.001 else [f"p {p:.1g}"],
    }


def report(found: list[dict]) -> None:
    """Print the rates."""
    total = {key: sum(each[key] for each in found) for key in ("given", "wrong", "doubtful")}
    every = total["given"] + total["doubtful"]
    print(f"{len(found)} tests, {every} modes: {total['given']} named, {total['wrong']} of them wrongly;", end=" ")
    print(f"{total['doubtful']} doubtful, {100 * total['doubtful'] / every:.1f} %")
    for way in ("poles", "shapes"):
        inside, shown = (np.array([each[way][key] for each in found]) for key in ("inside", "shown"))
        sure = np.array([not each[way]["doubts"] for each in found])
        joint = np.array([each[way]["joint"] for each in found]) < chi2.ppf(0.95, inside.shape[1])
        print(f"{way}: {len(found) - sure.sum()} tests in doubt, whose intervals are withheld")
        said("95 % intervals that are shown and hold the truth", inside[shown])
        said("all six together, of tests not in doubt", joint[sure])
        said("chi-squared below its 95 %, of tests not in doubt", np.array([e[way]["p"] for e in found])[sure] > 0.05)
        said("intervals of all tests, those in doubt too", inside.ravel())
        sd = np.array([each[way]["sd"] for each in found])[sure]
        print(f"  median sd of ln(stiffness) {np.array2string(np.median(sd, 0), precision=5)}")
        for n in np.flatnonzero(~sure):
            print(f"  test {found[n]['test']}: {'; '.join(found[n][way]['doubts'])}")


def said(what: str, holds: np.ndarray) -> None:
    """Print how often something holds, with the band of what happens with a chance of 95 %."""
    low, high = binom.interval(0.95, holds.size, 0.95)
    print(f"  {what}: {int(holds.sum())} of {holds.size} ({low:.0f} to {high:.0f} expected)")


def main() -> None:
    """Run the tests, those that are kept already left out, and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tests", type=int, default=200)
    parser.add_argument("--only", type=int, nargs="*", help="numbers of the tests, instead of the first ones")
    parser.add_argument("--seed", type=int, default=20261124)
    parser.add_argument("--kept", type=Path, help="a line of JSON for each test, from which a killed run goes on")
    parser.add_argument("--modes", type=Path, help="a folder that keeps the modes of each test")
    parser.add_argument("--searches", action="store_true", help="two searches for each fit, some 4 s, not `ident fit`")
    given = parser.parse_args()
    file = read_arm(DATA / "arm.toml")
    elbow = Point("elbow", file.arm.joints[2].name, (0.0, 0.0, 0.0))
    file = replace(file, arm=replace(file.arm, points=(elbow, *file.arm.points)))
    parameters = stiffness_parameters(file.arm, Unknowns())
    start = np.asarray(parameters.theta(parameters.column("start")))
    lines = given.kept.read_text().splitlines() if given.kept and given.kept.exists() else []
    known = {each["test"]: each for each in map(json.loads, lines)}
    if given.modes:
        given.modes.mkdir(exist_ok=True)
    wanted = range(given.tests) if given.only is None else given.only
    for n in (n for n in wanted if n not in known):
        rng, began = np.random.default_rng([given.seed, n]), time.process_time()
        kept = given.modes and given.modes / f"{n}.pickle"
        truth = start + SPREAD * rng.standard_normal(len(start))
        try:
            known[n] = {
                "test": n,
                **one_test(file, parameters, truth, rng, kept, searched if given.searches else fitted),
            }
        except IdentError as error:
            known[n] = {"test": n, "error": str(error)}
        if given.kept:
            with given.kept.open("a") as lines_file:
                lines_file.write(json.dumps(known[n]) + "\n")
        print(n, f"{time.process_time() - began:.1f} s of CPU", known[n].get("error", ""), file=sys.stderr, flush=True)
    print(f"{machine()}, commit {commit()}; seed {given.seed}, stiffnesses within {100 * SPREAD:.0f} %")
    found = [known[n] for n in wanted]
    for each in found:
        if "error" in each:
            print(f"test {each['test']} ended in an error: {each['error']}")
    report([each for each in found if "error" not in each])


if __name__ == "__main__":
    main()
