"""Vary numbers of an arm, or its speed, and see how the vibration over a motion depends on them."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from ident.errors import Problem, refusal
from ident.studies import ranges
from ident.studies.door import DEFAULT, study
from ident.studies.motion_options import basis_of
from ident.studies.options import option, repeated, seed_of_draws
from ident.studies.result import Progress, Result, alias, silent
from ident.studies.working.amplitudes import AmplitudeOptions

if TYPE_CHECKING:
    import numpy as np
    from jaxtyping import Float

    from ident.description.file import ArmFile
    from ident.identify.values import Values
    from ident.measure import Log
    from ident.studies.scenario import Basis
    from ident.studies.working.sweep_study import SweepStudy
    from ident.vibrate.sweep import Axis, Sweep, Trend

MOST_NAMED = 3
"""Parameters named one by one in file names."""


class SweepOptions(AmplitudeOptions):
    """Options of `ident.sweep`: the varied numbers, the motion, and the measure of its vibration."""

    vary: dict[str, ranges.Limits] = repeated(
        {},
        "number to vary, with bounds in SI, or in multiples of the present value with an x behind, and a count: "
        "joint1.k_tors, bracket.com.x=0:0.29, speed=4:20:17 (percent), link1.mass=0.5x:2x; several by one common "
        "factor: a.k_tors=b.k_tors=0.5x:2x; may be repeated; default: torsional stiffness of every joint",
        argument="axes",
        read=ranges.ranges,
    )
    grid: bool = option(False, "both of two parameters together, as a map")
    draws: int = option(50, "draws of the posterior", low=1, high=10_000)
    seed: int | None = seed_of_draws()

    def problems(self) -> list[Problem]:
        """Refuse invalid ranges and maps."""
        problems = [*super().problems(), *ranges.problems("vary", self.vary, "COUNT")]
        if self.grid and len(self.vary) != 2:
            got = f"{len(self.vary)} parameter{'s' * (len(self.vary) != 1)}"
            problems.append(Problem("grid", got, "two", "name two numbers (`vary`), or drop `grid`"))
        return problems


class SweepResult(Result):
    """Dependence of the vibration on numbers of an arm.

    The figure shows amplitudes against each parameter, or a map of two; the table has a row for each amplitude and
    direction: value in SI, the speed in %; amplitude and 5 to 95 % in mm.

    Attributes:
        study: what was varied, on which arm, and the amplitudes.
        options: the options of the call.
        present: amplitude of the present arm, in x, y and z [m].
    """

    study: "SweepStudy"
    options: SweepOptions

    made_from = ("study.basis.sources",)
    numbers = ("present",)
    summarised = ("present", "trends")

    present: ClassVar["Float[np.ndarray, '3']"] = alias("study.present")

    @property
    def name(self) -> str:
        """Name of the arm, its motion and the varied numbers."""
        names = [a.paths[0] + "-etc" * (len(a.paths) > 1) for sweep in self.study.sweeps for a in sweep.axes]
        if not self.study.is_map and len(names) > MOST_NAMED:
            names = [names[0], f"{len(names) - 1}-more"]
        return f"{self.study.basis.name}.{('-by-' if self.study.is_map else '+').join(names)}.sweep"

    @property
    def sweeps(self) -> "Mapping[str, Sweep]":
        """Amplitudes by varied number: `sweeps["speed"].amplitude` (3, K) [m] at `.axes[0].values` (K,) [SI or %]."""
        return {" by ".join(axis.name for axis in sweep.axes): sweep for sweep in self.study.sweeps}

    @property
    def trends(self) -> "Mapping[str, Mapping[str, tuple[Trend, Trend | None]]]":
        """Trend of the amplitudes with each varied number, by its name and the direction; empty for a map.

        Each over the whole range, and near the present value, if that lies within: `trends["speed"]["y"]`.
        """
        from ident.vibrate.sweep import trends

        single = {} if self.study.is_map else self.sweeps
        return {name: {d: (whole, about) for d, whole, about in trends(sweep)} for name, sweep in single.items()}

    def _write(self, path: Path, head: Mapping[str, Any]) -> tuple[Path, ...]:
        from ident.studies.working.sweep_report import write_csv

        table = self._beside(path, ".csv")
        write_csv(self.study, head, table)
        return (table, *super()._write(path, head))


@study
def sweep(
    arm: "ArmFile",
    options: SweepOptions = DEFAULT,
    *,
    path: "Log | None" = None,
    fit: "Values | None" = None,
    posterior: "Values | None" = None,
    progress: Progress = silent,
) -> SweepResult:
    """Simulate a motion with other numbers of the arm, each alone, or two together; by the fast method.

    Args:
        arm: the present arm.
        options: the varied numbers, the motion, and the measure of its vibration.
        path: a joint path to follow instead of the stroke: a log, or its file.
        fit: fitted values for the arm: a result, or its file.
        posterior: draws of the arm's numbers, for bands: a sample, or its file.
        progress: shows progress over batches of simulations.

    Raises:
        InputError: an unknown number, an impossible range, or a motion that the arm can't carry out.
        ModelError: the arm has no stable equilibrium at some value, which is named.
    """
    from ident.studies.working.sweep_study import SweepStudy
    from ident.vibrate.sweep import sweep, sweeps

    basis = basis_of(arm, options, path=path, fit=fit, posterior=posterior)
    axes, shown = _axes(basis, options), progress("simulations")
    evaluator = options.evaluator(basis)
    swept = (sweep(evaluator, axes, shown),) if options.grid else sweeps(evaluator, axes, shown)
    return SweepResult(SweepStudy(basis, swept, options.rate, options.elastic_belts, options.limit_si), options)


def _axes(basis: "Basis", options: SweepOptions) -> "list[Axis]":
    from ident.vibrate.sweep import COUNT, MAP_COUNT, MOST_ON_MAP, Range, axis_of

    usual = MAP_COUNT if options.grid else COUNT

    def axis(interval: Range) -> "Axis":
        return axis_of(basis.arm, interval, basis.percent, basis.arm_file.extents, usual)

    axes = ranges.each("vary", options.vary, basis.arm, axis)
    if options.grid:
        first, second = (len(axis.values) for axis in axes)
        if first * second > MOST_ON_MAP:
            got, expected = f"{first} x {second} = {first * second} points", f"at most {MOST_ON_MAP}"
            raise refusal("grid", got, expected, "give smaller counts (`vary` PATH=LOW:HIGH:COUNT)")
    return axes
