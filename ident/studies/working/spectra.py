"""The spectrum of a trace with the natural frequencies of the arm."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm
from ident.errors import refusal
from ident.identify.binding import loads_of
from ident.identify.modal_analysis import modal_analysis
from ident.measure import Load, Log, Trace
from ident.measure.grade import Grade
from ident.measure.trace import DIRECTIONS
from ident.studies.working.simulation import joined
from ident.text import quoted
from ident.vibrate.branches import branches
from ident.vibrate.compare import second_derivative
from ident.vibrate.lines import refined
from ident.vibrate.replay import replay
from ident.vibrate.spectra import Peak, Spectrogram, Spectrum, amplitude_spectrum, peaks, spectrogram

# -------- Marked modes
# Natural frequencies marked in a spectrum: of an arm held at a posture, or all along a motion.

MODES = 6
"""Number of marked modes."""
POSTURES = 400
"""Samples of a joint path at which the arm is held, at most: frequencies change slowly along it."""

ROUNDING = 1e-9
"""Time [s] by which a trace may exceed its path."""

Band = tuple[float, float]


@dataclass(frozen=True)
class MarkedModes:
    """The lowest natural frequencies of an arm.

    Attributes:
        arm: name of the arm.
        load: the load case.
        first: (driven,) [rad] the posture, or the first one of a motion.
        last: (driven,) [rad] the last one; the same if the arm is held.
        frequencies: (K,) [Hz] of each mode at equal time steps, by its label at the last posture; ascending there.
    """

    arm: str
    load: Load
    first: tuple[float, ...]
    last: tuple[float, ...]
    frequencies: Mapping[str, Float[np.ndarray, "K"]]

    @property
    def bands(self) -> dict[str, Band]:
        """The lowest and the highest frequency [Hz] of each mode, by its label."""
        return {label: (float(along.min()), float(along.max())) for label, along in self.frequencies.items()}

    @property
    def held(self) -> bool:
        """Whether the arm is held at one posture."""
        return all(low == high for low, high in self.bands.values())

    def near(self, frequency: float, within: float, direction: str) -> str | None:
        """Return the mode near a frequency, None for none.

        If several are near: one that moves in the direction, of these the one near for the longest time, then the
        nearest.

        Args:
            frequency: [Hz]
            within: [Hz] distance that counts as near.
            direction: `vertical` or `lateral`; empty if unknown.
        """
        apart = {label: np.abs(along - frequency) for label, along in self.frequencies.items()}
        near = {label: gap for label, gap in apart.items() if gap.min() <= within}
        rank = {label: (label.startswith(direction), (gap <= within).sum(), -gap.min()) for label, gap in near.items()}
        return max(rank, key=lambda label: rank[label], default=None)


def marked_at(arm: Arm, posture: tuple[float, ...], load: Load) -> MarkedModes:
    """Return the natural frequencies of an arm held at a posture [rad].

    Raises:
        InputError: the posture or the load does not match the arm.
        ModelError: the arm has no stable equilibrium there.
    """
    modes = modal_analysis(arm, posture, load, MODES)
    frequencies = np.asarray(modes.modes.frequency)[:, None]
    return MarkedModes(arm.name, load, posture, posture, dict(zip(map(str, modes.labels), frequencies, strict=True)))


def marked_along(arm: Arm, log: Log, span: tuple[float, float], load: Load) -> MarkedModes:
    """Return the natural frequencies of an arm held at the postures of a joint path, between two times [s].

    Raises:
        InputError: the path does not cover that time.
        ModelError: the arm has no stable equilibrium at some posture.
    """
    (start, end), time = span, log.time
    if start < time[0] - ROUNDING or end > time[-1] + ROUNDING:
        got, expected = f"{time[0]:.4g} to {time[-1]:.4g} s", f"the span of the trace, {start:.4g} to {end:.4g} s"
        raise refusal(log.path, got, expected, "cut the trace to it (`start`, `end`)", "time")
    at = np.linspace(start, end, min(POSTURES, len(time)))
    angles = np.stack([np.interp(at, time, log.angles[joint.name]) for joint in arm.driven])
    found = branches(arm, replay(at, angles), count=MODES, times=at - at[0], loads=loads_of(arm, load))
    frequencies = {str(found.labels[b]): found.median[b] for b in np.argsort(found.median[:, -1])}
    first, last = (tuple(round(float(angle), 9) for angle in angles[:, k]) for k in (0, -1))
    return MarkedModes(arm.name, load, first, last, frequencies)


# -------- Spectra
# The spectra of a trace as reported: compared with another trace, and over time.

Pulleys = Mapping[str, Float[np.ndarray, "T"]]
"""Rotation frequency [Hz] of pulleys, by name."""
PEAKS = 5
"""Peaks of each direction that are reported."""
SLOW = 3.0
"""Bins from zero in which a peak may be drift or the slow part of a motion; assumed."""
STANDING = 1e-3
"""Share of its highest speed below which a pulley counts as standing; assumed."""
SMALL = 0.02
"""Share of the largest peak below which a peak is not reported; assumed."""
NEAR = 0.05
"""Distance of a mode from a peak, relative to the frequency, up to which it is named; or one bin, if larger;
assumed."""
LONGEST, LEAST_SEGMENTS = 1.0, 4
"""Longest default segment [s] of a spectrogram, and least number of segments in a trace."""


@dataclass(frozen=True)
class Spectra:
    """The spectra of one trace, or of two.

    Attributes:
        directions: the requested directions.
        traces: by name, all of the same kind.
        spectra: by the same names, a column for each direction.
        upto: [Hz] upper end of the axis.
        pulleys: from the first trace's file; pulleys of equal speed have one name.
        modes: natural frequencies of the arm, if one was named.
        orders: orders of the pulleys drawn in the spectrograms.
        spectrograms: of the first trace by direction, if requested.
        remark: how the traces were made comparable; usually empty.
        grades: what each channel of the first file is worth, those that are not drawn last; none of a simulation.
    """

    directions: tuple[str, ...]
    traces: Mapping[str, Trace]
    spectra: Mapping[str, Spectrum]
    upto: float
    pulleys: Pulleys = field(default_factory=dict)
    modes: MarkedModes | None = None
    orders: tuple[float, ...] = (1.0,)
    spectrograms: Mapping[str, Spectrogram] = field(default_factory=dict)
    remark: str = ""
    grades: tuple[Grade, ...] = ()

    @property
    def name(self) -> str:
        """Name of the first trace."""
        return next(iter(self.traces))

    @property
    def kind(self) -> str:
        """`displacement` or `acceleration`; of a recording's channels also `velocity`, or their own unit."""
        return next(iter(self.traces.values())).kind

    @property
    def lines(self) -> dict[str, Float[np.ndarray, "T"]]:
        """Multiples of the pulleys' rotation frequencies [Hz] over the time of the first trace; NaN at standstill."""
        return joined(
            {
                f"{order:g} x {name}": np.where(frequency > STANDING * frequency.max(), order * frequency, np.nan)
                for name, frequency in self.pulleys.items()
                for order in self.orders
            }
        )

    @cached_property
    def peaks(self) -> dict[tuple[str, str], tuple[Peak, ...]]:
        """The strongest peaks by trace and direction, largest first, without slow drift, refined as lines."""
        return {(name, way): self._lines(name, way) for name in self.traces for way in self.directions}

    def _lines(self, name: str, direction: str) -> tuple[Peak, ...]:
        trace, spectrum = self.traces[name], self.spectra[name].column(self.directions.index(direction))
        largest = peaks(spectrum, PEAKS, (SLOW * spectrum.resolution, self.upto))
        found = [peak for peak in largest if peak.amplitude >= SMALL * largest[0].amplitude]
        return refined(spectrum, trace.values[direction], found, trace.step_error)

    def mode_near(self, name: str, direction: str, frequency: float) -> str | None:
        """Return the label of the mode near a peak [Hz] of a trace in a direction; see `MarkedModes.near`."""
        within = max(self.spectra[name].resolution, NEAR * frequency)
        way = {"z": "vertical"}.get(direction, "lateral" if direction in DIRECTIONS else "")
        return self.modes.near(frequency, within, way) if self.modes else None


