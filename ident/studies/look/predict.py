"""Predict natural frequencies, modes and static deflection of an arm at postures."""

from collections.abc import Mapping
from dataclasses import field, replace
from math import radians
from typing import TYPE_CHECKING

from ident.errors import Problem, refusal, require
from ident.studies import reading
from ident.studies.door import DEFAULT, study
from ident.studies.options import option, repeated, seed_of_draws
from ident.studies.result import Result
from ident.studies.shared import FARTHEST, ArmOptions, is_angle, with_numbers
from ident.text import did_you_mean, quoted
from ident.units import asked_postures

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.figure import Figure

    from ident.description.file import ArmFile
    from ident.identify.modal_analysis import ModalAnalysis
    from ident.identify.values import Values
    from ident.studies.look.prediction import Prediction


class PredictOptions(ArmOptions):
    """Options of `ident.predict`: postures, load, and number of modes."""

    posture: tuple[tuple[float, ...], ...] = repeated(
        (), "joint angles in degrees, as 30,-60,30; may be repeated", short="-q", read=reading.postures
    )
    modes: int = option(6, "number of modes", low=1, high=1000)
    drives: str = option("brake", "what holds the motors: brake, or servo of the arm file", choices=("brake", "servo"))
    tool: bool = option(False, "compliance at a point: motion and turn per force and moment, static and by frequency")
    frame: str = option("base", "axes of the compliance: base, or tool, the point's link", choices=("base", "tool"))
    point: str = option("", "point of the compliance; default: the last one of the arm file")
    draws: int = option(200, "draws of the posterior", low=2, high=100_000)
    seed: int | None = seed_of_draws()

    def problems(self) -> list[Problem]:
        """Return a negative mass or stiffness, an invalid posture, or options of a compliance that is not asked for."""
        fine = all(isinstance(q, tuple | list) and all(map(is_angle, q)) for q in self.posture)
        expected, remedy = f"postures, each of several angles within {FARTHEST:g} deg", "as ((30, -60, 30),)"
        wrong = [] if fine else [Problem("posture", f"{self.posture}", expected, remedy)]
        if not self.tool and (self.point or self.frame != "base"):
            where, expected = "point" if self.point else "frame", "none without `tool`, the compliance"
            wrong.append(Problem(where, quoted(getattr(self, where)), expected, "add `tool`, or leave it out"))
        return [*super().problems(), *wrong]


