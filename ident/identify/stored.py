"""A fit as plain numbers, and back: the campaign is posed again and evaluated at them, without a search."""

import math
from collections.abc import Mapping
from dataclasses import asdict, fields
from typing import Any, TypeVar

import numpy as np

from ident.arm.arm import Arm
from ident.identify.assumptions import Assumption, Assumptions
from ident.identify.damping import Poles
from ident.identify.fit import CampaignFit, damping_given, with_poles
from ident.identify.predict import Matching
from ident.identify.problem import Posed
from ident.identify.unknowns import Unknowns
from ident.inference.fit import CrossPrediction, information_at
from ident.inference.information import Direction, ScoreTest
from ident.inference.optima import Optimum
from ident.inference.scrutiny import Exchange, weighted
from ident.inference.search import look
from ident.measure import Campaign

T = TypeVar("T")
MOVED = 1e-6
"""Relative difference between a recomputed and the stored prediction above which a report mentions it."""
PARTS: Mapping[str, type] = {
    "optima": Optimum,
    "cross_predictions": CrossPrediction,
    "combinations": Direction,
    "exchanges": Exchange,
}
"""Parts of a fit that are lists, and the class of their items."""


def fit_state(fit: CampaignFit) -> dict[str, Any]:
    """Return the numbers from which a fit can be rebuilt.

    They are its optima and the results of searches: cross predictions of the kinds of measurement, ends of intervals,
    swapped values, and tests of assumptions. All that follows from the data at the best optimum is computed again.
    """
    held, granted = fit.choice.held, fit.assumptions
    state: dict[str, Any] = {name: [asdict(item) for item in getattr(fit, name)] for name in PARTS}
    state |= {name: getattr(fit, name) for name in ("failed", "predicted", "stretch", "beaten", "weights")}
    state["assumptions"] = None if granted is None else asdict(granted)
    state["modes"] = None if held is None else np.argmax(np.asarray(held.place), 0).tolist()
    state["poles"] = asdict(fit.poles)
    state["log_error"] = None if held is None else float(held.log_error)
    return state


def fit_of(arm: Arm, campaign: Campaign, unknowns: Unknowns, state: Mapping[str, Any]) -> CampaignFit:
    """Rebuild a fit from `fit_state`.

    Args:
        arm: of the fit.
        campaign: the measurements.
        unknowns: of the fit, with their priors.
        state: the numbers; from JSON, arrays may be lists, and nonfinite numbers names that `float` reads.

    Raises:
        InputError: see `pose`.
        KeyError, TypeError, ValueError: the numbers are not those of this fit.
    """
    stated = state.get("poles", {"numbers": {}, "apart": ()})
    poles = Poles(dict(stated["numbers"]), tuple(map(float, stated["apart"])))
    posed = with_poles(arm, campaign, unknowns, poles)
    weights = _array(state["weights"])
    problem = posed.problem if weights is None else weighted(posed.problem, weights)
    made: dict[str, Any] = {name: tuple(_made(kind, each) for each in state[name]) for name, kind in PARTS.items()}
    count = len(problem.parameters.items)
    best = made["optima"][0]
    if best.theta.shape != (count,):
        raise ValueError(f"{len(best.theta)} numbers for {count} unknowns")
    end = look(problem, best.theta, _held(posed, state))
    damping = damping_given(arm, posed, end, campaign, unknowns)
    return CampaignFit(
        problem=problem,
        failed=int(state["failed"]),
        predicted=end.predicted,
        jacobian=end.jacobian,
        information=information_at(problem, end),
        choice=end.choice,
        stretch=_array(state["stretch"]),
        beaten=_array(state["beaten"]),
        arm=arm,
        campaign=posed.campaign,
        damping=damping,
        poles=poles,
        assumptions=_assumptions(state["assumptions"]),
        weights=weights,
        **made,
    )


def _assumptions(state: Mapping[str, Any] | None) -> Assumptions | None:
    if state is None:
        return None
    items = (Assumption(each["kind"], each["joint"], _made(ScoreTest, each["test"])) for each in state["items"])
    return Assumptions(tuple(items), float(state["height"]))


def moved(fit: CampaignFit, state: Mapping[str, Any]) -> float:
    """Return the largest difference of predictions from the stored ones, relative to these, or to sigma if small."""
    before, sigma = np.asarray(_array(state["predicted"])), np.asarray(fit.problem.sigma)
    size = np.maximum(np.abs(before), np.where(np.isfinite(sigma), sigma, 0.0))
    if not np.array_equal(np.isnan(before), np.isnan(fit.predicted)):
        return math.inf
    return float(np.nanmax(np.abs(fit.predicted - before) / np.where(size > 0, size, 1.0), initial=0.0))


def _held(posed: Posed, state: Mapping[str, Any]) -> Matching | None:
    """Return the matching that keeps each labelled value at its stored mode, by order."""
    first = posed.model.first_matching()
    if first is None:
        return None
    modes = np.asarray(state["modes"], int)
    place = (np.arange(len(first.place))[:, None] == modes).astype(float)
    log_error = np.asarray(float(state["log_error"]))
    shape = np.zeros((len(first.shape), len(modes)))
    return Matching(shape, place, log_error, np.array(False), np.array(True))


def _array(value: Any) -> np.ndarray | None:
    return None if value is None else np.array(value, float)


def _made(kind: type[T], item: Mapping[str, Any]) -> T:
    """Return a part of a fit: its lists are arrays but where they number rows, its texts are names or numbers."""
    values: dict[str, Any] = {}
    for each in fields(kind):  # type: ignore[arg-type]
        value = item[each.name]
        if each.name == "open":  # directions: there may be none
            values[each.name] = np.array(value, float).reshape(-1, len(item["theta"]))
        elif isinstance(value, list):
            values[each.name] = tuple(map(int, value)) if each.name == "rows" else np.array(value, float)
        else:
            values[each.name] = float(value) if each.type is float else value
    return kind(**values)
