"""An arm, a campaign and a choice of unknowns, posed as an inverse problem."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import jax
import numpy as np

from ident.arm.arm import Arm
from ident.errors import InputError
from ident.identify.conditions import bind
from ident.identify.loops import loop_parameters
from ident.identify.predict import ArmModel, predict
from ident.identify.repeats import shared_error
from ident.identify.setups import frames_of, setup_parameters, vectors_of
from ident.identify.uncertain import check_measurable, scaled_bodies, uncertain_parameters
from ident.identify.unknowns import Unknowns, stiffness_parameters
from ident.inference.correlation import Correlation, correlation
from ident.inference.discrepancy import with_discrepancy
from ident.inference.parameters import Parameters
from ident.inference.problem import InverseProblem
from ident.jit import jit
from ident.measure import Campaign
from ident.measure.load import AXES
from ident.text import one_line

_predicted = jit(predict)


def arm_problem(
    arm: Arm, campaign: Campaign, parameters: Parameters, uncertain: Mapping[str, str] | None = None
) -> InverseProblem:
    """Pose the inverse problem of an arm and a campaign.

    Raises:
        InputError: the campaign speaks of points, payloads or modes that the arm has not.
    """
    conditions, widths = bind(arm, campaign), uncertain or {}
    check_measurable(widths, conditions.loads)
    frames = frames_of(campaign, _expected(arm, campaign))
    setups = setup_parameters(campaign, frames) if frames else ()
    value, sigma, step = np.array([(m.value, m.sigma, m.resolution) for m in campaign], float).T
    return InverseProblem(
        ArmModel(arm, conditions, scaled_bodies(arm, widths), frames),
        jax.device_put(value),
        jax.device_put(shared_error(np.asarray(conditions.order), sigma, step)),
        Parameters((*parameters.items, *uncertain_parameters(arm, widths), *setups, *loop_parameters(campaign))),
        tuple(m.kind for m in campaign),
        _correlation(campaign),
        vectors_of(campaign),
    )


def _expected(arm: Arm, campaign: Campaign) -> list[np.ndarray]:
    """Return what the arm file expects of each row with a setup, as a vector in the base frame; of others nothing."""
    rows = [m for m in campaign if m.setup]
    if not rows:
        return [np.zeros(3) for _ in campaign]
    blank: dict[str, Any] = {
        "setup": "",
        "ramp": "",
        "group": "",
        "member": 0,
        "repeat": "",
        "value": 0.0,
        "sigma": 1.0,
        "resolution": 0.0,
    }
    along = tuple(replace(m, direction=axis, **blank) for m in rows for axis in (AXES["x"], AXES["y"], AXES["z"]))
    vectors = iter(np.asarray(_predicted(arm, {}, bind(arm, Campaign(measurements=along)))).reshape(-1, 3))
    return [next(vectors) if m.setup else np.zeros(3) for m in campaign]


def _correlation(campaign: Campaign) -> Correlation | None:
    """Return how the errors of the rows are correlated.

    Raises:
        InputError: as no errors can be.
    """
    groups = [(places, np.array(matrix)) for places, matrix in campaign.correlated]
    try:
        return jax.device_put(correlation(groups, np.ones(len(campaign), bool)))
    except InputError as error:
        path = campaign.covariance.path if campaign.covariance else ""
        raise InputError(replace(problem, where=one_line(path)) for problem in error.problems) from None


def build_problem(arm: Arm, campaign: Campaign, unknowns: Unknowns | None = None) -> InverseProblem:
    """Make the joint stiffnesses, and what else is asked for, unknown; damping where damping ratios were measured.

    Args:
        arm: its numbers are starting values and centres of the priors.
        campaign: the measurements.
        unknowns: what is unknown, and its priors.

    Raises:
        InputError: campaign and arm, or the named parameters, do not fit together.
    """
    unknowns = unknowns or Unknowns()
    damping = any(m.kind == "damping_ratio" for m in campaign)
    parameters = stiffness_parameters(arm, unknowns, damping=damping)
    return with_discrepancy(arm_problem(arm, campaign, parameters, unknowns.uncertain), unknowns.discrepancy)
