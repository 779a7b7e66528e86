"""Report what a campaign can determine about each parameter, before any fit."""

from collections.abc import Mapping
from dataclasses import field, replace
from typing import TYPE_CHECKING, ClassVar

from ident.studies.door import DEFAULT, study
from ident.studies.options import option
from ident.studies.result import Result, alias
from ident.studies.shared import ProblemOptions

if TYPE_CHECKING:
    from ident.description.file import ArmFile
    from ident.identify.check import CampaignCheck
    from ident.measure import Campaign


class CheckOptions(ProblemOptions):
    """Options of `ident.check`: the unknowns and their priors."""

    refuses: ClassVar[tuple[str, ...]] = ()

    no_explain: bool = option(False, "where data contradict each other, do not search for what would reconcile them")


class CheckResult(Result):
    """What a campaign can determine about an arm.

    The table has a row for each parameter: verdict, and standard deviation of theta from the data alone, at the arm's
    values and the largest of all points; theta is ln(value) for a stiffness. There is no figure.

    Attributes:
        arm: the arm as in its file.
        check: verdicts, parameter combinations, leverage of each measurement, warnings about labels and data.
        options: the options of the call.
        contradictory: whether one kind of measurement contradicts the others.
        doubtful: whether the data contradict each other.
    """

    arm: "ArmFile"
    check: "CampaignCheck"
    options: CheckOptions = field(default_factory=CheckOptions)

    subject = "check.campaign.name"
    drawn = ()
    made_from = ("arm", "check.campaign")
    summarised = ("contradictory",)

    contradictory: ClassVar[bool] = alias("check.contradictory")
    doubtful: ClassVar[bool] = alias("contradictory")

    @property
    def verdicts(self) -> Mapping[str, str]:
        """Verdict by parameter: identifiable, weak, open, not seen or unknown."""
        return dict(zip((item.name for item in self.check.items), self.check.verdicts, strict=True))

    @property
    def others(self) -> tuple[Mapping[str, float], ...]:
        """Other values by parameter [SI] that give the same data: other optima of a search from several starts."""
        names = self.check.problem.parameters.names
        found = self.check.others.exact if self.check.others else ()
        return tuple(dict(zip(names, map(float, optimum.values), strict=True)) for optimum in found)


@study
def check(arm: "ArmFile", campaign: "Campaign", options: CheckOptions = DEFAULT) -> CheckResult:
    """Report what a campaign can determine about the joint stiffnesses and other freed numbers, before any fit.

    Args:
        arm: the model is linearised at its stiffnesses.
        campaign: the measurements.
        options: the unknowns and their priors.

    Raises:
        InputError: campaign and arm, or the named parameters, do not match; implausible values; contradictory
            repeats; a campaign without information on any unknown.
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
