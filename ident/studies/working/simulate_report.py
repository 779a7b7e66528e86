"""The report of a simulated motion, and a table of its vibration."""

import math
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.identify.unknowns import is_damping
from ident.report.report import Finding, Part, Report, Section, Table, Verdict, by_head, by_row, cut
from ident.report.words import MM, counted, degrees, percent
from ident.studies.basis import (
    assumed_section,
    assumption_findings,
    basis_findings,
    motion_section,
    passage_findings,
    subject,
    transmission_finding,
    without_transmission_error,
)
from ident.studies.scenario import DAMPING
from ident.vibrate.binomial import share_of_variance
from ident.vibrate.fast import passages
from ident.vibrate.settling import settling_time
from ident.vibrate.study import DIRECTIONS

if TYPE_CHECKING:
    from ident.studies.working.simulation import Simulation
    from ident.vibrate.compare import Comparison
    from ident.vibrate.study import Draws

METHODS = {
    "fast": "fast, equations linearised about the quasi-static deflection",
    "exact": "exact equations of motion, integrated with error control",
}
LOW = math.exp(-1.645 * DAMPING)
"""Share of the arm file's damping at its 5 % quantile."""
QUANTILES = (0.05, 0.95)
SLACK_LISTED = 4
"""Slack intervals of a span that are listed one by one."""
NEGLIGIBLE = 0.005
"""Share of a peak below which no number is printed on the first screen."""


def simulate_sections(simulation: "Simulation") -> Report:
    """Return the report of a simulated motion."""
    motion = simulation.response.motion
    held = float(motion.breaks[-1]) - motion.arrival
    dwell = f", then held for {held:.4g} s" if held else ""
    limit, following = simulation.limit, "ident sweep {arm} --vary speed"
    if limit is not None:
        following = "ident motion {arm}" if simulation.sizes.peak.max() > limit else ""
    return Report(
        f"Vibration of {cut(simulation.point, 20)} of {subject(simulation.basis)}: {motion.arrival:.4g} s{dwell}",
        _verdict(simulation),
        tuple(_answer(simulation)),
        tuple(_findings(simulation)),
        _largest(simulation),
        following,
        tuple(_details(simulation)),
    )


def _verdict(simulation: "Simulation") -> Verdict | None:
    """Judge a motion: NOT OK if it exceeds the limit, MARGINAL if it may, else OK.

    MARGINAL: some phases or draws exceed the limit. None without a limit.
    """
    if simulation.limit is None:
        return None
    limit, peak = f"the limit of {MM * simulation.limit:g} mm", simulation.sizes.peak
    size = f"{_mm(peak.max())} mm in {DIRECTIONS[int(peak.argmax())]}"
    shares, may = _exceeding(simulation, simulation.limit)
    more = f"; {shares}" if shares else ""
    if peak.max() > simulation.limit:
        return Verdict("NOT OK", f"{size} exceeds {limit}{more}.", "bad")
    if may:
        return Verdict("MARGINAL", f"{size} keeps {limit}, but not safely{more}.", "caution")
    return Verdict("OK", f"{size} keeps {limit} in all directions{more}.", "good")


def _exceeding(simulation: "Simulation", limit: float) -> tuple[str, bool]:
    """Say which share of the phases and draws exceeds the limit, and return whether any does."""
    words, may = [], False
    if simulation.draws is not None:
        share = simulation.draws.exceeds(limit)[1]
        words.append(f"probability of exceeding it {percent(share)} ({simulation.draws.vibration.shape[2]} draws)")
        may = share > 0
    if simulation.phases is not None:
        share, worst = simulation.phases.exceeds(limit)[1], float(simulation.phases.worst.max())
        words.append(f"{percent(share)} of random phases exceed it, worst case {_mm(worst)} mm")
        may = may or worst > limit
    return "; ".join(words), may


# -------- First screen


def _answer(simulation: "Simulation") -> Iterator[Part]:
    yield _sizes_table(simulation)
    over = simulation.phases
    if over is not None and not simulation.comparisons:
        way = int(over.worst.argmax())
        motion, imbalance, error = (
            f"below {percent(NEGLIGIBLE)}" if size < NEGLIGIBLE * over.worst[way] else f"{_mm(size)} mm"
            for size in over.division[:, way]
        )
        error = "set to 0" if without_transmission_error(simulation.basis) else error
        parts = f"imbalance {imbalance}, motion {motion}, transmission error {error}"
        yield f"The imbalance phases are unknown. Worst case in {DIRECTIONS[way]}: {parts}."
    if simulation.comparisons:
        yield _ratios(simulation)


