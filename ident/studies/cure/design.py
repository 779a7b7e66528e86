"""Parameter changes that minimise the vibration of an arm, and its sensitivities."""

from collections.abc import Mapping
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from ident.errors import InputError, Problem, refusal
from ident.studies import ranges
from ident.studies.door import DEFAULT, study
from ident.studies.motion_options import basis_of
from ident.studies.options import option, repeated
from ident.studies.result import Progress, Result, alias, silent
from ident.studies.values import drawn_groups
from ident.studies.working.amplitudes import AmplitudeOptions

if TYPE_CHECKING:
    import numpy as np
    from jaxtyping import Float
    from matplotlib.figure import Figure

    from ident.arm.arm import Arm
    from ident.description.file import ArmFile
    from ident.identify.values import Values
    from ident.measure import Log
    from ident.studies.cure.design_study import DesignStudy
    from ident.studies.scenario import Basis
    from ident.studies.stiffness.sample import SampleResult
    from ident.vibrate.design_search import Requirements
    from ident.vibrate.evaluator import Evaluator
    from ident.vibrate.variable import Variable

TIGHTENED = 2
"""Largest number of times that a limit is tightened for the search, until the exact equations keep it."""
OF_THE_SEARCH = ("change", "limit", "min_frequency", "max_deflection", "max_change", "no_curve")
"""Options without meaning for sensitivities alone."""


class DesignOptions(AmplitudeOptions):
    """Options of `ident.design`: what may change, what must be kept, the motion, and the search."""

    dwell: float = option(1.0, "time [s] that the arm is held at the end", low=0.0, high=3600.0)
    change: dict[str, ranges.Limits] = repeated(
        {},
        "number that may be changed, with bounds in SI or, with an x, in multiples of the present value, and the "
        "weight of its change: joint1.k_tors, link1.mass=0.5x:2x, fingers.com.x=1.3:1.8:2; several by one factor: "
        "a.k_tors=b.k_tors; may be repeated; default: all torsional stiffnesses, up to twice as stiff",
        argument="variables",
        read=ranges.ranges,
    )
    softer: bool = option(False, "a stiffness without bounds may fall to half as well; otherwise it may only rise")
    min_frequency: float | None = option(
        None, "first natural frequency [Hz] to keep at both ends of the motion", above=0.0, high=1000.0
    )
    max_deflection: float | None = option(None, "static deflection [mm] to keep at both ends", above=0.0)
    max_change: float | None = option(
        None, "largest change norm: 1 is one number of weight 1 at its farther bound", above=0.0
    )
    sensitivities: bool = option(False, "only the table of sensitivities")
    starts: int = option(3, "starts of the search", low=1, high=100)
    no_curve: bool = option(False, "no trade-off of amplitude and change")
    draws: int = option(16, "draws of the posterior for the search", low=1, high=1000)
    fresh: int = option(1000, "other draws, by which the design is verified", low=0, high=100_000)
    seed: int = option(0, "seed of all that is drawn at random", low=0, high=1e18)

    def problems(self) -> list[Problem]:
        """Refuse invalid ranges, and options of a search without a search."""
        problems = [*super().problems(), *ranges.problems("change", self.change, "WEIGHT")]
        for name in OF_THE_SEARCH if self.sensitivities else ():
            if getattr(self, name):
                problems.append(Problem(name, "it beside `sensitivities`", "one of them", "drop one"))
        return problems

    @property
    def required(self) -> "Requirements":
        """Requirements of a design [SI]."""
        from ident.vibrate.design_search import Requirements

        deflection = inf if self.max_deflection is None else self.max_deflection / 1e3
        return Requirements(self.min_frequency or 0.0, deflection, inf if self.max_change is None else self.max_change)


class DesignResult(Result):
    """The change that keeps a limit or minimises the vibration of an arm, or its sensitivities alone.

    The table has a row for each number [SI]: present and best value, and the bound it reaches; or its sensitivities.

    Attributes:
        study: what may be changed, on which arm, and the result.
        text: the arm file with the changed numbers; empty without one.
        options: the options of the call.
        present: amplitude of the present arm, in x, y and z [m].
    """

    study: "DesignStudy"
    text: str
    options: DesignOptions

    made_from = ("study.basis.sources",)
    numbers = ("present", "best")
    summarised = ("present", "best")

    present: ClassVar["Float[np.ndarray, '3']"] = alias("study.sensitivities.amplitude")

    @property
    def name(self) -> str:
        """Name of the arm, its motion and the computation."""
        return f"{self.study.basis.name}.{'sensitivities' if self.options.sensitivities else 'design'}"

    @property
    def values(self) -> Mapping[str, float]:
        """The changed numbers by path [SI]; empty if only sensitivities were computed."""
        return self.study.design.best.values if self.study.design else {}

    @property
    def best(self) -> "Float[np.ndarray, '3'] | None":
        """Amplitude of the changed arm, in x, y and z [m]; None if only sensitivities were computed."""
        return self.study.design.best.amplitude if self.study.design else None

    @property
    def short(self) -> bool:
        """Whether the least change exceeds its limit by the exact equations."""
        design, checks = self.study.design, self.study.verification
        if design is None or checks is None:
            return False
        exceeded = design.limit is not None and float(checks.after.amplitude.max()) > design.limit
        return design.minimum_change is not None and exceeded

    @property
    def changed_arm(self) -> "Arm":
        """The arm with the changed numbers."""
        return self.study.basis.arm.replace(self.values)

    def _figures(self) -> "dict[str, Figure]":
        """Return the trade-off, "vibration" before and after, and "sensitivities"; or only the latter."""
        from ident.studies.cure.design_figure import before_after_figure, sensitivity_figure, trade_off_figure

        sensitivities = sensitivity_figure(self.study)
        if self.study.design is None:
            return {"": sensitivities}
        vibration = before_after_figure(self.study)
        return {"": trade_off_figure(self.study), "vibration": vibration, "sensitivities": sensitivities}

    def _write(self, path: Path, head: Mapping[str, Any]) -> tuple[Path, ...]:
        from ident.studies.cure.design_report import write_arm

        written = super()._write(path, head)
        if not self.text:
            return written
        arm_file, arm = self.study.basis.arm_file, self._beside(path, ".toml")
        write_arm(self.text, f"by ident design from {arm_file.path}, sha256 {arm_file.sha256}", arm)
        return (*written, arm)


