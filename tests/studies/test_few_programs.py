"""Another speed, range or profile finds every program that a command needs: none is compiled for a length.

As long as it has no more time intervals than the least program: 24, which strokes at 5 to 50 % mostly keep to.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import jax
import pytest
from commands import ARM

import ident
from ident.studies.result import Result

pytestmark = pytest.mark.slow

COMPILED = "/jax/core/compile/backend_compile_duration"
"""What jax reports of each program that is compiled, or loaded from its cache."""


@contextmanager
def counting() -> Iterator[list[str]]:
    events: list[str] = []

    def listener(event: str, _: float, **more: object) -> None:
        if event == COMPILED:
            events.append(event)

    jax.monitoring.register_event_duration_secs_listener(listener)
    try:
        yield events
    finally:
        jax.monitoring.unregister_event_duration_listener(listener)


SHORT = {"rate": 100.0, "dwell": 0.2}


def simulated(speed: float) -> ident.SimulateResult:
    more = {} if speed > 30 else {"profile": "trapezoid", "retract": True}
    return ident.simulate(ARM, ident.SimulateOptions(speed=speed, **SHORT, **more))


def swept(speed: float) -> ident.SweepResult:
    vary = {"joint2.k_tors": ("0.5x", "2x", 4 if speed > 30 else 7)}
    return ident.sweep(ARM, ident.SweepOptions(speed=speed, vary=vary, **SHORT))


def differentiated(speed: float) -> ident.DesignResult:
    return ident.design(ARM, ident.DesignOptions(speed=speed, phases="file", sensitivities=True, **SHORT))


def resonating(speed: float) -> ident.ResonanceResult:
    return ident.resonance(ARM, ident.ResonanceOptions(speed=speed))


def test_programs_are_counted() -> None:
    with counting() as some:
        jax.jit(lambda x: x + 1)(1.0)
    assert some


@pytest.mark.parametrize("study", [simulated, swept, differentiated, resonating])
def test_another_speed_compiles_nothing(study: Callable[[float], Result], tmp_path: Path) -> None:
    """Nor does another profile, a way back, or another number of values."""
    study(41.0).save(tmp_path)
    with counting() as second:
        study(23.0).save(tmp_path)
    assert not second