class PredictResult(Result):
    """Modes and static deflection of an arm at some postures.

    The table has a row for each mode at each posture: angles [deg], frequency [Hz], label, damping ratio. With the
    option `tool` it has a row for each number of the compliance instead: motion, wrench, compliance [SI], its unit.

    Attributes:
        arm: the arm as in its file.
        predictions: modes, static deflection, and with `tool` compliance and frequency response, at each posture, in
            the order of the options, with those by draws.
        options: the options of the call.
        fit: fitted values of the arm.
        posterior: draws of the arm's numbers.
    """

    arm: "ArmFile"
    predictions: "tuple[Prediction, ...]"
    options: PredictOptions = field(default_factory=PredictOptions)
    fit: "Values | None" = None
    posterior: "Values | None" = None

    subject = "arm.name"
    shown = ("predictions", "fit", "posterior", "options.set")
    listed = ("predictions",)
    made_from = ("arm", "fit", "posterior")
    numbers = ("frequencies", "deflections")
    summarised = ("deflections", "deflection_bands", "peaks")

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes of the arm's description, and on the unit of a posture."""
        return (*super().notes, *asked_postures(each.posture for each in self.analyses))

    @property
    def analyses(self) -> "tuple[ModalAnalysis, ...]":
        """Modes and static deflection of the arm itself at each posture."""
        return tuple(each.analysis for each in self.predictions)

    @property
    def deflection_bands(self) -> "tuple[Mapping[str, np.ndarray], ...]":
        """5 and 95 % quantiles of the deflection at each posture by point name, (2, 3) [m]; NaN without draws."""
        return tuple(each.deflection_band for each in self.predictions)

    @property
    def frequencies(self) -> "tuple[np.ndarray, ...]":
        """Natural frequencies at each posture, ascending, (modes,) [Hz] each."""
        import numpy as np

        return tuple(np.asarray(analysis.modes.frequency) for analysis in self.analyses)

    @property
    def labels(self) -> tuple[tuple[str, ...], ...]:
        """Names of the modes at each posture, by their motion: `vertical bending 1`."""
        return tuple(tuple(map(str, analysis.labels)) for analysis in self.analyses)

    @property
    def deflections(self) -> "tuple[Mapping[str, np.ndarray], ...]":
        """Static deflection at each posture by point name, (3,) [m] in the base frame."""
        return tuple(analysis.deflection for analysis in self.analyses)

    @property
    def peaks(self) -> "tuple[Mapping[str, np.ndarray], ...]":
        """Largest responses along x, y and z (`tool`): `frequency` [Hz], `size` [m/N], (3,), their bands, (2, 3)."""
        found = (each.tool.response for each in self.predictions if each.tool and each.tool.response)
        names = "frequency", "size", "frequency_band", "size_band"
        return tuple(dict(zip(names, (*r.peaks, *r.peak_band.swapaxes(0, 1)), strict=True)) for r in found)

    def _figures(self) -> "dict[str, Figure]":
        """Return one figure a posture, `2` for the second: modes, or compliance, from the side and from above."""
        from ident.studies.look.predict_figure import compliance_figure, mode_figure

        shown = ((each.analysis, each.tool) for each in self.predictions)
        drawn = (compliance_figure(one, tool) if tool else mode_figure(one) for one, tool in shown)
        return {str(i + 1) if i else "": figure for i, figure in enumerate(drawn)}

    def frequency_figure(self, joint: str = "") -> "Figure":
        """Draw the natural frequencies against the angle of a joint, for postures along a motion.

        Args:
            joint: its name; by default the first joint that turns from posture to posture.

        Raises:
            InputError: the arm has no such driven joint.
        """
        from ident.studies.look.predict_figure import frequency_figure

        names = [each.name for each in self.arm.arm.driven]
        angles = zip(*(analysis.posture for analysis in self.analyses), strict=True)
        turning = [name for name, own in zip(names, angles, strict=True) if len(set(own)) > 1]
        chosen = joint or next(iter(turning), names[0])
        remedy = did_you_mean(chosen, names, "correct the name")
        require(chosen in names, "joint", quoted(chosen), f"one of {', '.join(names)}", remedy)
        return frequency_figure(self.predictions, names.index(chosen))


@study
def predict(
    arm: "ArmFile", options: PredictOptions = DEFAULT, *, fit: "Values | None" = None, posterior: "Values | None" = None
) -> PredictResult:
    """Predict natural frequencies, modes and static deflection of an arm, held at postures under a load.

    Args:
        arm: the arm.
        options: postures, by default the one with all angles zero; load; numbers to change; number of modes; whether
            the compliance at a point too, and in which frame.
        fit: fitted values for the arm: a result, or its file.
        posterior: draws for bands of 5 to 95 %, or the file of `ident sample`; the arm takes their medians unless it
            has fitted values.

    Raises:
        InputError: a posture of the wrong length, an unknown load, number or point, an arm without any point; a file
            that does not match the arm.
        ModelError: the arm has no stable equilibrium there.
    """
    from ident.identify.compliance import tool_compliance
    from ident.identify.modal_analysis import modal_analysis
    from ident.measure import Load
    from ident.studies.look.prediction import Prediction, predict_draws

    changed = with_numbers(arm.arm, fit or posterior, options.set)
    draws, load = posterior.without(options.set) if posterior else {}, Load.parse(options.load)
    if posterior and next(iter(posterior.values.values())).size < 2:
        raise refusal("posterior", "one draw", "two at least, for a band", "sample longer")
    if posterior and not draws:
        raise refusal("set", "every number of the posterior", "one that is drawn", "drop one of them")
    postures = [tuple(map(radians, angles)) for angles in options.posture] or [(0.0,) * len(changed.driven)]
    analyses = [modal_analysis(changed, posture, load, options.modes, options.drives) for posture in postures]
    predictions = tuple(predict_draws(each, draws) if draws else Prediction(each) for each in analyses)
    if options.tool:
        tools = [tool_compliance(each, options.point, options.frame, draws) for each in analyses]
        predictions = tuple(replace(each, tool=tool) for each, tool in zip(predictions, tools, strict=True))
    return PredictResult(arm, predictions, options, fit, posterior)
