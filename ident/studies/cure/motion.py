"""Choose the speed of the arm along its path so that it vibrates little: no part is changed."""

from collections.abc import Mapping
from dataclasses import field
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from ident.errors import Problem
from ident.studies.door import DEFAULT, study
from ident.studies.motion_options import LIMIT, HeldMotionOptions, basis_of
from ident.studies.options import option
from ident.studies.result import Progress, Result, alias, silent
from ident.studies.values import drawn_groups

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ident.description.file import ArmFile
    from ident.identify.values import Values
    from ident.measure import Log
    from ident.studies.cure.motion_study import MotionStudy
    from ident.studies.stiffness.sample import SampleResult


class MotionOptions(HeldMotionOptions):
    """Options of `ident.motion`: the present motion, the limit, and the resolution of the speed along the path."""

    speed: float | None = option(
        None,
        "percent of full speed of the motion as it is, default 10; the stroke never goes faster; "
        "with --path of its own speed, default 100",
        above=0.0,
        high=1000.0,
    )
    limit: float | None = option(None, "vibration [mm] never to exceed; default 0.5, or none with --settled", above=0.0)
    settled: float | None = option(None, "vibration [mm] below which the end must stay as soon as possible", above=0.0)
    direction: str | None = option(None, "direction that must settle; default: each", choices=("x", "y", "z"))
    time: float | None = option(
        None, "time [s] in which to vibrate least; default: the least time that keeps the limit", above=0.0
    )
    segments: int = option(12, "segments of the path; at their ends the speed is chosen", low=4, high=30)
    rate: float = option(250.0, "rows a second of the joint path that is written", low=10.0, high=10_000.0)
    draws: int = option(50, "draws of the posterior by which motions are judged", low=1, high=1000)
    fresh: int = option(200, "other draws, by which the proposed motion is verified", low=0, high=100_000)
    seed: int = option(0, "seed of the choice of draws", low=0, high=1e18)

    @property
    def hold(self) -> float:
        """Zero [s]: the study adds the dwell, not the motion."""
        return 0.0

    def problems(self) -> list[Problem]:
        """Refuse a direction without a value to settle to, and a dwell too short to know a decay."""
        problems = super().problems()
        if self.settled is None:
            alone = Problem("direction", "it without settled", "a value to settle to", "give `settled`")
            return [*problems, *([alone] if self.direction else [])]
        from ident.vibrate.settling import WATCHED  # loads the engine: only to settle

        short = Problem("dwell", f"{self.dwell:g} s with settled", f"at least {WATCHED:g} s", "hold the arm longer")
        return [*problems, *([short] if self.dwell < WATCHED else [])]


class MotionResult(Result):
    """Motions along the path of an arm, and the one that keeps the limit in the least time.

    The table has a row for each motion: time [s], vibration [m], probability of keeping the limit [-], acceleration.

    Attributes:
        motions: the present motion, the others, the speeds along the path, and their verification.
        options: the options of the call.
        time: time from start to arrival with the speeds along the path [s].
        vibration: largest vibration with these speeds and the worst phases, by the exact equations [m].
    """

    motions: "MotionStudy"
    options: MotionOptions = field(default_factory=MotionOptions)

    subject = "motions.basis.name"
    made_from = ("motions.basis.sources",)
    summarised = ("time", "vibration", "keeps", "ready")

    time: ClassVar[float] = alias("motions.schedule.duration")
    vibration: ClassVar[float] = alias("motions.verification.largest")

    @property
    def keeps(self) -> float | None:
        """Probability that these speeds keep the limit, by fresh draws [-]; None without a posterior."""
        kept = self.motions.verification.keeps
        return None if kept is None else kept.share

    @property
    def ready(self) -> float | None:
        """Time [s] from the start within which most draws of the recommended motion have settled; None if not asked."""
        best = self.motions.recommended
        return None if best is None or best.settled is None else best.ready

    @property
    def short(self) -> bool:
        """Whether no motion keeps the limit."""
        return self.motions.recommended is None

    def _figures(self) -> "dict[str, Figure]":
        """Return speed and vibration along the path; the residual vibration of input shapers (`shapers`) if tried."""
        from ident.studies.cure.motion_figure import motion_figure, shaper_figure

        shaped = any(each.kind == "shaper" for each in self.motions.candidates)
        return {"": motion_figure(self.motions)} | ({"shapers": shaper_figure(self.motions)} if shaped else {})

    def _write(self, path: Path, head: Mapping[str, Any]) -> tuple[Path, ...]:
        from ident.studies.cure.motion_report import write_path

        csv = self._beside(path, ".csv")
        write_path(self.motions, self.options.rate, head, csv)
        return csv, *super()._write(path, head)


@study
def motion(
    arm: "ArmFile",
    options: MotionOptions = DEFAULT,
    *,
    path: "Log | None" = None,
    fit: "Values | None" = None,
    posterior: "Values | SampleResult | str | Path | None" = None,
    progress: Progress = silent,
) -> MotionResult:
    """Choose the speed along the stroke, or a path: a limit of vibration kept, or the end settled, in the least time.

    Compared with the present motion, slower ones, other profiles and, where the motion itself excites the arm, input
    shapers. The path stays; the proposal is verified by the exact equations and by fresh draws.

    Args:
        arm: the arm; it has a stroke, or its joints have limits of speed, acceleration and jerk.
        options: the present motion, the limit, and the resolution of the speed.
        path: a joint path to follow instead of the stroke: a log, or its file; it starts and ends at rest.
        fit: fitted values for the arm: a result, or its file.
        posterior: draws that keep the limit with 95 % probability: a sample, or its file.
        progress: shows progress over the steps of the search.

    Raises:
        InputError: an arm without excitation; a time out of reach; a path with a corner, or that starts moving.
        ModelError: the arm collapses.
    """
    from ident.studies.cure.motion_study import Wanted, motions, scheduling_of
    from ident.vibrate.simulate import refuse_jumps

    judging, fresh = drawn_groups(posterior, arm, options.draws, options.fresh, options.seed, options)
    basis = basis_of(arm, options, path=path, fit=fit, posterior=judging)
    refuse_jumps(basis.arm, basis.motion)
    limit, settled = options.limit or (LIMIT if options.settled is None else inf), None
    ways = tuple(k for k in range(3) if options.direction in (None, "xyz"[k]))
    if options.settled is not None:
        basis, settled = basis.with_unknown_damping(options.draws), options.settled / 1e3
    stroke = None if path else basis.arm.stroke
    found = motions(
        basis,
        scheduling_of(basis, stroke, segments=options.segments, dwell=options.dwell, retract=options.retract),
        wanted=Wanted(limit / 1e3, settled, ways),
        time=options.time,
        fresh=basis.drawn(fresh, seed=1, count=options.fresh if settled and not judging else 0),
        progress=progress("speeds along the path"),
    )
    return MotionResult(found, options)
