"""Every part of the shipped campaign that a laboratory might have, and what check, fit and profile say of each.

A truth is drawn from the prior that the fit uses, its data from the model there.
"""

import re
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import jax.numpy as jnp
import numpy as np
from arms import DATA, lcd_arm

import ident
from ident.arm.arm import Arm
from ident.errors import InputError, ModelError
from ident.identify.problem import pose
from ident.inference.search import evaluate
from ident.measure import Campaign, Measurement, read_campaign
from ident.studies.result import Result

SIGMA = {"frequency": 0.005, "deflection": 0.02}
"""Standard deviation as a fraction of the true value."""
TRUST = ("all",)
"""No value is refused as implausible: a truth from the prior may be far from the arm file."""
FAMILIES: dict[str, Callable[[str], bool]] = {
    "all modes": lambda label: True,
    "vertical modes": lambda label: label.startswith("vertical"),
    "lateral modes": lambda label: label.startswith("lateral"),
    "one mode": lambda label: label == "lateral torsion 1",
}


@cache
def shipped() -> Campaign:
    """The shipped campaign."""
    return read_campaign(DATA / "lcd_arm" / "campaign.csv")


def parts() -> dict[str, Campaign]:
    """Return 55 campaigns by name: kinds, postures, families of modes; all modes with and without labels."""
    whole, found = shipped(), {}
    for where, postures in [("everywhere", whole.postures), *(_place(p) for p in whole.postures)]:
        rows = [m for m in whole if m.posture in postures]
        static = [m for m in rows if m.kind == "deflection"]
        found[f"deflections, {where}"] = static
        for name, modal in _families(rows):
            found[f"{name}, {where}"] = modal
            found[f"{name} and deflections, {where}"] = [*modal, *static]
    return {name: replace(whole, name=name, measurements=tuple(rows)) for name, rows in found.items()}


def _place(posture: tuple[float, ...]) -> tuple[str, tuple[tuple[float, ...], ...]]:
    return f"at {np.rad2deg(posture[0]):.0f} deg", (posture,)


def _families(rows: list[Measurement]) -> Iterator[tuple[str, list[Measurement]]]:
    modal = [m for m in rows if m.kind == "frequency"]
    for name, belongs in FAMILIES.items():
        yield name, [m for m in modal if belongs(m.mode or "")]
    yield "unlabelled modes", [replace(m, mode=None) for m in modal]


@dataclass(frozen=True)
class Verdict:
    """What was said of one simulated campaign.

    Attributes:
        part: its name.
        factor: the stated sigma over the true one.
        draw: number of the truth.
        refused: the clear word with which it was refused; empty if it was not.
        broken: traceback of what should not happen, or a report that says nan.
        lost: number of starts that ended at no optimum and in no open direction.
        doubts: why no interval is quoted.
        shown: parameters whose interval the fit shows, those of them that hold the truth, and whose profile does.
        held: see there.
        profiled: see there.
        optima: number of optima found, and whether the truth fits better than all of them.
        missed: see there.
    """

    part: str
    factor: float
    draw: int
    refused: str = ""
    broken: str = ""
    lost: int = 0
    doubts: list[str] = field(default_factory=list)
    shown: list[str] = field(default_factory=list)
    held: list[str] = field(default_factory=list)
    profiled: list[str] = field(default_factory=list)
    optima: int = 0
    missed: bool = False


def judge(part: str, factor: float, draw: int, seed: int) -> Verdict:
    """Simulate one campaign, and let check, fit and profile speak of it."""
    return _of_simulated(_judge, part, factor, draw, seed)


def sampled(part: str, factor: float, draw: int, seed: int) -> Verdict:
    """Simulate one campaign, and sample its posterior, not for long."""
    return _of_simulated(_sample, part, factor, draw, seed)


