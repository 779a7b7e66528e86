"""The spectra of a trace as they are reported: beside another trace, over time, and by a pulley's orders."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from ident.assess.simulation import alike
from ident.identify.modal_analysis import ModalAnalysis
from ident.measure import Pulley, Trace
from ident.vibrate.signal.derivative import second_derivative
from ident.vibrate.signal.orders import OrderTrack, order_tracking
from ident.vibrate.signal.spectrum import Peak, Spectrum, amplitude_spectrum, peaks

REVOLUTIONS = 4
"""Revolutions of a block for order tracking: they tell orders half a turn apart."""
PEAKS = 5
"""Peaks of each direction that are told."""
SLOW = 3.0
"""Bins from zero up to which a peak may be a drift or the slow part of a motion."""
STANDING = 1e-3
"""Share of its fastest turning below which a pulley counts as standing."""
SMALL = 0.02
"""Share of the largest peak below which a peak is not told."""


@dataclass(frozen=True)
class Spectra:
    """The spectra of one trace, or of two.

    Attributes:
        directions: which directions were asked for.
        traces: by name, all of the same kind.
        spectra: by the same names, a column for each direction.
        upto: [Hz] highest frequency that is looked at.
        pulleys: of the first trace's file, those that turn alike under one name.
        survey: modes of the arm, if one was named.
        tracks: by pulley, the orders in each direction.
        orders: multiples of the pulleys' turning that were asked for.
        remark: what was done to make the traces comparable; mostly empty.
    """

    directions: tuple[str, ...]
    traces: Mapping[str, Trace]
    spectra: Mapping[str, Spectrum]
    upto: float
    pulleys: Mapping[str, Pulley] = field(default_factory=dict)
    survey: ModalAnalysis | None = None
    tracks: Mapping[str, OrderTrack] = field(default_factory=dict)
    orders: tuple[float, ...] = ()
    remark: str = ""

    @property
    def kind(self) -> str:
        """`displacement` or `acceleration`."""
        return next(iter(self.traces.values())).kind

    @property
    def lines(self) -> dict[str, Float[np.ndarray, "T"]]:
        """Multiples of the pulleys' turning frequencies [Hz] over the time of the first trace; NaN while they stand."""
        turning = {name: p.frequency for name, p in self.pulleys.items() if p.frequency is not None}
        return alike(
            {
                f"{order:g} x {name}": np.where(frequency > STANDING * frequency.max(), order * frequency, np.nan)
                for name, frequency in turning.items()
                for order in self.orders or (1.0,)
            }
        )

    @property
    def marks(self) -> dict[str, float]:
        """Natural frequencies [Hz] by the modes' labels."""
        if self.survey is None:
            return {}
        return {str(label): float(f) for label, f in zip(self.survey.labels, self.survey.modes.frequency, strict=True)}

    def strongest(self, name: str, direction: str) -> tuple[Peak, ...]:
        """Return the strongest peaks of a trace in a direction, the largest first; none that is a slow drift."""
        spectrum = self.spectra[name].column(self.directions.index(direction))
        found = peaks(spectrum, PEAKS, (SLOW * spectrum.resolution, self.upto))
        return tuple(peak for peak in found if peak.amplitude >= SMALL * found[0].amplitude)


def spectra_of(
    traces: Mapping[str, Trace],
    directions: Sequence[str],
    *,
    window: str = "hann",
    segments: int = 1,
    upto: float = 20.0,
    pulleys: Mapping[str, Pulley] | None = None,
    survey: ModalAnalysis | None = None,
    orders: Sequence[float] = (),
    revolutions: int = REVOLUTIONS,
) -> Spectra:
    """Return the spectra of traces that all have these directions.

    A displacement beside an acceleration is differentiated twice; no acceleration is ever integrated.

    Raises:
        InputError: a trace is too short, or see `amplitude_spectrum` and `order_tracking`.
    """
    comparable, remark = _comparable(traces)
    spectra = {
        name: amplitude_spectrum(trace.time, _columns(trace, directions), window=window, segments=segments)
        for name, trace in comparable.items()
    }
    first, turning = next(iter(comparable.values())), _alike(pulleys or {})
    tracks = dict(_tracks(first, directions, turning, orders, revolutions)) if orders else {}
    return Spectra(tuple(directions), comparable, spectra, upto, turning, survey, tracks, tuple(orders), remark)


def _columns(trace: Trace, directions: Sequence[str]) -> Float[np.ndarray, "T D"]:
    return np.stack([trace.values[direction] for direction in directions], axis=1)


def _comparable(traces: Mapping[str, Trace]) -> tuple[dict[str, Trace], str]:
    if len({trace.kind for trace in traces.values()}) == 1:
        return dict(traces), ""
    made = {
        name: replace(
            trace,
            kind="acceleration",
            values={d: second_derivative(trace.time, values) for d, values in trace.values.items()},
        )
        for name, trace in traces.items()
        if trace.kind == "displacement"
    }
    return {**traces, **made}, f"{', '.join(made)}: a displacement, differentiated twice"


def _alike(pulleys: Mapping[str, Pulley]) -> dict[str, Pulley]:
    """Put pulleys that turn alike under one name: their orders cannot be told from each other."""
    groups: list[tuple[list[str], Pulley]] = []
    for name, pulley in pulleys.items():
        group = next((names for names, other in groups if _turns_as(pulley, other)), None)
        if group is None:
            groups.append(([name], pulley))
        else:
            group.append(name)
    return {" and ".join(names): pulley for names, pulley in groups}


def _turns_as(one: Pulley, other: Pulley) -> bool:
    pairs = [(one.frequency, other.frequency)]
    pairs.append((_turned(one.angle), _turned(other.angle)))
    return all(_close(a, b) for a, b in pairs)


def _turned(angle: np.ndarray | None) -> np.ndarray | None:
    return None if angle is None else np.abs(angle - angle[0])


def _close(a: np.ndarray | None, b: np.ndarray | None) -> bool:
    if a is None or b is None:
        return a is b
    return bool(np.allclose(a, b, rtol=1e-6, atol=1e-6 * np.abs(a).max()))


def _tracks(
    trace: Trace, directions: Sequence[str], pulleys: Mapping[str, Pulley], orders: Sequence[float], turns: int
) -> Iterator[tuple[str, OrderTrack]]:
    for name, pulley in pulleys.items():
        if pulley.angle is not None:
            values = _columns(trace, directions)
            yield name, order_tracking(trace.time, values, pulley.angle, orders=orders, revolutions=turns)
