"""The report on the causes of a moving arm's vibration, and its table."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ident.report.report import Finding, Report, Section, Table, Verdict, by_head, cut
from ident.report.words import TRACE_UNITS, counted
from ident.text import as_word, by_key

if TYPE_CHECKING:
    from ident.measure.runs import Runs
    from ident.vibrate.triage import Finding as Part
    from ident.vibrate.triage import Triage

WORDS = {"drive": "DRIVE", "mode": "STRUCTURE", "kicks": "STRUCTURE", "line": "FIXED LINE"}
"""Verdict by the cause of the largest part."""
MAINS, OFF_MAINS = (16.7, 50.0, 60.0), 0.1
"""Mains frequencies [Hz], and tolerance of a line."""
REMEDIES = {
    "profile": "smooth the command, or see ident motion",
    "standstill": "record at rest: a line of servo, mains or floor stays",
    "speed": "record a run at another speed",
    "modes": "add the multiple to --orders, or look for a source that the arm file lacks",
    "kicks": "look for shocks: end stops, cables, what passes by",
}
"""Remedy, by the hint of a part."""


def triage_sections(triage: "Triage", runs: "Runs") -> Report:
    """Return the report on the causes of a vibration."""
    found = triage.findings
    places = ((what(part), _trace(part, runs), part.time) for part in found)
    strongest = by_head(("What it follows", "trace", "time [s]|.1f"), places)
    alone = Path(runs.path).name in runs.names  # without a table, which is to be written first
    table = f"ident source {as_word(str(Path(runs.path).parent))} --init"
    source = table if alone else "ident source {runs} --arm {arm}"
    following = source if any(part.next == "source" for part in found) else ""
    return Report(
        f"What vibrates in {counted(len(runs.traces), 'trace')} of {counted(len(runs.names), 'run')}",
        _verdict(triage),
        (_parts(triage),) if found else (),
        tuple(_findings(triage, runs)),
        next=following,
        details=(Section("Where each part is strongest", (strongest,)), _compared(triage)),
    )


def _verdict(triage: "Triage") -> Verdict:
    if not triage.findings:
        return Verdict("NO VIBRATION", "Nothing stands out of the noise.", "good")
    largest = triage.findings[0]
    share = f"{100 * largest.share:.0f} % of the vibration"
    if not largest.told:
        return Verdict("CANNOT TELL", f"{share}: {what(largest)} or another cause.", "caution")
    if largest.kind == "unexplained":
        like = f"; it moves with speed like {_drive(largest)}" if largest.drives else ""
        return Verdict("UNEXPLAINED", f"{share} follows no known drive, mode or fixed frequency{like}.", "caution")
    return Verdict(WORDS[largest.kind], f"{share}: {what(largest)}.", "caution")


def what(part: "Part") -> str:
    """Name what a part follows: `drive2 x 1 or drive1/drive3 x 2`, `lateral torsion 1, rung by the command`."""
    if part.kind == "drive":
        by_order = by_key((order, drive) for drive, order in part.drives)
        return " or ".join(f"{'/'.join(names)} x {order}" for order, names in by_order.items())
    if part.kind in ("mode", "kicks"):
        by = "the command" if part.by_command else "kicks" if part.kind == "kicks" else ""
        return ", ".join(part.modes) + (f", rung by {by}" if by else "")
    if part.kind == "unexplained":
        return f"unexplained, like {_drive(part)}" if part.drives else "unexplained"
    mains = next((f" (mains, {own:g} Hz)" for own in MAINS if abs(part.frequency[0] - own) < OFF_MAINS), "")
    return f"a line at {part.frequency[0]:.4g} Hz{mains}"


def _drive(part: "Part") -> str:
    """Name the multiple of a drive's frequency with which a part moves: `0.35 x drive2`."""
    ((drive, order), *_) = part.drives
    return f"{order:.3g} x {drive}"


def _parts(triage: "Triage") -> Table:
    heads, rows = ("What it follows", "share [%]|.0f", "probability [%]|.0f", "frequency [Hz]", "amplified by"), []
    for part in triage.findings:
        low, high = (f"{end:.1f}" for end in part.frequency)
        frequency, modes = low if low == high else f"{low} .. {high}", ", ".join(part.modes)
        known = None if part.track is None else 100 * part.probability
        rows.append((what(part), 100 * part.share, known, frequency, modes if part.kind == "drive" else ""))
    note = "x 2: twice the frequency of that drive's pulley; drives whose frequencies coincide stand together."
    return by_head(heads, rows, note=note)


def _findings(triage: "Triage", runs: "Runs") -> Iterator[Finding]:
    for part in triage.findings:
        if part.next != "source":  # the next command does that
            text, (low, high) = cut(what(part), 60), part.frequency
            if part.kind == "unexplained":
                factor, unit = tuple(TRACE_UNITS.values())[runs.traces[part.trace].derivative]
                text += f", {factor * part.amplitude:.2g} {unit} at {low:.1f} to {high:.1f} Hz"
            yield Finding(text + ("" if part.told else " cannot be told from another cause"), REMEDIES[part.next])


def _compared(triage: "Triage") -> Section:
    drives = [each.drives for each in triage.hypotheses if each.kind == "drive"]
    rows = tuple((" or ".join(f"{name} x {order}" for name, order in each),) for each in drives)
    modes = tuple((label,) for label in dict.fromkeys(label for each in triage.labels for label in each))
    return Section("What was compared", (Table("", ("Drives",), rows), Table("", ("Modes",), modes)))


def triage_rows(triage: "Triage", runs: "Runs") -> list[dict[str, Any]]:
    """Return a row for each part [SI]."""
    return [
        {"kind": part.kind, "follows": what(part), "share": part.share, "probability": part.probability}
        | {"lowest": part.frequency[0], "highest": part.frequency[1], "time": part.time, "amplitude": part.amplitude}
        | {"trace": _trace(part, runs)}
        for part in triage.findings
    ]


def _trace(part: "Part", runs: "Runs") -> str:
    row = runs.traces[part.trace].row
    return f"{row.file} {row.channel}"
