"""Figures of vibration: of a simulated motion, and spectra and spectrograms of a trace."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import cycle
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.colors import Normalize, PowerNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ident.assess.simulate import Simulation, alike
from ident.present.figures.style import (
    BLUE,
    GREEN,
    GREY,
    NEAR,
    ORANGE,
    PALE,
    PALE_BLUE,
    PINK,
    Style,
    as_written,
    colour_bar,
    key_below,
    motion_title,
    note,
    plain,
    titled,
)
from ident.present.report import cut
from ident.present.words import MM, TRACE_UNITS, by_key, hertz, where_marked
from ident.vibrate.study import DIRECTIONS

if TYPE_CHECKING:
    from ident.assess.spectrum import Band, Spectra
    from ident.identify.joint import JointTwist
    from ident.vibrate.orders import OrderTrack, Spectrogram
    from ident.vibrate.spectra import Spectrum

# -------- Simulate
# Figures of a simulated motion: vibration of the end point, and what joints, belts and pulleys do meanwhile.

OURS: Style = {"color": BLUE, "linewidth": 1.3}
THEIRS: Style = {"color": ORANGE, "linewidth": 0.8, "zorder": 2.5}
PARTS: tuple[Style, ...] = tuple(
    {"color": color, "linestyle": line, "linewidth": 1.1}
    for color, line in ((BLUE, "-"), (ORANGE, "-"), (GREEN, "--"), (PINK, "-."), (GREY, ":"), ("black", "-"))
)
"""Styles of joints, spans and pulleys; the third differs in its line, as symmetric pulleys lie on one another."""


def simulate_figure(simulation: Simulation) -> Figure:
    """Draw the vibration of the end point in x, y and z over time, with bands of draws and a measured trace."""
    compared = simulation.comparisons or {}
    figure, grid = _panels(motion_title(f"Vibration of {simulation.point}", simulation.basis), len(DIRECTIONS))
    for i, (axes, direction) in enumerate(zip(grid, DIRECTIONS, strict=True)):
        _direction(axes, simulation, i)
        if direction in compared:  # the measured trace, about the simulation's mean over the common time
            trace, ours = compared[direction].measured.trace, compared[direction].simulated.trace
            factor = 1.0 if _by_acceleration(simulation, direction) else MM
            axes.plot(trace.time, factor * (trace.values + (ours.values.mean() - trace.values.mean())), **THEIRS)
        _arrival(axes, simulation, labelled=i == 0)
    figure.align_ylabels(grid)
    key_below(figure, list(_entries(simulation)), "\n".join(_notes(simulation)))
    return figure


def drives_figure(simulation: Simulation) -> Figure:
    """Draw joint rotations, belt tensions and the pulleys' turning frequencies over time."""
    panels = list(_drive_panels(simulation))
    figure, grid = _panels(motion_title("Joints, belts and pulleys", simulation.basis), len(panels))
    for i, (axes, (label, lines)) in enumerate(zip(grid, panels, strict=True)):
        for (name, values), style in zip(lines.items(), cycle(PARTS), strict=False):
            axes.plot(simulation.time, values, label=cut(name, 24), **style)
        axes.set(ylabel=label)
        key = axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize=8)
        as_written(key.get_texts())
        _arrival(axes, simulation, labelled=i == 0)
    notes = ["rotations about the axes of each joint's shaft; the quasi-static deflection is part of them"]
    if simulation.arm.belts and simulation.tension.min() <= 0:
        notes.append("a belt goes slack: see the report")
    figure.align_ylabels(grid)
    key_below(figure, [], "\n".join(notes))
    return figure


def _panels(title: str, count: int) -> tuple[Figure, list[Axes]]:
    figure = titled((8.0, 1.9 * count + 1.2), title, (0.08, 0.05))
    grid = list(figure.subplots(count, 1, squeeze=False, sharex=True)[:, 0])
    for axes in grid:
        plain(axes, grid=True)
    grid[-1].set(xlabel="time [s]")
    return figure, grid


