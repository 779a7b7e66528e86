"""The printed report of a simulated motion: how far the end point vibrates, when, and what it takes."""

import math
from collections.abc import Iterator

import numpy as np

from ident.assess.simulate import Simulation
from ident.present.text.basis import assumed_in_words, basis_in_words, load_in_words, motion_in_words, passages_in_words
from ident.present.text.words import MM, cut, degrees, paragraphs
from ident.vibrate.study import DIRECTIONS

METHODS = {
    "fast": "fast, equations linearised about the quasi-static deflection",
    "exact": "exact equations of motion, integrated with error control",
}
QUANTILES = (0.05, 0.95)
MOST_SLACK = 4
"""Times of a slack span that are listed one by one."""


def simulate_report(simulation: Simulation) -> str:
    """Return the report: motion, vibration, bands, comparison with a trace, belts and bushings, what is assumed."""
    sections = [
        _heading(simulation),
        _vibration(simulation),
        _phases(simulation),
        _bands(simulation),
        _trace(simulation),
        _methods(simulation),
        _belts(simulation),
        _moments(simulation),
        assumed_in_words(simulation.basis),
    ]
    return paragraphs(sections)


def _heading(simulation: Simulation) -> Iterator[str]:
    response = simulation.response
    yield from motion_in_words(simulation.basis)
    if simulation.pulleys:
        fastest = ", ".join(f"{name} {frequency.max():.3g} Hz" for name, (_, frequency) in simulation.pulleys.items())
        yield f"  pulleys turn up to: {fastest}"
    rate = (len(simulation.time) - 1) / (simulation.time[-1] - simulation.time[0])
    yield load_in_words(simulation.basis, response.model.elastic, rate)
    yield f"  method: {METHODS[response.method]}"
    yield from basis_in_words(simulation.basis)
    yield from passages_in_words(simulation.passages)
    if simulation.study.interrupted is not None:
        yield f"  INTERRUPTED: the exact method came to {simulation.study.interrupted:.4g} s"
        if simulation.basis.posterior:
            yield "  so the draws were not simulated"


def _vibration(simulation: Simulation) -> Iterator[str]:
    late = "" if simulation.at is None else f"   from {simulation.at:g} s on"
    tolerance = f"settled to {MM * simulation.tolerance:g} mm"
    yield f"Vibration of {simulation.point} [mm]: displacement from its quasi-static position"
    yield f"          peak      at s       rms   residual   {tolerance}{late}"
    sizes, width = simulation.sizes, len(tolerance)
    for i, direction in enumerate(DIRECTIONS):
        when = simulation.time[np.argmax(np.abs(simulation.vibration[i]))]
        last = "" if simulation.at is None else f"   {_mm(sizes.late[i]):>{len(late) - 3}s}"
        yield (
            f"  {direction} {_mm(sizes.peak[i]):>10s} {when:9.3f} {_mm(sizes.rms[i]):>9s} {_mm(sizes.residual[i]):>10s}"
            f"   {_seconds(simulation, sizes.settling[i]):>{width}s}{last}"
        )
    yield "  residual: largest after arrival; settled: time after arrival from which on it stays within"
    yield from _peak(simulation)


def _peak(simulation: Simulation) -> Iterator[str]:
    way, place = np.unravel_index(np.argmax(np.abs(simulation.vibration)), simulation.vibration.shape)
    posture = degrees(np.asarray(simulation.response.posture)[:, place].tolist())
    turning = [f"{name} {frequency[place]:.3g} Hz" for name, (_, frequency) in simulation.pulleys.items()]
    pulleys = f"; pulleys turn: {', '.join(turning)}" if turning else ""
    size = _mm(abs(simulation.vibration[way, place]))
    yield f"  largest: {size} mm in {DIRECTIONS[way]} at {simulation.time[place]:.4g} s, at {posture}{pulleys}"
    if simulation.limit is not None and simulation.draws is None:
        beyond = [d for d, size in zip(DIRECTIONS, simulation.sizes.peak, strict=True) if size > simulation.limit]
        words = f"exceeded in {', '.join(beyond)}" if beyond else "kept in all directions"
        yield f"  limit of {MM * simulation.limit:g} mm: {words}"