def _sizes_table(simulation: "Simulation") -> Table:
    """Return for each direction the peak, its range over draws or phases, and the other sizes."""
    sizes, over, draws = simulation.sizes, simulation.phases, simulation.draws
    peaks = simulation.time[np.abs(simulation.vibration).argmax(1)]
    columns = {"": list(DIRECTIONS), "peak [mm]": _all_mm(sizes.peak), "at [s]": [f"{time:.3f}" for time in peaks]}
    if draws is not None:
        columns["draws, 5 to 95 %"] = [_interval(each) for each in draws.sizes.peak]
    elif over is not None:
        columns["phases, 5 to 95 %"] = [f"{_mm(low)} to {_mm(high)}" for low, high in over.band.T]
    if over is not None:
        columns["worst phases"] = _all_mm(over.worst)
    columns |= {"rms [mm]": _all_mm(sizes.rms), "residual [mm]": _all_mm(sizes.residual)}
    columns[f"settled to {MM * simulation.settled:g} mm"] = [_seconds(each) for each in sizes.settled]
    if simulation.at is not None:
        columns[f"from {simulation.at:g} s on"] = _all_mm(sizes.late)
    return by_head(columns, zip(*columns.values(), strict=True))


def _largest(simulation: "Simulation") -> str:
    """Say when the vibration is largest, in which posture, and the pulley speeds at that time."""
    way, place = np.unravel_index(np.argmax(np.abs(simulation.vibration)), simulation.vibration.shape)
    posture = degrees(np.asarray(simulation.response.posture)[:, place].tolist())
    turning = [f"{name} {frequency[place]:.3g} Hz" for name, (_, frequency) in simulation.pulleys.items()]
    pulleys = f"; pulleys turn: {', '.join(turning)}" if turning else ""
    size = _mm(abs(simulation.vibration[way, place]))
    return f"Largest: {size} mm in {DIRECTIONS[way]} at {simulation.time[place]:.4g} s, at {posture}{pulleys}."


def _ratios(simulation: "Simulation") -> Table:
    """Return the comparison of the simulated vibration with a measured trace."""
    rows = (
        (direction, each.peak_ratio, each.rms_ratio, each.band_rms_ratio, *_dominant(each))
        for direction, each in (simulation.comparisons or {}).items()
    )
    heads = "peak", "rms", "rms in band", "strongest simulated [Hz]", "measured [Hz]"
    return by_head(("", *(f"{each}|.3f" for each in heads)), rows, "Simulated over measured")


def _dominant(comparison: "Comparison") -> list[float | None]:
    sizes = (comparison.simulated, comparison.measured)
    return [size.dominant.frequency if size.dominant else None for size in sizes]


def _findings(simulation: "Simulation") -> Iterator[Finding]:
    """Yield the findings that affect the result, most important first."""
    basis, spans = simulation.basis, simulation.slack
    if simulation.clock:
        yield Finding(f"clock of the trace, found from the motion: {simulation.clock}")
    if spans:
        number, side, start, end = spans[0]
        more = f" ({len(spans)} times in all)" if len(spans) > 1 else ""
        belt = simulation.arm.belts[number].name
        text = f"{belt} goes slack: its {side} span from {start:.4g} to {end:.4g} s{more}"
        if not simulation.response.model.elastic:
            yield Finding(f"{text}, but belts are taken as rigid", "raise the pretension, or use --elastic-belts")
        elif simulation.response.method == "fast":
            yield Finding(f"{text}; the fast method then pulls on, below zero", "use --method exact, or raise it")
        else:
            yield Finding(text, "raise the pretension")
    yield from passage_findings(passages(simulation.arm, simulation.response))
    yield from basis_findings(basis)
    if simulation.sizes.settled.max() > simulation.response.motion.arrival and not any(map(is_damping, basis.draws)):
        late = float(settling_time(simulation.response, simulation.settled, LOW).max())
        text = f"settling counts damping as exact; with {percent(1 - LOW)} less: {_seconds(late)}"
        yield Finding(text, "measure damping ratios, and give --posterior")
    if simulation.phases is None and simulation.arm.springs and basis.unknown.phases:
        yield Finding("only the arm file's imbalance phases were simulated: curved springs do not superpose")
    yield from assumption_findings(basis)
    yield from transmission_finding(basis)


# -------- Details


