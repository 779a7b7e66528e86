"""Labels and stiffnesses of synthetic hammer tests: `python tests/benchmarks/hammer_tests.py [--tests 200]`.

Each test is the paper's arm with stiffnesses drawn by 20 % about its file's, unknown to the fit, in two postures; in
the second one the two lowest modes are some percents apart. Two accelerometers along y and z, hits at the tip along
both, five of each, noise of 1 to 5 % of each frequency response; the responses are those of the equations of motion,
linearised, with their dampers. Counted: wrong names given with certainty, modes without a certain name, and 95 %
intervals of fitted stiffnesses that hold the truth, from frequencies and damping ratios alone and with shapes as data.
"""

import argparse
import json
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp
import numpy as np
from scipy.stats import binom, chi2
from timing import commit, machine

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))
import quickly  # noqa: F401  # the programs of fits compiled with half the effort

from ident.arm.arm import Arm
from ident.arm.chain import at_posture
from ident.arm.modes import linearize
from ident.arm.motors import point_motion
from ident.arm.parts import Point
from ident.assess.identified_modes import IdentifiedModes, modal_campaign
from ident.description.file import read_arm
from ident.errors import IdentError
from ident.identify.build_problem import build_problem
from ident.identify.modal_analysis import ModalAnalysis, modal_analysis
from ident.identify.mode_labels import label_modes
from ident.identify.unknowns import Unknowns, stiffness_parameters
from ident.inference.least_squares import solve
from ident.inference.problem import InverseProblem
from ident.measure import OWN_WEIGHT
from ident.modal.estimate import Modes, modes_of, together
from ident.modal.frf import Frf, Place
from ident.modal.stabilisation import mac

