"""LabVIEW measurement files (LVM), which are text: each segment is a block, and so is each restart of the times.

References:
    National Instruments, "Specification for the LabVIEW Measurement File (.lvm)": labels stand in the column of their
    samples; `X_Columns` is No, One, or Multi, with a column of times before each channel.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import date
from itertools import pairwise
from pathlib import Path

import numpy as np

from ident.errors import refusal, require
from ident.measure.recordings.recording import Channel, Contents, damaged, over
from ident.measure.recordings.sampling import rounded_step
from ident.text import decode, one_line

KIND = "a LabVIEW measurement file (LVM)"
TIMES, COMMENT = "X_Value", "Comment"
"""Names of columns that are not channels."""
HEADING = ("***", "Channels", "Notes", "Test_", "UUT_", TIMES)
"""Words that begin the heading of a segment."""
EPOCH = 1905
"""A date before this year is LabVIEW's zero: the channel has no time of day."""
_NUMBER = re.compile(r"[+-]?[0-9]*(?:\.(?P<digits>[0-9]*))?(?:[eE](?P<power>[+-]?[0-9]{1,3}))?")
_DATE = re.compile(r"([0-9]{4})/([0-9]{1,2})/([0-9]{1,2})")
_CLOCK = re.compile(r"([0-9]{1,2}):([0-9]{2}):([0-9]{2}(?:[.,][0-9]+)?)")


@dataclass
class _Segment:
    """Rows of samples under one header.

    Attributes:
        line: number of the line with the names of the columns.
        header: cells of each line of the header by its key, the first cell.
        names: of the columns.
        rows: cells.
        mark: decimal mark.
    """

    line: int
    header: Mapping[str, Sequence[str]]
    names: Sequence[str]
    mark: str
    rows: list[list[str]] = field(default_factory=list)

    def label(self, key: str, column: int) -> str:
        """Return the header's entry for a channel; empty if there is none."""
        cells = self.header.get(key, ())
        return cells[column].strip() if column < len(cells) else ""

    def number(self, key: str, column: int) -> float:
        """Return the same as a number; nan if there is none."""
        return _as_number(self.label(key, column).replace(self.mark, "."))

    def column(self, number: int) -> list[str]:
        """Return the cells of a column with a decimal point."""
        return [row[number].strip().replace(self.mark, ".") if number < len(row) else "" for row in self.rows]


def read(path: Path, data: bytes) -> Contents:
    """Return the channels of an LVM file."""
    text = decode(data, one_line(str(path)), by_instrument=True)
    if not text.endswith("\n"):
        damaged(path, KIND, "its last line has no end")
    segments = list(_segments(text))
    if not segments:
        damaged(path, KIND, "no segment of samples in it")
    for each in segments:
        counts = (each.number("Samples", i) for i in range(len(each.names)))
        promised = max((int(count) for count in counts if np.isfinite(count)), default=0)
        if not each.rows or len(each.rows) < promised:
            damaged(path, KIND, f"{len(each.rows)} of {promised} samples")
    file = one_line(str(path))
    return tuple(_joined(file, [list(_channels(file, each)) for each in segments])), (), {}


def _segments(text: str) -> Iterator[_Segment]:
    """Yield the segments; skip special sections, which hold no samples."""
    lines = text.replace("\r\n", "\n").split("\n")
    separator = next((line[9] for line in lines[:20] if line.startswith("Separator") and len(line) > 9), "\t")
    file_header: dict[str, list[str]] | None = None
    header: dict[str, list[str]] = {}
    segment: _Segment | None = None
    special = reading = False
    for number, line in enumerate(lines, 1):
        tag = line.partition(separator)[0].strip()
        blank = not line.strip(separator + " \t")
        if special or tag == "***Start_Special***":
            special = tag != "***End_Special***"
            continue
        if reading and (blank or tag.startswith(HEADING)):
            reading, header = False, {}
        if blank:
            continue
        if reading and segment:
            segment.rows.append(line.split(separator))
        elif segment and not header and not tag.startswith(HEADING):  # of a file with one heading for all segments
            yield segment
            segment, reading = replace(segment, line=number - 1, rows=[line.split(separator)]), True
        elif tag == "***End_of_Header***" and file_header is None:
            file_header, header = header, {}
        elif tag == TIMES:
            if segment:
                yield segment
            mark = (file_header or header).get("Decimal_Separator", ["", ""])[1:2] or [""]
            names = [name.strip() for name in line.split(separator)]
            row = "".join(lines[number : number + 1])  # the first versions do not declare the decimal mark
            guess = "," if separator != "," and "," in row and "." not in row else "."
            segment, reading = _Segment(number, header, names, mark[0].strip() or guess), True
        elif not tag.startswith("*"):
            header[tag] = line.split(separator)
    if segment:
        yield segment