def _details(simulation: "Simulation") -> Iterator[Section]:
    yield _motion(simulation)
    meaning = (
        f"Vibration: displacement of {simulation.point} from its quasi-static position, with the arm file's phases. "
        "residual: peak after arrival. settled: time from the start until it stays below that value for good, by the "
        "envelope of its decay; that of the arrival at the earliest."
    )
    yield Section("Sizes of the vibration", (meaning,))
    yield from _phases(simulation)
    yield from _bands(simulation)
    yield from _trace(simulation)
    yield from _methods(simulation)
    yield from _belts(simulation)
    yield _moments(simulation)
    yield from assumed_section(simulation.basis)


def _motion(simulation: "Simulation") -> Section:
    rate = (len(simulation.time) - 1) / (simulation.time[-1] - simulation.time[0])
    fastest = ", ".join(f"{name} {frequency.max():.3g} Hz" for name, (_, frequency) in simulation.pulleys.items())
    return motion_section(
        simulation.basis,
        elastic_belts=bool(simulation.response.model.elastic),
        rate=rate,
        method=METHODS[simulation.response.method],
        more=(f"Pulleys turn at up to: {fastest}.",) if fastest else (),
    )


def _phases(simulation: "Simulation") -> Iterator[Section]:
    over = simulation.phases
    if over is None:
        return
    what = "phases and transmission errors" if simulation.basis.unknown.errors else "imbalance phases"
    rows = (
        (direction, f"{_mm(low)} to {_mm(high)}", *_all_mm([worst, *parts]))
        for direction, low, high, worst, parts in zip(DIRECTIONS, *over.band, over.worst, over.division.T, strict=True)
    )
    heads = "", "5 to 95 %", "worst", "motion", "imbalance", "transmission error"
    note = "worst: reached with some phases; motion, imbalance and transmission error are its parts."
    table = by_head(heads, rows, note=note)
    limit = () if simulation.limit is None else (_shares(simulation.limit, *over.exceeds(simulation.limit)),)
    yield Section(f"Peak over random {what}, which are unknown [mm]", (table, *limit))


def _shares(limit: float, each: np.ndarray, any_of: float) -> str:
    ways = ", ".join(f"{percent(share)} in {direction}" for direction, share in zip(DIRECTIONS, each, strict=True))
    return f"Probability that the peak exceeds {MM * limit:g} mm: {ways}, {percent(any_of)} in any direction."


def _bands(simulation: "Simulation") -> Iterator[Section]:
    draws = simulation.draws
    if draws is None:
        return
    sizes, late = draws.sizes, simulation.at is not None
    own = ", each with random phases" if simulation.basis.unknown.phases else ""
    rows = []
    for i, direction in enumerate(DIRECTIONS):
        parts = (sizes.peak, sizes.rms, sizes.residual, *([sizes.late] if late else []))
        rows.append((direction, *(_interval(part[i]) for part in parts), _settled(sizes.settled[i])))
    heads = "", "peak", "rms", "residual", *([f"from {simulation.at:g} s on"] if late else []), "settled"
    limit = () if simulation.limit is None else (_shares(simulation.limit, *draws.exceeds(simulation.limit)),)
    title = f"5 to 95 % of {counted(draws.vibration.shape[2], 'draw')}{own} [mm]"
    yield Section(title, (by_head(heads, rows), *limit, *_owed_to_damping(draws)))


def _owed_to_damping(draws: "Draws") -> Iterator[str]:
    """Yield the share of the spread of peak and settling time due to the damping, if that has draws."""
    damping = {path: values for path, values in draws.values.items() if is_damping(path) and np.ptp(values) > 0}
    if damping:
        way = int(draws.sizes.peak.mean(1).argmax())
        peak, settling = (share_of_variance(damping, size[way]) for size in (draws.sizes.peak, draws.sizes.settled))
        yield (
            f"The uncertainty of the damping accounts for {percent(peak)} of the variance of the peak in "
            f"{DIRECTIONS[way]}, and for {percent(settling)} of that of its settling time."
        )


