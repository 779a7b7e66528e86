"""An arm, a campaign and a choice of unknowns, posed as an inverse problem."""

from collections.abc import Iterable, Mapping

import jax
import numpy as np

from ident.arm.arm import Arm
from ident.identify.conditions import bind
from ident.identify.predict import ArmModel
from ident.identify.unknowns import WEAK_PRIOR, stiffness_parameters
from ident.inference.discrepancy import with_discrepancy
from ident.inference.parameters import Parameters
from ident.inference.priors import Prior
from ident.inference.problem import InverseProblem
from ident.measure import Campaign


def arm_problem(arm: Arm, campaign: Campaign, parameters: Parameters) -> InverseProblem:
    """Pose the inverse problem of an arm and a campaign.

    Raises:
        InputError: the campaign speaks of points, payloads or modes that the arm has not.
    """
    return InverseProblem(
        ArmModel(arm, bind(arm, campaign)),
        jax.device_put(np.array([m.value for m in campaign], float)),
        jax.device_put(np.array([m.sigma for m in campaign], float)),
        parameters,
        tuple(m.kind for m in campaign),
    )


def build_problem(
    arm: Arm,
    campaign: Campaign,
    *,
    fixed: Iterable[str] = (),
    tied: Iterable[tuple[str, ...]] = (),
    free: Mapping[str, float] | None = None,
    prior_sd: float = WEAK_PRIOR,
    priors: Mapping[str, Prior] | None = None,
    discrepancy: Mapping[str, float] | None = None,
) -> InverseProblem:
    """Make the joint stiffnesses, and what else is asked for, unknown; damping where damping ratios were measured.

    Args:
        arm: its numbers are starting values and centres of the priors.
        campaign: the measurements.
        fixed: paths to keep.
        tied: groups of paths fitted as one number.
        free: further paths, each with the width of its prior (`math.inf` for none).
        prior_sd: width of the log-normal priors of stiffness and damping; `math.inf` for none.
        priors: priors of single parameters by path, in place of those.
        discrepancy: by kind of measurement, the standard deviation of ln(factor) by which the model may be off.

    Raises:
        InputError: campaign and arm, or the named parameters, do not fit together.
    """
    damping = any(m.kind == "damping_ratio" for m in campaign)
    unknown = stiffness_parameters(
        arm, fixed=fixed, tied=tied, free=free, prior_sd=prior_sd, priors=priors, damping=damping
    )
    return with_discrepancy(arm_problem(arm, campaign, unknown), discrepancy or {})