def cut(trace: Trace, pulleys: Pulleys, start: float | None, end: float | None) -> tuple[Trace, Pulleys]:
    """Return the part of a trace and of its pulleys between two times [s]."""
    time = trace.time
    low = 0 if start is None else int(np.searchsorted(time, start - 1e-9))
    high = len(time) if end is None else int(np.searchsorted(time, end + 1e-9))
    if high - low < 2:
        got, expected = f"{max(high - low, 0)} samples up to `end`", f"a span within {time[0]:.4g} to {time[-1]:.4g} s"
        raise refusal("start", got, expected, "widen it")
    inside = slice(low, high)
    part = replace(trace, time=time[inside], values={d: values[inside] for d, values in trace.values.items()})
    return part, {name: frequency[inside] for name, frequency in pulleys.items()}


def common_directions(traces: Mapping[str, Trace], wanted: Sequence[str] | None) -> tuple[str, ...]:
    """Return the requested directions, which all traces must have; by default all common ones."""
    common = [d for d in next(iter(traces.values())).values if all(d in trace.values for trace in traces.values())]
    for direction in wanted or ():
        if direction not in common:
            expected = f"some of {', '.join(common)}" if common else "a direction that both traces have"
            raise refusal("direction", quoted(direction), expected, "the traces have no other in common")
    if not common:
        raise refusal("against", "a trace of other directions", "one in common", "give another trace")
    return tuple(dict.fromkeys(wanted or common))


