"""Predict natural frequencies, modes and static deflection of an arm at postures."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ident.errors import Problem
from ident.studies import reading
from ident.studies.options import option
from ident.studies.result import Result
from ident.studies.shared import ArmOptions, as_file

if TYPE_CHECKING:
    import numpy as np

    from ident.arm.arm import Arm
    from ident.description.file import ArmFile
    from ident.identify.modal_analysis import ModalAnalysis


@dataclass(frozen=True, kw_only=True)
class PredictOptions(ArmOptions):
    """Options of `ident.predict`: where the arm is held, what it carries, and how many modes are asked for."""

    posture: tuple[tuple[float, ...], ...] = option(
        (),
        "joint angles in degrees, as 30,-60,30; may be repeated",
        short="-q",
        repeated=True,
        read=reading.postures,
    )
    modes: int = option(6, "number of modes", low=1)

    def problems(self) -> list[Problem]:
        """Return a negative mass or stiffness, or a posture that is none."""
        flat = any(not isinstance(angles, tuple | list) for angles in self.posture)
        expected, remedy = "postures, each of several angles", "as ((30, -60, 30),)"
        return [*super().problems(), *([Problem("posture", f"{self.posture}", expected, remedy)] if flat else ())]


@dataclass(frozen=True, repr=False)
class PredictResult(Result):
    """What an arm does at each of some postures.

    Attributes:
        arm: the arm as its file has it.
        analyses: modes and static deflection at each posture, in the order of the options.
        options: what was asked for.
    """

    arm: "ArmFile"
    analyses: "tuple[ModalAnalysis, ...]"
    options: PredictOptions = field(default_factory=PredictOptions)

    form, suffix = "ident-predict/1", ".json"

    @property
    def name(self) -> str:
        """The arm file's name and what was done with it."""
        return f"{Path(self.arm.path).stem or self.arm.arm.name}.predict"

    @property
    def frequencies(self) -> "tuple[np.ndarray, ...]":
        """Natural frequencies at each posture, ascending, (modes,) [Hz] each."""
        import numpy as np

        return tuple(np.asarray(analysis.modes.frequency) for analysis in self.analyses)

    @property
    def deflections(self) -> "tuple[Mapping[str, np.ndarray], ...]":
        """Static deflection at each posture by point name, (3,) [m] in the base frame."""
        return tuple(analysis.deflection for analysis in self.analyses)

    def report(self) -> str:
        """Return the text that `ident predict` prints."""
        from ident.present.text.predict import predict_report

        return "\n".join(map(predict_report, self.analyses))

    def table(self) -> list[dict[str, Any]]:
        """Return a row for each mode at each posture: angles [deg], frequency [Hz], label, damping ratio."""
        from ident.present.files.predict import mode_rows

        return mode_rows(self.analyses)

    def _write(self, path: Path) -> tuple[Path, ...]:
        from ident.present.files.document import write_result
        from ident.present.files.predict import predict_document

        document = predict_document(self.form, self.analyses, self.arm, self.options.recorded())
        write_result(document, self.fields(), path)
        return (path,)


def predict(arm: "Arm | ArmFile", options: PredictOptions | None = None) -> PredictResult:
    """Predict natural frequencies, modes and static deflection of an arm, held at postures under a load.

    Args:
        arm: the arm.
        options: postures, by default the one with all angles zero; load; numbers to change; number of modes.

    Raises:
        InputError: a posture of the wrong length, a load or a number that the arm has not, an arm without any point.
        ModelError: the arm has no stable equilibrium there.
    """
    from ident.identify.modal_analysis import modal_analysis
    from ident.measure import Load

    options, arm_file = options or PredictOptions(), as_file(arm)
    changed, load = arm_file.arm.replace(options.set), Load.parse(options.load)
    postures = [tuple(map(radians, angles)) for angles in options.posture] or [(0.0,) * len(changed.driven)]
    analyses = tuple(modal_analysis(changed, posture, load, options.modes) for posture in postures)
    return PredictResult(arm_file, analyses, options)