def _channels(file: str, segment: _Segment) -> Iterator[Channel]:
    """Yield the channels of a segment; each restart of its times begins a block."""
    places = [i for i, name in enumerate(segment.names) if name not in (TIMES, COMMENT, "")]
    labels = _labels(segment, places)
    samplings: dict[int, _Sampling] = {}
    for place, label in zip(places, labels, strict=True):
        before = max(i for i, name in enumerate(segment.names[: place + 1]) if name == TIMES)
        if before not in samplings:
            samplings[before] = _sampling(file, segment, before, label)
        sampling = samplings[before]
        values = _numbers(segment.column(place))[: sampling.ends[-1]]
        written = np.flatnonzero(~np.isnan(values))
        if len(sampling.ends) == 1 and len(written):
            values = values[: written[-1] + 1]  # blank cells below a channel of fewer samples
        blocks = np.split(values, sampling.ends[:-1])
        lengths, remedy = sorted({len(block) for block in blocks}), "put them into files of their own"
        got = f"records of {' and '.join(map(str, lengths[:3]))} samples, each from where {TIMES} starts again"
        require(len(lengths) == 1, f"{file}:{segment.line}", got, "records of one length", remedy, TIMES)
        step, start = sampling.step, sampling.start
        if label != sampling.label:  # the times are those of another channel
            later = segment.number("X0", label) - segment.number("X0", sampling.label)
            start += later if np.isfinite(later) else 0.0
        if segment.label("Delta_X", label) != segment.label("Delta_X", sampling.label):
            step = segment.number("Delta_X", label)
        quantity = segment.label("X_Dimension", label).lower()
        flaw = "" if quantity in ("", "time") else f"values over {one_line(quantity)}"
        unit, remedy = segment.label("Y_Unit_Label", label), "export the samples over time" if flaw else ""
        sampled = step if step > 0 else None, start
        channel = Channel(segment.names[place], np.array(blocks), unit, *sampled, flaw=flaw, remedy=remedy)
        one, two = (_clock(segment.label("Date", i), segment.label("Time", i)) for i in (label, labels[0]))
        later = one - two if one is not None and two is not None else 0.0  # [s] than the zero of the first one's times
        yield over(channel, segment.label("X_Unit_Label", label), "time", later)


def _labels(segment: _Segment, places: Sequence[int]) -> Sequence[int]:
    """Return the header's column for each channel: the channel's own, or those of the filled cells in order."""
    for key in ("Samples", "Delta_X", "X0"):
        filled = [i for i, cell in enumerate(segment.header.get(key, ())) if i and cell.strip()]
        if len(filled) == len(places):
            return filled
    return places


def _clock(day: str, time: str) -> float | None:
    """Return date and time of day in seconds from 2010 on; None where there is none."""
    found, clock = _DATE.fullmatch(day), _CLOCK.fullmatch(time)
    if not found or not clock or int(found[1]) < EPOCH:
        return None
    try:
        days = (date(*map(int, found.groups())) - date(2010, 1, 1)).days
    except ValueError:
        return None
    return 86400.0 * days + 3600 * int(clock[1]) + 60 * int(clock[2]) + float(clock[3].replace(",", "."))


@dataclass(frozen=True)
class _Sampling:
    """Sampling times of a column of times.

    Attributes:
        label: column of the header for its first channel.
        step: [s] nan if unknown.
        start: [s] of the first sample.
        ends: number of rows at the end of each block.
    """

    label: int
    step: float
    start: float
    ends: tuple[int, ...]


