"""A campaign posed to an arm as an inverse problem, and checks of its labels and values before any search."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm
from ident.errors import placed, refusal, require
from ident.identify.binding import check_references
from ident.identify.conditions import Conditions, bind, loop_names, loop_parameters, loop_places, shared_error
from ident.identify.predict import ArmModel, frames_of, setup_parameters, vectors_of
from ident.identify.unknowns import (
    LOAD,
    Unknowns,
    is_loaded,
    scaled_bodies,
    stiffness_parameters,
    uncertain_parameter,
    without_damping,
)
from ident.inference.information import information
from ident.inference.parameters import Parameters
from ident.inference.problem import DISCREPANCY_PREFIX, Discrepant, InverseProblem, correlation, with_discrepancy
from ident.inference.search import evaluate
from ident.measure import Campaign, Measurement
from ident.text import one_line

# -------- Pose

MOST_VALUES = 20000
"""Most distinct values of a campaign: their fit takes minutes, and more values add nothing."""


@dataclass(frozen=True)
class Posed:
    """A campaign posed to an arm.

    Attributes:
        campaign: the measurements.
        problem: unknowns, data, and the arm in the conditions of the campaign.
        ratios: measured damping ratios: they determine the damping, but no stiffness.
    """

    campaign: Campaign
    problem: InverseProblem
    ratios: Campaign = field(default_factory=Campaign)

    @property
    def model(self) -> ArmModel:
        """The arm in the conditions of the campaign, without discrepancies."""
        model = self.problem.model
        model = model.model if isinstance(model, Discrepant) else model
        assert isinstance(model, ArmModel)
        return model

    @property
    def arm(self) -> Arm:
        """The arm as in its file."""
        return self.model.arm

    @property
    def conditions(self) -> Conditions:
        """The campaign's conditions."""
        return self.model.conditions

    def applied(self, parameters: Mapping[str, Any]) -> tuple[Arm, Conditions]:
        """Return the arm and the conditions with these numbers in place; discrepancies change neither."""
        return self.model.applied({n: x for n, x in parameters.items() if not n.startswith(DISCREPANCY_PREFIX)})

    def with_unknowns(self, unknowns: Unknowns) -> "Posed":
        """Return the same campaign with other unknowns or priors.

        Raises:
            InputError: see `pose`.
        """
        return _posed(self.campaign, self.model, unknowns, self.ratios)


def pose(arm: Arm, campaign: Campaign, unknowns: Unknowns | None = None) -> Posed:
    """Pose a campaign without its damping ratios (see `ident.identify.damping`) to an arm.

    The remaining rows keep their own covariance, which is the exact marginal.

    Steps in order: check names and numbers of rows against the arm (`check_references`), bind the rows to it, estimate
    the measurement frames, choose the unknowns. All else builds on the result. `check_values` then checks the
    plausibility of the values with the model.

    Args:
        arm: its numbers are starting values and centres of the priors.
        campaign: the measurements.
        unknowns: with their priors.

    Raises:
        InputError: campaign and arm, or the named parameters, do not match; more values than can be fitted.
    """
    check_references(arm, campaign)
    ratios, campaign = campaign.of_kind("damping_ratio"), campaign.without("damping_ratio")
    remedy = "damping ratios tell nothing of a stiffness: add such rows"
    require(len(campaign), ratios.path, "damping ratios alone", "frequencies or deflections, too", remedy)
    conditions = bind(arm, campaign)
    if conditions.count > MOST_VALUES:
        states, rows = conditions.posture.shape[1], len(campaign)
        got = f"{conditions.count} different values in {states} states (posture and load case), {rows} rows"
        remedy = "fit a part of it, or hold the same postures again: repeated rows cost next to nothing"
        raise refusal(campaign.path, got, f"at most {MOST_VALUES} different values", remedy)
    model = ArmModel(arm, conditions, frames=frames_of(arm, campaign, conditions))
    return _posed(campaign, model, unknowns or Unknowns(), ratios)


