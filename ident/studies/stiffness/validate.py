"""Say how far a fitted arm may be trusted where it was not measured."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar

from ident.studies.door import DEFAULT, study
from ident.studies.options import option
from ident.studies.result import Progress, Result, alias, silent
from ident.studies.stiffness.fit import FitOptions
from ident.studies.stiffness.fit import fit as fit_study

if TYPE_CHECKING:
    from ident.description.file import ArmFile
    from ident.identify.compare import Scope, Validation
    from ident.measure import Campaign


@dataclass(frozen=True, kw_only=True)
class ValidateOptions(FitOptions):
    """Options of `ident.validate`: those of the fit, and what is left out at a time."""

    refuses: ClassVar[tuple[str, ...]] = ("robust", "no_explain")

    leave: str = option(
        "posture",
        "what is left out at a time, and predicted by the rest: posture, kind, row or fraction (a fifth at random)",
        choices=("posture", "kind", "row", "fraction"),
    )


@dataclass(frozen=True, repr=False, eq=False)
class ValidateResult(Result):
    """How well a fit predicts what it has not seen.

    Its table has a row for each measurement: value, prediction from the others, standard deviation [SI], and error
    in these. Its figure compares predicted and observed quantiles, and shows what each part is off.

    Attributes:
        arm: the arm as its file has it.
        validation: the fit, and the parts that were left out with their predictions.
        options: what was asked for.
        short: whether the fit to all is no optimum.
    """

    arm: "ArmFile"
    validation: "Validation"
    options: ValidateOptions = field(default_factory=ValidateOptions)

    form = "ident-validate/10"
    subject = "validation.fit.campaign.name"
    shown = ("validation",)
    made_from = ("arm", "validation.fit.campaign")
    summary = ("validation.scopes", "validation.covered")

    short: ClassVar[bool] = alias("validation.fit.short")

    @property
    def scopes(self) -> "Mapping[str, Scope]":
        """How well each kind of measurement is predicted where it was not measured [-]."""
        return {scope.kind: scope for scope in self.validation.scopes}

    @property
    def doubtful(self) -> bool:
        """Whether a part lies too far from its prediction, or the fit to all is in doubt."""
        return bool(self.validation.missed or self.validation.fit.doubts)


@study
def validate(
    arm: "ArmFile",
    campaign: "Campaign",
    options: ValidateOptions = DEFAULT,
    *,
    progress: Progress = silent,
) -> ValidateResult:
    """Say how far a fitted arm may be trusted where it was not measured.

    Each part of the campaign is left out in turn, the arm is fitted to the rest, and what was left out is predicted.

    Args:
        arm: the arm.
        campaign: the measurements.
        options: those of the fit, and what is left out at a time.
        progress: shows how far it is, over the starts of the fit and then over the parts.

    Raises:
        InputError: see `fit`, and a campaign of fewer than two such parts.
        ModelError: no optimum was reached.
    """
    from ident.identify.compare import validate_fit

    fit = fit_study(arm, campaign, options, progress=progress).fit
    return ValidateResult(arm, validate_fit(fit, options.leave, options.seed, progress("parts")), options)
