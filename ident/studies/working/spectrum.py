"""Show at which frequencies a trace vibrates, and by how much."""

from collections.abc import Mapping
from dataclasses import field
from math import inf, radians
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ident.errors import Problem, refusal
from ident.studies import reading
from ident.studies.door import DEFAULT, study
from ident.studies.options import WINDOWS, option
from ident.studies.result import Result
from ident.studies.shared import FARTHEST, BaseOptions, SamplesOptions, as_log, is_angle
from ident.studies.working.simulate import SimulateResult

if TYPE_CHECKING:
    import numpy as np
    from jaxtyping import Float
    from matplotlib.figure import Figure

    from ident.description.file import ArmFile
    from ident.measure import Log, Trace
    from ident.studies.working.spectra import MarkedModes, Pulleys, Spectra
    from ident.vibrate.spectra import Peak

    Given = Trace | SimulateResult | str | Path

SIMULATED = ".simulate"
"""End of the name of a simulated trace, which has no sensor."""


class SpectrumOptions(BaseOptions, SamplesOptions):
    """Options of `ident.spectrum`: the part of the trace, its analysis, and the posture of an arm."""

    direction: tuple[str, ...] | None = option(None, "as x,z, or names of channels; default: all", read=reading.words)
    window: str = option("hann", "hann, boxcar, hamming, blackmanharris or flattop", choices=WINDOWS)
    segments: int = option(1, "segments to average over: steadier, but wider peaks")
    upto: float = option(20.0, "highest frequency [Hz]", above=0.0)
    start: float | None = option(None, "time [s] from which on the trace counts", flag="--from")
    end: float | None = option(None, "time [s] up to which the trace counts", flag="--to")
    posture: tuple[float, ...] | None = option(
        None,
        "of that arm, in degrees, as 30,-60,30; default: along the trace's motion where its file has it",
        short="-q",
        read=reading.several,
    )
    load: str = option("", "load case, as 'glass' or '5 kg @ tip'")
    spectrogram: bool = option(False, "amplitudes over time and frequency")
    segment: float | None = option(
        None,
        "duration [s] of the spectrogram's segments; default: 1, at most a quarter of all",
        above=0.0,
        argument="segment_seconds",
    )
    decibel: bool = option(False, "colours of the spectrogram in dB")
    orders: tuple[float, ...] = option(
        (1.0,),
        "multiples of the pulleys' turning that are drawn in the spectrogram, where the file has their frequency",
        read=reading.several,
        text="1",
    )

    def problems(self) -> list[Problem]:
        """Refuse an invalid posture."""
        problems = super().problems()
        if self.posture and not all(map(is_angle, self.posture)):
            expected = f"angles within {FARTHEST:g} deg"
            problems.append(Problem("posture", f"{self.posture}", expected, "as (30, -60, 30)"))
        return problems


