"""Compare variants of an arm in one motion with one tool: mass, modes, compliance, vibration, best motion."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ident.errors import require
from ident.studies.cure.motion import MotionOptions
from ident.studies.door import DEFAULT, study
from ident.studies.motion_options import LIMIT, HeldMotionOptions, basis_of
from ident.studies.options import option
from ident.studies.result import Progress, Result, input_of, silent
from ident.studies.saved import files_of, load
from ident.studies.shared import as_file
from ident.studies.values import drawn_values, fitted_values
from ident.text import one_line

if TYPE_CHECKING:
    from ident.arm.arm import Arm
    from ident.description.file import ArmFile
    from ident.identify.values import Values
    from ident.studies.cure.motion_study import MotionStudy
    from ident.studies.scenario import Basis

MOST = 8
"""Variants in one table, at most."""
TAKEN = ("fit", "sample", "design")
"""Studies whose saved results are variants."""


class VariantsOptions(HeldMotionOptions):
    """Options of `ident.variants`: the motion of all variants, the limit, and when the end counts as settled."""

    limit: float = option(LIMIT, "vibration [mm] that the best motion of each variant keeps", above=0.0)
    settled: float = option(0.1, "vibration [mm] below which the end has settled once it stays there", above=0.0)
    dwell: float = option(2.0, "time [s] that the arm is held at the end", low=1.0, high=3600.0)
    segments: int = option(12, "segments of the path; at their ends the speed is chosen", low=4, high=30)
    draws: int = option(50, "draws of each posterior, of which 95 % keep the limit", low=2, high=1000)

    hold = MotionOptions.hold


@dataclass(frozen=True)
class Variant:
    """One of the compared arms.

    Attributes:
        name: that of its file.
        source: the result with its values, or else its arm file.
        motions: its motion, and the speeds along the path that keep the limit.
        numbers: those of the table [kg, Hz, m, m/N, s], by name; the best time is None where no motion keeps the limit.
    """

    name: str
    source: "ArmFile | Values"
    motions: "MotionStudy"
    numbers: Mapping[str, float | None]


class VariantsResult(Result):
    """Variants of an arm side by side.

    The table has a row for each variant: mass, two frequencies, static deflection and compliance at the end of the
    motion, vibration and settled time of the motion, and time of the best motion within the limit [SI].

    Attributes:
        variants: in the order in which they were given.
        options: the options of the call.
    """

    variants: tuple[Variant, ...]
    options: VariantsOptions = field(default_factory=VariantsOptions)

    shown = ("variants", "options")
    listed = ("variants",)

    @property
    def name(self) -> str:
        """Names of the variants."""
        return f"{'-'.join(dict.fromkeys(each.name for each in self.variants))[:120]}.variants"

    def _inputs(self) -> Mapping[str, Any]:
        return {f"arm {i}": each.source for i, each in enumerate(self.variants, 1)}

    @classmethod
    def arguments(cls, inputs: Mapping[str, Path], summary: Mapping[str, Any]) -> dict[str, Any]:
        """Return the files of the variants as one argument."""
        return {"arms": list(inputs.values())}


@study
def variants(
    arms: "Sequence[Arm | ArmFile | str | Path]", options: VariantsOptions = DEFAULT, *, progress: Progress = silent
) -> VariantsResult:
    """Compare up to eight arms, designs or fitted robots in one motion with one tool, a column for each.

    Args:
        arms: arms, arm files, or files of results of `fit`, `sample` and `design`.
        options: the motion of all variants, its load, and the limit.
        progress: shows progress over the variants.

    Raises:
        InputError: too few or too many variants, different motions or tools, an arm without drives.
        ModelError: an arm collapses.
    """
    import numpy as np

    from ident.identify.compliance import tool_compliance
    from ident.identify.modal_analysis import modal_analysis
    from ident.programs import beside_each_other
    from ident.studies.cure.motion_study import Wanted, motions, scheduling_of
    from ident.studies.cure.variants_report import QUANTITIES
    from ident.vibrate.settling import largest_decay, poles_at

    require(2 <= len(arms) <= MOST, "arms", f"{len(arms)} of them", f"2 to {MOST} variants", "give each its file")
    bases, limit = [_basis(arm, options) for arm in arms], Wanted(options.limit / 1e3)
    how: dict[str, Any] = {"segments": options.segments, "dwell": options.dwell, "retract": options.retract}
    searches = [scheduling_of(basis, basis.arm.stroke, **how) for basis in bases]
    for basis in bases[1:]:
        for own, first in zip(_work(basis), _work(bases[0]), strict=True):
            where, expected = one_line(basis.arm_file.path or basis.name), f"{first}, as of the first variant"
            require(own == first, where, own, expected, "compare variants of one application")

    def variant(i: int) -> Variant:
        basis, search = bases[i], searches[i]
        each = motions(basis, search, wanted=limit, time=None, fresh={}, others=False)
        now, best, arrival = each.candidates[0], each.recommended, basis.motion.arrival
        analysis = modal_analysis(basis.arm, tuple(basis.motion(arrival)[0].tolist()), basis.load, 2)
        tool, mass = tool_compliance(analysis), sum(float(body.mass) for body in basis.arm.bodies)
        arm = (mass, *analysis.modes.frequency.tolist(), np.linalg.norm(analysis.deflection[tool.point]))
        poles = poles_at(search.evaluator.arm, basis.motion, basis.loads)[:, 0]
        settled = arrival + largest_decay(each.before, arrival, poles).settled(options.settled / 1e3).max()
        numbers = *map(float, (*arm, tool.largest[0], now.worst, settled)), best.ready if best else None
        source = basis.fit or basis.posterior or basis.arm_file
        name = Path(source.path).stem or basis.arm_file.name
        return Variant(name, source, each, dict(zip(QUANTITIES, numbers, strict=True)))

    return VariantsResult(tuple(beside_each_other(variant, len(bases), progress("variants"))), options)


def _basis(given: Any, options: VariantsOptions) -> "Basis":
    """Return the motion of a variant: of an arm, or of a saved result with the arm that it names."""
    fit = sample = None
    if isinstance(given, str | Path) and (path := Path(given)).suffix in (".json", ".nc"):
        record = load(path)
        got, expected = f"a result of {record.study}", f"an arm file, or a result of {', '.join(TAKEN)}"
        require(record.study in TAKEN, one_line(str(path)), got, expected, "give that")
        of_arm = {name: each for name, each in record.inputs.items() if input_of(name) == "arm"}
        given = path.with_suffix(".toml") if record.study == "design" else files_of(of_arm, path.parent).paths["arm"]
        fit, sample = (path if record.study == study else None for study in ("fit", "sample"))
    arm = as_file(given, options.soft_base)
    values = fitted_values(fit, arm, options) if fit else None
    return basis_of(arm, options, fit=values, posterior=drawn_values(sample, arm, options.draws, options=options))


def _work(basis: "Basis") -> tuple[str, str]:
    """Return the motion and the tool of a variant, in words."""
    from ident.report.words import degrees

    motion = basis.motion
    start, end = (degrees(motion(motion.breaks[i])[0].round(9).tolist()) for i in (0, -1))
    loads = [f"{each.body.name} of {float(each.body.mass):.6g} kg" for each in basis.arm.payloads]
    way = f"the motion {motion.name} from {start} to {end} in {motion.arrival:.6g} s"
    return way, f"the tool {', '.join([basis.point, *loads])}"
