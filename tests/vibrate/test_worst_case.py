"""A design whose limit holds for phases that nobody knows, against the phases themselves."""

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from arms import lcd_arm
from runs import named
from scipy.optimize import minimize

from ident.vibrate import design_search
from ident.vibrate.design import design
from ident.vibrate.design_search import GAP, MARGIN, Requirements, Search, minimum_change, settled, worst
from ident.vibrate.evaluator import Evaluator, Variable
from ident.vibrate.motion import stroke

pytestmark = pytest.mark.slow

PHASES = tuple(f"{drive.name}.phase" for drive in lcd_arm().drives)
LIMIT = 0.98
"""Of the present amplitude."""
FOUND: dict[str, np.ndarray | None] = {}
"""What searches have found."""


@cache
def evaluator() -> Evaluator:
    """The paper's way in half a second, with three equal imbalances, so that their phases matter."""
    arm = lcd_arm().replace({f"{drive.name}.eccentricity": 0.02 for drive in lcd_arm().drives})
    present = float(arm.get("joint1.k_tors"))
    variables = (Variable(("joint1.k_tors",), 0.5 * present, 2.0 * present),)
    motion = named(stroke(arm.stroke, percent=200, dwell=0.2))
    return Evaluator(arm, motion, variables, rate=200.0, step=2e-3, unknown=PHASES)


