"""The main job in one call: an arm and a campaign in, a fit out, with what speaks against it."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from ident.arm.arm import Arm
from ident.identify.build_problem import build_problem
from ident.identify.data_checks import check_values
from ident.identify.label_checks import NEAR_DRAW
from ident.identify.unknowns import Unknowns
from ident.inference.cross_prediction import CrossPrediction, cross_predictions
from ident.inference.fit import STARTS, Fit, fit
from ident.measure import Campaign

SUSPICIOUS = 3.0
"""Standard deviations from which a difference is called a contradiction."""
IMPROBABLE = 1e-3
"""Chance of so large a chi-squared below which model or sigmas are called wrong."""


@dataclass(frozen=True, kw_only=True)
class CampaignFit(Fit):
    """A fit of an arm to a campaign, with each kind of data predicted from the others.

    Attributes:
        arm: with the numbers of its file.
        campaign: what was measured.
        cross_predictions: each kind of measurement against the others.
    """

    arm: Arm
    campaign: Campaign
    cross_predictions: tuple[CrossPrediction, ...]

    @property
    def contradictory(self) -> bool:
        """Whether one kind of measurement contradicts the others."""
        return any(np.abs(each.z).max() > SUSPICIOUS for each in self.cross_predictions)

    @property
    def mislabelled(self) -> bool:
        """Whether the modes that fit best are not those that labels and values make most probable."""
        return not self.choice.settled

    @property
    def near_draws(self) -> tuple[int, ...]:
        """Rows whose label is a near draw at the answer, or not the mode's own: it may be another mode's."""
        return tuple(np.flatnonzero(np.asarray(self.choice.cost) > NEAR_DRAW).tolist())

    @property
    def outliers(self) -> np.ndarray:
        """Which measurements lie more than three sigma from the fit."""
        return np.abs(self.residuals) > SUSPICIOUS

    @property
    def doubts(self) -> tuple[str, ...]:
        """Why no interval should be quoted from this fit; empty when nothing speaks against it."""
        reasons = {
            "the labels contradict the modes that fit best": self.mislabelled,
            "the gradient does not vanish here, so this is not an optimum": not self.best.converged,
            "the kinds of measurement contradict each other (see below)": self.contradictory,
            f"{self.outliers.sum()} measurements lie more than 3 sigma from the fit": self.outliers.any(),
            f"so large a chi-squared has a chance of {self.p_value:.1g}": self.p_value < IMPROBABLE,
        }
        return tuple(doubt for doubt, holds in reasons.items() if holds)

    @property
    def supported(self) -> np.ndarray:
        """Which parameters an interval may be quoted for: none where the fit itself is in doubt."""
        return self.information.supported & (not self.doubts)

    @property
    def fitted_arm(self) -> Arm:
        """The arm with the fitted numbers in place."""
        return self.arm.replace(self.parameters)


def fit_campaign(
    arm: Arm,
    campaign: Campaign,
    unknowns: Unknowns | None = None,
    *,
    starts: int = STARTS,
    seed: int = 0,
    trust_values: bool = False,
    progress: Callable[[Iterable[int]], Iterable[int]] = iter,
) -> CampaignFit:
    """Fit the joint stiffnesses, and what else is freed, to a campaign; damping where damping ratios were measured.

    Args:
        arm: its stiffnesses are starting values and centres of the priors.
        campaign: the measurements.
        unknowns: what is unknown, and its priors.
        starts: number of starts.
        seed: of the starts.
        trust_values: take values that the arm file makes implausible.
        progress: wraps the numbers of the starts, to show a bar.

    Raises:
        InputError: campaign and arm, or the named parameters, do not fit together; implausible values.
        ModelError: no optimum was reached.
    """
    problem = build_problem(arm, campaign, unknowns)
    if not trust_values:
        check_values(problem, campaign, arm)
    best = fit(problem, starts=starts, seed=seed, progress=progress)
    compared = build_problem(arm, campaign, (unknowns or Unknowns()).with_prior)
    return CampaignFit(**vars(best), arm=arm, campaign=campaign, cross_predictions=cross_predictions(compared))
