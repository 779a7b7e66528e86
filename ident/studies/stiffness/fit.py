"""Fit the joint stiffnesses to a campaign, and report which of them the data determine."""

from collections.abc import Mapping
from dataclasses import field, replace
from typing import TYPE_CHECKING, Any, ClassVar

from ident.studies.door import DEFAULT, study
from ident.studies.options import option
from ident.studies.result import Progress, Result, alias, silent
from ident.studies.shared import ProblemOptions

if TYPE_CHECKING:
    import numpy as np
    from jaxtyping import Float

    from ident.arm.arm import Arm
    from ident.description.file import ArmFile
    from ident.identify.assumptions import Assumptions
    from ident.identify.explanations import Explanations
    from ident.identify.fit import CampaignFit
    from ident.identify.values import Robot, Values
    from ident.inference.fit import CrossPrediction
    from ident.measure import Campaign


class FitOptions(ProblemOptions):
    """Options of `ident.fit`: the unknowns, their priors, and the length of the search."""

    refuses: ClassVar[tuple[str, ...]] = ()

    starts: int = option(16, "starts of the fit, at least", low=1, high=10_000)
    robust: str | None = option(
        None,
        "let values that are too far off count less, by Huber's loss or Student's t: huber or t",
        choices=("huber", "t"),
    )
    no_explain: bool = option(False, "where data are in doubt, do not search for what would reconcile them")

    @property
    def explains(self) -> bool:
        """Whether to search for possible causes of contradictory data: not where a report has no place for them."""
        return not self.no_explain and "no_explain" not in self.refuses