def _sampling(file: str, segment: _Segment, column: int, label: int) -> _Sampling:
    """Return the sampling by Delta_X and X0; a column of times must agree with it within its last printed digit.

    Raises:
        InputError: the times disagree.
    """
    cells, step, start = segment.column(column), segment.number("Delta_X", label), segment.number("X0", label)
    start = start if np.isfinite(start) else 0.0
    while cells and not cells[-1]:
        cells.pop()
    if not cells:
        return _Sampling(label, step, start, (len(segment.rows),))
    times, digit = _numbers(cells), _digit(*cells[:: max(len(cells) // 100, 1)], cells[-1])
    where = f"{file}:{segment.line + int(np.argmin(np.isfinite(times))) + 1}"
    got, remedy = "a time that is no number", "export it again with all times"
    require(np.isfinite(times).all(), where, got, "times that increase", remedy, TIMES)
    digit += 4 * float(np.spacing(abs(times).max()))
    starts = [0, *(int(i) + 1 for i in np.flatnonzero(np.diff(times) < -digit)), len(times)]
    said, fine = step if step > 0 else None, _digit(segment.label("Delta_X", label).replace(segment.mark, "."))
    steps = []
    for begin, end in pairwise(starts):
        even = rounded_step(times[begin:end], digit, said, fine)
        if even is None:
            expected = said or float(np.diff(times[begin:end]).mean())
            late = abs(times[begin:end] - times[begin] - expected * np.arange(end - begin)) > digit
            row = begin + max(int(np.argmax(late)), 1)
            got, source = f"a step of {times[row] - times[row - 1]:.6g} s", "by Delta_X" if said else "the mean step"
            remedy = "export evenly sampled waveforms with their true Delta_X"
            raise refusal(f"{file}:{segment.line + row + 1}", got, f"{expected:.6g} s, {source}", remedy, TIMES)
        steps.append((end - begin, even))
    start = start if abs(start - times[0]) <= digit else float(times[0])
    return _Sampling(label, max(steps)[1], start, tuple(starts[1:]))


def _digit(*cells: str) -> float:
    """Return the value of one unit in the last printed digit; some writers drop trailing zeros."""
    fixed, floating = [], [0.0]
    for cell in cells:
        found = _NUMBER.fullmatch(cell)
        if found and found["power"] is None:
            fixed.append(10.0 ** -len(found["digits"] or ""))
        elif found and _as_number(cell):
            floating.append(10.0 ** (int(found["power"]) - len(found["digits"] or "")))
    return min(fixed) if fixed else max(floating)


def _numbers(cells: Sequence[str]) -> np.ndarray:
    """Return cells as numbers (T,); nan for any other text."""
    try:
        return np.array(cells, float)
    except ValueError:
        return np.array([_as_number(cell) for cell in cells])


def _as_number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return float("nan")


def _joined(file: str, segments: list[list[Channel]]) -> Iterator[Channel]:
    """Yield the channels of all segments, with their blocks in order.

    Raises:
        InputError: the segments differ in channels, lengths, sampling, or in the delay of a channel.
    """
    first = segments[0]
    for other in segments[1:]:
        forms = [[(each.name, each.unit, each.flaw, each.values.shape[1]) for each in own] for own in (first, other)]
        steps = [(a.step or 0.0, b.step or 0.0) for a, b in zip(first, other, strict=False)]
        alike = forms[0] == forms[1] and all(np.isclose(a, b, rtol=1e-3, atol=0) for a, b in steps)
        got, remedy = "segments that differ in channels, length, unit or step", "put them into files of their own"
        require(alike, file, got, "segments that are alike", remedy)
    for i, each in enumerate(first):
        values = np.concatenate([segment[i].values for segment in segments])
        starts = np.concatenate([np.full(len(segment[i].values), segment[i].start) for segment in segments])
        start = each.start if len(segments) == 1 else tuple(starts.tolist())
        yield Channel(each.name, values, each.unit, each.step, start, flaw=each.flaw, remedy=each.remedy)