def _of_simulated(
    speak: Callable[[Verdict, Campaign, np.ndarray], Verdict], part: str, factor: float, draw: int, seed: int
) -> Verdict:
    truth, campaign = simulated(part, factor, draw, seed)
    verdict = Verdict(part, factor, draw)
    try:
        return speak(verdict, campaign, truth)
    except (InputError, ModelError) as refusal:
        return replace(verdict, refused=str(refusal))
    except Exception:
        return replace(verdict, broken=traceback.format_exc(limit=-4))


def simulated(part: str, factor: float, draw: int, seed: int, arm: Arm | None = None) -> tuple[np.ndarray, Campaign]:
    """Return a truth from the prior at which the model has an answer, and its campaign."""
    campaign = parts()[part]
    problem = pose(arm or lcd_arm(), campaign).problem
    rng = np.random.default_rng([seed, list(parts()).index(part), draw])
    for _ in range(100):
        truth = np.asarray(
            problem.parameters.from_uniform(jnp.asarray(rng.uniform(size=len(problem.parameters.items))))
        )
        exact = np.asarray(evaluate(problem, jnp.asarray(truth)).predicted)
        if np.isfinite(exact).all() and (exact > 0).all():
            break
    sigma = np.array([SIGMA[m.kind] for m in campaign]) * exact
    values = exact + sigma * rng.standard_normal(len(exact))
    rows = zip(campaign, values, factor * sigma, strict=True)
    return truth, replace(campaign, measurements=tuple(replace(m, value=v, sigma=s) for m, v, s in rows))


def _sample(verdict: Verdict, campaign: Campaign, truth: np.ndarray) -> Verdict:
    options = ident.SampleOptions(trust_values=TRUST, steps=500, ess=100.0, seed=verdict.draw)
    with TemporaryDirectory() as folder:
        result = ident.sample(lcd_arm(), campaign, options, folder=Path(folder) / "part")
        result.save(folder)
    found = result.sample.fitted
    names = found.problem.parameters.names
    low, high = np.asarray(found.problem.parameters.theta(np.array([result.intervals[n] for n in names]))).T
    held = [n for n, ok in zip(names, (low < truth) & (truth < high), strict=True) if ok]
    said = replace(verdict, broken=_broken(result), doubts=list(found.doubts), optima=len(found.optima))
    return replace(said, shown=list(names) if result.enough else [], held=held if result.enough else [])


def _broken(*results: Result) -> str:
    """Return the first report that says nan."""
    reports = (each.report() for each in results)
    return next((text for text in reports if re.search(r"\bnan\b", text)), "")


def _judge(verdict: Verdict, campaign: Campaign, truth: np.ndarray) -> Verdict:
    checked = ident.check(lcd_arm(), campaign, ident.CheckOptions(trust_values=TRUST))
    profiled = ident.profile(lcd_arm(), campaign, ident.ProfileOptions(trust_values=TRUST, seed=verdict.draw))
    fitted = ident.FitResult(profiled.arm, profiled.fit)
    found = profiled.fit
    names, posed = found.problem.parameters.names, found.problem
    low, high = np.asarray(posed.parameters.theta(found.interval())).T
    shown = [name for name, ok in zip(names, found.supported, strict=True) if ok]
    inside = dict(zip(names, (low < truth) & (truth < high), strict=True))
    profiles = {each.name: each.widest for each in profiled.profiles}
    at_truth = np.asarray(evaluate(posed, jnp.asarray(truth)).predicted)
    cost = float((posed.weigh(at_truth, np.zeros((len(at_truth), len(truth))), truth)[0] ** 2).sum())
    return replace(
        verdict,
        broken=_broken(checked, fitted, profiled),
        lost=found.failed,
        doubts=list(found.doubts),
        shown=shown,
        held=[name for name in shown if inside[name]],
        profiled=[n for n in shown if profiles[n].low < truth[names.index(n)] < profiles[n].high],
        optima=len(found.optima),
        missed=cost < found.best.cost - 1e-3,
    )
