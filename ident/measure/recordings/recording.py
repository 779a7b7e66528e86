"""A recording as a value: channels over time, or finished frequency responses, in the units of their file."""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NoReturn

import numpy as np

from ident.errors import InputError, LackingError, Problem, refusal
from ident.files import SourceFile as SourceFile
from ident.measure.recordings.sampling import even_step
from ident.text import by_key, one_line, quoted
from ident.units import sensor_factor


@dataclass(frozen=True)
class Channel:
    """Data of one sensor in blocks of equal length: triggered hits, or one block for the whole time.

    Attributes:
        name: name in the file; `12:+Z acceleration` for node 12, direction +Z of a universal file.
        values: (B, T) [unit] samples of B blocks; of a frequency response (B, F) [unit / reference_unit], complex.
        unit: unit in the file; empty if it has none.
        step: [s] between samples, or [Hz] between lines; None if not in the file.
        start: [s or Hz] of the first sample or line; (B,) [s] by block, where blocks differ.
        reference: force channel of a frequency response; empty for samples over time.
        reference_unit: the force's unit in the file.
        notes: (B,) the file's text on each of several blocks, for messages.
        flaw: why its values cannot be used; empty where they can.
        remedy: what to export instead.
        remarks: what was taken from a program's convention, and done to its times.
        step_error: relative standard error of the step, where it was fitted to stamps that jitter.
        band: [Hz] up to which resampling has kept the amplitudes.
    """

    name: str
    values: np.ndarray
    unit: str = ""
    step: float | None = None
    start: float | tuple[float, ...] = 0.0
    reference: str = ""
    reference_unit: str = ""
    notes: tuple[str, ...] = ()
    flaw: str = ""
    remedy: str = ""
    remarks: tuple[str, ...] = ()
    step_error: float = 0.0
    band: float = np.inf


@dataclass(frozen=True)
class Shape:
    """A finished mode of a file.

    Attributes:
        frequency: [Hz] of the mode, undamped or damped as the exporting program defines it.
        damping_ratio: [-]
        motion: complex motion by channel such as `12:+Z`, of any scale.
        sigma: standard deviations, if in the file: of `frequency` [Hz], `damping_ratio` [-], and of real and
            imaginary part of the motion, by channel.
        of: definition of the frequency, one of `ident.measure.DEFINITIONS`; empty if not in the file.
    """

    frequency: float
    damping_ratio: float
    motion: Mapping[str, complex]
    sigma: Mapping[str, float] = field(default_factory=dict)
    of: str = ""


@dataclass(frozen=True)
class Recording:
    """Content of a file.

    Attributes:
        path: the file.
        sha256: hash of its bytes.
        channels: in the order of the file; those with the same name are flawed, as they could be confused.
        shapes: finished modes.
        places: (3,) [as the file] coordinates of nodes, by node, in the test's own frame.
        holds: content other than channels, for messages; empty for none.
    """

    path: str
    sha256: str
    channels: tuple[Channel, ...]
    shapes: tuple[Shape, ...] = ()
    places: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    holds: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "channels", tuple(_told_apart(self.channels)))

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks on its channels, each once."""
        return tuple(dict.fromkeys(remark for channel in self.channels for remark in channel.remarks))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its channels and of the forces that its frequency responses refer to, each once."""
        responses = (channel.name for channel in self.channels)
        forces = (channel.reference for channel in self.channels if channel.reference)
        moving = (name for shape in self.shapes for name in shape.motion)
        return tuple(dict.fromkeys([*responses, *forces, *moving]))


ONE_NAME = "channels of one name"
"""Flaw of channels that share a name."""


def _told_apart(channels: Iterable[Channel]) -> Iterator[Channel]:
    """Yield channels, with those that share a name marked as flawed. Exact duplicates count once."""
    for first, *more in by_key(((each.name, each.reference), each) for each in channels).values():
        same = [first, *(m for m in more if m.unit != first.unit or not np.array_equal(m.values, first.values))]
        units = ", ".join(quoted(each.unit or "no unit") for each in same)
        flaw, remedy = f"{len(same)} {ONE_NAME}, in {units}", "give each channel of the file a name of its own"
        yield from (replace(each, flaw=flaw, remedy=remedy) for each in same) if same[1:] else same


Contents = tuple[tuple[Channel, ...], tuple[Shape, ...], dict[str, tuple[float, float, float]]]
"""Result of a reader: channels, finished modes, places of nodes."""


