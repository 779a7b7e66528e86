"""A design whose limit holds for phases that nobody knows, against the phases themselves."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from arms import lcd_arm
from conformance import agrees
from runs import named

from ident.arm.chain import no_loads
from ident.vibrate.design import Design, design
from ident.vibrate.design_search import Requirements, Search, minimum_change
from ident.vibrate.evaluator import Evaluator
from ident.vibrate.motion import stroke
from ident.vibrate.variable import Variable

pytestmark = pytest.mark.slow

PHASES = tuple(f"{drive.name}.phase" for drive in lcd_arm().drives)
LIMIT = 0.98
"""Of the present amplitude."""


@cache
def evaluator() -> Evaluator:
    """The paper's way in half a second, with three equal imbalances, so that their phases matter."""
    arm = lcd_arm().replace({f"{drive.name}.eccentricity": 0.02 for drive in lcd_arm().drives})
    present = float(arm.get("joint1.k_tors"))
    variables = (Variable(("joint1.k_tors",), 0.5 * present, 2.0 * present),)
    motion = named(stroke(arm.stroke, percent=200, dwell=0.2))
    return Evaluator(arm, motion, variables, loads=no_loads(arm), rate=200.0, step=2e-3, unknown=PHASES)


@cache
def designed() -> tuple[float, Design]:
    """The present amplitude, and what keeps a little less."""
    present = float(evaluator().amplitudes(np.zeros((1, 1)))[:, 0, 0].max())
    return present, design(evaluator(), limit=LIMIT * present, starts=1, curve=False)


def test_the_least_change_keeps_the_limit_with_any_phases() -> None:
    present, found = designed()
    assert found.present.largest == pytest.approx(present)
    least = found.minimum_change
    assert found.best is least, "it is what is proposed"
    assert least.largest <= LIMIT * present
    assert least.largest == pytest.approx(LIMIT * present, rel=5e-3), "no more than asked for"
    worst = evaluator().superposition(least.changes).worst_phases()
    phases = np.random.default_rng(1).uniform(0.0, 2 * np.pi, (3, 24))
    drawn = {path: np.append(row, worst[path]) for path, row in zip(PHASES, phases, strict=True)}
    amplitudes = replace(evaluator(), draws=drawn).amplitudes(least.changes[None])[:, 0].max(0)
    assert (amplitudes[1:] <= amplitudes[0] * (1 + 1e-3)).all()
    assert amplitudes[-1] == pytest.approx(amplitudes[0], rel=1e-3)


@pytest.mark.parametrize("measure", ["residual", "rms"])
def test_slopes_over_phases_are_those_of_differences(measure: str) -> None:
    """Over all phases, against amplitudes of shifted arms; a peak at its own sample."""
    own = replace(evaluator(), measure=measure)
    parts, slopes = own.slopes(np.zeros(1))
    np.testing.assert_allclose(parts.max(1)[:, 0], own.amplitudes(np.zeros((1, 1)))[:, 0, 0], rtol=1e-9)
    h = 1e-4
    ahead, behind = (own.slopes(np.array([sign * h]))[0] for sign in (1, -1))
    differences = (ahead - behind)[..., 0] / (2 * h)
    loud = parts[..., 0] > 0.5 * parts.max(1)  # elsewhere a window's largest sample may change its place
    allowed, what = float(1e-6 * np.abs(slopes).max()), f"slopes of the {measure} over phases"
    found = slopes[0, ..., 0][loud]
    agrees(found, differences[loud], "vibration", what, "central differences", atol=allowed)


def test_a_first_search_keeps_the_phases_that_are_worst_at_present() -> None:
    whole = Search(evaluator(), Requirements())
    kept = whole.with_phases()
    nothing = np.zeros(1)
    assert kept.evaluator.unknown == ()
    assert kept.objective.largest(nothing) == pytest.approx(whole.objective.largest(nothing), rel=1e-3)
    assert kept.objective.largest(nothing + 0.5) <= whole.objective.largest(nothing + 0.5) * (1 + 1e-3)


def test_a_limit_that_some_phases_exceed_is_not_kept() -> None:
    """The first phases alone would keep it."""
    (present, found), search = designed(), Search(evaluator(), Requirements())
    limit, some = 0.93 * present, np.linspace(-0.6, 0.6, 7)[:, None]
    assert search.with_phases().evaluator.amplitudes(some)[:, :, 0].max(0).min() < limit
    assert found.optima[0].largest > limit
    assert minimum_change(search, [found.optima[0].changes / search.objective.scale], limit) is None


def test_of_limits_out_of_reach_or_kept_already() -> None:
    search = Search(evaluator(), Requirements())
    present, quiet = search.objective.largest(np.zeros(1)), np.array([0.2])
    assert minimum_change(search, [quiet], 0.1 * present) is None
    assert minimum_change(search, [quiet], 1.1 * present).tolist() == [0.0]
