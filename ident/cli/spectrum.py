"""`ident spectrum`."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ident.cli import options, running
from ident.cli.app import app
from ident.errors import InputError, Problem

if TYPE_CHECKING:
    from ident.assess.spectra import Spectra
    from ident.identify.modal_analysis import ModalAnalysis
    from ident.measure import Trace

NAMED = {
    "window": "--window",
    "segments": "--segments",
    "segment_seconds": "--segment",
    "orders": "--orders",
    "angle": "--revolutions",
}
"""The option that gives each argument of the library."""


@app.command("spectrum")
def spectrum_command(
    file: Annotated[
        Path, typer.Argument(help="trace: CSV with time [s], x [mm] or x [m/s^2], ...; as of ident simulate")
    ],
    direction: Annotated[str | None, typer.Option(help="as x,z; default: all that the file has")] = None,
    window: Annotated[str, typer.Option(help="hann, boxcar, hamming, blackmanharris or flattop")] = "hann",
    segments: Annotated[int, typer.Option(help="segments to average over: steadier, but wider peaks")] = 1,
    upto: Annotated[float, typer.Option(help="highest frequency [Hz]")] = 20.0,
    start: Annotated[float | None, typer.Option("--from", help="time [s] from which on the trace counts")] = None,
    end: Annotated[float | None, typer.Option("--to", help="time [s] up to which the trace counts")] = None,
    arm: Annotated[Path | None, typer.Option(help="arm description: marks its natural frequencies")] = None,
    posture: Annotated[
        str | None, typer.Option("--posture", "-q", help="of that arm, in degrees, as 30,-60,30")
    ] = None,
    load: options.LoadOption = "",
    against: Annotated[Path | None, typer.Option(help="another trace, drawn over the first, as a measured one")] = None,
    spectrogram: Annotated[bool, typer.Option("--spectrogram", help="amplitudes over time and frequency")] = False,
    segment: Annotated[
        float | None,
        typer.Option(help="duration [s] of the spectrogram's segments; default: 1, at most a quarter of all"),
    ] = None,
    decibel: Annotated[bool, typer.Option("--decibel", help="colours of the spectrogram in dB")] = False,
    orders: Annotated[
        str | None,
        typer.Option(help="multiples of the pulleys' turning, as 1,2: tracked where the file has their angles"),
    ] = None,
    revolutions: Annotated[
        int, typer.Option(min=1, help="of a block over which an order is tracked: more tell orders better, times worse")
    ] = 4,
    out: options.OutOption = Path("out"),
    no_figure: options.NoFigureOption = False,
) -> None:
    """Show at which frequencies a trace vibrates, and how much.

    Writes FILE.spectrum.png, and with --spectrogram and --orders further figures, into the folder given by --out.
    """
    options.check_positive(upto, "--upto")
    options.check_positive(segment, "--segment")
    asked = options.several(orders, "--orders") if orders else ()
    if posture and arm is None:
        raise InputError(Problem("--posture", "it without --arm", "an arm", "name the arm's file (--arm)"))
    running.start()
    from ident.assess.spectra import spectra_of
    from ident.measure import read_pulleys, read_trace
    from ident.present.text.spectrum import spectrum_report

    trace = read_trace(file)
    pulleys = read_pulleys(file, trace)
    if asked and not any(pulley.angle is not None for pulley in pulleys.values()):
        expected, remedy = "a column as 'drive1.angle [rad]'", "give a file of ident simulate, or drop --orders"
        raise InputError(Problem(str(file), "no pulley's angle", expected, remedy))
    inside = _span(trace.time, start, end)
    traces = {file.stem: _cut(trace, inside)}
    pulleys = {name: _turning(pulley, inside) for name, pulley in pulleys.items()}
    if against is not None:
        other = read_trace(against)
        traces[_other_name(file, against)] = _cut(other, _span(other.time, start, end))
    found = options.renamed(
        NAMED,
        spectra_of,
        traces,
        _directions(direction, traces),
        window=window,
        segments=segments,
        upto=upto,
        pulleys=pulleys,
        survey=_survey(arm, posture, load) if arm else None,
        orders=asked,
        revolutions=revolutions,
    )
    base = out / f"{file.stem.removesuffix('.simulate')}.spectrum"
    figures: dict[Path, Any] = {}
    if not no_figure:
        figures = dict(_figures(found, base))
        if spectrogram:
            figures |= dict(_spectrograms(found, base, window, segment, decibel))
    typer.echo(spectrum_report(found))
    running.draw(figures)


def _figures(found: "Spectra", base: Path) -> Iterator[tuple[Path, Any]]:
    from ident.present.figures.orders import orders_figure
    from ident.present.figures.spectrum import spectrum_figure
    from ident.present.text.words import degrees

    remarks = [found.remark] if found.remark else []
    if found.survey:
        remarks.append(f"thin lines: natural frequencies at {degrees(found.survey.posture)}, {found.survey.load}")
    panels = [direction.upper() for direction in found.directions]
    yield (
        base.parent / f"{base.name}.png",
        spectrum_figure(found.spectra, panels, found.marks, upto=found.upto, kind=found.kind, remarks=remarks),
    )
    if found.tracks:
        yield base.parent / f"{base.name}.orders.png", orders_figure(found)


def _spectrograms(
    found: "Spectra", base: Path, window: str, segment: float | None, decibel: bool
) -> Iterator[tuple[Path, Any]]:
    """Yield a spectrogram of the first trace for each direction, with a line for each order of each pulley."""
    from ident.present.figures.spectrum import spectrogram_figure
    from ident.vibrate.signal.spectrogram import spectrogram

    name, trace = next(iter(found.traces.items()))
    seconds = segment or min(1.0, float(trace.time[-1] - trace.time[0]) / 4)
    lines = {name: (trace.time, frequency) for name, frequency in found.lines.items()}
    for direction in found.directions:
        shown = options.renamed(
            NAMED, spectrogram, trace.time, trace.values[direction], window=window, segment_seconds=seconds
        )
        title = f"{direction.upper()}: {name}"
        figure = spectrogram_figure(shown, lines, title=title, upto=found.upto, decibel=decibel, kind=found.kind)
        yield base.parent / f"{base.name}.{direction}.png", figure


def _directions(asked: str | None, traces: "dict[str, Trace]") -> list[str]:
    """Return the directions asked for, which all traces must have."""
    common = [d for d in next(iter(traces.values())).values if all(d in trace.values for trace in traces.values())]
    wanted = list(dict.fromkeys(part.strip().lower() for part in asked.split(","))) if asked else common
    for direction in wanted:
        if direction not in common:
            expected = f"some of {', '.join(common)}" if common else "a direction that both files have"
            raise InputError(Problem("--direction", f"'{direction}'", expected, "the files have no other in common"))
    if not wanted:
        raise InputError(Problem("--against", "a trace of other directions", "one in common", "give another file"))
    return wanted


def _span(time: Any, start: float | None, end: float | None) -> slice:
    import numpy as np

    low = 0 if start is None else int(np.searchsorted(time, start - 1e-9))
    high = len(time) if end is None else int(np.searchsorted(time, end + 1e-9))
    if high - low < 2:
        expected = f"a span within {time[0]:.4g} to {time[-1]:.4g} s"
        raise InputError(Problem("--from, --to", f"{high - low if high > low else 0} samples", expected, "widen it"))
    return slice(low, high)


def _cut(trace: "Trace", inside: slice) -> "Trace":
    from dataclasses import replace

    return replace(trace, time=trace.time[inside], values={d: x[inside] for d, x in trace.values.items()})


def _turning(pulley: Any, inside: slice) -> Any:
    parts = (None if part is None else part[inside] for part in (pulley.frequency, pulley.angle))
    return type(pulley)(*parts)


def _other_name(file: Path, other: Path) -> str:
    return other.stem if other.stem != file.stem else str(other)


def _survey(arm: Path, posture: str | None, load: str) -> "ModalAnalysis":
    from ident.description.file import read_arm
    from ident.identify.modal_analysis import modal_analysis
    from ident.measure import Load

    described = read_arm(arm).arm
    held = options.posture(posture) if posture else (0.0,) * len(described.driven)
    return modal_analysis(described, held, Load.parse(load), 6)
