"""Universal files (UFF, UNV): datasets 58 in ASCII and binary, 55, 15 and 2411; other types are skipped.

References:
    I-DEAS universal file formats, University of Cincinnati, Structural Dynamics Research Laboratory.
"""

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import cycle
from pathlib import Path

import numpy as np

from ident.errors import NoChannelError, Problem, refusal, require
from ident.measure.recordings.recording import Channel, Contents, Shape, damaged, over
from ident.text import by_key, one_line, quoted

KIND = "a universal file (UFF)"
DIRECTIONS = {
    0: "S",
    **{sign * k: f"{'+' if sign > 0 else '-'}{name}" for k, name in enumerate(("X", "Y", "Z"), 1) for sign in (1, -1)},
    **{sign * (k + 3): f"{'+' if sign > 0 else '-'}R{name}" for k, name in enumerate("XYZ", 1) for sign in (1, -1)},
}
"""Words for the numbers of directions: translations 1 to 3, rotations 4 to 6, a scalar 0."""
QUANTITIES = {8: " displacement", 9: " force", 11: " velocity", 12: " acceleration", 13: " force"}
"""Words for the quantity of a function, by the number of its specific data type."""
TIME, RESPONSE = 1, 4
"""Numbers of the supported functions: samples over time, frequency response."""
FUNCTIONS = (
    "unknown", "samples over time", "auto-spectrum", "cross-spectrum", "frequency response", "transmissibility",
    "coherence", "auto-correlation", "cross-correlation", "power spectral density", "energy spectral density",
    "probability density", "spectrum",
)  # fmt: skip
"""Words for the numbers of functions, from 0."""
REAL, COMPLEX, DOUBLE = (2, 4), (5, 6), (4, 6)
"""Types of ordinates: real, complex, and double precision."""
MODE = (2, 3, 7)
"""Analysis types of a dataset 55 that hold modes: real, and complex of first and second kind."""
NODES, SHAPE, FUNCTION = (15, 2411), 55, 58
"""Supported types of datasets."""
HEADER = 11
"""Lines of a dataset 58 before its values."""
FIELDS = 6
"""Most numbers on a line of values: some writers fill the last line with zeros."""
ROUNDED = 1e-5
"""Largest difference of two abscissas by rounding to E13.5, as a share of the largest abscissa."""
_TAG = rb" {4}-1 *(?=[\r\n]|\Z)"
_START = re.compile(rb"(?:\A|(?<=[\r\n]))" + _TAG)
"""Line that starts and ends a dataset."""
_BINARY_END = re.compile(rb"[\r\n]{0,2}" + _TAG)
"""The same after binary values, where it has no line of its own."""
_LINE = re.compile(rb"[^\r\n]*(?:\r\n|\r|\n)")
_EXPONENT = re.compile(r"(?<=[\d.])([-+]\d+)$")
"""An exponent without its letter, as Fortran writes those of three digits."""
_EVENT = re.compile(
    r"\b(hits?|impacts?|runs?|records?|blocks?|frames?|measurements?|meas|trials?|shots?|events?|averages?)\b", re.I
)
"""Words of an ID line whose number counts recordings, not sensors."""


def read(path: Path, data: bytes) -> Contents:
    """Return the content of a universal file.

    Raises:
        NoChannelError: it has only unsupported functions or datasets.
    """
    functions, shapes, places = list[_Function](), list[Shape](), dict[str, tuple[float, float, float]]()
    others, passed = Counter[str](), set[int]()
    for dataset in _datasets(path, data):
        try:
            if dataset.kind == FUNCTION:
                function = _function(path, dataset)
                functions += [function] if isinstance(function, _Function) else []
                others.update([function] if isinstance(function, str) else [])
            elif dataset.kind == SHAPE:
                shapes += _shape(dataset)
            elif dataset.kind in NODES:
                places |= _places(dataset)
            else:
                passed.add(dataset.kind)
        except (ValueError, OverflowError) as error:
            damaged(path, KIND, f"dataset {dataset.number}, of type {dataset.kind}: {one_line(str(error))}")
    if not functions and not shapes and (others or not places):
        kinds = [f"{count} function{'s' * (count > 1)} of kind {kind}" for kind, count in others.items()]
        got = ", ".join(kinds) or f"datasets of type {', '.join(map(str, sorted(passed or {SHAPE})))}"
        expected = "samples over time, frequency responses or modes"
        raise NoChannelError(Problem(one_line(str(path)), got, expected, "export one of these"))
    return tuple(_joined(path, functions)), tuple(shapes), places