@study
def design(
    arm: "ArmFile",
    options: DesignOptions = DEFAULT,
    *,
    path: "Log | None" = None,
    fit: "Values | None" = None,
    posterior: "Values | SampleResult | str | Path | None" = None,
    progress: Progress = silent,
) -> DesignResult:
    """Search the change of an arm's numbers, within bounds, that minimises its vibration, and verify it.

    With a limit, it is the least change that keeps it, if there is one; with a posterior too, the change with the least
    probability of exceeding the limit.

    Args:
        arm: the present arm; if from a file, the changed numbers must be written there.
        options: what may change, what must be kept, the motion, and the search.
        path: a joint path to follow instead of the stroke: a log, or its file.
        fit: fitted values for the arm: a result, or its file.
        posterior: draws of the arm's numbers: a sample, or its file; chosen draws all serve the search.
        progress: shows progress over starts, groups of sensitivities and batches of draws.

    Raises:
        InputError: an unknown number, impossible bounds, or a motion that the arm can't carry out.
        ModelError: no design within the bounds meets the requirements, or the arm collapses.
    """
    from ident.studies.cure.design_study import DesignStudy
    from ident.vibrate.design import design, verify, with_minimum_change
    from ident.vibrate.sweep import sensitivities

    searched, fresh = drawn_groups(posterior, arm, options.draws, options.fresh, options.seed, options)
    basis = basis_of(arm, options, path=path, fit=fit, posterior=searched)
    evaluator = _evaluator(basis, options)
    if options.sensitivities:
        each = sensitivities(evaluator, progress=progress("sensitivities"))
        return DesignResult(DesignStudy(basis, evaluator, each), "", options)
    text = _checked_text(basis, evaluator.variables)
    evaluator = replace(evaluator, step=evaluator.step_for(evaluator.bounds))  # one for all: they share programs
    best = design(
        evaluator,
        limit=options.limit_si,
        required=options.required,
        extents=arm.extents,
        starts=options.starts,
        curve=not options.no_curve,
        seed=options.seed,
        progress=progress("starts"),
    )
    each = sensitivities(evaluator, progress=progress("sensitivities"))
    unseen = basis.drawn(fresh, seed=1) if fresh else None
    checks, aim = verify(evaluator, best.best, best.limit, unseen, progress("verification")), best.limit
    for _ in range(TIGHTENED):  # if the fast method is wrong by more than the margin of the least change
        largest = float(checks.after.amplitude.max())
        if aim is None or best.limit is None or best.minimum_change is None or largest <= best.limit:
            break
        aim *= best.limit / largest
        best = with_minimum_change(replace(best, best=best.optima[0], minimum_change=None), aim)
        checks = verify(evaluator, best.best, best.limit, unseen, progress("verification"))
    study = DesignStudy(basis, evaluator, each, best, checks, options.starts)
    return DesignResult(study, _updated(text, basis, best.best.values) if text else "", options)


def _evaluator(basis: "Basis", options: DesignOptions) -> "Evaluator":
    from ident.vibrate.sweep import Range, variable_of

    def variable(interval: Range) -> "Variable":
        return variable_of(basis.arm, interval, basis.arm_file.extents, softer=options.softer)

    variables = () if options.sensitivities else tuple(ranges.each("change", options.change, basis.arm, variable))
    return options.evaluator(basis, variables)


def _checked_text(basis: "Basis", variables: "tuple[Variable, ...]") -> str:
    """Return the text of the arm file; empty without one in TOML."""
    from ident.description.file import parse_arm, update_file
    from ident.text import one_line, read_text

    path, values = basis.arm_file.path, basis.fit or basis.posterior
    if not path or basis.arm_file.bushings:
        return ""
    text = read_text(path, "an arm description (TOML)")
    names = [name for variable in variables for name in variable.paths]
    written = parse_arm(text, one_line(path))
    for name in [*names, *(values.values if values else ()), *basis.changed]:
        try:
            update_file(text, {name: float(basis.arm.get(name))}, origin="designed")
            here = bool(written.get(name) == basis.arm_file.arm.get(name))  # a soft base moves bushing 1
        except InputError:
            here = False
        if not here:
            got, expected = "a number that is not written in the arm file", "one that is"
            raise refusal(name, got, expected, "write it there, or change what it follows from")
    return text


def _updated(text: str, basis: "Basis", designed: Mapping[str, float]) -> str:
    """Return the text of the arm file with fitted, set and designed numbers, each with its origin."""
    from ident.description.file import update_file
    from ident.text import one_line

    values, where = basis.fit or basis.posterior, one_line(basis.arm_file.path)
    later = {**basis.changed, **designed}
    taken = {path: x for path, x in values.medians.items() if path not in later} if values else {}
    text = update_file(text, taken, origin="calibrated", where=where) if taken else text
    text = update_file(text, basis.changed, origin="assumed", where=where) if basis.changed else text
    return update_file(text, designed, origin="designed", where=where)
