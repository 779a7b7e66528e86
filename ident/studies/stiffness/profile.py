"""Check the intervals of a fit: move each parameter, refit all others, and follow the rise of the cost."""

from collections.abc import Mapping
from dataclasses import field
from typing import TYPE_CHECKING, ClassVar

from ident.studies import reading
from ident.studies.door import DEFAULT, study
from ident.studies.options import option, repeated
from ident.studies.result import Progress, Result, alias, silent
from ident.studies.stiffness.fit import FitOptions
from ident.studies.stiffness.fit import fit as fit_study

if TYPE_CHECKING:
    from ident.description.file import ArmFile
    from ident.identify.fit import CampaignFit
    from ident.inference.profile import Profile
    from ident.measure import Campaign


class ProfileOptions(FitOptions):
    """Options of `ident.profile`: those of the fit, the profiled parameters, and the range."""

    refuses: ClassVar[tuple[str, ...]] = ("no_explain",)

    parameter: tuple[str, ...] = repeated(
        (), "parameter to profile, default: all; may be repeated", read=reading.each_of
    )
    reach: float = option(
        1000.0, "factor on the fitted value beyond which a profile is called open", above=1.0, high=1e12
    )


class ProfileResult(Result):
    """Profile likelihoods of a fit.

    The figure has a panel for each parameter, the table a row: fitted value, unit, and the ends [SI] of both intervals.

    Attributes:
        arm: the arm as in its file.
        fit: the fit whose intervals are checked.
        profiles: the least cost as a function of each parameter.
        options: the options of the call.
        short: whether the profiled fit is not an optimum.
        doubts: objections to the profiled fit; empty without any.
    """

    arm: "ArmFile"
    fit: "CampaignFit"
    profiles: "tuple[Profile, ...]"
    options: ProfileOptions = field(default_factory=ProfileOptions)

    subject = "fit.campaign.name"
    shown = ("fit", "profiles")
    listed = ("profiles",)
    made_from = ("arm", "fit.campaign")
    numbers = ("fit.parameters",)
    summarised = ("doubts",)

    short: ClassVar[bool] = alias("fit.short")
    doubts: ClassVar[tuple[str, ...]] = alias("fit.doubts")

    @property
    def intervals(self) -> Mapping[str, tuple[float, float]]:
        """95 % intervals by parameter [SI]; an open side is infinite, or zero for a positive number."""
        ends = {each.name: each.values([each.widest.low, each.widest.high]) for each in self.profiles}
        return {name: (float(low), float(high)) for name, (low, high) in ends.items()}

    @property
    def linear(self) -> Mapping[str, bool]:
        """Whether the interval of a parameter agrees with the linear interval of the fit."""
        return {each.name: each.linear for each in self.profiles}


@study
def profile(
    arm: "ArmFile", campaign: "Campaign", options: ProfileOptions = DEFAULT, *, progress: Progress = silent
) -> ProfileResult:
    """Fit an arm to a campaign, and profile the likelihood of its parameters, priors included.

    With `no_prior` the profiles show what the data alone support.

    Args:
        arm: its stiffnesses are starting values and centres of the priors.
        campaign: the measurements.
        options: those of the fit; the profiled parameters, and the range.
        progress: shows progress over the starts and then over the sides of the profiles.

    Raises:
        InputError: campaign and arm, or the named parameters, do not match; implausible values.
        ModelError: no optimum was reached.
    """
    from ident.identify.problem import pose
    from ident.inference import profile as likelihood

    problem = pose(arm.arm, campaign, options.unknowns_of(arm)).problem
    likelihood.check(problem.parameters, options.parameter)
    fit = fit_study(arm, campaign, options, progress=progress).fit
    profiles = likelihood.profile(fit, options.parameter, reach=options.reach, progress=progress("profiles"))
    return ProfileResult(arm, fit, profiles, options)
