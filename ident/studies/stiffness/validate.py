"""Report how far to trust a fitted arm in postures that were not measured, and whether known arms are recovered."""

from collections.abc import Mapping
from dataclasses import field
from typing import TYPE_CHECKING, Any, ClassVar

from ident.errors import require
from ident.studies.door import DEFAULT, study
from ident.studies.options import option
from ident.studies.result import Progress, Result, alias, silent
from ident.studies.stiffness.fit import FitOptions
from ident.studies.stiffness.fit import fit as fit_study

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ident.description.file import ArmFile
    from ident.identify.recovery import Recovery
    from ident.identify.validate import Scope, Validation
    from ident.measure import Campaign


class ValidateOptions(FitOptions):
    """Options of `ident.validate`: those of the fit, and the part to leave out, or the robots to recover."""

    refuses: ClassVar[tuple[str, ...]] = ("robust", "no_explain")

    leave: str = option(
        "posture",
        "what is left out at a time, and predicted by the rest: posture, kind, row or fraction (a fifth at random)",
        choices=("posture", "kind", "row", "fraction"),
    )
    recover: bool = option(False, "instead, make this campaign of known robots, and compare the fits with the truth")
    draws: int = option(100, "known robots of --recover", low=10, high=10_000)
    truths: str = option(
        "prior", "what they are drawn from: prior, or posterior, about the fit", choices=("prior", "posterior")
    )


class ValidateResult(Result):
    """Prediction errors of a fit for parts of the campaign that were left out.

    The table has a row for each measurement: value, prediction from the others, standard deviation [SI], and error in
    standard deviations. The figure shows the error of each part. With `recover` the table has a row for each unknown:
    bias, intervals that hold the truth, power; and there is no figure.

    Attributes:
        arm: the arm as in its file.
        validation: the fit, and the left-out parts with their predictions; with `recover` the fits of known robots.
        options: the options of the call.
        short: whether the fit to all data is not an optimum.
        covered: number of measurements within the 95 % interval of their prediction; with `recover` of intervals that
            hold the truth.
    """

    arm: "ArmFile"
    validation: "Validation | Recovery"
    options: ValidateOptions = field(default_factory=ValidateOptions)

    subject = "validation.fit.campaign.name"
    made_from = ("arm", "validation.fit.campaign")
    summarised = ("validation.scopes", "covered")

    short: ClassVar[bool] = alias("validation.fit.short")
    covered: ClassVar[int] = alias("validation.covered")

    @property
    def scopes(self) -> "Mapping[str, Scope]":
        """Prediction error of each kind of measurement where it was not measured [-]."""
        return {scope.kind: scope for scope in self.validation.scopes}

    @property
    def doubtful(self) -> bool:
        """Whether a part lies too far from its prediction, a rate outside its band, or the fit to all data in doubt."""
        return bool(self.validation.missed or self.validation.fit.doubts)

    def _present(self, part: str, what: str) -> Any:
        if not self.options.recover:
            return super()._present(part, what)
        from ident.studies.stiffness import recovery_report

        return getattr(recovery_report, f"recovery_{what}")(self.validation)

    def _figures(self) -> "Mapping[str, Figure]":
        return {} if self.options.recover else super()._figures()


@study
def validate(
    arm: "ArmFile", campaign: "Campaign", options: ValidateOptions = DEFAULT, *, progress: Progress = silent
) -> ValidateResult:
    """Report how far to trust a fitted arm in postures that were not measured.

    Leave out each part of the campaign in turn, fit the arm to the rest, and predict the left-out part. With `recover`,
    make the campaign of robots with known stiffnesses instead, and fit it.

    Args:
        arm: the arm.
        campaign: the measurements.
        options: those of the fit, and the part to leave out, or the robots to recover.
        progress: shows progress over the starts of the fit and then over the parts, or the made campaigns.

    Raises:
        InputError: see `fit`; a campaign of fewer than two parts; `leave` with `recover`, or its options without it.
        ModelError: no optimum was reached.
    """
    from ident.identify.recovery import recover
    from ident.identify.validate import validate_fit

    usual, remedy = ValidateOptions(), "leave it out" if options.recover else "add `recover`, or leave it out"
    for name in ("leave",) if options.recover else ("draws", "truths"):
        same = getattr(options, name) == getattr(usual, name)
        require(same, name, f"it {'with' if options.recover else 'without'} `recover`", "nothing", remedy)
    fit = fit_study(arm, campaign, options, progress=progress).fit
    if options.recover:
        how = options.draws, options.seed, options.truths, progress("known robots")
        known = recover(fit, options.unknowns_of(arm), *how)
        return ValidateResult(arm, known, options)
    return ValidateResult(arm, validate_fit(fit, options.leave, options.seed, progress("parts")), options)
