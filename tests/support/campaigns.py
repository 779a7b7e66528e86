"""Campaigns that are right, or wrong in a known way, and what a fit says of them: for rates of false and true alarms.

A truth is drawn from the prior, data from the model there. Each case is one problem, so that one program serves all.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from arms import DATA, lcd_arm, posture_of, random_arm
from chains import storey_frequencies

from ident.identify.build_problem import build_problem
from ident.inference.fit import Fit, fit
from ident.inference.least_squares import evaluate
from ident.inference.parameters import Parameter, Parameters
from ident.inference.problem import InverseProblem
from ident.measure import Campaign, Load, Measurement, read_campaign

FAULTS = ("none", "swapped", "payload", "outliers", "copied")
"""What is wrong: nothing; two frequencies exchanged; deflections under more load than told; 10 % of the values (one at
least) 10 sigma off; sigmas ten times too large."""
OFF = 10.0
WEIGHT = 1.1
"""Factor of the deflections of a storey building whose load is not as told; the arm gets a mass on its tip."""


@dataclass(frozen=True)
class Case:
    """A kind of campaign.

    Attributes:
        problem: its sigmas are replaced where `relative` are given.
        relative: sigma as a fraction of the true value by kind.
        least: what is added to sigma by kind, as for a dial gauge's scale.
        swap: places of the two values that a wrong label exchanges.
        loaded: the same model, deflections under a load that nobody told; None for a factor `WEIGHT`.
        starts: of the fit.
    """

    problem: InverseProblem
    relative: dict[str, float]
    swap: tuple[int, int]
    loaded: InverseProblem | None = None
    starts: int = 16
    least: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Outcome:
    """What a fit says of one campaign.

    Attributes:
        draw: its number.
        alarms: which tests ring.
        p: p-value by kind of the comparison with the others, and of chi-squared as `all`.
        shown: parameters whose interval is shown, and those of them that hold the truth.
        held: see there.
        missed: whether the truth fits better than the best optimum found.
    """

    draw: int
    alarms: list[str]
    p: dict[str, float]
    shown: list[str]
    held: list[str]
    missed: bool


@cache
def case(name: str) -> Case:
    """Return a case by its name."""
    return CASES[name]()


def outcome(name: str, fault: str, draw: int, seed: int) -> Outcome:
    """Draw a truth, make its campaign, spoil it, and fit it."""
    rng = np.random.default_rng([seed, FAULTS.index(fault), draw])
    truth, posed = _campaign(case(name), fault, rng)
    found = fit(posed, starts=case(name).starts, seed=draw)
    at_truth = np.asarray(evaluate(posed, jnp.asarray(truth)).predicted)
    cost = float((posed.weigh(at_truth, np.zeros((len(at_truth), len(truth))), truth)[0] ** 2).sum())
    low, high = np.asarray(posed.parameters.theta(found.interval())).T
    names = posed.parameters.names
    shown = [n for n, ok in zip(names, found.supported, strict=True) if ok]
    held = [n for n, a, b, x in zip(names, low, high, truth, strict=True) if n in shown and a < x < b]
    p = {each.kind: each.p_value for each in found.cross_predictions} | {"all": found.p_value}
    return Outcome(draw, list(_alarms(found)), p, shown, held, fault == "none" and cost < found.best.cost - 1e-3)


def _alarms(found: Fit) -> dict[str, bool]:
    every = {
        "kinds": found.contradictory,
        "rows": bool(found.outliers.any()),
        "chi-squared large": found.p_value < 1e-3,
        "chi-squared small": bool(found.remarks),
        "no optimum": not found.best.converged,
        "any that withholds": bool(found.doubts),
    }
    return {name: True for name, rings in every.items() if rings}


def _campaign(kind: Case, fault: str, rng: np.random.Generator) -> tuple[np.ndarray, InverseProblem]:
    parameters = kind.problem.parameters
    for _ in range(100):  # a truth at which the model has an answer
        truth = np.asarray(parameters.from_uniform(jnp.asarray(rng.uniform(size=len(parameters.items)))))
        values = np.asarray(evaluate(kind.problem, jnp.asarray(truth)).predicted).copy()
        if np.isfinite(values).all():
            break
    sigma = np.array([kind.relative[k] for k in kind.problem.kinds]) * np.abs(values)
    sigma += np.array([kind.least.get(k, 0.0) for k in kind.problem.kinds])
    if fault == "payload":
        off = np.array(kind.problem.kinds) == "deflection"
        values = (
            np.where(off, WEIGHT * values, values)
            if kind.loaded is None
            else np.asarray(evaluate(kind.loaded, jnp.asarray(truth)).predicted)
        )
    data = values + sigma * rng.standard_normal(len(values))
    if fault == "swapped":
        data[list(kind.swap)] = data[list(kind.swap[::-1])]
    if fault == "outliers":
        hit = rng.permutation(len(data))[: max(1, len(data) // 10)]
        data[hit] += OFF * sigma[hit] * rng.choice([-1, 1], len(hit))
    sigma = 10 * sigma if fault == "copied" else sigma
    return truth, eqx.tree_at(lambda p: (p.measured, p.sigma), kind.problem, (jnp.asarray(data), jnp.asarray(sigma)))


def _paper() -> Case:
    """The shipped campaign's rows without labels, in ascending order: they exist for every truth."""
    rows = [replace(m, mode=None) for m in read_campaign(DATA / "lcd_arm" / "campaign.csv")]
    more = [replace(m, load=Load.parse("2 kg @ tip")) if m.kind == "deflection" else m for m in rows]
    told, loaded = (build_problem(lcd_arm(), Campaign(measurements=tuple(each))) for each in (rows, more))
    return Case(told, {"frequency": 0.005, "deflection": 0.02}, (0, 1), loaded)


