"""How often intervals of tap tests cover the truth: `python tests/benchmarks/taps.py [--tests 200] [--kept FILE]`.

Each test is the paper's arm where two modes are 2 % apart, tapped six times by hand, sideways and downwards in turn, at
random places, with random shapes, a third of them double; two accelerometers of 0.3 and of 3 mg/sqrt(Hz), mains, 16
bits. Counted: frequencies and damping ratios whose 95 % interval covers the truth, their half width over 1.96 times the
rms error, modes that are none and, in the first `--names` tests, names. `--hammer 50` strikes the force out of the
shipped hammer test, with so many seeds of its noise: chi-squared of the frequencies against the true poles.
"""

import argparse
import json
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.stats import chi2
from timing import commit, machine

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))
from ambient import matched
from hammer_files import FOLDER, generator
from modal import covered
from tapped import POSTURE, RATE, tap_test, tapped

import ident
from ident.arm.chain import body_axes
from ident.description.file import read_arm
from ident.errors import InputError
from ident.identify.modal_analysis import modal_analysis
from ident.identify.mode_names import Measured, label_modes
from ident.identify.unknowns import Unknowns, stiffness_parameters
from ident.measure import Load
from ident.modal.frf import Place
from ident.modal.operational import operational_modes

NOISES = (0.3, 3.0)
SHARP = 0.05
"""Damping ratio below which a mode has to be found."""


@dataclass(frozen=True)
class Truth:
    """Poles of the shipped hammer test's arm."""

    poles: np.ndarray


def numbers(truth, modes, names=()) -> dict:
    """Return how far each found mode is off, in the order of the truth; -1 for one that is none."""
    found = {"modes": [], "none": []}
    for i, j in enumerate(matched(truth, modes)):
        own = [float(modes.frequency[i]), float(modes.damping[i]), *modes.sigma[:, i].tolist()]
        found["none" if j < 0 else "modes"].append([j, *own, names[i] if names else ""])
    return found


def one_test(truth, noise, seed, arm=None) -> dict:
    """Return what comes of a test; with an arm its modes are named: right, wrong or doubtful."""
    rng = np.random.default_rng([seed, int(10 * noise)])
    try:
        modes = operational_modes(tap_test(truth.record(rng, noise=noise)))
    except InputError as error:
        return {"error": str(error), "modes": [], "none": []}
    return numbers(truth, modes, named(arm, truth, modes) if arm else ())


def named(arm, truth, modes) -> list[str]:
    """Return for each mode whether its name is right, wrong or doubtful."""
    load, posture = Load.parse(generator().LOAD), tuple(np.radians(POSTURE))
    links = {joint.name: joint.link[0].name for joint in arm.joints}
    axes = {point.name: body_axes(arm, np.array(posture), links[point.joint]) for point in arm.points}  # of the sensors
    places = tuple(Place(each.point, tuple(axes[each.point] @ each.direction)) for each in modes.responses)
    test = Measured(posture, replace(modes, responses=places), load)
    (labels,) = label_modes(arm, [test], stiffness_parameters(arm, Unknowns()))
    known = modal_analysis(arm, np.array(posture), load, modes=12)
    words = []
    for label, j in zip(labels.given, matched(truth, modes), strict=True):
        right = known.labels[int(np.argmin(np.abs(known.modes.frequency - truth.frequency[j])))] if j >= 0 else ""
        words.append("doubtful" if label is None else "right" if str(label) == str(right) else "wrong")
    return words