def _phases(simulation: Simulation) -> Iterator[str]:
    if simulation.phases is None:
        if simulation.arm.springs and simulation.basis.unknown.phases:
            yield "Phases of the turning masses: those of the arm file alone, as responses of curved springs do not add"
        return
    over = simulation.phases
    what = "phases and kinematic errors" if simulation.basis.unknown.errors else "phases of the turning masses"
    yield f"Peak over all {what}, which nobody knows; above, those of the arm file [mm]"
    yield "                 5 to 95 %           worst    of it: motion   imbalance   kinematic error"
    for direction, low, high, worst, parts in zip(DIRECTIONS, *over.band, over.worst, over.division.T, strict=True):
        band, (motion, imbalance, error) = f"{_mm(low)} to {_mm(high)}", map(_mm, parts)
        yield f"  {direction} {band:>27s}  {_mm(worst):>10s}  {motion:>16s}  {imbalance:>10s}  {error:>16s}"
    if simulation.limit is not None:
        yield _exceeding(simulation.limit, "them", *over.exceeds(simulation.limit))


def _exceeding(limit: float, of: str, each: np.ndarray, any_of: float) -> str:
    ways = ", ".join(f"{share:.0%} in {direction}" for direction, share in zip(DIRECTIONS, each, strict=True))
    return f"  share of {of} whose peak exceeds {MM * limit:g} mm: {ways}, {any_of:.0%} in any direction"


def _bands(simulation: Simulation) -> Iterator[str]:
    if simulation.draws is None:
        return
    sizes, count = simulation.draws.sizes, simulation.draws.vibration.shape[2]
    names = [
        "peak",
        "rms",
        "residual",
        "settled [s]",
        *([] if simulation.at is None else [f"from {simulation.at:g} s on"]),
    ]
    drawn = ", each with phases of its own" if simulation.basis.unknown.phases else ""
    yield f"5 to 95 % of {count} draws{drawn} [mm]"
    yield "   " + "".join(f"{name:>20s}" for name in names)
    for i, direction in enumerate(DIRECTIONS):
        columns = [_interval(part[i]) for part in (sizes.peak, sizes.rms, sizes.residual)]
        columns.append(_settling(simulation, sizes.settling[i]))
        columns += [] if simulation.at is None else [_interval(sizes.late[i])]
        yield f"  {direction}" + "".join(f"{column:>20s}" for column in columns)
    if simulation.limit is not None:
        each, any_of = simulation.draws.exceeds(simulation.limit)
        ways = ", ".join(f"{share:.0%} in {direction}" for direction, share in zip(DIRECTIONS, each, strict=True))
        yield f"  probability that the peak exceeds {MM * simulation.limit:g} mm: {ways}, {any_of:.0%} in any direction"


def _trace(simulation: Simulation) -> Iterator[str]:
    if not simulation.comparisons or simulation.trace is None:
        return
    acceleration = simulation.trace.kind == "acceleration"
    factor, unit = (1.0, "m/s^2") if acceleration else (MM, "mm")
    first = next(iter(simulation.comparisons.values()))
    low, high = first.band
    span = first.measured.trace.time[[0, -1]]
    yield f"Against {cut(simulation.trace.path, 60)}, {span[0]:.4g} to {span[1]:.4g} s, each about its mean [{unit}]"
    yield f"          {'peak':29s} {'rms':29s} {f'strongest in {low:g} to {high:g} Hz':29s} rms in that band"
    pair = "simulated  measured"
    yield f"    {pair + '  ratio':>29s}{pair + '  ratio':>30s}{pair + ' [Hz]':>28s}   ratio"
    for direction, comparison in simulation.comparisons.items():
        ours, theirs = comparison.simulated, comparison.measured
        peaks = [f"{size.dominant.frequency:.3f}" if size.dominant else "none" for size in (ours, theirs)]
        yield (
            f"  {direction} {factor * ours.peak:11.4g} {factor * theirs.peak:9.4g} {comparison.peak_ratio:6.3f}"
            f"  {factor * ours.rms:11.4g} {factor * theirs.rms:9.4g} {comparison.rms_ratio:6.3f}"
            f" {peaks[0]:>11s}  {peaks[1]:>11s}       {comparison.band_rms_ratio:6.3f}"
        )
    if acceleration:
        yield "  the simulated displacement was differentiated twice; the measured acceleration is as it was"


