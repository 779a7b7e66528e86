"""Balance the joint drives' rotors by a result of `ident source`: masses, places, and the remaining vibration."""

import hashlib
from collections.abc import Collection, Mapping
from dataclasses import field, replace
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from ident.errors import InputError, Problem, refusal
from ident.studies.door import DEFAULT, study
from ident.studies.motion_options import MovingOptions, basis_of
from ident.studies.options import option
from ident.studies.reading import EACH
from ident.studies.result import Result, alias, input_of
from ident.studies.saved import files_of, load, reading
from ident.studies.shared import as_file, as_log
from ident.text import LARGEST_BINARY, did_you_mean, one_line, read_bytes, study_of

if TYPE_CHECKING:
    from jaxtyping import Float
    from numpy import ndarray

    from ident.arm.arm import Arm
    from ident.arm.parts import Drive
    from ident.description.file import ArmFile
    from ident.identify.values import Values
    from ident.measure import Log
    from ident.studies.cause.source import SourceResult
    from ident.studies.cure.balance_study import Balance, Pulley

BY_DRIVE = ("radius", "height", "holes", "hole_angle", "most", "rotor")
"""Options that may differ between drives."""
MOST = 50.0
"""Largest mass [g] at one place of a pulley; assumed."""
FEWEST = 3
"""Holes around a pulley from which two neighbours can realise any correction."""
FEWEST_DRAWS = 20
"""Draws from which a 95 % interval is meaningful."""


class BalanceOptions(MovingOptions):
    """Options of `ident.balance`: where masses can be mounted, and the motion for which their effect is predicted."""

    radius: dict[str, float] = option(
        {},
        "radius [mm] at which masses sit, as 40 for all drives, drive2=40 for one; default: the largest pulley's",
        **EACH,
    )
    height: dict[str, float] = option({}, "height [mm] of masses above the bushing; default: the rotor's", **EACH)
    holes: dict[str, float] = option({}, "holes around the pulley, at that radius; default: any angle will do", **EACH)
    hole_angle: dict[str, float] = option({}, "angle [deg] of hole 1, counted as the report does; default 0", **EACH)
    most: dict[str, float] = option({}, f"mass [g] at one place at most; default {MOST:g} (assumed)", **EACH)
    rotor: dict[str, float] = option({}, "mass [kg] of the rotor, for its grade; default: its eccentric mass", **EACH)
    dwell: float = option(2.0, "time [s] that the arm is held at the end", low=0.0, high=3600.0)
    draws: int = option(400, "draws of what was identified", low=FEWEST_DRAWS, high=10_000)

    def problems(self) -> list[Problem]:
        """Refuse impossible sizes, and too few holes for a mass at any angle."""
        sizes, above = ("radius", "most", "rotor"), "a number above 0"
        bad = [(name, x, above) for name in sizes for x in getattr(self, name).values() if not 0 < x < 1e6]
        pattern = f"a whole number of at least {FEWEST}, so that two neighbouring holes hold a mass at any angle"
        bad += [("holes", x, pattern) for x in self.holes.values() if not FEWEST <= x <= 1000 or x != int(x)]
        return [*super().problems(), *(Problem(name, f"{x:g}", expected, "correct it") for name, x, expected in bad)]

    def check_drives(self, drives: Collection[str]) -> None:
        """Refuse options for a drive that the arm does not have."""
        for name in BY_DRIVE:
            for given in getattr(self, name):
                if given and given not in drives:
                    remedy = did_you_mean(given, tuple(drives), "name a drive of the arm")
                    raise refusal(name, f"the drive {one_line(given)}", f"one of {', '.join(drives)}", remedy)

    def of_drive(self, name: str, drive: str, default: float | None = None) -> Any:
        """Return the value of an option for a drive."""
        given: Mapping[str, float] = getattr(self, name)
        return given.get(drive, given.get("", default))


class BalanceResult(Result):
    """Masses that balance the drives' rotors, and the remaining vibration.

    The table has a row for each mass: drive, mass [kg] and its standard deviation, radius [m], angle [rad], hole, and
    standard deviations of the whole correction of the drive; a rotor without correction has one row without these. The
    figure shows the vibration before and after, and each rotor with its imbalance and its masses.

    Attributes:
        found: rotors, corrections, vibration before and after.
        values: the identified numbers.
        options: the options of the call.
        left: remaining share of the vibration's peak [-]: median and 95 % interval.
        imbalance_left: the same for the vibration from imbalance [-].
    """

    found: "Balance"
    values: "Values"
    options: BalanceOptions = field(default_factory=BalanceOptions)

    subject = "found.basis.name"
    made_from = ("found.basis.arm_file as arm", "values as source", "found.basis.log as path")
    summarised = ("left", "imbalance_left")

    left: ClassVar['Float[ndarray, "3"]'] = alias("found.left")
    imbalance_left: ClassVar['Float[ndarray, "3"]'] = alias("found.imbalance_left")

    @classmethod
    def arguments(cls, inputs: Mapping[str, Path], summary: Mapping[str, Any]) -> dict[str, Any]:
        """Return the result file of `ident source`, which names its arm, and the path."""
        return {name: path for name, path in inputs.items() if name != "arm"}

    @property
    def doubtful(self) -> bool:
        """Whether trial masses contradict each other."""
        return any(each.calibration.state == "contradicting" for each in self.found.rotors)