def _by_acceleration(simulation: Simulation, direction: str) -> bool:
    comparison = (simulation.comparisons or {}).get(direction)
    return comparison is not None and comparison.measured.trace.quantity == "acceleration"


def _direction(axes: Axes, simulation: Simulation, i: int) -> None:
    """Draw one direction in mm, or as the acceleration that was measured."""
    direction = DIRECTIONS[i]
    if _by_acceleration(simulation, direction):
        trace = (simulation.comparisons or {})[direction].simulated.trace
        axes.plot(trace.time, trace.values, zorder=3, **OURS)
        axes.set(ylabel=f"{direction.upper()}: acceleration\n[m/s$^2$]")
        return
    if simulation.phases is not None:
        high = MM * simulation.phases.envelope[i]
        axes.fill_between(simulation.time, -high, high, color=PALE, linewidth=0, zorder=0.5)
    if simulation.draws is not None:
        low, high = MM * simulation.draws.band[:, i]
        axes.fill_between(simulation.time, low, high, color=PALE_BLUE, linewidth=0, zorder=1)
    axes.plot(simulation.time, MM * simulation.vibration[i], zorder=3, **OURS)
    if _near_limit(simulation, i):
        for side in (-1, 1):
            axes.axhline(side * MM * (simulation.limit or 0.0), color=GREY, linewidth=0.8, linestyle=":")
    axes.set(ylabel=f"{direction.upper()}: vibration\n[mm]")


def _near_limit(simulation: Simulation, i: int) -> bool:
    """Tell whether a direction comes so near to the limit that it is drawn; elsewhere it would flatten the curve."""
    sizes = [simulation.sizes.peak[i], *([] if simulation.draws is None else simulation.draws.sizes.peak[i])]
    sizes += [] if simulation.phases is None else [simulation.phases.worst[i]]
    return simulation.limit is not None and bool(max(sizes) > NEAR * simulation.limit)


def _arrival(axes: Axes, simulation: Simulation, *, labelled: bool) -> None:
    """Mark when the arm arrives, and from when on the late peak counts."""
    marks = [("arrival", simulation.response.motion.arrival)]
    marks += [] if simulation.at is None else [(f"late peak from {simulation.at:g} s on", simulation.at)]
    axes.set(xlim=(simulation.time[0], simulation.time[-1]))
    for name, time in marks:
        if simulation.time[0] < time < simulation.time[-1]:
            axes.axvline(time, color=GREY, linewidth=0.8, linestyle="--", zorder=2)
            if labelled:
                note(axes, name, (time, 1.0), (0, 2), xycoords=axes.get_xaxis_transform(), ha="center")


def _entries(simulation: Simulation) -> Iterator[Line2D | Patch]:
    name = "simulated" if simulation.draws is None else "simulated, by the medians of the draws"
    if simulation.draws is not None and simulation.basis.fit is not None:
        name = "simulated, by the fitted values"
    yield Line2D([], [], label=name, **OURS)
    if simulation.draws is not None:
        yield Patch(color=PALE_BLUE, label=f"5 to 95 % of {simulation.draws.vibration.shape[2]} draws")
    if simulation.phases is not None:
        yield Patch(color=PALE, label="worst case over the imbalance phases")
    if simulation.comparisons:
        yield Line2D([], [], label="measured", **THEIRS)
    if any(_near_limit(simulation, i) for i in range(len(DIRECTIONS))):
        limit = simulation.limit or 0.0
        yield Line2D([], [], color=GREY, linewidth=0.8, linestyle=":", label=f"limit, {MM * limit:g} mm")