def _trace(simulation: "Simulation") -> Iterator[Section]:
    if not simulation.comparisons or simulation.trace is None:
        return
    acceleration = simulation.trace.kind == "acceleration"
    factor, unit = (1.0, "m/s^2") if acceleration else (MM, "mm")
    first = next(iter(simulation.comparisons.values()))
    (low, high), span = first.band, first.measured.trace.time[[0, -1]]
    rows = []
    for direction, each in simulation.comparisons.items():
        numbers = (each.simulated.peak, each.measured.peak, each.simulated.rms, each.measured.rms)
        rows.append((direction, *(factor * number for number in numbers), *_dominant(each)))
    sizes = "peak, simulated|.4g", "measured|.4g", "rms, simulated|.4g", "measured|.4g"
    heads = "", *sizes, "strongest, simulated [Hz]|.3f", "measured [Hz]|.3f"
    note = f"Each about its mean. strongest: frequency [Hz] in the band, {low:g} to {high:g} Hz."
    if acceleration:
        note += " The simulated displacement was differentiated twice; the measured acceleration is as it was."
    table = by_head(heads, rows, note=note)
    yield Section(f"Against {cut(simulation.trace.path, 60)}, {span[0]:.4g} to {span[1]:.4g} s [{unit}]", (table,))


def _methods(simulation: "Simulation") -> Iterator[Section]:
    if simulation.other is None:
        return
    ways = zip(DIRECTIONS, simulation.difference, strict=True)
    shares = ", ".join(f"{direction} {100 * share:.2g} %" for direction, share in ways)
    yield Section("Fast method against exact", (f"Largest difference over the peak: {shares}.",))


def _belts(simulation: "Simulation") -> Iterator[Section]:
    if not simulation.arm.belts:
        return
    tension, names = simulation.tension, [belt.name for belt in simulation.arm.belts]
    span, belt, place = np.unravel_index(np.argmin(tension), tension.shape)
    side = ("upper", "lower")[span]
    smallest = f"{tension[span, belt, place]:.4g} N, {side} span of {names[belt]} at {simulation.time[place]:.4g} s"
    slack = [
        f"Slack: {side} span of {names[number]} from {start:.4g} to {end:.4g} s."
        for number, side, start, end in simulation.slack[:SLACK_LISTED]
    ]
    hidden = len(simulation.slack) - SLACK_LISTED
    slack += [f"{hidden} more."] * (hidden > 0)
    yield Section("Belts", (f"Smallest tension: {smallest}.", *slack))


def _moments(simulation: "Simulation") -> Section:
    rows = []
    for joint, bending, torsion in zip(simulation.arm.joints, *simulation.moments, strict=True):
        about = np.abs(torsion)
        times = [float(simulation.time[np.argmax(moment)]) for moment in (bending, about)]
        rows.append((joint.name, float(bending.max()), times[0], float(about.max()), times[1]))
    table = by_head(("", "bending|.4g", "at [s]|.3f", "torsion|.4g", "at [s]|.3f"), rows)
    return Section("Largest moments of the bushings, weight included [N m]", (table,))


def _mm(value: float) -> str:
    return "-" if math.isnan(value) else f"{MM * value:.4f}"


def _all_mm(values: Iterable[float]) -> list[str]:
    return [_mm(float(value)) for value in values]


def _seconds(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.2f} s" if math.isfinite(value) else "never"


def _interval(values: np.ndarray) -> str:
    if np.isnan(values).any():
        return "-"
    low, high = np.quantile(MM * values, QUANTILES)
    return f"{low:.4f} to {high:.4f}"


def _settled(values: np.ndarray) -> str:
    low, high = np.quantile(values, QUANTILES, method="nearest")
    return f"{_seconds(low)} to {_seconds(high)}"


# -------- Rows


def simulate_rows(simulation: "Simulation") -> list[dict[str, Any]]:
    """Return the sizes of the vibration as rows, one for each direction [m, s]; NaN where one does not apply."""
    sizes, place = simulation.sizes, np.argmax(np.abs(simulation.vibration), axis=1)
    columns = {"peak": sizes.peak, "time_of_peak": simulation.time[place], "rms": sizes.rms}
    columns |= {"residual": sizes.residual, "settled": sizes.settled, "late_peak": sizes.late}
    if simulation.phases:
        low, high = simulation.phases.band
        columns |= {"peak_phases_q05": low, "peak_phases_q95": high, "peak_worst_phases": simulation.phases.worst}
    if simulation.draws:
        low, high = np.quantile(simulation.draws.sizes.peak, QUANTILES, axis=1)
        columns |= {"peak_q05": low, "peak_q95": high}
        if simulation.limit is not None:
            columns["exceedance"] = simulation.draws.exceeds(simulation.limit)[0]
    return by_row(direction=DIRECTIONS, **{name: np.asarray(column, float) for name, column in columns.items()})
