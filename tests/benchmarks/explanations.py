"""How often what is wrong on purpose is found among what would reconcile the data: `... explanations.py [--draws 10]`.

The shipped campaign's rows, measured on arms whose stiffnesses are drawn about the file's (a tenth), one thing wrong.
"""

import argparse

import jax

jax.config.update("jax_enable_x64", True)

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from timing import commit, machine

from ident.arm.arm import Arm, stiffness_paths
from ident.arm.springs import Spring
from ident.description.file import read_arm
from ident.identify.conditions import bind
from ident.identify.explanations import explain
from ident.identify.fit import fit_campaign
from ident.identify.predict import predict
from ident.jit import jit
from ident.measure import Campaign, Load, read_campaign

DATA = Path(__file__).parents[2] / "data" / "lcd_arm"
SPREAD = 0.1
LARGEST = 1790.0, 752.0, 197.0
"""Bending moments [N m] of the three joints in this campaign."""
PREDICT = jit(lambda arm, conditions: predict(arm, {}, conditions))

Fault = tuple[Callable[[Arm], Arm], Callable[[Campaign], Campaign], tuple[str, str]]


def heavier(arm: Arm) -> Arm:
    """Make the fingers 30 % heavier."""
    return arm.replace({"fingers.mass": 1.3 * float(arm.get("fingers.mass"))})


def hardening(arm: Arm) -> Arm:
    """Let all bending springs harden, their transitions within the data."""
    ends = {"ratio2": 1.2, "ratio3": 1.4}
    springs = [
        Spring(f"s{n}", f"joint{n}", "bending", torque1=0.6 * m, torque2=0.9 * m, **ends)
        for n, m in enumerate(LARGEST, 1)
    ]
    return replace(arm, springs=tuple(springs))


def gauge(campaign: Campaign) -> Campaign:
    """Read all deflections as 0.93 of what they are."""
    rows = (replace(m, value=0.93 * m.value) if m.kind == "deflection" else m for m in campaign)
    return replace(campaign, measurements=tuple(rows))


def misread(campaign: Campaign) -> Campaign:
    """Read the first deflection as 1.2 of what it is."""
    place = next(i for i, m in enumerate(campaign) if m.kind == "deflection")
    rows = (replace(m, value=1.2 * m.value) if i == place else m for i, m in enumerate(campaign))
    return replace(campaign, measurements=tuple(rows))


FAULTS: dict[str, Fault] = {
    "none": (lambda arm: arm, lambda campaign: campaign, ("", "")),
    "fingers 30 % heavier": (heavier, lambda campaign: campaign, ("mass", "fingers")),
    "deflections x 0.93": (lambda arm: arm, gauge, ("scale", "deflection")),
    "one deflection x 1.2": (lambda arm: arm, misread, ("value", "deflection")),
    "glass on, unsaid, in deflections": (lambda arm: arm, lambda campaign: campaign, ("on", "glass")),
    "springs harden": (hardening, lambda campaign: campaign, ("spring", "bending")),
}


def main() -> None:
    """Print, by fault, how many campaigns were in doubt, and where the true cause came."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=10)
    parser.add_argument("--only", default="")
    options = parser.parse_args()
    arm, campaign = read_arm(DATA / "arm.toml").arm, read_campaign(DATA / "campaign.csv")
    print(f"{machine()}, commit {commit()}")
    for words, fault in FAULTS.items():
        if options.only in words:
            began = time.process_time()
            places = [place(arm, campaign, words, fault, seed) for seed in range(options.draws)]
            doubtful = [p for p in places if p is not None]
            found = [p[0] for p in doubtful if p[0]]
            print(
                f"{words}: in doubt {len(doubtful)} of {len(places)}; true cause fits {len(found)}, first"
                f" {found.count(1)}, second {found.count(2)}; explanations that fit, median"
                f" {np.median([p[1] for p in doubtful] or [0]):.0f}; {time.process_time() - began:.0f} s",
                flush=True,
            )


def place(arm: Arm, campaign: Campaign, words: str, fault: Fault, seed: int) -> tuple[int, int] | None:
    """Return the place of the true cause among those that fit (0 for none), and their number; None where no doubt is.

    A truth whose modes change names is drawn again.
    """
    change, spoil, cause = fault
    rng = np.random.default_rng(seed)
    rows = campaign.measurements
    if words.startswith("glass"):
        rows = tuple(replace(m, load=Load(("glass",))) if m.kind == "deflection" else m for m in rows)
    sigma = np.array([m.sigma for m in rows])
    exact = np.full(len(rows), np.nan)
    while not np.isfinite(exact).all():
        drawn = {path: float(arm.get(path)) * np.exp(SPREAD * rng.standard_normal()) for path in stiffness_paths(arm)}
        true = change(arm.replace(drawn))
        exact = np.asarray(PREDICT(true, bind(true, replace(campaign, measurements=rows))))
    values = exact + sigma * rng.standard_normal(len(rows))
    said = (replace(m, value=float(v)) for m, v in zip(campaign, values, strict=True))
    fit = fit_campaign(arm, spoil(replace(campaign, measurements=tuple(said))), trusted=("all",), starts=4)
    found = explain(fit) if fit.in_doubt else None
    if found is None:
        return None
    causes = [[(change.kind, change.of) for change in item.changes] for item in found.fitting]
    return next((i for i, each in enumerate(causes, 1) if each == [cause]), 0), len(causes)


if __name__ == "__main__":
    main()