class SpectrumResult(Result):
    """The spectra of one or two traces.

    The table has a row for each of the strongest peaks: frequency [Hz] and amplitude [SI] with standard errors, and the
    mode near it.

    Attributes:
        spectra: traces, spectra, spectrograms, and the modes of an arm.
        arm: the arm as in its file; None if none was named.
        path: the joint path that was given for the modes; None for the path in the trace's own file.
        options: the options of the call.
    """

    spectra: "Spectra"
    arm: "ArmFile | None" = None
    path: "Log | None" = None
    options: SpectrumOptions = field(default_factory=SpectrumOptions)

    numbers = ("amplitudes",)

    @property
    def name(self) -> str:
        """Name of the trace and of the study."""
        return f"{next(iter(self.spectra.traces)).removesuffix(SIMULATED)}.spectrum"

    @property
    def frequency(self) -> 'Float[np.ndarray, "F"]':
        """Frequencies of the (first) trace's spectrum [Hz], up to half the sampling rate."""
        return self.spectra.spectra[self.spectra.name].frequency

    @property
    def amplitudes(self) -> "Mapping[str, Float[np.ndarray, 'F']]":
        """Amplitudes of the (first) trace at these frequencies, 0-peak, by direction [SI]."""
        spectrum = self.spectra.spectra[self.spectra.name]
        return {d: spectrum.column(i).amplitude for i, d in enumerate(self.spectra.directions)}

    def band_rms(self, low: float, high: float) -> "Mapping[str, float]":
        """Return the root mean square of the (first) trace within a band, by direction [SI].

        Args:
            low: [Hz] lower end of the band.
            high: [Hz] upper end.

        Raises:
            InputError: the spectrum has no frequency in the band.
        """
        from ident.vibrate.spectra import band_rms

        rms = band_rms(self.spectra.spectra[self.spectra.name], low, high)
        return dict(zip(self.spectra.directions, map(float, rms), strict=True))

    def peaks(self, direction: str, *, low: float = 0.0, high: float = inf, count: int = 5) -> "tuple[Peak, ...]":
        """Return the largest peaks of the (first) trace in a direction within a band, the largest first [Hz].

        Args:
            direction: one of those of the spectrum.
            low: [Hz] lower end of the band.
            high: [Hz] upper end.
            count: peaks, at most.
        """
        from ident.vibrate.spectra import peaks

        column = self.spectra.directions.index(direction)
        return peaks(self.spectra.spectra[self.spectra.name].column(column), count, (low, high))

    @property
    def notes(self) -> tuple[str, ...]:
        """Differences between the arm and its robot description; those of a trace are findings."""
        return self.arm.notes if self.arm else ()

    def _figures(self) -> "dict[str, Figure]":
        """Return the spectra, and spectrograms by direction if requested."""
        from ident.studies.working.spectrogram_figure import spectrogram_figures
        from ident.studies.working.spectrum_figure import spectra_figure

        return {"": spectra_figure(self.spectra), **spectrogram_figures(self.spectra, decibel=self.options.decibel)}

    def _inputs(self) -> Mapping[str, Any]:
        files = dict(zip(("trace", "against"), self.spectra.traces.values(), strict=False))
        return {"arm": self.arm, "path": self.path, "trace": None, "against": None} | files


@study
def spectrum(
    trace: "Trace | SimulateResult | str | Path",
    options: SpectrumOptions = DEFAULT,
    *,
    arm: "ArmFile | None" = None,
    against: "Trace | SimulateResult | str | Path | None" = None,
    pulleys: "Pulleys | None" = None,
    path: "Log | str | Path | None" = None,
) -> SpectrumResult:
    """Show at which frequencies [Hz] a trace vibrates, by how much, and what is in its file.

    Args:
        trace: a trace, a file (columns x, y, z, or a recording of any format), or a simulated motion.
        options: the part of the trace, and its analysis.
        arm: marks its natural frequencies: along the motion if the joint path is known, else at a posture.
        against: another trace, such as a measured one, drawn over the first.
        pulleys: rotation of pulleys at the times of the trace, by name; by default from its file or the simulation.
        path: joint angles at the times of the trace: a log, or its file; by default from the trace's file or the
            simulation.

    Raises:
        InputError: a trace that is too short, or lacks what is requested; contradictory options.
        ModelError: the arm has no stable equilibrium at the posture.
    """
    from ident.studies.working.spectra import (
        Spectra,
        amplitude_spectra,
        common_directions,
        comparable,
        distinct,
        spectrograms,
    )

    _check_arm(arm, options, path)
    given, turning, others = _traces(trace, against, pulleys, options)
    directions, (traces, remark) = common_directions(given, options.direction), comparable(given)
    first, turning = next(iter(traces.values())), distinct(turning)
    log = None if arm is None or path is None else as_log(path, arm.arm, options.columns)
    window = options.window
    graded = () if next(iter(traces)).endswith(SIMULATED) else (next(iter(given.values())), *others)
    spectra = Spectra(
        directions,
        traces,
        amplitude_spectra(traces, directions, window=window, segments=options.segments),
        options.upto,
        turning,
        _modes(arm, options, first, trace, log),
        options.orders,
        spectrograms(first, directions, window=window, seconds=options.segment) if options.spectrogram else {},
        remark,
        tuple(each for one in graded for each in one.grades),
    )
    return SpectrumResult(spectra, arm, log, options)