@dataclass(frozen=True)
class _Dataset:
    """A dataset as bytes.

    Attributes:
        number: of the dataset in its file, from 1.
        kind: its type.
        head: the line with its type.
        binary: whether it is a function with binary values.
        body: the bytes after that line.
    """

    number: int
    kind: int
    head: str
    binary: bool
    body: bytes

    @property
    def lines(self) -> list[str]:
        return _text(self.body).splitlines()


def _datasets(path: Path, data: bytes) -> Iterator[_Dataset]:
    """Yield the datasets of a file; refuse a file with an unfinished dataset."""
    number, at = 0, 0
    while tag := _START.search(data, at):
        if number and data[at : tag.start()].strip():
            damaged(path, KIND, f"dataset {number} has no end")
        first = _LINE.match(data, tag.end())
        line = _LINE.match(data, first.end()) if first else None
        if line is None or not line.group().strip():
            at = tag.end()
            break
        number += 1
        head = _text(line.group())
        try:
            kind = int(head[:6])
        except ValueError:
            kind = -1
        if kind < 0:
            damaged(path, KIND, f"dataset {number} has no type")
        binary = kind == FUNCTION and head[6:7].lower() == "b"
        end = _binary_end(data, line.end(), head) if binary else _START.search(data, line.end())
        if end is None:
            damaged(path, KIND, "its last dataset has no end")
        yield _Dataset(number, kind, head, binary, data[line.end() : end.start()])
        at = end.end()
    if not number:
        damaged(path, KIND, "no dataset in it")
    if data[at:].strip(b" \t\r\n\0\x1a"):
        damaged(path, KIND, "its last dataset has no end")


def _binary_end(data: bytes, at: int, head: str) -> re.Match[bytes] | None:
    """Return the tag after binary values: at the header's byte count, since values may contain it; or the next tag.

    Args:
        data: of the file.
        at: start of the line after its type.
        head: the line with its type and number of bytes.
    """
    _, at = _header(data, at)
    size = head[31:43].strip()
    there = _BINARY_END.match(data, at + int(size)) if size.isdecimal() else None
    return there or _BINARY_END.search(data, at)


def _header(data: bytes, at: int = 0) -> tuple[list[str], int]:
    """Return the lines of a dataset 58 before its values, and the position of their end."""
    lines = list[str]()
    while len(lines) < HEADER and (line := _LINE.match(data, at)):
        at = line.end()
        lines.append(_text(line.group()).rstrip("\r\n"))
    return lines, at


def _text(data: bytes) -> str:
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        return data.decode("latin-1")


@dataclass(frozen=True)
class _Function:
    """A function as a channel of one block, with labels that may distinguish it at its node and direction.

    Attributes:
        channel: named by node, direction and quantity.
        place: node and direction.
        labels: entity and label of the ordinate.
        reference_entity: entity of the force.
        identity: ID lines.
        has_node: whether the response has a node.
    """

    channel: Channel
    place: str
    labels: tuple[str, ...]
    reference_entity: str
    identity: tuple[str, ...]
    has_node: bool

    @property
    def is_force(self) -> bool:
        """Whether the function is a force, by its quantity or unit."""
        return self.channel.name.endswith(" force") or self.channel.unit in ("N", "kN", "lbf")

    def called(self, label: str, reference: str = "") -> "_Function":
        """Return the function with more labels in its names."""
        name, force = self.channel.name, self.channel.reference
        name = f"{self.place} {label}{name.removeprefix(self.place)}" if label else name
        force = " ".join([*force.split(" ")[:1], reference, *force.split(" ")[1:]]) if reference else force
        return replace(self, channel=replace(self.channel, name=name, reference=force))