class FitResult(Result):
    """A fit of an arm to a campaign.

    The figure shows values with intervals, parameter combinations and residuals. The table has a row for each
    parameter: value, unit, standard error (of a positive number value times that of its logarithm) and interval [SI],
    and whether the data support it; `measurements` a row for each measurement.

    Attributes:
        arm: the arm as in its file.
        fit: fitted values, intervals, residuals and objections to them.
        options: the options of the call.
        short: whether the best point of all starts is not an optimum.
        parameters: fitted values by path [SI: N m/rad for a stiffness]; tied numbers each by its own path.
        explanations: possible causes of doubtful data, most plausible first; None without a search for them.
        assumptions: how far a violation of each assumption may shift a value, and the evidence in the data.
        doubts: why no interval of this fit should be reported; empty without objections.
        fitted_arm: the arm with the fitted numbers in place.
        doubtful: whether there is any objection to the fit, or evidence against one of its assumptions.
        fitted: the fit itself.
        chi_squared: sum of squared residuals of the data [-].
        degrees_of_freedom: fitted values less the parameter combinations that they determine.
        p_value: probability of a larger chi-squared [-]; NaN without degrees of freedom, and for a robust fit.
        rank: parameter combinations on which the data depend.
    """

    arm: "ArmFile"
    fit: "CampaignFit"
    options: FitOptions = field(default_factory=FitOptions)

    subject = "fit.campaign.name"
    made_from = ("arm", "fit.campaign")
    numbers = ("parameters", "fit.predicted", "fit.chi_squared")
    summarised = (
        *("parameters", "damping", "scaled", "doubts"),
        *("chi_squared", "degrees_of_freedom", "p_value", "rank"),
    )

    short: ClassVar[bool] = alias("fit.short")
    parameters: ClassVar[Mapping[str, float]] = alias("fit.parameters")
    explanations: ClassVar["Explanations | None"] = alias("fit.explanations")
    assumptions: ClassVar["Assumptions | None"] = alias("fit.assumptions")
    doubts: ClassVar[tuple[str, ...]] = alias("fit.doubts")
    fitted_arm: ClassVar["Arm"] = alias("fit.fitted_arm")
    doubtful: ClassVar[bool] = alias("fit.in_doubt")
    fitted: ClassVar["CampaignFit"] = alias("fit")
    chi_squared: ClassVar[float] = alias("fit.chi_squared")
    degrees_of_freedom: ClassVar[int] = alias("fit.degrees_of_freedom")
    p_value: ClassVar[float] = alias("fit.p_value")
    rank: ClassVar[int] = alias("fit.information.rank")

    @property
    def damping(self) -> Mapping[str, float] | None:
        """Damping by the law that fits the measured ratios, by path [s or -]; None where the arm has no place for it.

        Empty without measured ratios.
        """
        known = self.fit.damping
        numbers = known.carried if known else {}
        return {path: x for paths, x in numbers.items() for path in paths} if numbers or not known else None

    @property
    def scaled(self) -> tuple[str, ...]:
        """Bodies with an uncertain mass, whose inertia scales with it."""
        from ident.identify.values import scaled_by

        return scaled_by(self.fit.problem)

    @property
    def intervals(self) -> Mapping[str, tuple[float, float]]:
        """95 % intervals by parameter [SI], supported by the data or not: see `doubts` and `supported`."""
        names = self.fit.problem.parameters.names
        return {name: (float(low), float(high)) for name, (low, high) in zip(names, self.fit.interval(), strict=True)}

    @property
    def sd(self) -> Mapping[str, float]:
        """Standard deviation of each parameter from data and prior, of ln(value) [-] for a positive one."""
        known = self.fit.information
        return dict(zip(known.names, map(float, known.sd), strict=True))

    @property
    def covariance(self) -> Mapping[str, Mapping[str, float]]:
        """Covariance of the parameters, for `pandas.DataFrame`: of what `sd` is of [-]; on its diagonal sd squared."""
        return _by_names(self.fit.information.names, self.fit.information.covariance)

    @property
    def correlations(self) -> Mapping[str, Mapping[str, float]]:
        """Correlations of the parameters [-], as `covariance`; NaN where a variance is infinite."""
        return _by_names(self.fit.information.names, self.fit.information.correlation)

    @property
    def residuals(self) -> 'Float[np.ndarray, "D"]':
        """(D,) (measured - predicted) / sigma [-] of each measurement, in the order of the campaign."""
        return -self.fit.off

    @property
    def trade_offs(self) -> Mapping[str, Mapping[str, float]]:
        """Trade-offs that the data don't notice: for each parameter that may move, changes of all in ln(value) [-]."""
        known = self.fit.information
        return {each.name: dict(zip(known.names, map(float, each.change), strict=True)) for each in known.trade_offs()}

    @property
    def cross_predictions(self) -> "Mapping[str, CrossPrediction]":
        """Each kind of measurement as a fit to all others predicts it [SI]."""
        return {each.kind: each for each in self.fit.cross_predictions}

    @property
    def supported(self) -> Mapping[str, bool]:
        """Whether the interval of a parameter may be reported."""
        return dict(zip(self.fit.problem.parameters.names, map(bool, self.fit.supported), strict=True))

    @property
    def measurements(self) -> list[dict[str, Any]]:
        """Rows of all measurements, for `pandas.DataFrame`: measured, predicted, sigma [SI], residual [-]."""
        from ident.studies.stiffness.fit_report import measurement_rows

        return measurement_rows(self.fit)

    def _document(self, head: Mapping[str, Any]) -> dict[str, Any]:
        from ident.report.document import plain

        return {**super()._document(head), "measurements": plain(self.measurements)}

    def values_of(self, arm: "Arm") -> "tuple[Values, Robot, float | None]":
        """Return the fitted values of an arm [SI], the robot of the fit, and the height [m] of its soft base."""
        from ident.identify.values import Robot, Values

        return Values.of_fit(self.fit, arm), Robot.of(self.arm.arm, self.arm.sha256), self.options.soft_base


def _by_names(names: tuple[str, ...], matrix: "np.ndarray") -> dict[str, dict[str, float]]:
    rows = (dict(zip(names, map(float, row), strict=True)) for row in matrix)
    return dict(zip(names, rows, strict=True))


@study
def fit(
    arm: "ArmFile", campaign: "Campaign", options: FitOptions = DEFAULT, *, progress: Progress = silent
) -> FitResult:
    """Fit the joint stiffnesses and other freed numbers to a campaign; with measured damping ratios also the damping.

    Args:
        arm: its stiffnesses are starting values and centres of the priors.
        campaign: the measurements.
        options: the unknowns, their priors, and the length of the search.
        progress: shows progress over the starts.

    Raises:
        InputError: campaign and arm, or the named parameters, do not match; implausible values.
        ModelError: no optimum was reached.
    """
    from ident.identify.fit import fit_campaign

    unknowns = options.unknowns_of(arm)
    fitted = fit_campaign(
        arm.arm,
        campaign,
        unknowns,
        starts=options.starts,
        seed=options.seed,
        trusted=tuple(map(str, options.trust_values)),
        robust=options.robust,
        progress=progress("starts"),
    )
    if options.explains and fitted.in_doubt:
        from ident.identify.explanations import explain

        fitted = replace(fitted, explanations=explain(fitted, unknowns, progress=progress("explanations")))
    return FitResult(arm, fitted, options)
