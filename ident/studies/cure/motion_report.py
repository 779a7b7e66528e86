"""The report of motions along one path, its table, and the joint path as a file."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.files import replace_file
from ident.measure.table import csv_text, guarded
from ident.report.report import Finding, Report, Section, Table, Verdict, by_head
from ident.report.words import MM, counted, percent
from ident.studies.basis import all_findings, assumed_section, motion_section, subject
from ident.studies.cure.motion_study import LIMITS, TOUCHED, Candidate
from ident.studies.cure.remedies import CONFIDENT
from ident.studies.scenario import DAMPING
from ident.vibrate.study import DIRECTIONS

if TYPE_CHECKING:
    from ident.studies.cure.motion_study import MotionStudy


TEACHING, TEACHING_WORDS = 0.25, "the teaching limit of 250 mm/s"
"""Highest speed of the tool [m/s] at reduced speed: ISO 10218-1:2011, section 5.6.2."""


def motion_sections(motions: "MotionStudy") -> Report:
    """Return the report of motions along a path."""
    return Report(
        f"Motions of {subject(motions.basis)}: {counted(len(motions.candidates), 'way')} along the same path",
        _verdict(motions),
        (_touched(motions), _candidates(motions, _shown(motions)), *_typed(motions)),
        tuple(_findings(motions)),
        next=_next(motions),
        details=tuple(_details(motions)),
    )


def _verdict(motions: "MotionStudy") -> Verdict:
    best, now, wanted = motions.recommended, motions.candidates[0], motions.wanted
    words, until = [f"keeps the limit of {MM * wanted.limit:g} mm"] * bool(np.isfinite(wanted.limit)), "in"
    if wanted.settled is not None:
        way = f" in {DIRECTIONS[wanted.ways[0]]}" * (len(wanted.ways) == 1)
        words, until = [*words, f"settles to {MM * wanted.settled:g} mm{way}"], "within"
    keeps, quiet = " and ".join(words), min(motions.candidates, key=lambda each: each.worst)
    if best is None:
        least = f"the quietest is {quiet.name}: {MM * quiet.worst:.2f} mm in {quiet.time:.1f} s"
        return Verdict("NOT MET", f"No motion {keeps} with confidence; {least}.", "bad")
    keeps += f" {until} {best.ready:.1f} s"
    if best is now:
        return Verdict("MET", f"The motion as it is {keeps}: no change is needed.", "good")
    compared = f"as it is: {MM * now.worst:.2f} mm in {now.time:.1f} s"
    largest = best.worst if best.verification is None else best.verification.largest
    size = f"{MM * largest:.2f} mm by the exact equations"
    if best.verification is not None and best.verification.settled is not None:
        keeps += f", with {100 * CONFIDENT:g} % probability"
        size, compared = f"{best.verification.settled:.1f} s by the exact equations", f"as it is: {now.ready:.1f} s"
    return Verdict("MET", f"Recommended: {best.name}. It {keeps} ({size}; {compared}).", "good")


def _touched(motions: "MotionStudy") -> str:
    share = motions.share_of_motion
    what = "shape the motion" if share > 0.5 else "shapers may help" if share > TOUCHED else "no shaper helps"
    what += ", no ramp and no jerk time" * (share <= TOUCHED and any(each.typed for each in motions.candidates))
    return f"The motion itself makes {100 * share:.0f} % of the vibration as it is, the drives the rest: {what}."


def _typed(motions: "MotionStudy") -> Iterator[str]:
    """Yield the numbers to type, of the best setting first, and what it loses against the recommended motion."""
    rows = sorted((each for each in motions.candidates if each.typed), key=lambda each: each.kind != "best")
    for each in rows:
        lost = each.ready - motions.recommended.ready if motions.recommended and each.kind == "best" else 0.0
        more = f" ({lost:.1f} s later than recommended)" * (lost > 0 and motions.met(each))
        yield f"{each.name[:1].upper()}{each.name[1:]}: {each.typed}{more}."
    if rows and motions.best_knobs is None:
        yield "No setting of speed, ramp and jerk within the arm file's limits keeps what is asked for."


def _shown(motions: "MotionStudy") -> tuple[Candidate, ...]:
    """Return the candidates but for shapers that another beats in time and vibration; with knobs but for profiles."""
    shapers = [each for each in motions.candidates if each.kind == "shaper"]
    beaten = {one.name for one in shapers for each in shapers if each.time <= one.time and each.left < one.left}
    every, best = list(motions.candidates), motions.best_knobs
    if any(each.typed for each in every):  # what a controller can be set to first, then what needs a joint path
        every = [each for each in every if each.kind != "profile" or each is motions.recommended]
        every.sort(key=lambda each: (each is not best, best is None or each.kind != "along the path"))
    return tuple(each for each in every if each.name not in beaten or each is motions.recommended)


def _candidates(motions: "MotionStudy", candidates: tuple[Candidate, ...]) -> Table:
    now, best, rows = motions.candidates[0], motions.recommended, []
    settles, limited = now.settled is not None, bool(np.isfinite(motions.limit))
    for each in candidates:
        keeps = each.keeps(motions.limit)
        if each.verification is not None and each.verification.keeps is not None:
            keeps = each.verification.keeps
        median, high = np.quantile(each.peaks, (0.5, 0.95))
        sizes = (MM * median, MM * high, MM * each.worst, MM * each.left)
        name, added = each.name + " *" * bool(each.beyond), round(each.time, 1) - round(now.time, 1)
        kept = [each.ready] * settles + [100 * keeps.share] * limited
        rows.append((name, each.time, added, *sizes, *kept, np.degrees(each.acceleration)))
    of_sizes = "vibration, median [mm]|.2f", "95 % [mm]|.2f", "worst phases [mm]|.2f", "after arrival [mm]|.2f"
    wishes = ["settled, 95 % [s]|.1f"] * settles + ["keeps limit [%]|.0f"] * limited
    heads = "time [s]|.1f", "added [s]|+.1f", *of_sizes, *wishes, "joint acceleration [deg/s^2]|.0f"
    strong = tuple(k for k, each in enumerate(candidates) if each is best)
    beyond = [name for name in LIMITS if any(name in each.beyond for each in candidates)]
    note = f"* beyond the arm file's limit of {' and '.join(beyond)}: not recommended." if beyond else ""
    return by_head(("Motion", *heads), rows, "", note, strong)


def _findings(motions: "MotionStudy") -> Iterator[Finding]:
    checked, found = motions.verification, motions.candidates[-1]
    for each in motions.candidates:
        if each.verification is not None and each.verification.slack:
            text = f"{each.name}: the exact equations have {', '.join(each.verification.slack)} go slack: not confirmed"
            yield Finding(text, "raise the pretension")
    if checked.largest > motions.limit >= found.worst:
        text = f"the exact equations give {MM * checked.largest:.3f} mm along the path: more than the limit"
        yield Finding(text, "give it more time (--time)")
    if checked.keeps is not None and checked.keeps.share < CONFIDENT:
        low, high = (f"{100 * end:.0f}" for end in checked.keeps.interval)
        text = f"speed along the path keeps the limit with {low} to {high} % of {checked.keeps.draws} fresh draws"
        yield Finding(text, "measure the stiffnesses better (ident plan), or give it more time (--time)")
    if motions.basis.unknown.damping:
        text = f"damping counts as known within {percent(DAMPING)} (standard error, assumed), all of it together"
        yield Finding(text, "measure damping ratios: settling takes as long as damping is low")
    if not motions.basis.posterior:
        yield Finding("the stiffnesses count as exact", "add --posterior of ident sample")
    if checked.tool > TEACHING:
        yield Finding(f"the end moves at up to {MM * checked.tool:.0f} mm/s, above {TEACHING_WORDS}", "lower --speed")
    yield from all_findings(motions.basis)


def _next(motions: "MotionStudy") -> str:
    best, settled = motions.recommended, motions.wanted.settled
    if best is None or best.kind != "along the path":
        return "ident design {arm}" if best is None else ""
    return "ident simulate {arm} --path {result}.csv" + (f" --settled {MM * settled:g}" if settled else "")


def _details(motions: "MotionStudy") -> Iterator[Section]:
    basis, schedule, allowed = motions.basis, motions.schedule, motions.scheduling.allowed
    rate, method = motions.scheduling.evaluator.rate, "fast, the proposed motion also exact"
    yield motion_section(basis, elastic_belts=False, rate=rate, method=method)
    if len(_shown(motions)) < len(motions.candidates):
        meaning = "With all profiles, and the shapers than which another is quicker and leaves less."
        yield Section("All motions", (meaning, _candidates(motions, motions.candidates)))
    full = np.degrees(allowed.speed.max()) * (1 if basis.log else 100 / basis.percent)
    places, speeds = np.degrees(schedule.places), 100 * np.degrees(schedule.speeds) / full
    accelerations = np.degrees(schedule.accelerations)
    segments = zip(places[:-1], places[1:], speeds[:-1], speeds[1:], accelerations, strict=True)
    rows = [(number, *segment) for number, segment in enumerate(segments, 1)]
    of_alpha = ", the length of the path in the space of the joint angles" if basis.log else ""
    ends = "alpha from [deg]|.1f", "to [deg]|.1f", "speed from [%]|.2f", "to [%]|.2f"
    windows = " and ".join(f"{window:.3f} s" for window in schedule.windows)
    note = (
        f"Percent of full speed, {full:.4g} deg/s of alpha{of_alpha}, with an even acceleration in each segment; "
        f"then the mean over {windows}, the periods of the two lowest modes at the arrival."
    )
    table = by_head(("Segment|d", *ends, "acceleration [deg/s^2]|.1f"), rows)
    slowest, least = np.degrees(allowed.speed.min()), np.degrees(allowed.acceleration.min())
    limits = f"Limits of alpha: {slowest:.4g} deg/s at the slowest place, {least:.4g} deg/s^2."
    yield Section("Speed along the path", (note, table, limits))
    yield from assumed_section(basis)


def motion_rows(motions: "MotionStudy") -> list[dict[str, Any]]:
    """Return a row for each motion [SI]: time, vibration, probability of keeping the limit, largest acceleration."""
    return [
        {"motion": each.name, "kind": each.kind, "time": each.time}
        | {"median": float(np.median(each.peaks)), "q95": float(np.quantile(each.peaks, 0.95)), "worst": each.worst}
        | {"after_arrival": each.left, "keeps": each.keeps(motions.limit).share}
        | {"acceleration": each.acceleration, "met": motions.met(each)}
        | ({} if each.settled is None else {"settled": each.ready})
        for each in motions.candidates
    ]


def write_path(motions: "MotionStudy", rate: float, head: Mapping[str, Any], path: Path) -> None:
    """Write the joint path with the speeds along it as CSV, the format of `read_log`."""
    motion, arm = motions.schedule.motion, motions.basis.arm
    time = np.append(np.arange(0.0, motion.arrival - 0.5 / rate, 1 / rate), motion.arrival)
    columns = np.column_stack([time, *np.degrees(np.asarray(motion(time)[0]))])
    note = f"{head['format']} {head['created']} ident {head['software']['ident']}: {guarded(motions.basis.name)}"
    top = csv_text(["time [s]", *(f"{joint.name} [deg]" for joint in arm.driven)], (), [note])

    def write(file: Any) -> None:
        file.write(top.encode())
        np.savetxt(file, columns, fmt="%.10g", delimiter=",")

    replace_file(path, write, make_folders=True)