def _notes(simulation: Simulation) -> Iterator[str]:
    yield "displacement of the end point from its quasi-static position; scales differ"
    if simulation.comparisons:
        low, high = next(iter(simulation.comparisons.values())).measured.trace.time[[0, -1]]
        yield f"measured: from {low:.4g} to {high:.4g} s, drawn behind, its mean set to the simulation's"
    if any(_by_acceleration(simulation, direction) for direction in DIRECTIONS):
        yield "where an acceleration was measured: the simulated displacement differentiated twice; no bands"


def _drive_panels(simulation: Simulation) -> Iterator[tuple[str, Mapping[str, np.ndarray]]]:
    """Yield label and lines by name of each panel."""
    names = [joint.name for joint in simulation.arm.joints]
    for axis, rotations in zip("xyz", np.degrees(simulation.phi), strict=True):
        yield f"rotation\nabout {axis} [deg]", dict(zip(names, rotations, strict=True))
    if simulation.arm.belts:
        tensions = {
            f"{belt.name}, {span}": simulation.tension[s, b]
            for b, belt in enumerate(simulation.arm.belts)
            for s, span in enumerate(("upper", "lower"))
        }
        yield "belt tension\n[N]", tensions
    if simulation.pulleys:
        yield "pulleys turn\n[Hz]", alike({name: frequency for name, (_, frequency) in simulation.pulleys.items()})


# -------- Spectrum
# Figures of vibration: amplitude against frequency, against time and frequency, and of a pulley's orders over time.

SPECTRUM_PANEL = (8.0, 2.5)
"""Width and height of a panel [inch]."""
LETTER, LINE = 0.068, 12.0
"""Width of a letter [inch] and height of a line [point] of what is written above a panel."""


def _styles(width: float, colours: Sequence[str]) -> tuple[Style, ...]:
    """Return a style for each colour as a solid line, then dashed, then dotted."""
    lines = ("-", "--", ":")
    return tuple({"color": color, "linestyle": line, "linewidth": width} for line in lines for color in colours)


SERIES = _styles(1.4, (BLUE, ORANGE, GREEN, PINK))
LINES = _styles(1.6, (ORANGE, GREEN, "black", PINK))
"""Styles of a pulley's orders: over the blue of a spectrogram, and the same over time."""


def spectra_figure(spectra: "Spectra") -> Figure:
    """Draw the spectra of one or two traces with the modes of an arm, a panel for each direction."""
    remarks, modes = [spectra.remark] if spectra.remark else [], spectra.modes
    if modes:
        drawn = "thin lines" if modes.held else "grey"
        remarks.append(f"{drawn}: natural frequencies {where_marked(modes)}, {modes.load}")
    panels = [direction.upper() for direction in spectra.directions]
    return spectrum_figure(
        spectra.spectra, panels, modes.bands if modes else {}, upto=spectra.upto, kind=spectra.kind, remarks=remarks
    )


def spectrogram_figures(spectra: "Spectra", *, decibel: bool = False) -> dict[str, Figure]:
    """Draw the spectrogram of each direction, with a line for each order of each pulley."""
    time = spectra.traces[spectra.name].time
    same = {f"{track.orders[o]:g} x {name}" for name, track, o, other in _orders(spectra) if other}
    lines = {name: (time, frequency) for name, frequency in spectra.lines.items() if name not in same}
    style: dict[str, Any] = {"upto": spectra.upto, "decibel": decibel, "kind": spectra.kind}
    return {
        direction: spectrogram_figure(part, lines, title=f"{direction.upper()}: {spectra.name}", **style)
        for direction, part in spectra.spectrograms.items()
    }