def _posed(campaign: Campaign, model: ArmModel, unknowns: Unknowns, ratios: Campaign) -> Posed:
    arm, widths = model.arm, unknowns.uncertain
    stiffnesses = stiffness_parameters(arm, without_damping(unknowns.named(arm)) if len(ratios) else unknowns)
    if LOAD in widths and not is_loaded(model.conditions.loads):
        raise refusal("uncertain", "load, and no row with a mass, force or moment", "one at least", "drop it")
    own, frames = [uncertain_parameter(arm, *each) for each in widths.items()], setup_parameters(campaign, model.frames)
    model = replace(model, scaled=scaled_bodies(arm, widths))
    value, sigma, step = np.array([(m.value, m.sigma, m.resolution) for m in campaign], float).T
    groups = [(places, np.array(matrix)) for places, matrix in campaign.correlated]
    with placed(one_line(campaign.covariance.path) if campaign.covariance else ""):
        shared = jax.device_put(correlation(groups, np.ones(len(campaign), bool)))
    sigmas = jax.device_put(shared_error(np.asarray(model.conditions.order), sigma, step))
    parameters = Parameters((*stiffnesses.items, *own, *frames, *loop_parameters(campaign)))
    data = jax.device_put(value), sigmas, parameters, tuple(m.kind for m in campaign)
    problem = InverseProblem(model, *data, shared, vectors_of(campaign))
    return Posed(campaign, with_discrepancy(problem, unknowns.discrepancy), ratios)


# -------- Ramps
# How well the widths of hysteresis loops are determined.


@dataclass(frozen=True)
class Ramp:
    """A ramp of loads, and how well the width of its loop is determined.

    Attributes:
        name: of its width among the unknowns.
        rows: indices of its rows in the campaign.
        of: one of these, for the measured quantity and the posture.
        sd: [m or rad] standard deviation of the width; infinite where the data do not determine it.
    """

    name: str
    rows: tuple[int, ...]
    of: Measurement
    sd: float


def ramps(posed: Posed) -> tuple[Ramp, ...]:
    """Return the ramps of a campaign, and how well its data alone determine their widths at the starting values."""
    if not loop_names(posed.campaign):
        return ()
    problem, parameters = posed.problem, posed.problem.parameters
    jacobian = np.asarray(evaluate(problem).jacobian)
    if not np.isfinite(jacobian).all():
        return ramps_of(posed.campaign, problem, np.full(len(parameters.items), np.inf))
    prior = np.where(parameters.nuisance, parameters.normal_sd, np.inf)
    known = information(problem.scaled(jacobian), prior, parameters.names, parameters.nuisance)
    return ramps_of(posed.campaign, problem, known.sd)


def ramps_of(campaign: Campaign, problem: InverseProblem, sd: Float[np.ndarray, "P"]) -> tuple[Ramp, ...]:
    """Return the ramps of a campaign, given the standard deviations of theta."""
    places, items = np.abs(loop_places(campaign)), {item.name: item for item in problem.parameters.items}
    known = dict(zip(items, sd, strict=True))
    return tuple(
        Ramp(name, rows, campaign.measurements[rows[0]], float(items[name].scale * known[name]))
        for number, name in loop_names(campaign).items()
        if (rows := tuple(np.flatnonzero(places == number).tolist()))
    )


# -------- Labels nearby
# Label costs at points near the starting values.

POINTS = 16
"""Points near the starting values at which labels are checked."""
NEARBY, FREE = 0.4, 1.0
"""Standard deviation of these points in theta, unless the prior is narrower: for checks of values, and of labels."""


def labels_about(
    problem: InverseProblem, points: int = POINTS, spread: float = NEARBY, seed: int = 0
) -> tuple[Float[np.ndarray, "points D"], Float[np.ndarray, "points D"]]:
    """Return the cost of each label and the predictions, by labels alone, at and near the starting values.

    Args:
        problem: of an arm and a campaign.
        points: number of points in addition to the starting values.
        spread: their standard deviation in theta, unless the prior is narrower.
        seed: of the points.
    """
    parameters = problem.parameters
    start = parameters.theta_start
    noise = np.random.default_rng(seed).standard_normal((points, len(start))) * np.minimum(parameters.normal_sd, spread)
    ends = [evaluate(problem, theta) for theta in (start, *(start + noise))]
    stable = [end for end in ends if np.isfinite(end.predicted).all()] or ends[:1]
    return np.array([end.choice.cost for end in stable]), np.array([end.predicted for end in stable])
