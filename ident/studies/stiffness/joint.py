"""Identify stiffness, damping, friction, backlash and delay of a joint from logs of its motor and its link."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ident.errors import Problem, refuse, require
from ident.studies.door import DEFAULT, study
from ident.studies.options import option
from ident.studies.reading import EACH
from ident.studies.result import Result
from ident.studies.shared import SamplesOptions
from ident.text import did_you_mean, one_line

if TYPE_CHECKING:
    from ident.identify.joint import JointTwist
    from ident.measure.joint_log import JointLog

NAMED = 3
"""Largest number of logs in the name of a result."""
ALIKE = 0.99
"""Correlation of motor and link from which one follows the other."""


class JointOptions(SamplesOptions):
    """Options of `ident.joint`: known data of the joints, and how they were tested."""

    ratio: dict[str, float] = option(
        {}, "ratio of a drive whose motor is logged at its own shaft, as joint1=121, or 121 for all; default 1", **EACH
    )
    inertia: dict[str, float] = option(
        {}, "inertia [kg m^2] of the motor at its shaft, at the joint without a ratio; default: unknown", **EACH
    )
    alone: bool = option(False, "no other joint moved: the torque tells friction by itself")
    locked: bool = option(False, "the links were clamped: no column of a link is needed")
    centred: bool = option(False, "the links' encoders have no eccentricity, which else is fitted")
    upto: float = option(20.0, "frequency [Hz] up to which the logs count", above=0.0)

    def problems(self) -> list[Problem]:
        """Refuse impossible ratios and inertias."""
        numbers = [(name, x) for name in ("ratio", "inertia") for x in getattr(self, name).values()]
        bad = [Problem(name, f"{x:g}", "a number above 0", "correct it") for name, x in numbers if not 0 < x < 1e9]
        if self.alone and self.locked:
            bad.append(Problem("alone", "it beside `locked`", "one of them", "a clamped joint needs no `alone`"))
        return bad


class JointResult(Result):
    """Quantities of joints, identified from their logs.

    The table has a row for each joint and quantity: value with its 95 % interval [SI], and whether it is determined.
    The figure shows the torque of each joint over its twist.

    Attributes:
        joints: identified quantities of each joint.
        logs: the logs, converted to joint side.
        options: the options of the call.
    """

    joints: "tuple[JointTwist, ...]"
    logs: "tuple[JointLog, ...]"
    options: JointOptions = field(default_factory=JointOptions)

    shown = ("joints", "logs")
    drawn = listed = ("joints",)

    @classmethod
    def arguments(cls, inputs: Mapping[str, Path], summary: Mapping[str, Any]) -> dict[str, Any]:
        """Return the logs."""
        return {"logs": tuple(inputs.values())}

    @property
    def name(self) -> str:
        """Names of the logs, and the study."""
        return f"{'-'.join(Path(log.path).stem for log in self.logs[:NAMED])}.joint"

    @property
    def doubtful(self) -> bool:
        """Whether logs contradict each other."""
        return any(each.disagree for each in self.joints)

    def _inputs(self) -> Mapping[str, Any]:
        return {f"log{i}": log for i, log in enumerate(self.logs, 1)}


@study
def joint(
    logs: "JointLog | str | Path | Sequence[JointLog | str | Path]", options: JointOptions = DEFAULT
) -> JointResult:
    """Identify stiffness, damping, friction, backlash and delay of joints from logs of their motors and links.

    Args:
        logs: one or several logs of the same joints, or their files.
        options: known data of the joints, and how they were tested.

    Raises:
        InputError: a wrong log, or with other columns than the first; an option names an unknown joint.
    """
    from ident.identify.joint import TwistSetting, joint_twist
    from ident.measure.joint_log import JointLog, read_joint_log

    given = [logs] if isinstance(logs, JointLog | str | Path) else [*logs]
    require(given, "logs", "none", "at least one log", "give its file")
    how: Any = {"locked": options.locked, "columns": options.columns}
    read = [each if isinstance(each, JointLog) else read_joint_log(each, **how) for each in given]
    names, channels = [*read[0].columns], {name: {*columns} for name, columns in read[0].columns.items()}
    expected, remedy = f"those of {one_line(read[0].path)}", "give logs of the same joints"
    problems = [
        Problem(one_line(log.path), "other columns", expected, remedy)
        for log in read
        if {name: {*columns} for name, columns in log.columns.items()} != channels
    ]
    hashes = [log.sha256 for log in read]
    for k, log in enumerate(read):
        if log.sha256 and log.sha256 in hashes[:k]:  # counted twice, it would halve the variance
            got = f"the log {one_line(read[hashes.index(log.sha256)].path)} again"
            problems.append(Problem(one_line(log.path), got, "each log once", "drop one of them"))
    for option_ in ("ratio", "inertia"):
        for name in getattr(options, option_):
            if name and name not in names:
                expected = f"one of {', '.join(names)}"
                problems.append(Problem(option_, one_line(name), expected, did_you_mean(name, names, "name a joint")))
    refuse(problems)
    ratios = {name: options.ratio.get(name, options.ratio.get("", 1.0)) for name in names}
    counted = tuple(replace(log, columns={n: _at_joint(log.columns[n], ratios[n]) for n in names}) for log in read)
    refuse(each for log in counted for each in _unlike(log))
    found = []
    for name in names:
        inertia = options.inertia.get(name, options.inertia.get("", 0.0)) * ratios[name] ** 2 or None
        setting = TwistSetting(inertia, options.alone, options.locked, options.centred, options.upto)
        found.append(joint_twist(name, counted, setting))
    return JointResult(tuple(found), counted, options)


def _unlike(log: "JointLog") -> Iterator[Problem]:
    """Yield links identical to their motors, and motors that follow their links with another amplitude or sign."""
    import numpy as np

    for name, columns in log.columns.items():
        if "link" not in columns:
            continue
        if np.array_equal(columns["motor"], columns["link"]):
            got, remedy = "the motor's angle throughout", "give the column of the link's own encoder"
            yield Problem(one_line(log.path), got, "an angle measured at the link", remedy, f"{name}.link")
        (own, both), (_, link) = np.cov(columns["motor"], columns["link"])
        if both**2 > ALIKE**2 * own * link and not own < 2 * both < 4 * own:
            got, expected = f"{own / both:.3g} times the link's angle", "about the link's angle, counted at the joint"
            remedy = "give its `ratio`, or correct its unit or its sign in the file"
            yield Problem(one_line(log.path), got, expected, remedy, f"{name}.motor")


def _at_joint(columns: Mapping[str, Any], ratio: float) -> dict[str, Any]:
    """Return the columns of a joint, with those of the motor converted to joint side."""
    factors = {"motor": 1 / ratio, "torque": ratio}
    return {channel: values * factors.get(channel, 1.0) for channel, values in columns.items()}
