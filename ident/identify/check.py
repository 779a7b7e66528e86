"""All that can be said of a campaign before solving, in one call: an arm and a campaign in, a check out."""

from collections.abc import Collection, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ident.arm.arm import Arm
from ident.errors import InputError, Problem
from ident.identify.build_problem import build_problem
from ident.identify.curved import SpringCheck, check_springs
from ident.identify.data_checks import check_values, contradictory_repeats
from ident.identify.label_checks import LabelDoubt, changing_labels, label_doubts
from ident.identify.loops import Ramp, ramps
from ident.identify.unknowns import Unknowns
from ident.inference.consistency import Consistency, consistency
from ident.inference.cross_prediction import CrossPrediction, contradicting, cross_predictions
from ident.inference.identifiability import Check, check
from ident.measure import Campaign

if TYPE_CHECKING:
    from ident.identify.explanations import Explanations


@dataclass(frozen=True, kw_only=True)
class CampaignCheck(Check):
    """What a campaign can tell about an arm, before any solving.

    Attributes:
        arm: with the numbers of its file.
        campaign: what was measured.
        consistency: the data among themselves; None where the model has no answer at the start.
        cross_predictions: each kind of measurement against the others, by fits from a few starts.
        labels: measurements whose mode is not sure.
        changing: at what share of points within the prior each row's label is a near draw, or has no mode; if at any.
        springs: the curved springs of the arm, with the eyes of the campaign.
        repeats: pairs of rows that measured the same and contradict each other; refused unless one is trusted.
        ramps: those of the campaign, and how well it would tell the widths of their loops.
        explanations: what would reconcile the data, see `ident.identify.explanations`; None where that was not asked.
    """

    arm: Arm
    campaign: Campaign
    consistency: Consistency | None
    cross_predictions: tuple[CrossPrediction, ...]
    labels: tuple[LabelDoubt, ...]
    changing: Mapping[int, float]
    springs: tuple[SpringCheck, ...]
    repeats: tuple[tuple[int, int], ...]
    ramps: tuple[Ramp, ...] = ()
    explanations: "Explanations | None" = None

    @property
    def contradictory(self) -> bool:
        """Whether one kind of measurement contradicts the others."""
        return bool(contradicting(self.cross_predictions))


def check_campaign(
    arm: Arm, campaign: Campaign, unknowns: Unknowns | None = None, *, seed: int = 0, trusted: Collection[str] = ()
) -> CampaignCheck:
    """Say what a campaign can tell about the joint stiffnesses, and what else is freed, before any solving.

    Args:
        arm: its stiffnesses are where the model is linearised.
        campaign: the measurements.
        unknowns: what is unknown, and its priors.
        seed: of the further points that are tried.
        trusted: rows whose values are right though implausible, or contradict a repeat, see `check_values`.

    Raises:
        InputError: campaign and arm, or the named parameters, do not fit together; implausible values; contradictory
            repeats; a campaign that says nothing of any unknown.
    """
    with ThreadPoolExecutor(1) as beside:
        labels = beside.submit(label_doubts, arm, campaign)  # its program is compiled while the other one is
        problem = build_problem(arm, campaign, unknowns)
        check_values(problem, campaign, arm, trusted)
        checked = check(problem, seed=seed)
        if checked.blind:
            got = "no measurement that depends on any of the unknowns"
            remedy = "measure modes or postures that the unknown joints take part in, or free other parameters"
            raise InputError(Problem(campaign.path, got, "some information on one at least", remedy))
        compared = build_problem(arm, campaign, (unknowns or Unknowns()).with_prior)
        start = np.asarray(compared.parameters.theta(compared.parameters.column("start")))
        return CampaignCheck(
            **vars(checked),
            arm=arm,
            campaign=campaign,
            consistency=consistency(compared),
            cross_predictions=cross_predictions(compared, [start], seed=seed)[0],
            labels=labels.result(),
            changing=changing_labels(problem, seed=seed),
            springs=check_springs(arm, campaign, unknowns),
            repeats=tuple(contradictory_repeats(campaign)),
            ramps=ramps(campaign, problem),
        )