def comparable(traces: Mapping[str, Trace]) -> tuple[dict[str, Trace], str]:
    """Return traces of one kind, and the conversion.

    A displacement compared with an acceleration is differentiated twice; no acceleration is ever integrated.
    """
    if len({trace.kind for trace in traces.values()}) == 1:
        return dict(traces), ""
    made = {}
    for name, trace in traces.items():
        if trace.kind == "displacement":
            values = {direction: second_derivative(trace.time, x) for direction, x in trace.values.items()}
            made[name] = replace(trace, kind="acceleration", values=values)
    return {**traces, **made}, f"{', '.join(made)}: a displacement, differentiated twice"


def amplitude_spectra(
    traces: Mapping[str, Trace], directions: Sequence[str], *, window: str, segments: int
) -> dict[str, Spectrum]:
    """Return the spectrum of each trace, a column for each direction."""
    columns = {name: np.stack([trace.values[d] for d in directions], 1) for name, trace in traces.items()}
    return {
        name: amplitude_spectrum(trace.time, columns[name], window=window, segments=segments)
        for name, trace in traces.items()
    }


def spectrograms(
    trace: Trace, directions: Sequence[str], *, window: str, seconds: float | None
) -> dict[str, Spectrogram]:
    """Return the spectrogram of a trace in each direction."""
    segment = seconds or min(LONGEST, float(trace.time[-1] - trace.time[0]) / LEAST_SEGMENTS)
    return {
        direction: spectrogram(trace.time, trace.values[direction], window=window, segment_seconds=segment)
        for direction in directions
    }


def distinct(pulleys: Pulleys) -> dict[str, np.ndarray]:
    """Join pulleys of equal speed under one name: their orders are indistinguishable."""
    fastest = max((float(np.abs(frequency).max()) for frequency in pulleys.values()), default=0.0)
    return joined(pulleys, " and ", 1e-6 * fastest)
