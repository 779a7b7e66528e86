"""Modes identified by other software, with their covariance where it exports one."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ident.errors import Problem, every, refuse
from ident.measure.channels import RESPONSE, ChannelRow, ChannelTable
from ident.measure.recordings import Recording, Shape
from ident.modal.frf import HeldArm, ModeSet
from ident.modal.recorded import STATE, check_state, is_finished, place_of, rows_of, state_of
from ident.text import did_you_mean, one_line, quoted

KINDS = ("frequency", "damping_ratio", "shape")
"""Quantities with a standard deviation; that of a shape is a share of its largest motion."""
POLE = "pole"


@dataclass(frozen=True)
class FinishedModes(ModeSet):
    """Modes of a file: missing damping ratios are zero, shapes have any scale, correlations are unknown.

    Attributes:
        of: definition of the frequencies, one of `ident.measure.DEFINITIONS`.
    """

    of: str


@dataclass(frozen=True)
class FinishedTest(HeldArm):
    """A file of finished modes, and the state of the arm.

    Attributes:
        modes: its modes.
    """

    modes: FinishedModes


def finished_tests(
    table: ChannelTable, recordings: Mapping[str, Recording], sigma: Mapping[str, float], of: str | None = None
) -> tuple[FinishedTest, ...]:
    """Return the files of finished modes in a channel table.

    Args:
        table: with directions in the base frame.
        recordings: by file name.
        sigma: relative standard deviations, by `KINDS`, for files without them.
        of: definition of the frequencies, for files without it.

    Raises:
        InputError: a channel is not in the file, or standard deviations or the definition of frequencies are missing.
    """
    every_row = ((name, rows_of(table, name, recording)) for name, recording in recordings.items())
    rows = {name: [row for row in own if row.role == RESPONSE] for name, own in every_row}
    names = [name for name, recording in recordings.items() if is_finished(recording) and rows[name]]
    return tuple(every(lambda name: _test(name, recordings[name], rows[name], sigma, of), names))


def _test(
    name: str, recording: Recording, rows: list[ChannelRow], sigma: Mapping[str, float], of: str | None
) -> FinishedTest:
    shapes = sorted(recording.shapes, key=lambda shape: shape.frequency)
    refuse([*_lacking(name, recording, rows), *_unsaid(name, shapes, sigma, of)])
    check_state(rows, STATE)
    motion = np.array([[shape.motion[row.channel] for shape in shapes] for row in rows], complex)
    frequency, damping = (np.array([getattr(s, key) for s in shapes], float) for key in ("frequency", "damping_ratio"))
    sd = [s.sigma.get("frequency", sigma.get("frequency", 0.0) * s.frequency) for s in shapes]
    sd += [s.sigma.get("damping_ratio", sigma.get("damping_ratio", 0.0) * s.damping_ratio) for s in shapes]
    for i, s in enumerate(shapes):
        share = sigma.get("shape", 0.0) * float(np.abs(motion[:, i]).max())
        sd += 2 * [s.sigma.get(row.channel, share) for row in rows]
    covariance, places = np.diag(np.array(sd) ** 2), tuple(map(place_of, rows))
    band, of = (float(frequency[0]), float(frequency[-1])), next(s.of for s in shapes) or of or ""
    modes = FinishedModes(frequency, damping, motion, covariance, places, band, of)
    return FinishedTest(*state_of(rows[0]), (name,), modes)


def _lacking(name: str, recording: Recording, rows: list[ChannelRow]) -> Iterator[Problem]:
    for row in rows:
        if any(row.channel not in shape.motion for shape in recording.shapes):
            remedy = did_you_mean(row.channel, recording.names, f"it has {', '.join(recording.names[:8])}")
            expected = f"a channel of each mode of {quoted(name)}"
            yield Problem(row.where, quoted(row.channel), expected, remedy, "channel")
        if row.sensitivity is not None:
            remedy = "empty the cell: a shape has any scale, the same for all of its channels"
            yield Problem(row.where, "a sensitivity", "none for finished modes", remedy, "sensitivity")


def _unsaid(name: str, shapes: Sequence[Shape], sigma: Mapping[str, float], of: str | None) -> Iterator[Problem]:
    """Yield the inputs missing from both the file and the options, by name."""
    file = one_line(name)
    has = {
        "frequency": all("frequency" in shape.sigma for shape in shapes),
        "damping_ratio": all("damping_ratio" in shape.sigma or shape.damping_ratio == 0 for shape in shapes),
        "shape": all(name in shape.sigma for shape in shapes for name in shape.motion),
    }
    for kind in KINDS:
        if kind not in sigma and not has[kind]:
            remedy = f"give their standard deviation as a share, such as `sigma` {kind}=0.01, or in the file"
            yield Problem(file, f"{kind} without a standard deviation", "one for each", remedy)
    if not all(shape.of for shape in shapes) and not of:
        remedy = "say it by `frequency_is`: undamped, pole (|pole| / 2 pi) or damped"
        yield Problem(file, "frequencies of modes", "what they are of a damped mode", remedy)