def _traces(
    trace: "Given", against: "Given | None", pulleys: "Pulleys | None", options: SpectrumOptions
) -> "tuple[dict[str, Trace], Pulleys, tuple[Trace, ...]]":
    """Return the selected parts of the traces, by name, the pulleys of the first, and what is not drawn of its file."""
    from ident.studies.working.spectra import cut

    name, (first, *others), beside = _read(trace, options.columns)
    turning = beside if pulleys is None else pulleys
    first, turning = cut(first, turning, options.start, options.end)
    if against is None:
        return {name: first}, turning, tuple(others)
    other, (second, *_), _ = _read(against, options.columns)
    second, _ = cut(second, {}, options.start, options.end)
    return {name: first, other if other != name else second.path or f"{other} (2)": second}, turning, tuple(others)


def _read(trace: "Given", columns: Mapping[str, str]) -> "tuple[str, tuple[Trace, ...], Pulleys]":
    """Return a trace with its name, further channels of its file, and its pulleys."""
    from ident.measure import Trace, read_pulleys
    from ident.measure.signals import read_signals

    if isinstance(trace, Trace):
        return Path(trace.path).stem or "trace", (trace,), {}
    if isinstance(trace, SimulateResult):
        values = dict(zip("xyz", trace.vibration, strict=True))
        turning = {name: frequency for name, (_, frequency) in trace.simulation.pulleys.items()}
        return trace.name, (Trace("", "", trace.time, "displacement", values),), turning
    signals = read_signals(trace, columns)
    return Path(trace).stem, signals, read_pulleys(trace, signals[0])


def _check_arm(arm: "ArmFile | None", options: SpectrumOptions, path: Any) -> None:
    """Refuse options of an arm without an arm, and two postures at once."""
    if path is not None and options.posture is not None:
        raise refusal("posture", "it beside `path`", "one of them", "drop one")
    for name, value in {"posture": options.posture, "soft_base": options.soft_base, "path": path}.items():
        if arm is None and value is not None:
            raise refusal(name, "it without `arm`", "an arm", "name the arm's file (`arm`)")


def _modes(
    arm_file: "ArmFile | None",
    options: SpectrumOptions,
    first: "Trace",
    trace: "Trace | SimulateResult | str | Path",
    path: "Log | None",
) -> "MarkedModes | None":
    """Return the arm's natural frequencies at the requested posture, or along the motion, or at zero angles."""
    from ident.measure import Load
    from ident.studies.working.spectra import marked_along, marked_at

    if arm_file is None:
        return None
    arm, load = arm_file.arm, Load.parse(options.load)
    joints = [joint.name for joint in arm.driven]
    log = path or (_joint_path(trace, first, joints, options.columns) if options.posture is None else None)
    if log is not None:
        return marked_along(arm, log, (float(first.time[0]), float(first.time[-1])), load)
    return marked_at(arm, tuple(map(radians, options.posture or (0.0,) * len(joints))), load)


def _joint_path(trace: "Given", first: "Trace", joints: list[str], columns: Mapping[str, str]) -> "Log | None":
    """Return the joint angles during a trace: from the simulation or the file; None for none."""
    from ident.measure import Log, Trace, read_log

    if isinstance(trace, Trace):
        return None
    if isinstance(trace, SimulateResult):
        simulated = trace.simulation
        names = [joint.name for joint in simulated.arm.driven]
        angles = dict(zip(names, simulated.response.posture, strict=True))
        return Log("", "", trace.time, angles) if set(joints) <= set(angles) else None
    named = {column.partition(" [")[0] for column in first.ignored}
    return read_log(trace, joints, columns) if named.issuperset(joints) else None
