"""A recording as a value: channels over time, or finished frequency responses, in the units of their file."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from ident.errors import InputError, Problem
from ident.text import one_line


@dataclass(frozen=True)
class Channel:
    """What one sensor gave, in blocks of equal length: hits that were triggered, or one block for all of the time.

    Attributes:
        name: as the file names it; `12:+Z acceleration` for node 12, direction +Z of a universal file.
        values: (B, T) [unit] samples of B blocks; of a frequency response (B, F) [unit / reference_unit], complex.
        unit: as the file says it; empty where it says none.
        step: [s] between samples, or [Hz] between lines; None where the file does not say it.
        start: [s or Hz] of the first sample or line; (B,) [s] of those of each block, where they differ.
        reference: channel of the force, of a frequency response; empty for samples over time.
        reference_unit: the force's unit, as the file says it.
        notes: (B,) what the file says of each of several blocks, for messages.
    """

    name: str
    values: np.ndarray
    unit: str = ""
    step: float | None = None
    start: float | tuple[float, ...] = 0.0
    reference: str = ""
    reference_unit: str = ""
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Shape:
    """A finished mode, as a file has it.

    Attributes:
        frequency: [Hz] of the mode, undamped or damped as the program that wrote it has it.
        damping_ratio: [-]
        motion: complex motion by channel such as `12:+Z`, of any scale.
        sigma: standard deviations, where the file has them: of `frequency` [Hz], `damping_ratio` [-], and of real and
            imaginary part of the motion, by channel.
        of: what the frequency is, one of `ident.measure.DEFINITIONS`; empty where the file does not say it.
    """

    frequency: float
    damping_ratio: float
    motion: Mapping[str, complex]
    sigma: Mapping[str, float] = field(default_factory=dict)
    of: str = ""


@dataclass(frozen=True)
class Recording:
    """What a file holds.

    Attributes:
        path: the file.
        sha256: hash of its bytes.
        channels: in the order of the file.
        shapes: finished modes.
        places: (3,) [as the file] coordinates of nodes, by node, in a frame that only the test knows.
        holds: what is in it instead of channels, for messages; empty where nothing is to be said.
    """

    path: str
    sha256: str
    channels: tuple[Channel, ...]
    shapes: tuple[Shape, ...] = ()
    places: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    holds: str = ""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its channels and of the forces that its frequency responses refer to, each once."""
        responses = (channel.name for channel in self.channels)
        forces = (channel.reference for channel in self.channels if channel.reference)
        moving = (name for shape in self.shapes for name in shape.motion)
        return tuple(dict.fromkeys([*responses, *forces, *moving]))


Contents = tuple[tuple[Channel, ...], tuple[Shape, ...], dict[str, tuple[float, float, float]]]
"""What a reader returns: channels, finished modes, places of nodes."""


def columns(name: str, values: Any, **more: Any) -> list[Channel]:
    """Return an array as channels: each column one; the longer side of an array is time."""
    table = np.asarray(values, float)
    if table.ndim == 2 and 1 in table.shape:
        table = table.ravel()
    if table.ndim == 1:
        return [Channel(name, table[None], **more)] if table.size > 1 else []
    if table.ndim != 2 or not table.size:
        return []
    table = table.T if table.shape[0] > table.shape[1] else table
    return [Channel(f"{name}:{i}", row[None], **more) for i, row in enumerate(table, 1)]


class NoChannelError(InputError):
    """A sound file holds nothing that a test could take."""


def lacking(path: Path, package: str) -> NoReturn:
    """Refuse a file that needs a package which is not installed."""
    got = f"a file that needs the package {package}"
    raise InputError(Problem(one_line(str(path)), got, f"{package} to read it", "pip install 'ident[modal]'")) from None


def damaged(path: Path, kind: str, why: Exception | str) -> NoReturn:
    """Refuse a file that its reader cannot read."""
    reason = why if isinstance(why, str) else f"{type(why).__name__}: {one_line(str(why))[:80]}".rstrip(": ")
    got = f"a damaged or truncated file ({reason})"
    raise InputError(Problem(one_line(str(path)), got, kind, "export it anew")) from None