def _methods(simulation: Simulation) -> Iterator[str]:
    if simulation.study.other is not None:
        ways = zip(DIRECTIONS, simulation.study.difference, strict=True)
        shares = ", ".join(f"{direction} {100 * share:.2g} %" for direction, share in ways)
        stopped = simulation.study.interrupted
        span = "" if stopped is None else f" up to {stopped:.4g} s"
        yield f"Fast method against exact, largest difference over peak{span}: {shares}"


def _belts(simulation: Simulation) -> Iterator[str]:
    if not simulation.arm.belts:
        return
    tension, names = simulation.tension, [belt.name for belt in simulation.arm.belts]
    span, belt, place = np.unravel_index(np.argmin(tension), tension.shape)
    yield (
        f"Belts: smallest tension {tension[span, belt, place]:.4g} N, {('upper', 'lower')[span]} span of {names[belt]}"
        f" at {simulation.time[place]:.4g} s"
    )
    slack = simulation.slack
    for number, side, start, end in slack[:MOST_SLACK]:
        yield f"  SLACK: {side} span of {names[number]} from {start:.4g} to {end:.4g} s"
    if len(slack) > MOST_SLACK:
        yield f"  and {len(slack) - MOST_SLACK} times more"
    if slack and not simulation.response.model.elastic:
        yield "  The belts are taken as rigid, which a slack one is not: raise the pretension, or use --elastic-belts"
    elif slack and simulation.response.method == "fast":
        yield "  The fast method has slack spans pull on, below zero: use --method exact, or raise the pretension"


def _moments(simulation: Simulation) -> Iterator[str]:
    bending, torsion = simulation.moments
    yield "Largest moments of the bushings [N m], weight included"
    yield f"  {'':18s} {'bending':>9s}     at s   {'torsion':>9s}     at s"
    for joint, b, t in zip(simulation.arm.joints, bending, np.abs(torsion), strict=True):
        when = (simulation.time[np.argmax(x)] for x in (b, t))
        yield f"  {cut(joint.name, 18):18s} {b.max():9.4g} {next(when):8.3f}   {t.max():9.4g} {next(when):8.3f}"


def _mm(value: float) -> str:
    return "-" if math.isnan(value) else f"{MM * value:.4f}"


def _seconds(simulation: Simulation, value: float) -> str:
    if math.isnan(value):
        return "-"
    held = float(simulation.time[-1]) - simulation.response.motion.arrival
    if value == 0:
        return "at arrival"
    return f"{value:.3f} s" if math.isfinite(value) else f"not in {held:.3g} s"


def _interval(values: np.ndarray) -> str:
    if np.isnan(values).any():
        return "-"
    low, high = np.quantile(MM * values, QUANTILES)
    return f"{low:.4f} to {high:.4f}"


def _settling(simulation: Simulation, values: np.ndarray) -> str:
    if np.isnan(values).any():
        return "-"
    low, high = np.quantile(values, QUANTILES, method="nearest")
    held = float(simulation.time[-1]) - simulation.response.motion.arrival
    if math.isinf(low):
        return f"beyond {held:.3g}"
    return f"{low:.2f} to {high:.2f}" if math.isfinite(high) else f"{low:.2f} to beyond {held:.3g}"
