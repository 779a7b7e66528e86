"""Say what a campaign can tell about each parameter, before any solving."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, ClassVar

from ident.studies.door import DEFAULT, study
from ident.studies.options import option
from ident.studies.result import Result, alias
from ident.studies.shared import ProblemOptions

if TYPE_CHECKING:
    from ident.description.file import ArmFile
    from ident.identify.check import CampaignCheck
    from ident.measure import Campaign


@dataclass(frozen=True, kw_only=True)
class CheckOptions(ProblemOptions):
    """Options of `ident.check`: what is unknown, and what is known of it."""

    refuses: ClassVar[tuple[str, ...]] = ()

    no_explain: bool = option(False, "where data contradict each other, do not search for what would reconcile them")


@dataclass(frozen=True, repr=False, eq=False)
class CheckResult(Result):
    """What a campaign can tell about an arm.

    Its table has a row for each parameter: verdict, and the standard deviation of theta by the data alone, at the arm's
    values and the largest of all points; theta is ln(value) for a stiffness. It has no figure.

    Attributes:
        arm: the arm as its file has it.
        check: verdicts, directions, the part of each measurement, doubts on labels and data.
        options: what was asked for.
        contradictory: whether one kind of measurement contradicts the others.
        doubtful: whether the data contradict each other.
    """

    arm: "ArmFile"
    check: "CampaignCheck"
    options: CheckOptions = field(default_factory=CheckOptions)

    form = "ident-check/10"
    subject = "check.campaign.name"
    shown, drawn = ("check",), ()
    made_from = ("arm", "check.campaign")
    summary = ("contradictory",)

    contradictory: ClassVar[bool] = alias("check.contradictory")
    doubtful: ClassVar[bool] = alias("contradictory")

    @property
    def verdicts(self) -> Mapping[str, str]:
        """Verdict by parameter: identifiable, weak, open, not seen or unknown."""
        return dict(zip((item.name for item in self.check.items), self.check.verdicts, strict=True))

    @property
    def others(self) -> tuple[Mapping[str, float], ...]:
        """Other values by parameter [SI] that give the same data: those that a search from several starts found."""
        names = self.check.problem.parameters.names
        found = self.check.others.exact if self.check.others else ()
        return tuple(dict(zip(names, map(float, optimum.values), strict=True)) for optimum in found)


@study
def check(
    arm: "ArmFile",
    campaign: "Campaign",
    options: CheckOptions = DEFAULT,
) -> CheckResult:
    """Say what a campaign can tell about the joint stiffnesses, and what else is freed, before any solving.

    Args:
        arm: its stiffnesses are where the model is linearised.
        campaign: the measurements.
        options: what is unknown, and what is known of it.

    Raises:
        InputError: campaign and arm, or the named parameters, do not fit together; implausible values; contradictory
            repeats; a campaign that says nothing of any unknown.
    """
    from ident.identify.check import check_campaign

    unknowns, trusted = options.unknowns_of(arm), tuple(map(str, options.trust_values))
    checked = check_campaign(arm.arm, campaign, unknowns, seed=options.seed, trusted=trusted)
    if checked.contradictory and not options.no_explain:
        from ident.identify.explanations import explain
        from ident.identify.fit import fit_campaign

        fitted = fit_campaign(arm.arm, campaign, unknowns, seed=options.seed, trusted=trusted)
        checked = replace(checked, explanations=explain(fitted, unknowns))
    return CheckResult(arm, checked, options)