def columns(name: str, values: np.ndarray, unit: str) -> list[Channel]:
    """Return a vector or a matrix (samples x channels) as channels, one per column."""
    table = np.squeeze(values).astype(float)
    if table.size < 2:
        return []
    rows = enumerate(np.atleast_2d(table.T), 1)
    return [Channel(f"{name}:{i}" if table.ndim > 1 else name, row[None], unit) for i, row in rows]


def over(channel: Channel, unit: str, quantity: str, later: float = 0.0) -> Channel:
    """Return a channel with step and start converted from the file's unit to SI; flawed if the unit is unknown.

    Args:
        channel: of one block.
        unit: empty for s or Hz.
        quantity: `time` or `frequency`.
        later: [s or Hz] added to its start.
    """
    unit = unit.strip(" []()")
    factor = sensor_factor(unit, quantity) if unit else 1.0
    assert isinstance(channel.start, float), "of one block"
    if not factor:
        words, si = ("times", "s") if quantity == "time" else ("frequencies", "Hz")
        return replace(channel, flaw=f"{words} in {quoted(unit)}", remedy=f"export them in {si}")
    return replace(channel, step=channel.step and channel.step * factor, start=channel.start * factor + later)


FORCE = "force"
"""Name of the force of frequency responses in a file without names; `force:2` for the second of several."""
FREQUENCY = re.compile(r"(?:.*[./])?(?:f|f_?hz|hz|freqs?(?:_?hz)?|frequency(?:_?hz)?|frequencies)", re.IGNORECASE)
"""Names of arrays of frequencies [Hz]."""
TIMES = re.compile(r"(?:.*[./])?(?:t|times?|time_?s|seconds|sec)", re.IGNORECASE)
"""Names of arrays of times."""
_PART = re.compile(
    r"(?P<lead>real|imag(?:inary)?|re|im)(?:\s+part)?(?:\s+of)?[\s_:(]+(?P<named>.+?)\)?"
    r"|(?P<name>.+?)[\s_:./(-]+(?P<trail>real|imag(?:inary)?|re|im)(?:\s+part)?\)?"
    r"|(?P<alone>real|imag(?:inary)?)(?:\s+part)?",
    re.IGNORECASE,
)
"""Names of the real and the imaginary part of a response, as `real H`, `H_imag`, `Re(H)`."""
Array = tuple[str, np.ndarray, str]
"""An array of a file: its name, values and unit."""
VECTORS = "save each channel as a column or a vector of its own, and each hit in a file of its own"
CHANNELS_MAX, SAMPLES_MIN = 64, 4
"""Most columns of a matrix of channels, and fewest rows per column; in any other matrix, rows may be hits."""
REAL = "values over frequency without an imaginary part"
EXPORT = "export the real and the imaginary part of the frequency response"


def response_and_part(name: str) -> tuple[str, str]:
    """Return the name of the response, and `r` or `i` for its real or imaginary part, empty for neither."""
    found = _PART.fullmatch(name)
    if not found:
        return name, ""
    word = found["lead"] or found["trail"] or found["alone"]
    return found["named"] or found["name"] or "H", word[0].lower()


def array_channels(arrays: Iterable[Array]) -> Iterator[Channel]:
    """Yield arrays of a file as channels, complex arrays as frequency responses.

    Args:
        arrays: name, values and unit of each. Complex ones are `(F,)`, `(F, O)` or `(F, O, I)` for O responses to I
            forces, with the axes in any order (of axes of equal length, F comes first). A vector of F frequencies is
            called `freq`, `frequency` or `f`, and increases. Real and imaginary part may be two arrays. A text in place
            of an array describes the content.
    """
    every = list(arrays)
    vectors = [(n, np.ravel(a).astype(float), u) for n, a, u in every if a.dtype.kind in "iuf" and a.size in a.shape]
    axes = {n: (v, u) for n, v, u in vectors if FREQUENCY.fullmatch(n) and v.size > 1 and (np.diff(v) > 0).all()}
    clocks = {v.size for name, v, _ in vectors if TIMES.fullmatch(name) and v.size > 1}
    used: set[str] = set()
    made: list[tuple[str, list[Channel]]] = []
    for name, values, unit in _complex(every, {v.size for v, _ in axes.values()}):
        near, axis, sizes = sorted(axes, key=lambda axis: _group(axis) != _group(name)), None, np.squeeze(values).shape
        most = min(CHANNELS_MAX, sizes[0] / SAMPLES_MIN) if len(sizes) == 2 else 0
        if values.dtype.kind == "U" or (values.dtype.kind != "c" and len(sizes) > 1 and sizes[-1] > most):
            flaw = str(values) if values.dtype.kind == "U" else f"an array of {' x '.join(map(str, sizes))}"
            made.append((name, [Channel(name, np.zeros((1, 1)), flaw=flaw, remedy=VECTORS)]))
        elif values.dtype.kind == "c":
            axis = next((axis for axis in near if axes[axis][0].size in values.shape), None)
            made.append((name, list(_responses(name, values, unit, axes.get(axis or "")))))
        else:
            found = columns(name, values, unit)
            lines = found[0].values.shape[1] if found and name not in axes else 0
            axis = next((axis for axis in near if axes[axis][0].size == lines and lines not in clocks), None)
            made.append((name, [replace(each, flaw=REAL, remedy=EXPORT) for each in found] if axis else found))
        used |= {axis} if axis else set()
    for name, channels in made:
        yield from channels if name not in used else ()


