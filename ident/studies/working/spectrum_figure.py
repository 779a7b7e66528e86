"""Amplitude spectra of traces, with natural frequencies."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import cycle
from typing import TYPE_CHECKING, Any, NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ident.report.report import cut
from ident.report.style import BLUE, GREEN, GREY, ORANGE, PINK, key_below, note, plain, titled
from ident.report.words import trace_unit
from ident.studies.working.spectrogram_figure import styles
from ident.studies.working.spectrum_report import hertz, where_marked
from ident.text import by_key

if TYPE_CHECKING:
    from ident.studies.working.spectra import Band, Spectra
    from ident.vibrate.spectra import Spectrum

PANEL = (8.0, 2.5)
"""Width and height of a panel [inch]."""
LETTER, LINE = 0.068, 12.0
"""Width of a letter [inch] and height of a line [point] above a panel."""


SERIES = styles(1.4, (BLUE, ORANGE, GREEN, PINK))


def spectra_figure(spectra: "Spectra") -> Figure:
    """Draw the spectra of one or two traces with the modes of an arm, a panel for each direction."""
    remarks, modes = [spectra.remark] if spectra.remark else [], spectra.modes
    if modes:
        drawn = "thin lines" if modes.held else "grey"
        remarks.append(f"{drawn}: natural frequencies {where_marked(modes)}, {modes.load}")
    style: dict[str, Any] = {"upto": spectra.upto, "kind": spectra.kind, "remarks": remarks}
    return spectrum_figure(spectra.spectra, spectra.directions, modes.bands if modes else {}, **style)


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
        marks: lowest and highest frequency [Hz] by name, drawn as thin lines if equal, else as a shade; marks beyond
            the axis are named below.
        upto: [Hz] right end of the axis.
        kind: `displacement` [m], drawn in mm, or another of `trace_unit`.
        remarks: further lines below the panels.
    """
    flags = _rows_of_flags({name: band for name, band in (marks or {}).items() if band[0] <= upto}, upto)
    beyond = [_mark(name, band) for name, band in (marks or {}).items() if band[0] > upto]
    notes = [*_descriptions(series), *([f"beyond the axis: {', '.join(beyond)}"] if beyond else []), *remarks]
    above = LINE / 72 * (1 + max((flag.row for flag in flags), default=-1))
    height = PANEL[1] * len(directions) + above + 0.19 * len(notes) + 0.9
    figure = titled((PANEL[0], height), "Amplitude spectrum")
    grid = figure.subplots(len(directions), 1, squeeze=False, sharex=True)[:, 0]
    for i, (axes, direction) in enumerate(zip(grid, directions, strict=True)):
        _spectra(axes, series, i, upto, trace_unit(kind)[0])
        axes.set_ylabel(
            f"{cut(direction, 20)}: amplitude, 0-peak [{trace_unit(kind)[1]}]", fontsize=9, parse_math=False
        )
        _flags(axes, flags, labelled=i == 0)
    grid[-1].set(xlabel="frequency [Hz]")
    handles = [Line2D([], [], label=cut(name, 40), **s) for name, s in zip(series, cycle(SERIES), strict=False)]
    figure.align_ylabels(grid)
    key_below(figure, handles, "\n".join(notes), columns=3)
    return figure


def _spectra(axes: Axes, series: Mapping[str, "Spectrum"], column: int, upto: float, factor: float) -> None:
    """Draw one direction of each spectrum, with the axis starting at zero."""
    top = 0.0
    for spectrum, style in zip(series.values(), cycle(SERIES), strict=False):
        amplitude = factor * spectrum.amplitude.reshape(len(spectrum.frequency), -1)[:, column]
        axes.plot(spectrum.frequency, amplitude, **style)
        top = max(top, float(amplitude[spectrum.frequency <= upto].max()))
    plain(axes)
    axes.set(xlim=(0, upto), ylim=(0, 1.08 * top or 1.0))


class _Flag(NamedTuple):
    """A mark: its text, its lower and upper frequency [Hz], and its row above the panel."""

    text: str
    band: "Band"
    row: int


def _rows_of_flags(marks: Mapping[str, "Band"], upto: float) -> list[_Flag]:
    """Return the marks, each above the rows of all others that its text overlaps."""
    flags: list[_Flag] = []
    for name, band in sorted(marks.items(), key=lambda mark: -mark[1][0]):
        text = _mark(name, band)
        end = band[0] + LETTER * (len(text) + 2) * upto / (PANEL[0] - 2.0)
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


def _descriptions(series: Mapping[str, "Spectrum"]) -> Iterator[str]:
    """Yield how the spectra were computed: one line for all with the same settings."""
    alike = by_key((spectrum.description(), cut(name, 24)) for name, spectrum in series.items())
    for words, names in alike.items():
        yield words if len(alike) == 1 else f"{', '.join(names)}: {words}"
    resolutions = [spectrum.resolution for spectrum in series.values()]
    if max(resolutions) > 1.01 * min(resolutions):
        yield "resolutions differ: compare the heights of steady sines only, not of what swells, decays or is noise"