def spectrum_figure(
    series: Mapping[str, "Spectrum"],
    directions: Sequence[str] = ("X", "Z"),
    marks: Mapping[str, "Band"] | None = None,
    *,
    upto: float = 20.0,
    kind: str = "displacement",
    remarks: Sequence[str] = (),
) -> Figure:
    """Draw amplitude spectra of displacements or accelerations, a panel for each direction.

    Args:
        series: spectra by name, of amplitudes (F, directions) [m], or (F,) [m] for a single direction.
        directions: names of the panels, in the order of the amplitudes' columns.
        marks: lowest and highest frequency [Hz] by name, drawn as thin lines where they are alike, else as a shade;
            those beyond the axis are named below.
        upto: [Hz] right end of the axis.
        kind: `displacement` [m], drawn in mm, or `acceleration` [m/s^2].
        remarks: further lines below the panels.
    """
    flags = _rows_of_flags({name: band for name, band in (marks or {}).items() if band[0] <= upto}, upto)
    beyond = [_mark(name, band) for name, band in (marks or {}).items() if band[0] > upto]
    notes = [*_descriptions(series), *([f"beyond the axis: {', '.join(beyond)}"] if beyond else []), *remarks]
    above = LINE / 72 * (1 + max((flag.row for flag in flags), default=-1))
    height = SPECTRUM_PANEL[1] * len(directions) + above + 0.19 * len(notes) + 0.9
    figure = titled((SPECTRUM_PANEL[0], height), "Amplitude spectrum")
    grid = figure.subplots(len(directions), 1, squeeze=False, sharex=True)[:, 0]
    for i, (axes, direction) in enumerate(zip(grid, directions, strict=True)):
        _spectra(axes, series, i, upto, TRACE_UNITS[kind][0])
        axes.set_ylabel(
            f"{cut(direction, 20)}: amplitude, 0-peak [{TRACE_UNITS[kind][1]}]", fontsize=9, parse_math=False
        )
        _flags(axes, flags, labelled=i == 0)
    grid[-1].set(xlabel="frequency [Hz]")
    handles = [Line2D([], [], label=cut(name, 40), **s) for name, s in zip(series, cycle(SERIES), strict=False)]
    figure.align_ylabels(grid)
    key_below(figure, handles, "\n".join(notes), columns=3)
    return figure


def spectrogram_figure(
    spectrogram: "Spectrogram",
    lines: Mapping[str, tuple[Float[np.ndarray, "_"], Float[np.ndarray, "_"]]] | None = None,
    *,
    title: str = "Spectrogram",
    upto: float = 20.0,
    decibel: bool = False,
    kind: str = "displacement",
) -> Figure:
    """Draw the amplitude of a trace over time and frequency, with lines such as a pulley's frequency.

    Args:
        spectrogram: of one trace, amplitudes (F, B) [m].
        lines: times [s] and frequencies [Hz] by name; NaN interrupts a line.
        title: heading, such as which direction of which motion.
        upto: [Hz] upper end of the axis.
        decibel: colours by 20 log10(amplitude / 1 unit), down to 60 dB below the largest, instead of the unit.
        kind: `displacement` [m], drawn in mm, or `acceleration` [m/s^2].
    """
    figure, axes = amplitude_figure((SPECTRUM_PANEL[0], 4.9), spectrogram, title, upto, kind, decibel)
    handles = []
    for (name, (time, frequency)), style in zip((lines or {}).items(), cycle(LINES), strict=False):
        axes.plot(time, frequency, **style)
        handles.append(Line2D([], [], label=cut(name, 40), **style))
    note = f"{spectrogram.description()}\ngrey: less than half a segment from an end of the trace"
    key_below(figure, handles, note, columns=3)
    return figure


def _spectra(axes: Axes, series: Mapping[str, "Spectrum"], column: int, upto: float, factor: float) -> None:
    """Draw one direction of each spectrum, the axis from zero to what is seen."""
    top = 0.0
    for spectrum, style in zip(series.values(), cycle(SERIES), strict=False):
        amplitude = factor * spectrum.amplitude.reshape(len(spectrum.frequency), -1)[:, column]
        axes.plot(spectrum.frequency, amplitude, **style)
        top = max(top, float(amplitude[spectrum.frequency <= upto].max()))
    plain(axes)
    axes.set(xlim=(0, upto), ylim=(0, 1.08 * top or 1.0))


