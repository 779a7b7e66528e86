"""Compare the pulleys' frequencies with the arm's natural frequencies along a motion."""

from dataclasses import field
from typing import TYPE_CHECKING

from ident.errors import Problem
from ident.studies import reading
from ident.studies.door import DEFAULT, study
from ident.studies.motion_options import MovingOptions, basis_of
from ident.studies.options import option, seed_of_draws
from ident.studies.result import Result

if TYPE_CHECKING:
    from ident.description.file import ArmFile
    from ident.identify.values import Values
    from ident.measure import Log
    from ident.studies.scenario import Basis
    from ident.vibrate.branches import Branches
    from ident.vibrate.resonance import Excitation, ResonanceCrossing


class ResonanceOptions(MovingOptions):
    """Options of `ident.resonance`: the motion, the number of modes, and the margin."""

    draws: int = option(200, "draws of the posterior", low=1, high=100_000)
    seed: int | None = seed_of_draws()
    count: int = option(3, "lowest natural frequencies that are followed", low=1, high=100)
    orders: tuple[int, ...] | None = option(
        None,
        "multiples of the pulleys' frequencies, as 1,2; default: 1, and those of transmission errors",
        read=reading.whole_numbers,
    )
    margin: float = option(10.0, "percent of a natural frequency that count as near", above=0.0)

    def problems(self) -> list[Problem]:
        """Refuse a margin that reaches down to zero frequency."""
        wide = Problem("margin", f"{self.margin:g}", "a number below 100", "10 is 10 % of the frequency")
        return [*super().problems(), *([wide] if self.margin >= 100 else [])]


class ResonanceResult(Result):
    """A Campbell diagram: natural frequencies along a motion against the rotation frequencies of the pulleys.

    The table has a row for each resonance crossing: drive, mode, times [s], frequencies [Hz], vibration [m]. The figure
    is the Campbell diagram over time, with the crossings numbered as in the report.

    Attributes:
        basis: arm and motion, and the sources of their numbers.
        branches: natural frequencies of the arm held along the motion.
        excitation: frequencies of the pulleys at the same times.
        crossings: where both are near, the cause of most vibration first.
        options: the options of the call.
    """

    basis: "Basis"
    branches: "Branches"
    excitation: "Excitation"
    crossings: "tuple[ResonanceCrossing, ...]"
    options: ResonanceOptions = field(default_factory=ResonanceOptions)

    subject = "basis.name"
    shown = ("basis", "branches", "excitation", "crossings", "options.margin")
    drawn = ("branches", "excitation", "crossings", "title")
    listed = ("crossings",)
    made_from = ("basis.sources",)

    @property
    def title(self) -> str:
        """Name of the arm and its motion."""
        return f"{self.basis.arm_file.arm.name}, {self.basis.motion.name}"


@study
def resonance(
    arm: "ArmFile",
    options: ResonanceOptions = DEFAULT,
    *,
    path: "Log | None" = None,
    fit: "Values | None" = None,
    posterior: "Values | None" = None,
) -> ResonanceResult:
    """Compare the pulleys' frequencies with the arm's natural frequencies along a motion (the paper's Figure 4).

    Args:
        arm: the arm.
        options: motion and load, number of modes, and the margin.
        path: a joint path to follow instead of the stroke: a log, or its file.
        fit: fitted values for the arm: a result, or its file.
        posterior: draws for bands of 5 to 95 %, or the file of `ident sample`; the arm takes their medians unless it
            has fitted values.

    Raises:
        InputError: contradictory options, a file that does not match the arm, an arm without drives.
        ModelError: the arm has no stable equilibrium at some posture.
    """
    from ident.vibrate.branches import branches
    from ident.vibrate.resonance import excitation, resonance_crossings, with_amplitudes

    basis = basis_of(arm, options, path=path, fit=fit, posterior=posterior)
    turning = excitation(basis.arm, basis.motion, orders=options.orders)
    followed = branches(basis.arm.replace(basis.draws), basis.motion, count=options.count, loads=basis.loads)
    near = resonance_crossings(followed, turning, margin=options.margin / 100)
    crossings = with_amplitudes(near, basis.arm, basis.motion, basis.loads)
    return ResonanceResult(basis, followed, turning, crossings, options)
