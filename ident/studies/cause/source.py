"""Identify imbalance and transmission error of each drive from vibration traces of the moving arm."""

from collections.abc import Mapping
from dataclasses import field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from ident.studies import reading
from ident.studies.door import DEFAULT, study
from ident.studies.options import option, repeated
from ident.studies.result import Progress, Result, alias, silent
from ident.studies.shared import RunsOptions, with_numbers
from ident.studies.values import drawn_values

if TYPE_CHECKING:
    from ident.description.file import ArmFile
    from ident.identify.values import Values
    from ident.measure.runs import Runs
    from ident.studies.cause.source_study import SourceStudy
    from ident.studies.stiffness.sample import SampleResult

MOST_DRAWS = 4000
"""Draws of a posterior for its mean and covariance."""


class SourceOptions(RunsOptions):
    """Options of `ident.source`: the clock error, and the runs left out for testing."""

    offset: float = option(
        0.05, "time [s] by which a recorder's clock may differ from the motion's", above=0.0, high=1.0
    )
    hold_out: tuple[str, ...] = repeated(
        (), "file of a run to leave out and to predict; may be repeated", read=reading.names
    )
    calibration: float = option(0.0, "standard error [%] of each sensor's calibration", low=0.0, high=50.0)
    peak: float | None = option(None, "frequency [Hz] of a peak: which cause makes it", above=0.0, high=1e3)
    teeth: dict[str, float] = repeated(
        {}, "teeth of a belt's driving pulley, as belt1=40: its mesh as a cause; may be repeated", read=reading.numbers
    )
    draws: int = option(400, "draws of what was identified, for --posterior of other commands", low=1, high=10_000)
    seed: int = option(0, "seed of these draws", low=0, high=1e18)


class SourceResult(Result):
    """Sources of the arm, identified from traces of its vibration.

    The table has a row for each source: amplitude and its standard deviation [SI], phase [rad], whether it is
    determined. The figure shows the measured traces, the computed ones and the residuals.

    Attributes:
        study: traces, identified sources, and predicted runs.
        arm_file: the arm.
        runs: the table of runs.
        options: the options of the call.
        posterior: draws of stiffnesses known beforehand.
        doubtful: whether runs contradict each other or the model.
    """

    study: "SourceStudy"
    arm_file: "ArmFile"
    runs: "Runs"
    options: SourceOptions = field(default_factory=SourceOptions)
    posterior: "Values | None" = None

    subject = "runs.name"
    made_from = ("arm_file as arm", "runs", "posterior")
    summarised = ("parameters", "draws", "phases", "trials", "causes")

    doubtful: ClassVar[bool] = alias("study.doubtful")

    @property
    def parameters(self) -> Mapping[str, float]:
        """Identified numbers of the arm, by path [SI]."""
        return self.study.found.numbers()

    @cached_property
    def draws(self) -> Mapping[str, Any]:
        """Draws of these numbers."""
        return self.study.found.draws(self.options.draws, self.options.seed)

    @property
    def phases(self) -> Mapping[str, tuple[Any, Any]]:
        """Phase of each drive's imbalance in each phase group, with its standard deviation [rad]."""
        found = [each for each in self.study.found.estimates if not each.source.of_error]
        return {each.source.drive: (each.phase, each.phase_sd) for each in found}

    @cached_property
    def trials(self) -> list[dict[str, Any]]:
        """Masses added for runs: stated imbalance [kg m], factor of its effect [-], draws of the factor.

        Complex numbers are given as real and imaginary part.
        """
        import numpy as np

        found = self.study.tried(self.options.draws, self.options.seed)
        return [
            {"run": each.run, "drive": each.drive}
            | {name: (x.real, x.imag) for name, x in (("stated", each.stated), ("factor", each.factor))}
            | {"draws": np.stack([each.draws.real, each.draws.imag])}
            for each in found
        ]

    @property
    def causes(self) -> list[dict[str, Any]]:
        """Possible causes of the queried peak, most probable first; empty without a query."""
        found = self.study.causes
        told = {"peak": found.peak, "told": found.told} if found else {}
        return [
            told | vars(each) | {"source": each.source and list(each.source[:3])}
            for each in (found.causes if found else ())
        ]

    @property
    def short(self) -> bool:
        """Whether the search has not converged."""
        return not self.study.found.settled


@study
def source(
    runs: "Runs | str | Path",
    arm: "ArmFile | None" = None,
    options: SourceOptions = DEFAULT,
    *,
    posterior: "Values | SampleResult | str | Path | None" = None,
    progress: Progress = silent,
) -> SourceResult:
    """Identify imbalance and transmission error of each drive from traces of the moving arm.

    Args:
        runs: the table of runs, see `ident source --init`, or its file.
        arm: the arm; by default arm.toml in the folder of the table.
        options: the clock error, the runs left out for testing.
        posterior: draws of its stiffnesses: a sample, or its file; without it they are known within 10 % (assumed).
        progress: shows the progress of the search.

    Raises:
        InputError: a file is wrong, or does not match the arm; runs without common time or with too few turns.
        ModelError: the arm collapses.
    """
    from ident.studies.cause.run_problem import arm_beside, as_runs, with_clocks, with_notes
    from ident.studies.cause.source_study import studied

    runs = as_runs(runs, options.columns)
    arm = arm or arm_beside(runs, options.soft_base)
    drawn = drawn_values(posterior, arm, MOST_DRAWS, None, options)
    described = with_numbers(arm.arm, drawn, options.set)
    runs = with_notes(described, with_clocks(described, runs, options.offset))
    draws = drawn.without(options.set) if drawn else {}
    found = studied(
        described,
        runs,
        draws,
        offset=options.offset,
        hold_out=options.hold_out,
        peak=options.peak,
        teeth=options.teeth,
        calibration=options.calibration / 100,
        progress=progress("search"),
    )
    return SourceResult(found, arm, runs, options, drawn)