DATA = Path(__file__).parents[2] / "data" / "lcd_arm"
POSTURES = tuple(tuple(np.radians(a) * np.array([1.0, -2.0, 1.0])) for a in (0.0, 60.0))
LINES = np.arange(1.0, 24.0, 0.05)
PLACES = tuple(Place(point, axis) for point in ("tip", "elbow") for axis in ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
SPREAD = 0.2
HITS = 5


@dataclass(frozen=True)
class Shaken:
    """An arm at a posture as a linear system."""

    M: np.ndarray
    C: np.ndarray
    H: np.ndarray
    rows: np.ndarray

    def accelerance(self, frequency):
        """B s^2 (s^2 M + s C + H)^-1 B', responses by references by lines."""
        s = 2j * np.pi * frequency[:, None, None]
        moved = np.linalg.solve(s**2 * self.M + s * self.C + self.H, self.rows.T[None])
        return np.moveaxis(s**2 * (self.rows @ moved), 0, -1)[:, :2]


@dataclass(frozen=True)
class Measured:
    """A test of one posture, as far as a campaign asks."""

    frf: object
    posture: tuple[float, ...]
    load: object = OWN_WEIGHT
    drives: str = "brake"


def hammered(structure: Shaken, noise: float, rng: np.random.Generator) -> Frf:
    """Return the hits of a test, with noise as a share of the largest response of each accelerometer."""
    clean = structure.accelerance(LINES)
    size = noise * np.sqrt((np.abs(clean) ** 2).mean(-1)).max(1)[:, None, None]
    scatter = rng.normal(size=(HITS, *clean.shape, 2)) @ np.array([1, 1j]) / np.sqrt(2)
    return Frf(LINES, clean + size * scatter, PLACES, PLACES[:2], 0.0)


def shaken(arm: Arm, posture: tuple[float, ...]) -> Shaken:
    """Return the arm's equations at a posture and how its coordinates move the places."""
    names = [point.name for point in arm.points]
    found = linearized(arm, jnp.asarray(posture))
    rows = [np.asarray(found[1])[:, names.index(place.point)].T @ np.array(place.direction) for place in PLACES]
    return Shaken(*(np.asarray(each) for each in found[0]), np.array(rows))


@jax.jit
def linearized(arm: Arm, posture):
    """Return M, C, H and how each coordinate moves the points (3, P, n)."""
    chain = at_posture(arm, posture)
    linear = linearize(chain)
    unit = jnp.eye(len(linear.M))
    return (linear.M, linear.C, linear.H), jax.vmap(lambda v: point_motion(chain, linear.phi, v), 1, 2)(unit)


def one_test(arm: Arm, parameters, truth: np.ndarray, rng: np.random.Generator) -> dict:
    """Return what comes of a test: names given, wrong and withheld, and how far fitted values are off."""
    true = arm.replace(parameters.by_path(np.asarray(parameters.values(truth))))
    noise = rng.uniform(0.01, 0.05)
    frfs = [hammered(shaken(true, q), noise, rng) for q in POSTURES]
    modes = together([modes_of(frf) for frf in frfs])
    labels = [label_modes(arm, q, each, parameters) for q, each in zip(POSTURES, modes, strict=True)]
    names = {"given": 0, "wrong": 0, "doubtful": 0}
    for q, each, own in zip(POSTURES, modes, labels, strict=True):
        known = modal_analysis(true, q, modes=8)
        for i, given in enumerate(own.given):
            meant = known.labels[meant_mode(each, i, known)]
            names["given" if given else "doubtful"] += 1
            names["wrong"] += int(given is not None and given != meant)
    tests = [Measured(frf, q) for frf, q in zip(frfs, POSTURES, strict=True)]
    identified = [IdentifiedModes(*pair) for pair in zip(modes, labels, strict=True)]
    found = {"noise": noise, **names}
    for way, shapes in (("poles", False), ("shapes", True)):
        problem = build_problem(arm, modal_campaign("test", tests, identified, shapes=shapes))
        found[way] = fitted(problem, parameters.names, truth)
    return found


def meant_mode(modes: Modes, i: int, known: ModalAnalysis) -> int:
    """Return which of the true arm's modes one is: of those within 5 % in frequency the one that moves like it most."""
    names = [point.name for point in known.arm.points]
    moved = np.array([np.array(p.direction) @ known.modes.motion[:, names.index(p.point)] for p in PLACES])
    alike = mac(modes.shape[:, [i]], moved.astype(complex))[0]
    near = abs(np.log(known.modes.frequency / modes.frequency[i]))
    return int(np.argmax(np.where(near < max(0.05, near.min() + 1e-9), alike, -1.0)))


def fitted(problem: InverseProblem, names: tuple[str, ...], truth: np.ndarray) -> dict:
    """Return how far the optimum is off that a search from the file's values ends in, and what is said of it."""
    own = problem.parameters
    end = solve(problem, np.asarray(own.theta(own.column("start"))))
    residuals, slope = problem.weigh(np.asarray(end.predicted), np.asarray(end.jacobian), np.asarray(end.theta))
    data = residuals[: len(problem.kinds)]
    order = [own.names.index(name) for name in names]
    off = np.asarray(end.theta)[order] - truth
    covariance = np.linalg.inv(slope.T @ slope)[np.ix_(order, order)]
    return {
        "off": off.tolist(),
        "sd": np.sqrt(np.diag(covariance)).tolist(),
        "joint": float(off @ np.linalg.solve(covariance, off)),
        "p": float(chi2.sf(data @ data, len(data) - len(own.names))),
    }


def report(found: list[dict]) -> None:
    """Print the rates."""
    total = {key: sum(each[key] for each in found) for key in ("given", "wrong", "doubtful")}
    every = total["given"] + total["doubtful"]
    print(f"{len(found)} tests, {every} modes: {total['given']} named, {total['wrong']} of them wrongly;", end=" ")
    print(f"{total['doubtful']} doubtful, {100 * total['doubtful'] / every:.1f} %")
    for way in ("poles", "shapes"):
        off, sd = (np.array([each[way][key] for each in found]) for key in ("off", "sd"))
        inside, number = int((abs(off) < 1.959964 * sd).sum()), off.size
        low, high = binom.interval(0.95, number, 0.95)
        joint = int((np.array([each[way]["joint"] for each in found]) < chi2.ppf(0.95, off.shape[1])).sum())
        right = int((np.array([each[way]["p"] for each in found]) > 0.05).sum())
        band = binom.interval(0.95, len(found), 0.95)
        print(
            f"{way:<7} intervals of stiffnesses {inside} of {number} hold the truth, {low:.0f} to {high:.0f} expected;"
        )
        print(
            f"        together {joint}, chi-squared {right} of {len(found)}, {band[0]:.0f} to {band[1]:.0f} expected;"
        )
        print(f"        median sd of ln(stiffness) {np.array2string(np.median(sd, 0), precision=5)}")


def main() -> None:
    """Run the tests, those that are kept already left out, and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tests", type=int, default=200)
    parser.add_argument("--seed", type=int, default=20261124)
    parser.add_argument("--kept", type=Path, help="a line of JSON for each test, from which a killed run goes on")
    given = parser.parse_args()
    arm = read_arm(DATA / "arm.toml").arm
    arm = replace(arm, points=(Point("elbow", arm.joints[2].name, (0.0, 0.0, 0.0)), *arm.points))
    parameters = stiffness_parameters(arm, Unknowns())
    start = np.asarray(parameters.theta(parameters.column("start")))
    lines = given.kept.read_text().splitlines() if given.kept and given.kept.exists() else []
    found = [json.loads(line) for line in lines]
    for n in range(len(found), given.tests):
        rng, began = np.random.default_rng([given.seed, n]), time.process_time()
        try:
            found.append(one_test(arm, parameters, start + SPREAD * rng.standard_normal(len(start)), rng))
        except IdentError as error:
            found.append({"error": str(error)})
        if given.kept:
            with given.kept.open("a") as file:
                file.write(json.dumps(found[-1]) + "\n")
        print(n, f"{time.process_time() - began:.1f} s of CPU", found[-1].get("error", ""), file=sys.stderr, flush=True)
    print(f"{machine()}, commit {commit()}; seed {given.seed}, stiffnesses within {100 * SPREAD:.0f} %")
    broken = [each for each in found if "error" in each]
    print(f"{len(broken)} tests ended in an error")
    report([each for each in found if "error" not in each])


if __name__ == "__main__":
    main()