def _function(path: Path, dataset: _Dataset) -> _Function | str:
    """Return a dataset 58 with samples over time or a frequency response; for any other function its name."""
    (header, at), file = _header(dataset.body), one_line(str(path))
    if len(header) < HEADER:
        raise ValueError(f"fewer than {HEADER} lines")
    kind, _, _, _, entity, node, direction, *of_force = _cut(header[5], 5, 10, 5, 10, 11, 10, 4, 11, 10, 4)
    force_entity, force_node, force_direction = of_force
    function = _whole(kind)
    if function not in (TIME, RESPONSE):
        return FUNCTIONS[function] if 0 <= function < len(FUNCTIONS) else str(function)
    ordinates, count, spacing, *abscissa = _cut(header[6], 10, 10, 10, 13, 13)
    code, _, _, _, label, unit = map(_label, _cut(header[8], 10, 5, 5, 5, 21, 21))
    force_code, _, _, _, _, below = map(_label, _cut(header[9], 10, 5, 5, 5, 21, 21))
    place, name = _degree_of_freedom(node, direction, code)
    form, even = _whole(ordinates), _whole(spacing) == 1
    got, remedy = f"ordinates of type {form} for {name}", "export it again in single or double precision"
    require(form in REAL + COMPLEX, f"{file}, dataset {dataset.number}", got, "2 or 4 (real), 5 or 6 (complex)", remedy)
    width = (1 if form in REAL else 2) + (not even)
    table = _table(dataset, at, form, even).copy()
    padding = table[_whole(count) * width :]
    if not dataset.binary and len(padding) < FIELDS and not padding.any():
        table = table[: _whole(count) * width]
    if len(table) != _whole(count) * width:  # more if the header has another precision than the numbers
        raise ValueError(f"{len(table) / width:g} values of {name}, its header says {_whole(count)}")
    table = table.reshape(-1, width)
    start, step = map(_real, abscissa)
    if not even:
        start, step = _even(table[:, 0], step, f"{file}, dataset {dataset.number}", name)
    *_, of_axis = map(_label, _cut(header[7], 10, 5, 5, 5, 21, 21))
    if not (np.isfinite(start) and 0 <= step < np.inf):
        raise ValueError(f"an abscissa from {start:g} in steps of {step:g}")
    values = table[:, -1] if form in REAL else table[:, -2] + 1.0j * table[:, -1]
    if function == RESPONSE:
        real = f"real ordinates (type {form})" if form in REAL else "imaginary parts that are all zero"
        fine, got = values.imag.any() or not values.any(), f"{real} for the frequency response {name}"
        require(fine and form in COMPLEX, file, got, "complex ordinates", "export real and imaginary parts")
    else:
        got = f"complex ordinates (type {form}) for the samples of {name}"
        require(not values.imag.any(), file, got, "real ordinates", "export the samples over time")
    identity = tuple(_label(each) for each in header[:5])
    labels, has_node = (_label(entity), label), bool(_whole(node))
    if function == TIME:
        channel = over(Channel(name, values.real[None].astype(float), unit, step or None, start), of_axis, "time")
        return _Function(channel, place, labels, "", identity, has_node)
    _, reference = _degree_of_freedom(force_node, force_direction, force_code)
    numerator = unit.removesuffix(f"/{below}") if below else unit
    channel = Channel(name, values[None].astype(complex), numerator, step or None, start, reference, below)
    channel = over(channel, of_axis, "frequency")
    return _Function(channel, place, labels, _label(force_entity), identity, has_node)


