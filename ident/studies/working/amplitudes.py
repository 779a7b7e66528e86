"""Shared by the studies that compute amplitudes repeatedly: the measure of amplitude, and the evaluator."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

from ident.studies.motion_options import HeldMotionOptions
from ident.studies.options import MEASURES, option

if TYPE_CHECKING:
    from ident.studies.scenario import Basis
    from ident.vibrate.evaluator import Evaluator
    from ident.vibrate.variable import Variable


class AmplitudeOptions(HeldMotionOptions):
    """Options of a held motion, and the measure of the vibration's amplitude."""

    measure: str = option("peak", "peak or rms over the motion, or residual: peak after arrival", choices=MEASURES)
    limit: float | None = option(None, "amplitude [mm] that should not be exceeded", above=0.0)
    elastic_belts: bool = option(False, "belts stretch: k_tors without them, which one from a hammer test has in it")
    rate: float = option(500.0, "samples a second", low=1.0, high=1e6)

    @property
    def limit_si(self) -> float | None:
        """The limit [m]."""
        return None if self.limit is None else self.limit / 1e3

    def evaluator(self, basis: "Basis", variables: "Iterable[Variable]" = ()) -> "Evaluator":
        """Return the evaluator that simulates an arm and its draws repeatedly, by the fast method.

        Raises:
            InputError: an elastic belt of the present arm goes slack.
        """
        from ident.vibrate.evaluator import Evaluator
        from ident.vibrate.response import refuse_slack
        from ident.vibrate.simulate import simulate

        if self.elastic_belts and basis.arm.belts:
            as_is = simulate(basis.arm, basis.motion, loads=basis.loads, elastic_belts=True, rate=self.rate)
            refuse_slack(as_is, [belt.name for belt in basis.arm.belts])
        own = (self.measure, basis.draws, basis.loads, self.elastic_belts, self.rate)
        return Evaluator(basis.arm, basis.motion, tuple(variables), *own, unknown=basis.unknown.phases)