class _Flag(NamedTuple):
    """A mark: its text, and from which to which frequency [Hz] it reaches, in which row above the panel."""

    text: str
    band: "Band"
    row: int


def _rows_of_flags(marks: Mapping[str, "Band"], upto: float) -> list[_Flag]:
    """Return the marks, each above the rows of all others that its text reaches over."""
    flags: list[_Flag] = []
    for name, band in sorted(marks.items(), key=lambda mark: -mark[1][0]):
        text = _mark(name, band)
        end = band[0] + LETTER * (len(text) + 2) * upto / (SPECTRUM_PANEL[0] - 2.0)
        row = 1 + max((flag.row for flag in flags if flag.band[0] <= end), default=-1)
        flags.append(_Flag(text, band, row))
    return flags


def _mark(name: str, band: "Band") -> str:
    return f"{cut(name, 24)}: {hertz(band)}"


def _flags(axes: Axes, flags: Sequence[_Flag], *, labelled: bool) -> None:
    """Draw each mark as a thin line, or the shade of a band, up to its text above the panel."""
    for text, (low, high), row in flags:
        axes.axvline(low, color=GREY, linewidth=0.7, zorder=1)
        if high > low:
            axes.axvspan(low, high, color=GREY, alpha=0.15, linewidth=0, zorder=0)
        if labelled:
            line = {"arrowstyle": "-", "color": GREY, "linewidth": 0.7, "relpos": (0, 0), "shrinkA": 0, "shrinkB": 0}
            place: Any = {"xycoords": axes.get_xaxis_transform(), "arrowprops": line}
            note(axes, f" {text}", (low, 1.0), (0, 2 + LINE * row), **place)


def amplitude_figure(
    size: tuple[float, float], spectrogram: "Spectrogram", title: str, upto: float, kind: str, decibel: bool = False
) -> tuple[Figure, Axes]:
    """Draw the amplitudes, straight between bins and segments, and the bar that tells them."""
    factor, unit = TRACE_UNITS[kind]
    figure = titled(size, cut(title, 70))
    axes = figure.subplots()
    inside = spectrogram.frequency <= upto + spectrogram.resolution
    shown = factor * spectrogram.amplitude[inside]
    top, bottom = float(shown.max()), 0.0
    if decibel:
        shown = 20 * np.log10(np.maximum(shown, np.finfo(float).tiny))
        top, unit = float(shown.max()), f"dB re 1 {unit}"
        bottom = top - 60.0
    # in proportion to the root of the amplitude, so that an order is seen beside its resonances
    scale = Normalize(bottom, top or 1.0) if decibel else PowerNorm(0.5, bottom, top or 1.0)
    mesh = axes.pcolormesh(
        spectrogram.time, spectrogram.frequency[inside], shown, cmap="Blues", norm=scale, shading="gouraud"
    )
    colour_bar(figure, axes, mesh, f"amplitude, 0-peak [{unit}]", extend="min" if decibel else "neither")
    axes.set_facecolor("#E4E4E4")
    half = 0.5 / spectrogram.resolution
    axes.set(xlim=(spectrogram.time[0] - half, spectrogram.time[-1] + half), ylim=(0, upto))
    axes.set(xlabel="time [s]", ylabel="frequency [Hz]")
    plain(axes)
    return figure, axes


def _descriptions(series: Mapping[str, "Spectrum"]) -> Iterator[str]:
    """Yield how the spectra were made: one line for all that were made alike."""
    alike = by_key((spectrum.description(), cut(name, 24)) for name, spectrum in series.items())
    for words, names in alike.items():
        yield words if len(alike) == 1 else f"{', '.join(names)}: {words}"
    resolutions = [spectrum.resolution for spectrum in series.values()]
    if max(resolutions) > 1.01 * min(resolutions):
        yield "resolutions differ: compare the heights of steady sines only, not of what swells, decays or is noise"


