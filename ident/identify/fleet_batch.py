"""Robots of one arm file that were measured in the same way, fitted together."""

from collections.abc import Collection, Hashable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ident.arm.arm import Arm
from ident.errors import IdentError
from ident.identify.build_problem import build_problem
from ident.identify.conditions import bind
from ident.identify.data_checks import check_values, plausible_beside
from ident.identify.fleet import Linear, Robot, SourceFile, Stiffnesses, robot_at
from ident.identify.repeats import shared_error
from ident.identify.unknowns import Unknowns
from ident.inference.fit_many import Values, fit_many
from ident.inference.least_squares import evaluate
from ident.measure import Campaign
from ident.measure.kinds import SHAPES


class Given(NamedTuple):
    """A robot's inputs: its name, campaign and arm, with their files."""

    name: str
    campaign: Campaign
    arm: Arm
    campaign_file: SourceFile
    arm_file: SourceFile


def robots_together(
    given: Sequence[Given], unknowns: Unknowns, size: int, *, seed: int = 0, trusted: Collection[str] = ()
) -> Mapping[str, Robot]:
    """Fit robots together, and return those that nothing speaks against, by name; each of the others is for itself.

    Together are those of one arm file whose campaigns have the same rows but for their values.

    Args:
        given: robots of different names, `size` at most.
        unknowns: what is unknown of each, and its priors.
        size: robots that the program is for.
        seed: of the starts.
        trusted: rows whose values are right though implausible, see `check_values`.
    """
    groups: dict[Hashable, list[Given]] = {}
    for each in (one._replace(campaign=_ascending(one.campaign)) for one in given):
        groups.setdefault((each.arm_file.sha256, _way(each.campaign)), []).append(each)
    found: dict[str, Robot] = {}
    for group in groups.values():
        leader = next((i for i, each in enumerate(group) if _right(each, unknowns, trusted)), None)
        if leader is not None and len(group) > 1:
            found |= _fitted(group[leader:], unknowns, size, seed)
    return found


def _way(campaign: Campaign) -> Hashable:
    """Return how a campaign was measured: all but its values."""
    return tuple(
        (
            m.kind,
            m.posture,
            m.mode,
            m.of,
            m.point,
            m.direction,
            m.joint,
            m.setup,
            m.ramp,
            m.repeat,
            m.load,
            m.reference_load,
            m.drives,
        )
        for m in campaign
    )


def _ascending(campaign: Campaign) -> Campaign:
    """Return a campaign in which modes without a label ascend in each state, as they are told apart by that alone."""
    rows, places = list(campaign.measurements), dict[Hashable, list[int]]()
    for i, m in enumerate(rows):
        if m.kind == "frequency" and not m.mode:
            places.setdefault((m.posture, m.load, m.drives), []).append(i)
    for own in places.values():
        for i, m in zip(own, sorted((rows[i] for i in own), key=lambda m: m.value), strict=True):
            rows[i] = m
    return replace(campaign, measurements=tuple(rows))


def _values(given: Sequence[Given]) -> Values:
    """Return what was measured, with sigmas as `arm_problem` takes them."""
    order = np.asarray(bind(given[0].arm, given[0].campaign).order)
    every = np.array([[(m.value, m.sigma, m.resolution) for m in each.campaign] for each in given])
    value, sigma, step = np.moveaxis(every, 2, 0)
    return Values(value, np.array([shared_error(order, *each) for each in zip(sigma, step, strict=True)]))


def _right(given: Given, unknowns: Unknowns, trusted: Collection[str]) -> bool:
    """Tell whether a robot's campaign can be posed and is plausible."""
    try:
        problem = build_problem(given.arm, given.campaign, unknowns)
        check_values(problem, given.campaign, given.arm, trusted)
    except IdentError:
        return False
    bound = any(m.kind in SHAPES for m in given.campaign)  # to what was measured of one robot
    return problem.in_parts() is None and problem.correlation is None and not bound


def _fitted(group: Sequence[Given], unknowns: Unknowns, size: int, seed: int) -> dict[str, Robot]:
    """Fit robots like the first one, which is right; one that is right by what is trusted only is for itself."""
    problem = build_problem(group[0].arm, group[0].campaign, unknowns)
    predicted = evaluate(problem).predicted
    right = [each for each in group if plausible_beside(each.campaign, predicted)]
    if not right:
        return {}
    fits = fit_many(problem, _values(right), size, seed)
    stiffnesses = Stiffnesses.of(problem.parameters)
    return {
        each.name: replace(
            robot_at(Linear(*known), problem.parameters, stiffnesses),
            name=each.name,
            campaign=each.campaign_file,
            arm=each.arm_file,
            measurements=len(each.campaign),
        )
        for each, sound, *known in zip(right, *fits, strict=True)
        if sound
    }