@study
def balance(
    source: "SourceResult | str | Path", options: BalanceOptions = DEFAULT, *, path: "Log | str | Path | None" = None
) -> BalanceResult:
    """Balance the drives' rotors: masses [kg], angles [rad], and the remaining vibration [m].

    Args:
        source: a result of `ident.source`, or its file.
        options: where masses can be mounted, the motion.
        path: a joint path to follow instead of the stroke, or its file.

    Raises:
        InputError: no such result, or an unusable one; a drive without a radius; a motion beyond its limits.
        ModelError: the arm collapses.
    """
    from ident.arm.multibody import IMBALANCE
    from ident.studies.cure.balance_study import balanced, rotor_of, tried_in

    arm, record, values = _taken(source, options)
    options = replace(options, set=_numbers(record, options.set))
    drives = {drive.name: drive for drive in arm.arm.drives}
    options.check_drives(drives)
    log = None if path is None else as_log(path, arm.arm, options.columns)
    basis = basis_of(arm, options, path=log, posterior=values)
    pulleys = {name: pulley_of(drive, basis.arm, options) for name, drive in drives.items()}
    with reading(record):
        rows = [row for row in record.table() if row["kind"] == IMBALANCE]
        tried = [tried_in(each, options.draws) for each in record.trials]
        if not any(row["told"] for row in rows):
            where, expected = one_line(values.path or "source"), "one at least"
            raise refusal(where, "no imbalance that is told", expected, "measure more runs, see ident show of it")
        rotors = [
            rotor_of(basis, drives[row["drive"]], pulleys[row["drive"]], record.parameters, row, record.phases, tried)
            for row in rows
        ]
    return BalanceResult(balanced(basis, rotors, tried, record.parameters), values, options)


def _numbers(record: Any, asked: Mapping[str, float]) -> dict[str, float]:
    """Return the set numbers: those under which the sources were identified, and those of the options."""
    bad = []
    before = {path: x for path, x in record.options.set.items() if path not in record.parameters}
    for path, x in asked.items():
        if path in record.parameters:
            remedy = "change the table of runs, or drop it"
            bad.append(Problem("set", path, "a number that ident source has not identified", remedy))
        elif before.get(path, x) != x:
            remedy = "drop it, or identify again with this value"
            bad.append(Problem("set", f"{path}={x:g} (SI)", f"{before[path]:g}, as ident source was given", remedy))
    if bad:
        raise InputError(bad)
    return {**before, **asked}


def _taken(source: "SourceResult | str | Path", options: BalanceOptions) -> "tuple[ArmFile, Any, Values]":
    """Return the arm of a result of `ident source`, the result, and the first of its draws."""
    from ident.arm.multibody import IMBALANCE
    from ident.identify.values import Values
    from ident.studies.result_values import UNSOUND, draws_of

    expected, remedy = "a result of ident source (.source.json)", "give the file that ident source wrote"
    path, sha256 = "", ""
    record: Any = source
    if isinstance(source, Result) and study_of(source.form) == "source":
        arm, usable = record.arm_file, record.study.usable
    elif isinstance(source, str | Path):
        record = load(source)
        if record.study != "source" or not {"phases", "trials"} <= {*record.summary}:
            got = f"a result of {record.study}" + " of before balancing" * (record.study == "source")
            raise refusal(one_line(str(source)), got, expected, remedy)
        path, sha256 = str(source), hashlib.sha256(read_bytes(source, expected, LARGEST_BINARY)).hexdigest()
        of_arm = {name: each for name, each in record.inputs.items() if input_of(name) == "arm"}
        with reading(record):
            arm = as_file(files_of(of_arm, Path(source).parent).paths["arm"], options.soft_base)
            usable = record.record["verdict"] not in UNSOUND
    else:
        raise refusal("source", f"a {type(source).__name__}", expected, remedy)
    with reading(record):
        lacking = sorted({row["drive"] for row in record.table() if row["kind"] == IMBALANCE} - {*record.phases})
        drawn = {names: x[: options.draws] for names, x in draws_of(record.draws).items()}
    if lacking:
        where = one_line(path or "source")
        raise refusal(where, f"no phases of {', '.join(lacking)}", "those of each drive", remedy)
    if not usable:
        got, remedy = "runs that are not usable", "see ident show of that file, and correct its table of runs"
        raise refusal(one_line(path or "source"), got, "sources that are identified", remedy)
    return arm, record, Values.of_arm(drawn, arm.arm, path, sha256)


def pulley_of(drive: "Drive", arm: "Arm", options: BalanceOptions) -> "Pulley":
    """Return where masses can be mounted on a drive.

    Raises:
        InputError: no radius is given, and the drive has no pulley with a belt.
    """
    from ident.studies.cure.balance_study import Pulley

    sizes = [float(belt.driver_radius) for belt in arm.belts if belt.driver == drive.joint]
    sizes += [float(belt.driven_radius) for belt in arm.belts if belt.driven == drive.joint]
    radius = options.of_drive("radius", drive.name, 1e3 * max(sizes) if sizes else None)
    if radius is None:
        remedy = f"give one, as {drive.name}=40"
        raise refusal("radius", f"no pulley's radius for {drive.name}", "one", remedy)
    mass = float(drive.eccentric_mass)
    return Pulley(
        radius / 1e3,
        options.of_drive("height", drive.name, 1e3 * float(drive.height)) / 1e3,
        options.of_drive("most", drive.name, MOST) / 1e3,
        options.of_drive("rotor", drive.name, mass or 1.0),
        int(options.of_drive("holes", drive.name, 0)),
        radians(options.of_drive("hole_angle", drive.name, 0.0)),
        "" if options.of_drive("rotor", drive.name) else "eccentric mass, assumed" if mass else "assumed",
    )
