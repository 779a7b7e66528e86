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
from jaxtyping import Array, Float
from one_program import predicted

from ident.arm.arm import Arm, on_soft_base
from ident.identify.assumptions import Assumptions, assumptions
from ident.identify.conditions import Conditions, bind
from ident.identify.predict import predict
from ident.identify.problem import pose
from ident.inference.fit import Fit, fit
from ident.inference.parameters import Parameter, Parameters
from ident.inference.problem import InverseProblem
from ident.inference.search import evaluate
from ident.measure import Campaign, Load, Measurement, read_campaign

DATA_FAULTS = ("none", "swapped", "payload", "outliers", "copied")
"""What is wrong: nothing; two frequencies exchanged; deflections under more load than told; 10 % of the values (one at
least) 10 sigma off; sigmas ten times too large."""
BASES = {"base 5": 5.0, "base 10": 10.0, "base 20": 20.0}
"""A base that gives, so many times as stiff as joint 1, while the fit takes it to be rigid."""
FAULTS = (*DATA_FAULTS, *BASES, "mass")
"""In the arm's case also such a base, or link 2 a tenth heavier than told."""
HEIGHT = 0.5
"""Of bushing 1 above the point about which the base gives [m]."""
SHARES = {fault: {"base rocks": 1 / times, "base turns": 1 / times} for fault, times in BASES.items()}
SHARES["mass"] = {"mass": 0.1}
"""How much of what the fit takes for granted is wrong."""
OFF = 10.0
RELATIVE = {"frequency": 0.005, "deflection": 0.02}
"""Sigmas of the arm's campaign."""
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
        ascending: places of the frequencies of each state, which take the modes in their order.
        loaded: the same model, deflections under a load that nobody told; None for a factor `WEIGHT`.
        starts: of the fit.
        arm, campaign: what the problem is made of, where it is an arm's.
        wrong: by fault, the model in which something is not as the problem takes it for granted.
        faults: what may be wrong.
    """

    problem: InverseProblem
    relative: dict[str, float]
    swap: tuple[int, int]
    ascending: tuple[list[int], ...]
    loaded: InverseProblem | None = None
    starts: int = 16
    least: Mapping[str, float] = field(default_factory=dict)
    arm: Arm | None = None
    campaign: Campaign | None = None
    wrong: dict[str, InverseProblem] = field(default_factory=dict)
    faults: tuple[str, ...] = DATA_FAULTS


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
        asked: what is taken for granted that the data ask to drop, most of all first.
        widened: parameters that are shown whose interval, widened by the shifts stated for what was wrong, holds the
            truth; by those shifts for as much as was wrong, `scaled`.
        scaled: see there.
    """

    draw: int
    alarms: list[str]
    p: dict[str, float]
    shown: list[str]
    held: list[str]
    missed: bool
    asked: list[str] = field(default_factory=list)
    widened: list[str] = field(default_factory=list)
    scaled: list[str] = field(default_factory=list)


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
    missed, alarms = fault == "none" and cost < found.best.cost - 1e-3, list(_alarms(found))
    if not (case(name).arm and found.best.converged):
        return Outcome(draw, alarms, p, shown, held, missed)
    granted = assumptions(found, pose(case(name).arm, case(name).campaign))
    asked = [f"{item.kind} {item.joint}".strip() for item in granted.asked_for]
    holds = []
    for stated in (True, False):
        down, up = np.array([low, high])[:, None] + _shifts(granted, fault, stated)[None]
        wide = zip(names, np.minimum(low, down.min(0)), np.maximum(high, up.max(0)), truth, strict=True)
        holds.append([n for n, a, b, x in wide if n in shown and a < x < b])
    return Outcome(draw, alarms + ["assumptions"] * bool(asked), p, shown, held, missed, asked, *holds)


