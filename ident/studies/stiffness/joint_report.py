"""The report of joints from their own logs, and its table."""

from collections.abc import Iterator, Sequence
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ident.report.report import Finding, Report, Section, Table, Verdict, by_head, cut, written
from ident.report.words import counted, percent, some, span
from ident.units import stiffness_unit

if TYPE_CHECKING:
    from ident.identify.joint import JointNumber, JointTwist
    from ident.measure.joint_log import JointLog

HEADS = {
    "stiffness": "stiffness",
    "damping": "damping [N m s/rad]",
    "coulomb": "Coulomb friction [N m]",
    "viscous": "viscous friction [N m s/rad]",
    "backlash": "backlash [mrad]",
    "delay": "delay [ms]",
}
"""Column heads of the quantities."""
SIZES = {"backlash": 1e3, "delay": 1e3}
"""Factors from SI to the unit of a column head, where it differs."""


def joint_sections(joints: "Sequence[JointTwist]", logs: "Sequence[JointLog]") -> Report:
    """Return the report of joints."""
    names = some([Path(log.path).name or "a log" for log in logs])
    return Report(
        f"{counted(len(joints), 'joint')} from {counted(len(logs), 'log')} of motor and link ({names})",
        _verdict(joints),
        (_table(joints),),
        tuple(_findings(joints, logs)),
        details=tuple(_details(joints, logs)),
    )


def _verdict(joints: "Sequence[JointTwist]") -> Verdict:
    told = [each for each in joints if each.told("stiffness")]
    if off := [each.name for each in joints if each.disagree]:
        return Verdict("LOGS DISAGREE", f"On the stiffness of {some(off)} the logs contradict each other.", "bad")
    if not told:
        return Verdict("CANNOT TELL", "No stiffness is known within half of its value.", "caution")
    worst = max(told, key=_width)
    reason = f"The least certain stiffness, of {worst.name}, is known within {percent(_width(worst))}."
    if loose := [each.name for each in told if each.loose]:
        reason += f" Any backlash of {some(loose)} counts as compliance."
    if len(told) == len(joints):
        return Verdict("IDENTIFIED", reason, "caution" if loose else "good")
    return Verdict(f"PARTLY {len(told)} OF {len(joints)}", reason, "caution")


def _width(joint: "JointTwist") -> float:
    return _half(joint.numbers["stiffness"]) / joint.numbers["stiffness"].value


def _half(number: "JointNumber") -> float:
    return max(number.high - number.value, number.value - number.low)


def _size(quantity: str) -> float:
    return 1 / stiffness_unit()[0] if quantity == "stiffness" else SIZES.get(quantity, 1.0)


def _head(quantity: str) -> str:
    return f"stiffness [{stiffness_unit()[1]}]" if quantity == "stiffness" else HEADS[quantity]


def _table(joints: "Sequence[JointTwist]") -> Table:
    shown = [quantity for quantity in HEADS if any(each.told(quantity) for each in joints)]
    hidden = [HEADS[quantity].partition(" [")[0] for quantity in HEADS if quantity not in shown]

    def cell(joint: "JointTwist", quantity: str) -> str:
        if not joint.told(quantity):
            return "-"
        number = joint.numbers[quantity]
        share = 100 * _half(number) / abs(number.value)
        return f"{written(_size(quantity) * number.value, '#.3g')} ±{share:.2g}%"

    rows = ((each.name, *(cell(each, quantity) for quantity in shown)) for each in joints)
    both = "" if joints[0].parted else ", less viscous friction / stiffness"
    both += "; damping: plus viscous friction" if both and "damping" in shown else ""
    lag = f" Delay: of the link's channel{both}."
    if joints[0].setting.locked:
        lag = " Friction of a clamped joint has its damping in it."
    nowhere = f"; of no joint: {', '.join(hidden)}" if hidden else ""
    return by_head(("Joint", *map(_head, shown)), rows, note=f"-: cannot be told{nowhere}. ±: 95 %.{lag}")


def _findings(joints: "Sequence[JointTwist]", logs: "Sequence[JointLog]") -> Iterator[Finding]:
    for each in joints:
        if each.disagree:
            sizes = (_size("stiffness") * alone.numbers["stiffness"].value for alone in each.alone)
            values = ", ".join(written(size, ".2g") for size in sizes)
            remedy = "compare what differs: posture, load, clocks; the encoder's error"
            yield Finding(f"{each.name}: one log at a time the stiffness is {values}", remedy)
    if not joints[0].parted:
        remedy = "log joints that move alone (--alone), or a column of the torque in the joint (.load)"
        also = "; backlash counts as compliance" if any(each.loose for each in joints) else ""
        yield Finding(f"Viscous friction and delay cannot be told apart{also}", remedy)
    columns = logs[0].columns
    if lacking := [each.name for each in joints if "load" not in columns[each.name] and each.setting.inertia is None]:
        yield Finding(f"Motor inertia of {some(lacking)} unknown: fitted, at a loss of certainty", "give --inertia")
    hidden = [each for each in joints if not each.told("stiffness") and not each.disagree]
    if below := [each.name for each in hidden if each.compliance.high < 0]:
        remedy = "count torques positive the way that angles grow; check inertia; are motor and link swapped?"
        yield Finding(f"The stiffness of {some(below)} comes out below 0: the twist is against the torque", remedy)
    if quiet := [each.name for each in hidden if each.name not in below]:
        remedy = "log faster reversals, or a larger load on the joint"
        yield Finding(f"The stiffness of {some(quiet)} cannot be told: the torque in it varies too little", remedy)


def _numbers(number: "JointNumber", size: float) -> tuple[float, str]:
    return size * number.value, span(size * number.low, size * number.high)


def _details(joints: "Sequence[JointTwist]", logs: "Sequence[JointLog]") -> Iterator[Section]:
    rows = [
        (each.name, _head(quantity), *_numbers(number, _size(quantity)))
        for each in joints
        for quantity, number in each.numbers.items()
        if not isnan(number.value)
    ]
    heads = "Joint", "quantity", "value|.3g", "95 % interval"
    yield Section("All estimates, told or not", (by_head(heads, rows),))
    parts = []
    for each in joints:
        numbers = [(f"without {word}", number) for word, number in each.without.items()]
        numbers += [(Path(x.path).name, own.numbers["stiffness"]) for x, own in zip(logs, each.alone, strict=False)]
        parts += [(each.name, cut(name, 40), *_numbers(x, _size("stiffness"))) for name, x in numbers]
    heads = "Joint", "of", f"{_head('stiffness')}|.3g", "95 % interval"
    yield Section("Stiffness if the model lacked an effect, and of one log at a time", (by_head(heads, parts),))
    left = ", ".join(f"{each.name} {1e3 * float(each.residual.std()):.2g} mrad" for each in joints)
    lag = "Damping is counted with the torque on the motor angle's clock: a lag of 1 ms counts as stiffness times 1 ms."
    yield Section("Residual", (f"Root mean square: {left}.", lag))


def joint_rows(joints: "Sequence[JointTwist]") -> list[dict[str, Any]]:
    """Return a row for each joint and quantity [SI]; NaN for quantities without information in the logs."""
    return [
        {"joint": each.name, "quantity": quantity, "value": number.value, "low": number.low, "high": number.high}
        | {"told": each.told(quantity)}
        for each in joints
        for quantity, number in each.numbers.items()
    ]
