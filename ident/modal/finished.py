"""Modes that another program has estimated: frequency, damping ratio and shape, with standard deviations."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

import numpy as np
from jaxtyping import Complex, Float

from ident.errors import InputError, Problem
from ident.measure.channels import RESPONSE, ChannelRow, ChannelTable
from ident.measure.load import Load
from ident.measure.recordings import Recording, Shape
from ident.modal.frf import Place
from ident.text import did_you_mean, one_line, quoted

KINDS = ("frequency", "damping_ratio", "shape")
"""What a standard deviation may be of; that of a shape is a share of its largest motion."""
POLE = "pole"


@dataclass(frozen=True)
class FinishedModes:
    """Modes of a file, ascending in frequency.

    Attributes:
        frequency: (m,) [Hz] see `of`.
        damping: (m,) [-] damping ratios; zero where the file has none.
        shape: (O, m) complex motion of each response, of any scale.
        sd: (n,) standard deviations of frequencies, damping ratios, then real and imaginary parts of each shape.
        responses: places of the responses.
        of: what the frequencies are, one of `ident.measure.DEFINITIONS`.
    """

    frequency: Float[np.ndarray, "m"]
    damping: Float[np.ndarray, "m"]
    shape: Complex[np.ndarray, "O m"]
    sd: Float[np.ndarray, "n"]
    responses: tuple[Place, ...]
    of: str

    @property
    def covariance(self) -> Float[np.ndarray, "n n"]:
        """Covariance, in the order of `sd`: a file says nothing of correlations."""
        return np.diag(self.sd**2)

    @property
    def sigma(self) -> Float[np.ndarray, "2 m"]:
        """(2, m) [Hz, -] standard deviations of frequencies and damping ratios."""
        return self.sd[: 2 * len(self.frequency)].reshape(2, -1)

    @property
    def band(self) -> tuple[float, float]:
        """Lowest and highest frequency [Hz]."""
        return float(self.frequency[0]), float(self.frequency[-1])

    def of_shape(self, modes: Sequence[int]) -> Float[np.ndarray, "k k"]:
        """Return the covariance of the shapes of some modes: real parts, then imaginary ones, mode by mode."""
        count, size = 2 * len(self.frequency), 2 * len(self.shape)
        return np.diag(np.concatenate([self.sd[count + mode * size :][:size] for mode in modes]) ** 2)


@dataclass(frozen=True)
class FinishedTest:
    """A file of finished modes, and how the arm was held.

    Attributes:
        posture: (joints,) [rad]
        load: the load case, sensors included.
        drives: what held the motors.
        files: the file.
        modes: its modes.
    """

    posture: tuple[float, ...]
    load: Load
    drives: str
    files: tuple[str, ...]
    modes: FinishedModes


def is_finished(recording: Recording) -> bool:
    """Tell whether a file has modes only; functions beside them are identified anew."""
    return bool(recording.shapes) and not recording.channels


def finished_tests(
    table: ChannelTable, recordings: Mapping[str, Recording], sigma: Mapping[str, float], of: str | None = None
) -> tuple[FinishedTest, ...]:
    """Return the files of finished modes that a channel table speaks of.

    Args:
        table: with directions in the base frame.
        recordings: by file name.
        sigma: standard deviations as shares, by `KINDS`, where a file has none.
        of: what frequencies are, where a file does not say it.

    Raises:
        InputError: a channel that a file has not; no standard deviations, or no word for what frequencies are.
    """
    found, problems = list[FinishedTest](), list[Problem]()
    for name, recording in recordings.items():
        rows = [row for row in table.rows if row.role == RESPONSE and fnmatchcase(name, row.file)]
        if not (is_finished(recording) and rows):
            continue
        try:
            found.append(_test(name, recording, rows, sigma, of))
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    return tuple(found)


def _test(
    name: str, recording: Recording, rows: list[ChannelRow], sigma: Mapping[str, float], of: str | None
) -> FinishedTest:
    shapes = sorted(recording.shapes, key=lambda shape: shape.frequency)
    if problems := [*_lacking(name, recording, rows), *_unsaid(name, shapes, sigma, of)]:
        raise InputError(problems)
    motion = np.array([[shape.motion[row.channel] for shape in shapes] for row in rows], complex)
    frequency, damping = (np.array([getattr(s, key) for s in shapes], float) for key in ("frequency", "damping_ratio"))
    sd = [s.sigma.get("frequency", sigma.get("frequency", 0.0) * s.frequency) for s in shapes]
    sd += [s.sigma.get("damping_ratio", sigma.get("damping_ratio", 0.0) * s.damping_ratio) for s in shapes]
    for i, s in enumerate(shapes):
        share = sigma.get("shape", 0.0) * float(np.abs(motion[:, i]).max())
        sd += 2 * [s.sigma.get(row.channel, share) for row in rows]
    places = tuple(Place(row.point, row.direction) for row in rows if row.direction is not None)
    modes = FinishedModes(frequency, damping, motion, np.array(sd), places, next(s.of for s in shapes) or of or "")
    return FinishedTest(rows[0].posture, rows[0].load, rows[0].drives, (name,), modes)


def _lacking(name: str, recording: Recording, rows: list[ChannelRow]) -> Iterator[Problem]:
    for row in rows:
        if any(row.channel not in shape.motion for shape in recording.shapes):
            remedy = did_you_mean(row.channel, recording.names, f"it has {', '.join(recording.names[:8])}")
            yield Problem(
                row.where, quoted(row.channel), f"a channel of each mode of {quoted(name)}", remedy, "channel"
            )
        if row.sensitivity is not None:
            remedy = "empty the cell: a shape has any scale, the same for all of its channels"
            yield Problem(row.where, "a sensitivity", "none for finished modes", remedy, "sensitivity")
        if (row.posture, row.load, row.drives) != (rows[0].posture, rows[0].load, rows[0].drives):
            remedy = "a file is of one state of the arm"
            yield Problem(row.where, "another posture, load or state of the drives", "the file's first", remedy, "q1")


def _unsaid(name: str, shapes: Sequence[Shape], sigma: Mapping[str, float], of: str | None) -> Iterator[Problem]:
    """Yield what neither the file nor the options say: it is asked for by name."""
    file = one_line(name)
    for kind in KINDS:
        here = all(_has(shape, kind) for shape in shapes)
        if not here and kind not in sigma:
            remedy = f"give their standard deviation as a share, such as `sigma` {kind}=0.01, or in the file"
            yield Problem(file, f"{kind} without a standard deviation", "one for each", remedy, "sigma")
    if not all(shape.of for shape in shapes) and not of:
        remedy = "say it by `frequency_is`: undamped, pole (|pole| / 2 pi) or damped"
        yield Problem(file, "frequencies of modes", "what they are of a damped mode", remedy, "frequency_is")


def _has(shape: Shape, kind: str) -> bool:
    if kind == "shape":
        return all(name in shape.sigma for name in shape.motion)
    return kind in shape.sigma or (kind == "damping_ratio" and shape.damping_ratio == 0)