def _shifts(granted: Assumptions, fault: str, stated: bool) -> np.ndarray:
    """Return by how much to move an interval (n, P): by nothing, and by what is stated for the fault, or as much of it.

    A fault that may have either sign moves it both ways.
    """
    total = np.zeros_like(granted.items[0].test.shift)
    for item in granted.items:
        share = SHARES.get(fault, {}).get(item.kind)
        if share and item.joint in ("", "joint2"):
            total = total + item.test.shift * (1.0 if stated else share / item.test.amount)
    return np.stack([0 * total, total, *([-total] if fault == "mass" else [])])


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
    model = kind.wrong.get(fault, kind.problem)
    for _ in range(100):  # a truth at which the model has an answer
        truth = np.asarray(parameters.from_uniform(jnp.asarray(rng.uniform(size=len(parameters.items)))))
        if model is kind.problem:
            values = np.asarray(evaluate(model, jnp.asarray(truth)).predicted).copy()
        else:  # a model that is not fitted needs no program of a search
            values = predicted(model, truth)
        if np.isfinite(values).all():
            break
    sigma = np.array([kind.relative[k] for k in kind.problem.kinds]) * np.abs(values)
    sigma += np.array([kind.least.get(k, 0.0) for k in kind.problem.kinds])
    if fault == "payload":
        off = np.array(kind.problem.kinds) == "deflection"
        values = np.where(off, WEIGHT * values, values) if kind.loaded is None else predicted(kind.loaded, truth)
    data = values + sigma * rng.standard_normal(len(values))
    for places in kind.ascending:
        data[places] = np.sort(data[places])
    if fault == "swapped":
        data[list(kind.swap)] = data[list(kind.swap[::-1])]
    if fault == "outliers":
        hit = rng.permutation(len(data))[: max(1, len(data) // 10)]
        data[hit] += OFF * sigma[hit] * rng.choice([-1, 1], len(hit))
    sigma = 10 * sigma if fault == "copied" else sigma
    return truth, eqx.tree_at(lambda p: (p.measured, p.sigma), kind.problem, (jnp.asarray(data), jnp.asarray(sigma)))


def _paper() -> Case:
    """The shipped campaign's rows without labels, in ascending order: they exist for every truth."""
    arm, campaign = lcd_arm(), _rows()
    more = [replace(m, load=Load.parse("2 kg @ tip")) if m.kind == "deflection" else m for m in campaign]
    told, loaded = pose(arm, campaign).problem, pose(arm, Campaign(measurements=tuple(more))).problem
    models = {fault: OnBase(on_soft_base(arm, HEIGHT), bind(arm, campaign), jnp.array(x)) for fault, x in BASES.items()}
    heavier = {path: 1.1 * arm.get(path) for path in arm.paths() if path.startswith(("link2.mass", "link2.inertia"))}
    models |= {"mass": eqx.tree_at(lambda model: model.arm, told.model, arm.replace(heavier))}
    wrong = {fault: eqx.tree_at(lambda p: p.model, told, model) for fault, model in models.items()}
    return Case(
        told, RELATIVE, (0, 1), _ascending(campaign), loaded, arm=arm, campaign=campaign, wrong=wrong, faults=FAULTS
    )


def _soft() -> Case:
    """The same rows of the arm on a base that gives and is fitted."""
    arm, campaign = on_soft_base(lcd_arm(), HEIGHT), _rows()
    told = pose(arm, campaign).problem
    return Case(told, RELATIVE, (0, 1), _ascending(campaign), arm=arm, campaign=campaign, faults=("none",))


def _rows() -> Campaign:
    rows = read_campaign(DATA / "lcd_arm" / "campaign.csv")
    return Campaign(measurements=tuple(replace(m, mode=None) for m in rows))


class OnBase(eqx.Module):
    """An arm on a base that is so many times as stiff as joint 1, whatever that is."""

    arm: Arm
    conditions: Conditions
    times: Float[Array, ""]

    def __call__(self, parameters: Mapping[str, Any]) -> Float[Array, "D *batch"]:
        """Predict the campaign's values."""
        base = {f"base.{k}": self.times * parameters[f"joint1.{k}"] for k in ("k_bend", "k_tors")}
        return predict(self.arm, {**parameters, **base}, self.conditions)


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
    campaign, heavier = (Campaign(measurements=tuple(each)) for each in (rows, more))
    told, loaded = pose(arm, campaign).problem, pose(arm, heavier).problem
    return Case(told, RELATIVE, (0, 1), _ascending(campaign), loaded, least={"deflection": 2e-5})


def _ascending(campaign: Campaign) -> tuple[list[int], ...]:
    groups = [[i for i, m in enumerate(campaign) if (m.posture, m.kind) == (p, "frequency")] for p in campaign.postures]
    for places in groups:
        values = [campaign.measurements[i].value for i in places]
        assert values == sorted(values), "rows of a posture ascend"
    return tuple(groups)


def _storeys(prior: dict[str, float]) -> Case:
    """A building of four storeys: its frequencies, and what a force on each floor moves that floor [m]."""
    names = tuple(f"k{i}" for i in range(1, 5))

    def model(p: dict[str, Any]) -> Any:
        compliance = jnp.cumsum(jnp.stack([1e4 / p[name] for name in names]), 0)
        return jnp.concatenate([storey_frequencies(p), compliance])

    items = tuple(Parameter((name,), True, 1e6, 1e6, **prior) for name in names)
    kinds = ("frequency",) * 4 + ("deflection",) * 4
    problem = InverseProblem(model, jnp.ones(8), jnp.ones(8), Parameters(items), kinds)
    return Case(problem, {"frequency": 0.01, "deflection": 0.05}, (0, 1), ([0, 1, 2, 3],))


CASES: dict[str, Callable[[], Case]] = {
    "paper": _paper,
    "six axes": _six_axes,
    "paper, soft base": _soft,
    "storeys": lambda: _storeys({"prior_sd": 0.5}),
    "storeys, flat prior": lambda: _storeys({"prior_sd": 0.01, "flat": 1.0}),
    "storeys, catalogue": lambda: _storeys({"prior_sd": 0.1, "flat": 0.3}),
}