def _six_axes() -> Case:
    """A random six-axis arm: the six lowest frequencies and the tip's deflection at each of eight postures."""
    rng = np.random.default_rng(0)
    arm = random_arm(rng, 6)
    payload, rows, more = Load.parse("2 kg @ tip"), [], []
    for _ in range(8):
        posture = tuple(np.asarray(posture_of(arm, rng)).tolist())
        modal = [Measurement(kind="frequency", posture=posture, value=1.0 + i, sigma=1.0) for i in range(6)]
        static = Measurement(kind="deflection", posture=posture, value=1.0, sigma=1.0, point="tip")
        rows += [*modal, static]
        more += [*modal, replace(static, load=payload)]
    told, loaded = (build_problem(arm, Campaign(measurements=tuple(each))) for each in (rows, more))
    return Case(told, {"frequency": 0.005, "deflection": 0.02}, (0, 1), loaded, least={"deflection": 2e-5})


def _storeys(prior: dict[str, float]) -> Case:
    """A building of four storeys: its frequencies, and what a force on each floor moves that floor [m]."""
    names = tuple(f"k{i}" for i in range(1, 5))

    def model(p: dict[str, Any]) -> Any:
        compliance = jnp.cumsum(jnp.stack([1e4 / p[name] for name in names]), 0)
        return jnp.concatenate([storey_frequencies(p), compliance])

    items = tuple(Parameter((name,), True, 1e6, 1e6, **prior) for name in names)
    kinds = ("frequency",) * 4 + ("deflection",) * 4
    problem = InverseProblem(model, jnp.ones(8), jnp.ones(8), Parameters(items), kinds)
    return Case(problem, {"frequency": 0.01, "deflection": 0.05}, (0, 1))


CASES: dict[str, Callable[[], Case]] = {
    "paper": _paper,
    "six axes": _six_axes,
    "storeys": lambda: _storeys({"prior_sd": 0.5}),
    "storeys, flat prior": lambda: _storeys({"prior_sd": 0.01, "flat": 1.0}),
    "storeys, catalogue": lambda: _storeys({"prior_sd": 0.1, "flat": 0.3}),
}