def count(truth, found) -> None:
    """Print the rates."""
    frequency, damping = np.abs(truth.poles) / (2 * np.pi), -truth.poles.real / np.abs(truth.poles)
    rows = np.array([row[:5] for each in found for row in each["modes"]])
    true = rows[:, 0].astype(int)
    off = rows[:, 1:3] - np.stack([frequency, damping], 1)[true]
    scaled = off / rows[:, 3:]
    for name, some in (("all", damping[true] < 1), (f"below {SHARP:.0%}", damping[true] < SHARP)):
        print(f"modes damped by: {name}")
        covered("  frequencies", scaled[some, 0])
        covered("  damping ratios", scaled[some, 1])
    for j, (hertz, ratio) in enumerate(zip(frequency, damping, strict=True)):
        own = true == j
        if not own.any():
            print(f"  {hertz:7.3f} Hz, {100 * ratio:5.2f} %: found 0 of {len(found)}")
            continue
        inside = (np.abs(scaled[own]) < 1.96).mean(0)
        width = np.median(rows[own, 3:], 0) / np.sqrt((off[own] ** 2).mean(0))
        print(
            f"  {hertz:7.3f} Hz, {100 * ratio:5.2f} %: found {own.sum()} of {len(found)}; covered: frequency "
            f"{inside[0]:.3f}, damping {inside[1]:.3f}; half width over 1.96 rms: {width[0]:.2f}, {width[1]:.2f}"
        )
    words = [row[5] for each in found for row in [*each["modes"], *each["none"]] if row[5]]
    counted = ", ".join(f"{words.count(word)} {word}" for word in ("right", "wrong", "doubtful"))
    print(f"names                  {counted}; {sum(len(each['none']) for each in found)} modes found that are none")
    print("\n".join(f"test {n}: {each['error']}" for n, each in enumerate(found) if "error" in each))


def struck_out(seeds: int) -> None:
    """Print what comes of the shipped hammer test without its force, posture by posture."""
    make, arm = generator(), read_arm(FOLDER / "arm.toml").arm
    noise, line = make.NOISE["acceleration"], make.MAINS
    make.NOISE, make.MAINS = {"force": 0.0, "acceleration": 0.0}, (line[0], 0.0)
    for alpha in make.ALPHA:
        posture = (alpha, -2 * alpha, alpha)
        seen, rng = make.system(arm, np.radians(posture)), np.random.default_rng(make.SEED)
        clean = [make.records(seen, alpha, force, rng)[1] for force in make.FORCES]
        inside = seen.poles[(seen.poles.imag > 0) & (np.abs(seen.poles) < 2 * np.pi * RATE / 4)]
        truth, found = Truth(inside[np.argsort(np.abs(inside))]), []
        for seed in range(seeds):
            own = np.random.default_rng([seed, alpha])
            blocks = [each[:, n] for each in clean for n in range(each.shape[1])]
            time = np.arange(blocks[0].shape[1]) / make.RATE
            faded = np.exp(-make.WINDOW.get(alpha, 0.0) * time)
            heard = [
                block
                + (line[1] * np.sin(2 * np.pi * (line[0] * time + own.random())) + noise * own.normal(size=block.shape))
                * faded
                for block in blocks
            ]
            test = tap_test(*heard, posture=posture, decay=make.WINDOW.get(alpha, 0.0))
            found.append(numbers(truth, operational_modes(test)))
        print(f"posture {alpha} deg")
        count(truth, found)
        hertz = np.abs(truth.poles) / (2 * np.pi)
        off = [((row[1] - hertz[row[0]]) / row[3]) ** 2 for each in found for row in each["modes"]]
        most = chi2.ppf(0.95, len(off))
        print(f"chi-squared            {sum(off):.1f} of {len(off)} frequencies; at most {most:.1f}", flush=True)


def main() -> None:
    """Run the tests, those that are kept already left out, and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tests", type=int, default=200)
    parser.add_argument("--names", type=int, default=200)
    parser.add_argument("--hammer", type=int, default=0, help="seeds of the shipped hammer test, instead")
    parser.add_argument("--kept", type=Path, help="a line of JSON for each test, from which a killed run goes on")
    given = parser.parse_args()
    ident.ModalOptions()
    print(f"{machine()}, commit {commit()}")
    if given.hammer:
        struck_out(given.hammer)
        return
    truth, arm = tapped(), read_arm(FOLDER / "arm.toml").arm
    lines = given.kept.read_text().splitlines() if given.kept and given.kept.exists() else []
    known = {(each["noise"], each["seed"]): each for each in map(json.loads, lines)}
    for n in range(given.tests):
        for noise in (noise for noise in NOISES if (noise, n) not in known):
            known[noise, n] = {"noise": noise, "seed": n}
            known[noise, n] |= one_test(truth, noise, n, arm if n < given.names else None)
            if given.kept:
                with given.kept.open("a") as file:
                    file.write(json.dumps(known[noise, n]) + "\n")
    for noise in NOISES:
        print(f"{noise} mg/sqrt(Hz), {given.tests} tests")
        count(truth, [known[noise, n] for n in range(given.tests)])


if __name__ == "__main__":
    main()
