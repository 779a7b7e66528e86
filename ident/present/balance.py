"""Balancing of the drives' rotors: what is said of it, and its rows for programs."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.assess.balance import RATE, grade
from ident.present.basis import motion_section, subject
from ident.present.report import Finding, Report, Section, Table, Verdict
from ident.present.source import acting, tried_section
from ident.present.words import MM, counted, some

if TYPE_CHECKING:
    from ident.assess.balance import Balance, Rotor

GRAM_MM = 1e6
"""g mm in a kg m."""


def balance_sections(balance: "Balance") -> Report:
    """Return all that is said of balancing."""
    return Report(
        f"Balancing of {subject(balance.basis)}",
        _verdict(balance),
        (_rotors(balance), *_masses(balance)),
        tuple(_findings(balance)),
        remark=_remark(balance),
        details=tuple(_details(balance)),
    )


def _left(share: np.ndarray) -> str:
    middle, low, high = 100 * share
    return f"{middle:.0f} % (95 %: {low:.0f} to {high:.0f} %)"


def _verdict(balance: "Balance") -> Verdict:
    states = [each.state for each in balance.rotors if each.state != "not worth it"]
    done = balance.balanced
    if not states:
        most = 100 * max(each.share for each in balance.rotors)
        return Verdict("NO GAIN", f"No imbalance makes more than {most:.0f} % of the vibration's peak.", "caution")
    if not done:
        if (large := next((each for each in balance.rotors if each.state == "does not fit"), None)) is not None:
            return Verdict("DOES NOT FIT", f"{_needs(large)}.", "bad")
        if "trials contradict" in states:
            return Verdict("CONTRADICTING", "The trial masses contradict each other: no mass is recommended.", "bad")
        return Verdict("NOT TOLD", "The runs do not tell the imbalances that matter.", "bad")
    before, after = (MM * float(np.abs(part).max()) for part in (balance.before, balance.after))
    names = some([each.drive.name for each in done])
    falls = f"Masses on {names}: the vibration falls from {before:.3f} to {after:.3f} mm, {_left(balance.left)} is left"
    if any(each.calibration.state == "one trial" for each in done):
        return Verdict("TRY AGAIN", f"{falls}, if one trial run is right.", "caution")
    if balance.left[2] > 1:
        return Verdict("NO GAIN", f"{falls}.", "caution")
    if len(done) < len(states):
        return Verdict(f"PARTLY {len(done)} OF {len(states)}", f"{falls}.", "caution")
    return Verdict("BALANCE", f"{falls}.", "good")


def _needs(rotor: "Rotor") -> str:
    mass = 1e3 * max(body.mass for body in rotor.bodies)
    return f"{rotor.drive.name} needs {mass:.3g} g at {MM * rotor.pulley.radius:g} mm: does not fit"


def _grade(quality: float) -> str:
    coarse = grade(quality)
    return f"G {coarse:g}" if np.isfinite(coarse) else "above G 4000"


def _rotors(balance: "Balance") -> Table:
    rows = []
    for each in balance.rotors:
        size = abs(each.found)
        middle = (GRAM_MM * size, 100 * each.sd, float(np.degrees(np.angle(each.found))) % 360)
        left = float(np.quantile(np.abs(each.left), 0.95))
        after = _grade(each.quality(left)) if each.balanced else ""
        name, seen = each.drive.name, (_grade(each.quality(size)), after, MM * each.makes, each.state)
        rows.append((name, *(middle if each.told else (None,) * 3), *seen))
    head = ("Rotor", "imbalance [g mm]", "error [%]", "at [deg]", "grade", "balanced", "vibration [mm]", "correction")
    return Table("", head, tuple(rows), ("", ".0f", ".1f", ".0f", "", "", ".3f", ""))


def _masses(balance: "Balance") -> Iterator[Table]:
    rows = []
    for each in balance.balanced:
        size, turn = each.wanted_sd
        for body in each.bodies:
            hole = (f"{body.hole} of {each.pulley.holes}",) if each.pulley.holes else ("any",)
            sizes = (1e3 * body.mass, MM * each.pulley.radius, float(np.degrees(body.angle)))
            rows.append((each.drive.name, *hole, *sizes, 100 * size, float(np.degrees(turn))))
    head = ("Mount on", "hole", "mass [g]", "radius [mm]", "angle [deg]", "+- [%]", "+- [deg]")
    note = (
        "Angles: joints at 0, from the x axis of the link before (y where the joint turns about x), counter-clockwise "
        "as seen with the joint's axis pointing at you; +-: std. error."
    )
    if rows:
        yield Table("", head, tuple(rows), ("", "", ".1f", ".1f", ".1f", ".1f", ".1f"), note)


def _findings(balance: "Balance") -> Iterator[Finding]:
    for each in balance.rotors:
        name, calibration = each.drive.name, each.calibration
        if each.state == "does not fit":
            mass = max(body.mass for body in each.bodies)
            radius = MM * each.pulley.radius * mass / each.pulley.most
            remedy = f"mount at {radius:.0f} mm (--radius {name}={radius:.0f}), or allow more (--most)"
            yield Finding(f"{_needs(each)} ({1e3 * each.pulley.most:g} g at most)", remedy)
        if calibration.mirrored:
            yield Finding(f"{name}: the trial masses' angles count the other way round", "so do those above")
        for odd in calibration.odd:
            turn = np.degrees(np.angle(odd.factor)) / (360 / (each.pulley.holes or 360))
            hole = f", {abs(turn):.0f} of {each.pulley.holes} holes" if each.pulley.holes else ""
            second = "; a second trial at another angle tells a wrong mark from a wrong sense"
            remedy = "check where and what it is" + second * (calibration.state == "one trial")
            yield Finding(f"{odd.run}: the mass on {name} acts {acting(odd)}{hole}", remedy)
        if each.state == "cannot be told" and each.share > 0:
            yield Finding(f"{name}'s imbalance cannot be told", "see ident source: which run would tell it")
    scatter = [each for each in balance.balanced if each.repeats > 0]
    for each in scatter:
        text = f"{each.drive.name}'s phase differs by {np.degrees(each.repeats):.0f} deg (sd) between groups of runs"
        yield Finding(text, "find what slips; a mark on the pulley does not")
    if balance.balanced and all(np.isnan(each.repeats) for each in balance.balanced):
        remedy = "add a run after homing again, as another group"
        yield Finding("one group of runs: whether the pulleys keep their angle is not known", remedy)
    if balance.balanced and not balance.tried:
        remedy = "mount the mass, measure, and name it in the column trial"
        yield Finding("no trial mass: mark, sense and model are not verified", remedy)


def _remark(balance: "Balance") -> str:
    peak = float(np.abs(balance.before).max())
    if balance.errors < 0.05 * peak:
        return ""
    share = f"{MM * balance.errors:.3f} mm"
    return f"Transmission errors make {share}: no matter of mass, but of the command."


def _details(balance: "Balance") -> Iterator[Section]:
    rows = [
        (each.drive.name, float(each.drive.ratio), each.speed, each.quality(abs(each.found)), each.pulley.rotor)
        for each in balance.rotors
    ]
    more = [
        (
            each.quality(float(np.quantile(np.abs(each.left), 0.95))),
            1e9 * each.couple,
            None if np.isnan(each.repeats) else float(np.degrees(each.repeats)),
        )
        for each in balance.rotors
    ]
    head = (
        *("Rotor", "ratio", "at most [Hz]", "e omega [mm/s]", "rotor [kg]", "left, 95 % [mm/s]"),
        *("couple left [g mm^2]", "phase sd [deg]"),
    )
    table = [(*a, *b) for a, b in zip(rows, more, strict=True)]
    yield Section(
        "Rotors",
        (
            "Grades of ISO 21940-11 by eccentricity times angular speed, as one plane, at the motion's highest speed. "
            "Ratio: turns for one of the joint, negative where the rotor turns against it; with a joint 1 deg off 0, "
            "its mark is as many degrees away. The couple is in the prediction.",
            Table("", head, tuple(table), ("", "g", ".2f", ".3g", ".3g", ".3g", ".3g", ".1f")),
        ),
    )
    parts = [
        ("all", *(MM * np.median(balance.peaks, 1)), _left(balance.left)),
        ("imbalance", *(MM * np.median(balance.of_imbalance, 1)), _left(balance.imbalance_left)),
        ("transmission errors", MM * balance.errors, MM * balance.errors, ""),
        ("motion itself", MM * balance.own, MM * balance.own, ""),
    ]
    made = Table("", ("Made by", "before [mm]", "after [mm]", "left"), tuple(parts), ("", ".3f", ".3f", ""))
    yield Section("Peak of the vibration", (made,))
    if balance.tried:
        yield tried_section(balance.tried)
    how = f"fast, {counted(balance.peaks.shape[1], 'draw')}"
    yield motion_section(balance.basis, elastic_belts=False, rate=RATE, method=how)


def balance_rows(balance: "Balance") -> list[dict[str, Any]]:
    """Return a row for each mass [SI], and for each rotor that gets none."""
    rows = []
    for each in balance.rotors:
        size, turn = each.wanted_sd
        about = {"drive": each.drive.name, "state": each.state, "imbalance": abs(each.found), "makes": each.makes}
        for body in each.bodies:
            where = {"radius": each.pulley.radius, "height": each.pulley.height, "hole": body.hole}
            rows.append(about | {"mass": body.mass, "angle": body.angle, "size_sd": size, "angle_sd": turn} | where)
    return rows
