"""Report how far to trust a fitted arm in postures that were not measured."""

from collections.abc import Mapping
from dataclasses import field
from typing import TYPE_CHECKING, ClassVar

from ident.studies.door import DEFAULT, study
from ident.studies.options import option
from ident.studies.result import Progress, Result, alias, silent
from ident.studies.stiffness.fit import FitOptions
from ident.studies.stiffness.fit import fit as fit_study

if TYPE_CHECKING:
    from ident.description.file import ArmFile
    from ident.identify.validate import Scope, Validation
    from ident.measure import Campaign


class ValidateOptions(FitOptions):
    """Options of `ident.validate`: those of the fit, and the part to leave out."""

    refuses: ClassVar[tuple[str, ...]] = ("robust", "no_explain")

    leave: str = option(
        "posture",
        "what is left out at a time, and predicted by the rest: posture, kind, row or fraction (a fifth at random)",
        choices=("posture", "kind", "row", "fraction"),
    )


class ValidateResult(Result):
    """Prediction errors of a fit for parts of the campaign that were left out.

    The table has a row for each measurement: value, prediction from the others, standard deviation [SI], and error in
    standard deviations. The figure shows the error of each part.

    Attributes:
        arm: the arm as in its file.
        validation: the fit, and the left-out parts with their predictions.
        options: the options of the call.
        short: whether the fit to all data is not an optimum.
        covered: number of measurements within the 95 % interval of their prediction.
    """

    arm: "ArmFile"
    validation: "Validation"
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
        """Whether a part lies too far from its prediction, or the fit to all data is in doubt."""
        return bool(self.validation.missed or self.validation.fit.doubts)


@study
def validate(
    arm: "ArmFile", campaign: "Campaign", options: ValidateOptions = DEFAULT, *, progress: Progress = silent
) -> ValidateResult:
    """Report how far to trust a fitted arm in postures that were not measured.

    Leave out each part of the campaign in turn, fit the arm to the rest, and predict the left-out part.

    Args:
        arm: the arm.
        campaign: the measurements.
        options: those of the fit, and the part to leave out.
        progress: shows progress over the starts of the fit and then over the parts.

    Raises:
        InputError: see `fit`, and a campaign of fewer than two parts.
        ModelError: no optimum was reached.
    """
    from ident.identify.validate import validate_fit

    fit = fit_study(arm, campaign, options, progress=progress).fit
    return ValidateResult(arm, validate_fit(fit, options.leave, options.seed, progress("parts")), options)