@pytest.fixture(autouse=True)
def each_search_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Search the least amplitude with the same phases, from the same place on, once for all tests."""
    search_for = Search.minimum_amplitude

    def once(search: Search, start: np.ndarray, *norm: float) -> np.ndarray | None:
        assert search.evaluator is evaluator()
        key = repr((search.required, search.screened, search.iterations, search.cuts, start.tolist(), norm))
        if key not in FOUND:
            FOUND[key] = search_for(search, start, *norm)
        return None if FOUND[key] is None else FOUND[key].copy()

    monkeypatch.setattr(Search, "minimum_amplitude", once)


def test_the_least_change_keeps_the_limit_with_any_phases() -> None:
    own = evaluator()
    present = float(own.amplitudes(np.zeros((1, 1)))[:, 0, 0].max())
    found = design(own, limit=LIMIT * present, starts=1, curve=False)
    assert found.settled
    assert found.present.largest == pytest.approx(present)
    least = found.minimum_change
    assert found.best is least, "it is what is proposed"
    assert least.largest <= LIMIT * present
    assert least.largest == pytest.approx(LIMIT * present, rel=5e-3), "no more than asked for"
    phases = np.random.default_rng(1).uniform(0.0, 2 * np.pi, (3, 200))
    drawn = dict(zip(PHASES, phases, strict=True))
    amplitudes = replace(own, draws=drawn).amplitudes(least.changes[None])[:, 0].max(0)
    assert (amplitudes[1:] <= amplitudes[0] * (1 + 1e-3)).all()
    assert amplitudes[1:].max() > 0.8 * amplitudes[0], "some phases come near"


def test_a_search_sees_the_worst_phases_of_what_it_finds() -> None:
    search, largest = worst(Search(evaluator(), Requirements()), np.zeros(1))
    assert search.objective.largest(np.zeros(1)) == pytest.approx(largest, rel=1e-3)
    seen, u, good = settled(search, Search.minimum_amplitude, search.minimum_amplitude(np.zeros(1)))
    assert u is not None
    assert good == (worst(seen, u)[1] <= seen.objective.largest(u) * 1.01)
    assert len(seen.cuts) <= 5


def test_a_limit_that_some_phases_exceed_is_not_kept() -> None:
    """The first phases alone would keep it."""
    own = evaluator()
    present = float(own.amplitudes(np.zeros((1, 1)))[:, 0, 0].max())
    found = design(own, limit=0.93 * present, starts=1, curve=False)
    assert found.minimum_change is None
    assert found.best.largest > 0.93 * present


NOTHING = Requirements()
SLOPES = np.array([[1.0, 0.1, 0.0], [0.2, 1.0, 0.3], [0.6, 0.6, -0.2], [0.9, -0.1, 0.4], [0.5, 0.8, 0.5]])
"""How the amplitude with each of five sets of phases falls with three changes."""


@dataclass(frozen=True)
class Toy(Search):
    """A search over amplitudes that are known: it sees some sets of phases, and solves what it sees a little off."""

    evaluator: Any = None
    required: Requirements = NOTHING
    cuts: Any = ({},)
    seen: tuple[int, ...] = (0,)
    off: float = 0.0
    learns: bool = True

    @property
    def objective(self) -> Any:
        return self

    def change_norm(self, u: np.ndarray) -> float:
        return float(np.sqrt(u @ u))

    def largest(self, u: np.ndarray) -> float:
        return float(self.amplitudes(u)[list(self.seen)].max())

    def amplitudes(self, u: np.ndarray) -> np.ndarray:
        return 1.0 - SLOPES @ u + 0.1 * (u @ u)

    def minimum_change(self, start: np.ndarray, limit: float) -> np.ndarray | None:
        rows = {"type": "ineq", "fun": lambda u: limit - self.amplitudes(u)[list(self.seen)]}
        found = minimize(lambda u: u @ u, start, constraints=[rows], method="SLSQP", options={"ftol": 1e-12})
        return found.x * (1 + self.off) if found.success else None

    def missed(self, u: np.ndarray) -> float:
        return -np.inf


@pytest.fixture
def toys(monkeypatch: pytest.MonkeyPatch) -> None:
    def worst_of(search: Toy, u: np.ndarray) -> tuple[Toy, float]:
        amplitudes = search.amplitudes(u)
        more = replace(search, seen=(*search.seen, int(amplitudes.argmax()))) if search.learns else replace(search)
        return more, float(amplitudes.max())

    monkeypatch.setattr(design_search, "worst", worst_of)
    monkeypatch.setattr(design_search, "worst_amplitude", lambda search, u: float(search.amplitudes(u).max()))


QUIET = np.array([0.9, 0.9, 0.4])


@pytest.mark.parametrize("off", [0.0, 1e-3, -1e-3])
@pytest.mark.parametrize("first", [0, 1, 3])
def test_the_least_change_is_one_answer_that_keeps_the_limit(toys: None, off: float, first: int) -> None:
    """However far a search by another processor is off, and whatever phases it sees first."""
    exact = Toy(seen=tuple(range(5))).minimum_change(QUIET, 0.6 * (1 - MARGIN))
    _, u, is_settled = minimum_change(Toy(seen=(first,), off=off), [QUIET], 0.6)
    assert is_settled
    assert Toy().amplitudes(u).max() <= 0.6
    assert np.linalg.norm(u) == pytest.approx(np.linalg.norm(exact), rel=2 * GAP)
    np.testing.assert_allclose(u, exact, atol=0.02)


class Straying(Toy):
    """A search that finds nothing from where phases are too loud that it sees."""

    def minimum_change(self, start: np.ndarray, limit: float) -> np.ndarray | None:
        return super().minimum_change(start, limit) if self.largest(start) <= limit else None


def test_a_search_that_loses_its_way_begins_again_at_its_start(toys: None) -> None:
    _, u, is_settled = minimum_change(Straying(seen=(1,)), [QUIET], 0.6)
    _, right, _ = minimum_change(Toy(seen=(1,)), [QUIET], 0.6)
    assert is_settled
    np.testing.assert_allclose(u, right, atol=1e-3)


def test_a_search_that_learns_nothing_keeps_the_limit_and_is_not_settled(toys: None) -> None:
    _, u, is_settled = minimum_change(Toy(learns=False), [QUIET], 0.6)
    assert not is_settled
    assert Toy().amplitudes(u).max() <= 0.6


def test_of_limits_out_of_reach_or_kept_already(toys: None) -> None:
    assert minimum_change(Toy(), [QUIET], 0.1)[1:] == (None, True)
    _, u, is_settled = minimum_change(Toy(), [QUIET], 1.1)
    assert (u.tolist(), is_settled) == ([0.0, 0.0, 0.0], True)