def orders_figure(spectra: "Spectra") -> Figure:
    """Draw the amplitude of each pulley's orders over time, a panel for each direction; none that is another's."""
    factor, unit = TRACE_UNITS[spectra.kind]
    count = len(spectra.directions)
    figure = titled((SPECTRUM_PANEL[0], SPECTRUM_PANEL[1] * count + 1.3), "Orders of the pulleys")
    grid = figure.subplots(count, 1, squeeze=False, sharex=True)[:, 0]
    every = list(_orders(spectra))
    styled = list(zip([order[:3] for order in every if not order[3]], cycle(LINES), strict=False))
    for d, (axes, direction) in enumerate(zip(grid, spectra.directions, strict=True)):
        for (_, track, o), style in styled:
            axes.plot(track.time, factor * track.amplitude[o, :, d], marker="o", markersize=3.5, **style)
        plain(axes)
        axes.set_ylim(bottom=0)
        axes.set(ylabel=f"{direction.upper()}: amplitude, 0-peak [{unit}]")
    grid[-1].set(xlabel="time [s]")
    figure.align_ylabels(grid)
    handles = [
        Line2D([], [], marker="o", markersize=3.5, label=_order(track, o, name), **style)
        for (name, track, o), style in styled
    ]
    revolutions = next(iter(spectra.tracks.values())).revolutions
    fastest = max(float(np.max(track.frequency)) for track in spectra.tracks.values())
    notes = f"a point for each {revolutions} revolutions; pulleys turn at up to {fastest:.3g} Hz"
    same = [(_order(track, o, name), other) for name, track, o, other in every if other]
    notes += "".join(f"\nnot drawn: {order}, as fast as {cut(other, 30)}" for order, other in same)
    key_below(figure, handles, notes, columns=3)
    return figure


def _orders(spectra: "Spectra") -> Iterator[tuple[str, "OrderTrack", int, str | None]]:
    """Yield each order of each pulley, with the lower order that turns as fast, if there is one."""
    for name, track in spectra.tracks.items():
        for o in range(len(track.orders)):
            yield name, track, o, spectra.elsewhere(name, o)


def _order(track: "OrderTrack", order: int, name: str) -> str:
    return f"order {track.orders[order]:g} of {cut(name, 30)}"


# -------- Joint
# Logs of a joint's motor and link.


def joint_figure(joints: "Sequence[JointTwist]") -> Figure:
    """Draw the twist of each joint over its torque: samples, and the straight line of the stiffness."""
    columns = min(len(joints), 3)
    lines = -(-len(joints) // columns)
    figure = titled((3.2 * columns + 1.0, 3.2 * lines + 0.6), "Twist of joints over their torque")
    for number, each in enumerate(joints, 1):
        axes = figure.add_subplot(lines, columns, number)
        axes.plot(each.torque, 1e3 * each.twist, color=PALE_BLUE, marker=".", markersize=2, linestyle="")
        ends = np.array([each.torque.min(), each.torque.max()])
        middle = float(each.torque.mean()), float(each.twist.mean())
        slope = each.compliance
        for compliance, style in ((slope.value, "-"), (slope.low, "--"), (slope.high, "--")):
            line = middle[1] - compliance * (ends - middle[0])
            axes.plot(ends, 1e3 * line, color=ORANGE, linestyle=style, linewidth=1.2)
        axes.set_title(cut(each.name, 24), fontsize=10, parse_math=False)
        axes.set(xlabel="torque [N m]", ylabel="twist [mrad]")
        plain(axes, grid=True)
    samples = Line2D([], [], label="samples", color=PALE_BLUE, marker=".", linestyle="")
    handles = [samples, Line2D([], [], label="stiffness, with its 95 % interval (broken)", color=ORANGE)]
    key_below(figure, handles, "Without zero, delay, friction and the encoder's error.", columns=2)
    return figure
