"""Coverage of what a laser tracker tells, its frame free: `python tests/benchmarks/tracker.py [--arm FILE]`.

Twenty postures, three known forces on the tip in turn, 30 um of noise in each component; loaded less unloaded, and as
absolute positions. The arm that measured has 0.5 mm of error in each offset, and loads that are off by 1 %. Its
stiffnesses are 10 % (sd) off the file, or drawn from the prior of the fit (`--truths prior`): then intervals hold the
truth in 95 % of campaigns whatever the data know.
"""

import argparse
import json

import jax

jax.config.update("jax_enable_x64", True)

from dataclasses import replace
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import binom
from timing import commit, machine

from ident.arm.arm import Arm
from ident.description.file import read_arm
from ident.identify.problem import pose
from ident.identify.unknowns import WEAK_PRIOR, Unknowns
from ident.inference.fit import fit
from ident.inference.information import half_width
from ident.measure import Campaign, Load, Measurement
from ident.programs import jit

Widths = dict[str, str]
DATA = Path(__file__).parents[2] / "data"
TURN, ORIGIN = Rotation.from_rotvec([0.4, -2.0, 1.1]).as_matrix(), np.array([2.3, -1.7, 0.6])
NOISE, OFFSET, SCALE, SPREAD = 3e-5, 5e-4, 0.01, 0.1
"""Of readings [m], of offsets [m], ln of the loads' common factor, ln of the true stiffnesses."""
PREDICT = jit(lambda problem, theta: problem.predict(theta))


def main() -> None:
    """Print how often each stiffness is in its interval, for each way to measure and to fit."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--campaigns", type=int, default=200)
    parser.add_argument("--arm", type=Path, default=DATA / "lcd_arm" / "arm.toml")
    parser.add_argument("--only", default="", help="ways whose names hold this text")
    parser.add_argument("--truths", choices=["near", "prior"], default="near", help="where true stiffnesses are drawn")
    parser.add_argument("--kept", type=Path, help="a line of JSON for each campaign, from which a killed run goes on")
    options = parser.parse_args()
    arm = read_arm(options.arm).arm
    spread = SPREAD if options.truths == "near" else WEAK_PRIOR
    offsets = {f"{joint.name}.offset.{axis}": "0.5mm" for joint in arm.joints[1:] for axis in "xyz"}
    both = {**offsets, "load": "1%"}
    ways = {
        ("deflection_difference", "nothing off"): ({}, {}),
        ("deflection_difference", "geometry off, taken as exact"): (offsets, {}),
        ("deflection_difference", "geometry off, uncertain"): (offsets, offsets),
        ("deflection_difference", "loads off, taken as exact"): ({"load": "1%"}, {}),
        ("deflection_difference", "loads off, uncertain"): ({"load": "1%"}, {"load": "1%"}),
        ("position", "both off, taken as exact"): (both, {}),
        ("position", "both off, uncertain"): (both, both),
    }
    print(f"{machine()}, commit {commit()}; true stiffnesses {options.truths}")
    for (kind, words), (wrong, uncertain) in ways.items():
        if options.only not in (name := f"{kind}, {words}"):
            continue
        found = kept(options.kept, name)
        for n in range(len(found), options.campaigns):
            found.append(one(arm, kind, (wrong, uncertain), spread, np.random.default_rng([0, n])))
            if options.kept:
                with options.kept.open("a") as file:
                    file.write(json.dumps({"way": name, **found[-1]}) + "\n")
        report(name, found)


def kept(path: Path | None, way: str) -> list[dict[str, Any]]:
    """Return the campaigns of one way that a file holds."""
    lines = path.read_text().splitlines() if path and path.exists() else []
    return [each for each in map(json.loads, lines) if each["way"] == way]


def report(name: str, found: list[dict[str, Any]]) -> None:
    """Print how often each stiffness is in its interval, in the order of `stiffness_paths`."""
    off, sd = (np.array([each[word] for each in found]) for word in ("off", "sd"))
    low, high = binom.ppf([0.005, 0.995], len(found), 0.95)
    print(
        f"{name}: of {len(found)}, band {low:.0f} to {high:.0f}; {sum(bool(each['doubts']) for each in found)} in doubt"
    )
    print(f"  in the interval reported    {np.sum([each['held'] for each in found], 0).tolist()}")
    print(f"  in the normal one           {(np.abs(off) < half_width(0.95) * sd).sum(0).tolist()}")
    print(f"  sd of ln(stiffness), median {np.median(sd, 0).round(3).tolist()}", flush=True)


def one(
    arm: Arm, kind: str, off_and_uncertain: tuple[Widths, Widths], spread: float, rng: np.random.Generator
) -> dict[str, Any]:
    """Return for one campaign of an arm that is off how far ln(stiffness) is off, its sd, and what holds the truth."""
    (wrong, uncertain), rows = off_and_uncertain, planned(arm, kind)
    truth = pose(arm, Campaign(measurements=in_base(rows)), Unknowns(uncertain=wrong)).problem
    start = np.asarray(truth.parameters.theta(truth.parameters.column("start")))
    sd = np.where(truth.parameters.nuisance, truth.parameters.normal_sd, spread)
    theta = start + sd * rng.standard_normal(len(start))
    vectors = np.asarray(PREDICT(truth, jnp.asarray(theta))).reshape(-1, 3)
    vectors = (vectors - (ORIGIN if kind == "position" else 0.0)) @ TURN
    values = vectors.ravel() + NOISE * rng.standard_normal(len(rows))
    campaign = Campaign(measurements=tuple(replace(m, value=float(v)) for m, v in zip(rows, values, strict=True)))
    fitted = fit(pose(arm, campaign, Unknowns(uncertain=uncertain)).problem, starts=1)
    own, true = ~fitted.problem.parameters.nuisance, theta[~truth.parameters.nuisance]
    low, high = np.log(fitted.interval()[own]).T
    return {
        "off": (fitted.best.theta[own] - true).tolist(),
        "sd": fitted.information.sd[own].tolist(),
        "held": ((low <= true) & (true <= high)).tolist(),
        "doubts": fitted.doubts,
    }


def planned(arm: Arm, kind: str) -> tuple[Measurement, ...]:
    """Return the rows of a campaign, with no values yet; postures at random within the middle of the limits."""
    rng, tip = np.random.default_rng(1), arm.points[-1].name
    low, high = np.clip(np.array([joint.limits for joint in arm.driven], float).T, -2.0, 2.0)
    size = 30.0 * np.eye(3) if len(arm.joints) > 3 else 300.0 * np.eye(3)
    loads = [Load(forces=((tuple(force), tip),)) for force in size]
    loads = [Load(), *loads] if kind == "position" else loads
    return tuple(
        Measurement(
            kind=kind,
            posture=tuple(q),
            value=0.0,
            sigma=NOISE,
            point=tip,
            direction=tuple(axis),
            load=load,
            setup="tracker",
        )
        for q in rng.uniform(low, high, (20, len(low))).tolist()
        for load in loads
        for axis in np.eye(3).tolist()
    )


def in_base(rows: tuple[Measurement, ...]) -> tuple[Measurement, ...]:
    """Return the same as it would be read in the base frame."""
    return tuple(replace(m, setup="") for m in rows)


if __name__ == "__main__":
    main()
