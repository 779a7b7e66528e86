"""Find the causes of a moving arm's vibration in its traces: a drive, a mode, a fixed frequency."""

from dataclasses import field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ident.errors import Problem, require
from ident.studies import reading
from ident.studies.door import DEFAULT, study
from ident.studies.options import option
from ident.studies.result import Result
from ident.studies.shared import RunsOptions, as_log, with_numbers

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ident.arm.arm import Arm
    from ident.description.file import ArmFile
    from ident.measure import Log, Trace
    from ident.measure.runs import Runs
    from ident.vibrate.triage import MovingTrace, Triage


MOST_ORDERS = 12
"""Largest multiple of a pulley's frequency: all tracks are compared with each other, at cubic cost."""
SEGMENT = 2.0
"""Length [s] of a segment of the order map: it separates frequencies half a hertz apart."""


class TriageOptions(RunsOptions):
    """Options of `ident.triage`: the multiples of a pulley's frequency."""

    orders: tuple[int, ...] = option(
        (1, 2, 4), "multiples of each pulley's frequency that are looked at", read=reading.whole_numbers, text="1,2,4"
    )
    upto: float = option(20.0, "highest frequency [Hz] that is drawn", above=0.0)
    delay: float | None = option(None, "time [s] to add to the times of a trace with a path; default: found")

    def problems(self) -> list[Problem]:
        """Refuse more multiples than a search can handle."""
        got, remedy = f"{len(self.orders)} multiples", "name those that are likely"
        many = [Problem("orders", got, f"at most {MOST_ORDERS}", remedy)] if len(self.orders) > MOST_ORDERS else []
        return [*super().problems(), *many]


class TriageResult(Result):
    """Causes of the strong parts of a vibration, from its frequencies over time.

    The table has a row for each part: what it follows, its share of the vibration, probability, frequencies.

    Attributes:
        found: the parts, and all compared tracks.
        runs: the table of runs.
        arm_file: the arm.
        options: the options of the call.
        log: the joint path of a trace without a table.
    """

    found: "Triage"
    runs: "Runs"
    arm_file: "ArmFile"
    options: TriageOptions = field(default_factory=TriageOptions)
    log: "Log | None" = None

    subject = "runs.name"
    shown = ("found", "runs")
    made_from = ("arm_file as arm", "runs", "log as path")

    def _figures(self) -> "dict[str, Figure]":
        """Return the order map of the trace in which the largest part is strongest."""
        from ident.measure.runs import QUANTITIES
        from ident.studies.cause.triage_figure import triage_figure
        from ident.vibrate.spectra import spectrogram

        strongest = self.found.findings[0].trace if self.found.findings else 0
        trace = self.runs.traces[strongest]
        drawn = spectrogram(trace.time, trace.values, segment_seconds=SEGMENT)
        title, kind = f"Order map: {trace.row.file} {trace.row.channel}", tuple(QUANTITIES)[trace.derivative]
        how: Any = {"trace": strongest, "title": title, "upto": self.options.upto, "kind": kind}
        return {"": triage_figure(self.found, drawn, **how)}


@study
def triage(
    runs: "Runs | Trace | str | Path",
    arm: "ArmFile | None" = None,
    options: TriageOptions = DEFAULT,
    *,
    path: "Log | str | Path | None" = None,
) -> TriageResult:
    """Find the causes of a moving arm's vibration by how its frequencies [Hz] move; needs no identified arm.

    Args:
        runs: the table of runs, see `ident source --init`, or its file; with `path` a trace, or its file.
        arm: the arm, its stiffnesses within 10 %; by default arm.toml in the folder of the table.
        options: the multiples of a pulley's frequency.
        path: the joint path of a trace without a table: a log, or its file; its clock is found unless `delay` is given.

    Raises:
        InputError: a file is wrong, or does not match the arm.
        ModelError: the arm collapses.
    """
    from ident.measure.runs import Runs, runs_of
    from ident.measure.trace import Trace, read_trace
    from ident.studies.cause.run_problem import arm_beside, as_runs, with_clocks, with_notes
    from ident.vibrate.triage import triage as found

    if path is None:
        require(options.delay is None, "delay", "it without a path", "a trace and its path", "state it in the table")
        runs, log = as_runs(runs.path if isinstance(runs, Trace) else runs, options.columns), None
        arm = arm or arm_beside(runs, options.soft_base)
    else:
        file = runs.path if isinstance(runs, Runs) else runs
        trace = file if isinstance(file, Trace) else read_trace(file, options.columns)
        arm = arm or arm_beside(trace, options.soft_base)
        log = as_log(path, arm.arm, options.columns)
        runs = runs_of(trace, log, options.delay)
    described = with_numbers(arm.arm, None, options.set)
    runs = with_notes(described, with_clocks(described, runs))
    causes = found(described, moving_traces(described, runs), orders=options.orders)
    return TriageResult(causes, runs, arm, options, log)


def moving_traces(arm: "Arm", table: "Runs") -> "list[MovingTrace]":
    """Return the traces of a table, each with its motion."""
    from ident.studies.cause.run_problem import CLOCK, problem_of
    from ident.vibrate.source_problem import Prior
    from ident.vibrate.triage import MovingTrace

    problem = problem_of(arm, table, table.names, Prior.of(arm, {}), CLOCK)
    runs = [problem.runs[each.run] for each in problem.channels]
    each = zip(problem.channels, runs, strict=True)
    return [MovingTrace(own.time, own.values, run.motion, run.loads) for own, run in each]