def _complex(every: list[Array], sizes: set[int]) -> list[Array]:
    """Return arrays, with real and imaginary parts of a response (with one of these numbers of lines) joined."""
    parts = {response_and_part(each[0]): each for each in every}
    for (response, part), (imaginary, b, below) in parts.items():
        real, a, unit = parts.get((response, "r"), parts.get((response, ""), ("", np.zeros(0), "")))
        if part == "i" and a.dtype.kind != "c" and a.shape == b.shape and below in ("", unit) and sizes & {*a.shape}:
            every = [(response, a + 1j * b, unit) if e[0] == real else e for e in every if e[0] != imaginary]
    return every


def _group(name: str) -> str:
    """Return the structure or group of an array."""
    return re.sub(r"[^./]*$", "", name)


def _responses(name: str, values: np.ndarray, unit: str, axis: tuple[np.ndarray, str] | None) -> Iterator[Channel]:
    """Yield frequency responses, or one flawed channel that names the missing part."""
    whole = Channel(name, values.reshape(1, -1), unit)
    if axis is None:
        if values.size > 1:
            remedy = "save their frequencies in Hz beside them, as a vector freq of the same length"
            yield replace(whole, flaw="complex values without frequencies", remedy=remedy)
        return
    frequency, of_frequency = axis
    try:
        step = even_step(frequency, name)
    except InputError:
        yield replace(whole, flaw="a frequency response at uneven frequencies", remedy="export it at even steps")
        return
    table = np.moveaxis(values, values.shape.index(frequency.size), -1)
    table = table.reshape([size for size in table.shape[:-1] if size > 1] + [frequency.size])
    if table.ndim > 3:
        remedy = "save it as lines, responses, forces"
        yield replace(whole, flaw=f"an array of {values.ndim} dimensions", remedy=remedy)
        return
    numerator, below = quotient(unit)
    for place in np.ndindex(table.shape[:-1]):
        own = f"{name}:{place[0] + 1}" if place else name
        force = f"{FORCE}:{place[1] + 1}" if len(place) > 1 else FORCE
        made = Channel(own, table[place][None], numerator, step, float(frequency[0]), force, below)
        yield over(made, of_frequency, "frequency")


def quotient(unit: str) -> tuple[str, str]:
    """Split the unit of a frequency response into that of the response and that of the force, if it has one."""
    above, _, below = (part.strip(" ()") for part in unit.rpartition("/"))
    is_force = below.lower().rstrip("s") in ("n", "kn", "mn", "lbf", "lb", "newton")
    return (above, below) if above and is_force else (unit, "")


def lacking(path: Path, package: str) -> NoReturn:
    """Refuse a file for want of a package that is not installed."""
    got = f"a file that needs the package {package}"
    raise LackingError(Problem(one_line(str(path)), got, f"{package} to read it", f"pip install {package}")) from None


def damaged(path: Path, kind: str, why: Exception | str) -> NoReturn:
    """Refuse a damaged or truncated file."""
    reason = why if isinstance(why, str) else f"{type(why).__name__}: {one_line(str(why))[:80]}".rstrip(": ")
    raise refusal(one_line(str(path)), f"a damaged or truncated file ({reason})", kind, "export it again") from None
