"""The report of balancing the drives' rotors, and its table."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.report.report import Finding, Report, Section, Table, Verdict, by_head, without_empty_columns
from ident.report.words import MM, counted, some
from ident.studies.basis import motion_section, subject
from ident.studies.cause.trials import acting, tried_section, turned
from ident.studies.cure.balance_study import RATE, grade

if TYPE_CHECKING:
    from ident.studies.cure.balance_study import Balance, Calibration, Rotor

GRAM_MM = 1e6
"""g mm in one kg m."""
TRY = "mount it, measure, name it in the column trial: ident source {runs} --arm {arm}"
"""Verification of mark, sense of rotation and model."""


def balance_sections(balance: "Balance") -> Report:
    """Return the report of balancing."""
    return Report(
        f"Balancing of {subject(balance.basis)}",
        _verdict(balance),
        (_rotors(balance), *_masses(balance)),
        tuple(_findings(balance)),
        remark=_remark(balance),
        next=TRY if balance.balanced and balance.gains and not balance.tried else "",
        details=tuple(_details(balance)),
    )


def _left(share: np.ndarray) -> str:
    middle, low, high = 100 * share
    return f"{middle:.0f} % (95 %: {low:.0f} to {high:.0f} %)"


def _verdict(balance: "Balance") -> Verdict:
    states = [each.state for each in balance.rotors if each.state != "not worth it"]
    done = balance.balanced
    if not states:
        most = 100 * max(each.most for each in balance.rotors)
        return Verdict("NO GAIN", f"No imbalance makes more than {most:.0f} % of the vibration's peak.", "caution")
    if not done:
        if (large := next((each for each in balance.rotors if each.state == "does not fit"), None)) is not None:
            return Verdict("DOES NOT FIT", f"{needs_words(large)}.", "bad")
        if "trials contradict" in states:
            return Verdict("CONTRADICTING", "The trial masses contradict each other: no mass is recommended.", "bad")
        return Verdict("NOT TOLD", "The runs do not tell the imbalances that matter.", "bad")
    before, after = (MM * float(np.abs(part).max()) for part in (balance.before, balance.after))
    names = some([each.drive.name for each in done])
    does = "falls" if balance.gains else "changes"
    sizes = f"from {before:.3f} to {after:.3f} mm, {_left(balance.left)} is left"
    falls = f"Masses on {names}: the vibration {does} {sizes}"
    if not balance.gains:
        return Verdict("NO GAIN", f"{falls}.", "caution")
    if doubted := [each.calibration for each in done if each.calibration.state == "one trial"]:
        alone = all(each.trials == 1 for each in doubted)
        condition = "the one trial run is right" if alone else "the mark is wrong, not the sense of angles"
        return Verdict("TRY AGAIN", f"{falls}, if {condition}.", "caution")
    if len(done) < len(states):
        return Verdict(f"PARTLY {len(done)} OF {len(states)}", f"{falls}.", "caution")
    return Verdict("BALANCE", f"{falls}.", "good")


def needs_words(rotor: "Rotor") -> str:
    """Say which mass a rotor needs if it does not fit."""
    mass, pulley = 1e3 * max(body.mass for body in rotor.bodies), rotor.pulley
    needed = f"{mass:.3g} g at {MM * pulley.radius:g} mm"
    return f"{rotor.drive.name} needs {needed}, above the {1e3 * pulley.most:g} g allowed"


def _grade(quality: float) -> str:
    coarse = grade(quality)
    return f"G {coarse:g}" if np.isfinite(coarse) else "above G 4000"


def _state(balance: "Balance", rotor: "Rotor") -> str:
    return rotor.state if balance.gains or not rotor.balanced else "no gain"


def _rotors(balance: "Balance") -> Table:
    rows = []
    for each in balance.rotors:
        size = abs(each.found)
        way, off = (float(np.degrees(x)) for x in (np.angle(each.found), (each.draws / each.found).imag.std()))
        middle = (GRAM_MM * size, 100 * each.sd, way % 360, off)
        left = float(np.quantile(np.abs(each.left), 0.95))
        state = _state(balance, each)
        after = _grade(each.quality(left)) if state == "balance" else ""
        name, seen = each.drive.name, (_grade(each.quality(size)), after, MM * each.makes, state)
        rows.append((name, *(middle if each.told else (None,) * 4), *seen))
    of_imbalance = "imbalance [g mm]|.0f", "+- [%]|.1f", "at [deg]|.0f", "+- [deg]|.1f"
    pulleys = [each.pulley for each in balance.rotors]
    masses = dict.fromkeys(f"rotor of {each.rotor:.3g} kg: {each.assumed}" for each in pulleys if each.assumed)
    note = f"Grades of ISO 21940-11 ({'; '.join(masses)})." if masses else ""
    heads = "Rotor", *of_imbalance, "grade", "after", "makes [mm]|.3f", "correction"
    return by_head(heads, rows, note=note)


def _masses(balance: "Balance") -> Iterator[Table]:
    rows = []
    for each in balance.balanced if balance.gains else ():
        holes, turn = each.pulley.holes, float(np.degrees(each.wanted_sd[1]))
        for body, sd in zip(each.bodies, each.masses_sd.tolist(), strict=True):
            hole, off = (f"{body.hole} of {holes}", "") if holes else ("any", turn)
            sizes = (1e3 * body.mass, 1e3 * sd, MM * each.pulley.radius, float(np.degrees(body.angle)))
            rows.append((each.drive.name, hole, *sizes, off))
    sizes_of = "mass [g]|.1f", "+- [g]|.2f", "radius [mm]|.1f", "angle [deg]|.1f", "+- [deg]|.1f"
    other = [each.drive.name for each in balance.balanced if each.calibration.trials]
    note = (
        "Angles: joints at 0, from the x axis of the link before (y where the joint turns about x), counter-clockwise "
        "as seen with the joint's axis pointing at you"
        + f"; but those to mount on {some(other)} as the column trial counts them" * bool(other)
        + "; +-: std. error."
    )
    if rows:
        yield without_empty_columns(by_head(("Mount on", "hole", *sizes_of), rows, note=note))


def _findings(balance: "Balance") -> Iterator[Finding]:
    unverified = "mark, sense and model are not verified"
    for each in balance.rotors:
        name, calibration = each.drive.name, each.calibration
        if each.state == "does not fit":
            mass = max(body.mass for body in each.bodies)
            radius = np.ceil(MM * each.pulley.radius * mass / each.pulley.most)  # a smaller radius needs too much
            remedy = f"mount at {radius:.0f} mm (--radius {name}={radius:.0f}), or allow more (--most)"
            yield Finding(needs_words(each), remedy)
        if calibration.trials > 1 and not calibration.state:
            yield Finding(f"{name}: masses act {_acts(calibration)}: allowed for")
        for tried in balance.tried:
            if tried.drive == name and not tried.told:
                acts = f"factor {abs(tried.factor):.2g} +- {tried.spread:.2g}"
                text = f"{tried.run}: the trial mass on {name} tells nothing ({acts})"
                text += f": {unverified}" * (not any(each.told for each in balance.tried))
                yield Finding(text, f"take one {np.ceil(10 * tried.too_light) / 10:.1f} times as heavy")
        for odd in calibration.odd:
            turn = np.degrees(np.angle(odd.factor)) / (360 / (each.pulley.holes or 360))
            hole = f", {abs(turn):.0f} of {each.pulley.holes} holes" if each.pulley.holes else ""
            second = "; another trial about 90 deg away tells a wrong mark from a wrong sense"
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
        yield Finding(f"no trial mass: {unverified}")


def _remark(balance: "Balance") -> str:
    peak = float(np.abs(balance.before).max())
    if balance.errors < 0.05 * peak:
        return ""
    less = " What else is left cancels part of it." * (float(np.abs(balance.after).max()) < balance.errors)
    return f"Transmission errors make {MM * balance.errors:.3f} mm; masses do not change that.{less}"


def _acts(calibration: "Calibration") -> str:
    """Say how stated masses act: `as 1.30 of what is stated, 23 deg further (two trials)`."""
    sense = ", angles counted the other way round" if calibration.mirrored else ""
    how = f"{turned(calibration.factor)} ({counted(calibration.trials, 'trial')})"
    return f"as {abs(calibration.factor):.2f} of what is stated{sense}, {how}"


def _details(balance: "Balance") -> Iterator[Section]:
    rows = []
    for each in balance.rotors:
        drive, left = each.drive, each.quality(float(np.quantile(np.abs(each.left), 0.95)))
        repeats = None if np.isnan(each.repeats) else float(np.degrees(each.repeats))
        own = (drive.name, float(drive.ratio), each.speed, each.quality(abs(each.found)), each.pulley.rotor)
        rows.append((*own, left, 1e9 * each.couple, repeats))
    heads = (
        *("Rotor", "ratio|g", "at most [Hz]|.2f", "e omega [mm/s]|.3g", "rotor [kg]|.3g", "left, 95 % [mm/s]|.3g"),
        *("couple left [g mm^2]|.3g", "phase sd [deg]|.1f"),
    )
    meaning = (
        "Grades of ISO 21940-11 by eccentricity times angular speed, as one plane, at the motion's highest speed. "
        "Ratio: turns for one of the joint, negative where the rotor turns against it; with a joint 1 deg off 0, "
        "its mark is as many degrees away. The couple is in the prediction."
    )
    yield Section("Rotors", (meaning, by_head(heads, rows)))
    parts = [
        ("all", *(MM * np.median(balance.peaks, 1)), _left(balance.left)),
        ("imbalance", *(MM * np.median(balance.of_imbalance, 1)), _left(balance.imbalance_left)),
        ("transmission errors", MM * balance.errors, MM * balance.errors, ""),
        ("motion itself", MM * balance.own, MM * balance.own, ""),
    ]
    made = by_head(("Made by", "before [mm]|.3f", "after [mm]|.3f", "left"), parts)
    yield Section("Peak of the vibration", (made,))
    if balance.tried:
        yield tried_section(balance.tried)
    how = f"fast, {counted(balance.peaks.shape[1], 'draw')}"
    yield motion_section(balance.basis, elastic_belts=False, rate=RATE, method=how)


def balance_rows(balance: "Balance") -> list[dict[str, Any]]:
    """Return a row for each mass [SI], and one for each rotor without correction: mass, angle and hole are NaN."""
    rows = list[dict[str, Any]]()
    for each in balance.rotors:
        state, place = _state(balance, each), {"radius": each.pulley.radius, "height": each.pulley.height}
        about = {"drive": each.drive.name, "state": state, "imbalance": float(abs(each.found)), "makes": each.makes}
        if state != "balance":
            nothing = dict.fromkeys(("mass", "mass_sd", "angle", "size_sd", "angle_sd"), np.nan)
            rows.append(about | nothing | place | {"hole": np.nan})
            continue
        of_size, of_turn = each.wanted_sd
        for body, sd in zip(each.bodies, each.masses_sd.tolist(), strict=True):
            mounted = {"mass": body.mass, "mass_sd": sd, "angle": body.angle, "size_sd": of_size, "angle_sd": of_turn}
            rows.append(about | mounted | place | {"hole": body.hole})
    return rows