def _table(dataset: _Dataset, at: int, form: int, even: bool) -> np.ndarray:
    """Return the numbers of a dataset 58 in order."""
    if dataset.binary:
        order, size = "<" if _whole(dataset.head[7:13]) == 1 else ">", 8 if form in DOUBLE else 4
        payload = dataset.body[at:]
        return np.frombuffer(payload[: len(payload) // size * size], f"{order}f{size}").astype(float)
    widths = [13] if form not in DOUBLE else [20] if even else [13, 20] if form in REAL else [13, 20, 20]
    lines = _text(dataset.body[at:]).splitlines()
    return np.array([_number(field) for line in lines for field in _fields(line.rstrip(), widths)], float)


def _fields(line: str, widths: Sequence[int]) -> Iterator[str]:
    """Yield the fields of a line with repeating widths."""
    at = 0
    for width in cycle(widths):
        if at >= len(line):
            return
        yield line[at : at + width]
        at += width


def _even(abscissa: np.ndarray, step: float, where: str, name: str) -> tuple[float, float]:
    """Return start and step of an abscissa given value by value.

    It counts as even to 1 % of a step, and to the last of its six printed digits.

    Args:
        abscissa: (T,) [s or Hz]
        step: [s or Hz] in the header, 0 for none.
        where: for a message.
        name: of the channel, for a message.
    """
    if len(abscissa) < 2 or not np.isfinite(abscissa).all():
        raise ValueError(f"no abscissa of {name}")
    span, largest = float(abscissa[-1] - abscissa[0]), float(np.abs(abscissa).max())
    mean = span / (len(abscissa) - 1)
    rounding = min(ROUNDED * largest, mean) if largest < 100 * span else 0.0
    wrong = np.abs(abscissa - (abscissa[0] + mean * np.arange(len(abscissa)))) > max(0.01 * mean, rounding)
    got = f"{name} at uneven steps, about value {int(np.argmax(wrong)) + 1}"
    require(mean > 0 and not wrong.any(), where, got, "even steps", "resample it, then export it again")
    return float(abscissa[0]), step if abs(step - mean) <= ROUNDED * mean else mean


def _degree_of_freedom(node: str, direction: str, code: str) -> tuple[str, str]:
    """Return node and direction, without and with the quantity: force and acceleration may share a node."""
    place = f"{_whole(node)}:{DIRECTIONS.get(_whole(direction), '?')}"
    return place, place + QUANTITIES.get(_whole(code), "")


def _label(text: str) -> str:
    text = text.strip()
    return "" if text.upper() == "NONE" else text


def _cut(line: str, *widths: int) -> list[str]:
    """Return the fields of a line by their widths, without surrounding blanks."""
    ends = np.cumsum(widths)
    return [line[end - width : end].strip() for end, width in zip(ends, widths, strict=True)]


def _whole(text: str) -> int:
    """Return a whole number; an empty field is 0, as Fortran reads it."""
    try:
        return int(text or "0")
    except ValueError:
        raise ValueError(f"{quoted(text)} is no whole number") from None


def _real(text: str) -> float:
    return _number(text) if text.strip() else 0.0


def _number(text: str) -> float:
    """Return a number; its exponent may have the letter D, or none before three digits."""
    try:
        return float(text)
    except ValueError:
        pass
    try:
        return float(_EXPONENT.sub(r"E\1", text.strip().upper().replace("D", "E")))
    except ValueError:
        raise ValueError(f"{quoted(text.strip())} is no number") from None


def _joined(path: Path, functions: Sequence[_Function]) -> list[Channel]:
    """Return the functions of one channel as its blocks, in the order of the file."""
    groups = by_key(((each.channel.name, each.channel.reference), each) for each in functions)
    parts = [part for group in groups.values() for part in _by_label(group)]
    return [_blocks(split) for part in parts for split in _by_identity(path, part, parts)]


def _by_label(group: list[_Function]) -> list[list[_Function]]:
    """Return the functions of one node and direction by entity and label of the ordinate, where these differ."""
    differ = [i for i in range(2) if len({each.labels[i] for each in group}) > 1]
    several = len({each.reference_entity for each in group}) > 1

    def key(each: _Function) -> tuple[str, str]:
        label = " ".join(filter(None, (each.labels[i] for i in differ)))
        return label, each.reference_entity if several else ""

    return [
        [each.called(*words) for each in part] for words, part in by_key((key(each), each) for each in group).items()
    ]


def _by_identity(path: Path, part: list[_Function], parts: list[list[_Function]]) -> list[list[_Function]]:
    """Split functions of possibly several sensors by a distinguishing ID line.

    Several functions of one node and direction are blocks of one channel, hit by hit. They are doubtful if they are not
    alike, if they have no node and a number of blocks that no force has, or if no other function of the file repeats.
    An ID line shared with other channels, or one that counts hits, does not identify sensors.

    Raises:
        InputError: no ID line distinguishes them.
    """
    if len(part) == 1:
        return [part]
    finished = bool(part[0].channel.reference)
    others = [each for each in parts if each is not part and bool(each[0].channel.reference) == finished]
    hits = any(len(each) == len(part) and each[0].is_force != part[0].is_force for each in others)
    alone = bool(others) and all(len(each) == 1 for each in others)
    if _are_alike(part) and (hits or part[0].has_node) and not alone:
        return [part]
    for line in (0, 1, 3, 4):  # the third is the date
        words = [each.identity[line] for each in part]
        if len(set(words)) < 2 or not all(words):
            continue
        if {each.identity[line] for other in others for each in other} & set(words):
            continue
        if len({re.sub(r"\d+", "", word) for word in words}) == 1 and _EVENT.search(words[0]):
            if _are_alike(part):
                return [part]
            continue
        split = [[each.called(word) for each in part if each.identity[line] == word] for word in dict.fromkeys(words)]
        if all(map(_are_alike, split)):
            return split
    if _are_alike(part) and part[0].has_node:
        return [part]
    alike = "" if _are_alike(part) else "differ in length, sampling or unit, and that "
    got = f"{len(part)} functions of {part[0].channel.name} that {alike}nothing tells apart"
    got += f" (ID lines: {', '.join(map(quoted, _identities(part[:4])))})"
    expected = "a node, an entity name or an ID line of its own for each channel"
    raise refusal(one_line(str(path)), got, expected, "name the channels in the program that exports them")


def _identities(part: Sequence[_Function]) -> tuple[str, ...]:
    """Return the ID lines of each function as one text."""
    return tuple(" / ".join(filter(None, each.identity)) for each in part)


def _are_alike(part: Sequence[_Function]) -> bool:
    """Whether functions may be blocks of one channel."""
    channels = [each.channel for each in part]
    return len({(own.values.shape, own.step, own.unit, own.reference and own.start) for own in channels}) == 1


def _blocks(part: Sequence[_Function]) -> Channel:
    first, made = part[0].channel, np.concatenate([each.channel.values for each in part])
    starts = np.ravel([each.channel.start for each in part])
    start = tuple(starts.tolist()) if np.ptp(starts) else first.start
    return replace(first, values=made, start=start, notes=_identities(part) if len(part) > 1 else ())


def _shape(dataset: _Dataset) -> list[Shape]:
    """Return the mode of a dataset 55; frequency and damping of a complex mode are those of its pole."""
    lines = dataset.lines
    if len(lines) < 9:
        raise ValueError("fewer than 9 lines")
    _, analysis, _, _, form, width = map(_whole, _cut(lines[5], *6 * [10]))
    if analysis not in MODE:
        return []
    if form not in (2, 5) or width < 3:
        raise ValueError(f"data of type {form} with {width} values a node, expected type 2 or 5 with 3 or 6")
    first, second, third, *_ = map(_real, _cut(lines[7], *6 * [13]))
    if analysis == 2:
        frequency, ratio = first, third
    else:
        pole = first + 1.0j * second
        if not pole:
            raise ValueError("a pole of zero")
        frequency, ratio = abs(pole) / (2 * np.pi), -pole.real / abs(pole)
    nodes, rows = _nodal_values([line for line in lines[8:] if line.strip()], width * (1 if form == 2 else 2))
    values = rows if form == 2 else rows[:, 0::2] + 1.0j * rows[:, 1::2]
    motion = {
        f"{node}:{DIRECTIONS[k]}": complex(value)
        for k in (1, 2, 3)
        for node, value in zip(nodes, values[:, k - 1], strict=True)
    }
    return [Shape(frequency, ratio, motion, of="" if analysis == 2 else "pole")]


def _nodal_values(lines: Sequence[str], count: int) -> tuple[list[int], np.ndarray]:
    """Return the nodes of a dataset 55 and their values (nodes, count), which may span several lines."""
    nodes, rows, at = list[int](), list[list[float]](), 0
    while at < len(lines):
        nodes.append(_whole(lines[at].strip()))
        row, at = list[float](), at + 1
        while len(row) < count:
            if at == len(lines):
                raise ValueError(f"{len(row)} of {count} values of node {nodes[-1]}")
            row += [_number(field) for field in _fields(lines[at].rstrip(), [13])]
            at += 1
        rows.append(row[:count])
    return nodes, np.array(rows, float).reshape(-1, count)


def _places(dataset: _Dataset) -> dict[str, tuple[float, float, float]]:
    """Return the coordinates of nodes of a dataset 15 (one line each) or 2411 (two lines each)."""
    words = list[str]()
    for line in dataset.lines:
        has_blanks = dataset.kind != 15 or len(line.split()) in (0, 7)
        words += line.split() if has_blanks else _cut(line, *4 * [10], *3 * [13])
    if len(words) % 7:
        raise ValueError(f"{len(words)} numbers, expected seven for each node")
    rows = np.array([_number(word) for word in words], float).reshape(-1, 7)
    return {str(int(node)): (float(x), float(y), float(z)) for node, _, _, _, x, y, z in rows}
