"""Shared by the studies that move an arm: options of the motion, and the basis of a simulation."""

from collections.abc import Mapping
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING

from ident.errors import Problem, refusal
from ident.studies import reading
from ident.studies.options import STROKE_PROFILES, option
from ident.studies.shared import ArmOptions, SamplesOptions, with_numbers

if TYPE_CHECKING:
    from ident.arm.arm import Arm
    from ident.description.file import ArmFile
    from ident.identify.values import Values
    from ident.measure import Log
    from ident.studies.scenario import Basis, Unknowns
    from ident.vibrate.motion import Motion

STROKE = "add a [stroke] section to the arm file (example: `ident new scara`), or give a joint path (`path`)"

SLOWEST = 1e-3
"""Lowest speed [%]."""
LIMIT = 0.5
"""Largest accepted vibration [mm] where no limit is given; assumed."""
PHASES = ("unknown", "file")
"""Choices for the phases of the rotating unbalance."""


class MovingOptions(ArmOptions, SamplesOptions):
    """The motion of the arm, its load, and its changed numbers."""

    speed: float | None = option(
        None, "percent of full speed, default 10; with --path of its own speed, default 100", above=0.0, high=1000.0
    )
    profile: str | None = option(
        None, "how the stroke's speed rises and falls; the arm file's by default", choices=STROKE_PROFILES
    )
    retract: bool = option(False, "from unfolded to folded")
    smoothing: float = option(0.0, "noise of that path, rms [deg]", low=0.0, high=90.0)

    @property
    def hold(self) -> float:
        """Dwell at the end [s]: the option `dwell`, in studies that have it."""
        dwell: float = getattr(self, "dwell", 0.0)
        return dwell

    def problems(self) -> list[Problem]:
        """Refuse a motion that takes for ever."""
        slow = self.speed is not None and self.speed < SLOWEST
        problem = Problem("speed", f"{self.speed}", f"at least {SLOWEST:g}", "100 is full speed, 10 a tenth")
        return [*super().problems(), *([problem] if slow else [])]

    def unknown(self, arm: "Arm", origins: "Mapping[str, str]") -> "tuple[Arm, Unknowns]":
        """Return the arm, and the relevant unknowns of its excitation."""
        from ident.studies.scenario import Unknowns

        return arm, Unknowns()


class HeldMotionOptions(MovingOptions):
    """The same, and the dwell at the end."""

    dwell: float = option(2.0, "time [s] that the arm is held at the end", low=0.0, high=3600.0)
    phases: str = option(
        "unknown",
        "phases of the rotating unbalance: unknown (but for those set, measured, or of a datasheet or paper) or file",
        choices=PHASES,
    )
    errors: tuple[float, float] | None = option(
        None,
        "transmission error of each drive at twice a turn, LOW:HIGH [arc seconds, peak to peak], as 30:60; "
        "default: the arm file's",
        read=reading.peak_to_peak,
    )

    def unknown(self, arm: "Arm", origins: "Mapping[str, str]") -> "tuple[Arm, Unknowns]":
        """Return the arm with the largest transmission errors, and the unknowns of its excitation."""
        from ident.studies.scenario import unknowns

        return unknowns(arm, origins, self.set, errors=self.errors, phases=self.phases == "unknown")


def basis_of(
    arm: "ArmFile",
    options: MovingOptions,
    *,
    path: "Log | None" = None,
    fit: "Values | None" = None,
    posterior: "Values | None" = None,
) -> "Basis":
    """Return the basis of a simulation: the arm with its fitted values, and its motion.

    Args:
        arm: the arm.
        options: the motion, the load and the set numbers.
        path: a joint path to follow instead of the stroke.
        fit: fitted values for the arm.
        posterior: draws; the arm takes their medians, unless it has fitted values.
    """
    from ident.measure import Load
    from ident.studies.scenario import IDENTIFIED, Basis

    described = with_numbers(arm.arm, fit or posterior, options.set)
    _check(options, path is not None)
    motion, percent = _motion(described, options, path)
    name = f"{arm.name}.{_name(described, options, path, percent)}"
    load = Load.parse(options.load)
    taken = [path for values in (fit, posterior) if values for path in values.values]
    described, unknown = options.unknown(described, {**arm.origins, **dict.fromkeys(taken, IDENTIFIED)})
    basis = Basis(arm, described, motion, percent, load, path, fit, posterior, options.set, name, unknown)
    if posterior and not basis.draws:
        raise refusal("set", "every number of the posterior", "one that is drawn", "drop one of them")
    return basis


def _motion(arm: "Arm", options: MovingOptions, log: "Log | None") -> "tuple[Motion, float]":
    """Return the stroke, or the path of a log, within the joint limits, and its speed in percent."""
    import numpy as np

    from ident.vibrate.motion import beyond_limits, stroke

    percent = options.speed if options.speed is not None else 10.0 if log is None else 100.0
    if log is not None:
        from ident.vibrate.replay import replay  # SciPy's splines take half a second to import, a stroke has none

        angles = np.stack(list(log.angles.values()))
        motion = replay(log.time, angles, smoothing=radians(options.smoothing), name=Path(log.path).name, arm=arm)
        motion = motion if options.speed is None else motion.at_speed(percent)
        motion = motion.dwell(options.hold)
    elif arm.stroke is not None:
        profile, retract = options.profile, options.retract
        motion = stroke(arm.stroke, percent=percent, profile=profile, retract=retract, dwell=options.hold)
    else:
        raise refusal(arm.name, "no motion defined", "a stroke or a joint path", STROKE)
    beyond_limits(arm, motion)
    return motion, percent


def _check(options: MovingOptions, replayed: bool) -> None:
    """Refuse contradictory options."""
    if replayed and (options.profile or options.retract):
        name = "profile" if options.profile else "retract"
        raise refusal(name, "it beside `path`", "one of them", "it shapes the stroke: drop one")
    if not replayed and options.smoothing:
        raise refusal("smoothing", "it without `path`", "a path to smooth", "drop it, or give `path`")


def _name(arm: "Arm", options: MovingOptions, log: "Log | None", percent: float) -> str:
    """Return the base name of a motion's files: motion, percent."""
    if log is not None:
        return f"{Path(log.path).stem}{'' if options.speed is None else f'-{options.speed:g}'}"
    own = arm.stroke.profile if arm.stroke else None
    form = "" if options.profile in (None, own) else f"-{options.profile}"
    return f"{'retract' if options.retract else 'extend'}-{percent:g}{form}"
