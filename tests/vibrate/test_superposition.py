"""The vibration as a sum over what excites it, against simulations with those phases by both methods."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from arms import first_guess_arm, lcd_arm
from conformance import agrees
from runs import SAMPLES, STEPS, off, scaled, short, swing, vibration_at, with_error

from ident.arm.arm import Arm
from ident.errors import InputError
from ident.vibrate.motion import Motion, stroke
from ident.vibrate.response import Response, outline
from ident.vibrate.simulate import Superposition, parts_of, sets_of, simulate, superposition

SWING = swing()
RATE, STEP = SAMPLES / 5.0, 5.0 / STEPS
MOMENTS = 0.7 * np.arange(8)


def imbalance(arm: Arm) -> tuple[str, ...]:
    return tuple(f"{drive.name}.phase" for drive in arm.drives)


def error(arm: Arm) -> tuple[str, ...]:
    return tuple(f"{drive.name}.error_phase" for drive in arm.drives)


def summed(arm: Arm, unknown: tuple[str, ...] | None = None, **options) -> Superposition:
    """With the phases of all drives unknown, unless they are named."""
    unknown = (*imbalance(arm), *error(arm)) if unknown is None else unknown
    return superposition(arm, SWING, unknown, rate=RATE, step=STEP, **options)


def random_phases(count: int, seed: int = 0) -> np.ndarray:
    """Of imbalance and error of three drives."""
    return np.random.default_rng(seed).uniform(0.0, 2 * np.pi, (6, count))


def with_phases(arm: Arm, whole: Superposition, phases: np.ndarray) -> Arm:
    return arm.replace(dict(zip(whole.unknown, phases.tolist(), strict=True)))


@cache
def wavy() -> Arm:
    """The paper's arm with transmission errors."""
    return with_error(3.0)


@cache
def of_wavy() -> Superposition:
    return summed(wavy())


@pytest.mark.slow
def test_no_phases_exceed_the_worst_and_some_come_near() -> None:
    whole, phases = of_wavy(), random_phases(400)
    peaks = whole.peaks(phases)
    assert (peaks <= whole.worst[:, None]).all()
    assert (peaks.max(1) > 0.7 * whole.worst).all()
    np.testing.assert_allclose(peaks[:, 7], np.abs(vibration_at(whole, phases[:, 7])).max(1), rtol=1e-12)
    np.testing.assert_allclose(whole.division.sum(0), whole.worst, rtol=1e-12)
    worst = np.array([whole.worst_phases()[path] for path in whole.unknown])
    assert np.abs(vibration_at(whole, worst)).max() == pytest.approx(whole.worst.max(), rel=1e-9)
    alone, what = short(with_phases(wavy(), whole, worst), SWING).vibration, "sum over phases, at the worst ones"
    agrees(vibration_at(whole, worst), alone, "vibration", what, "the simulation with them", largest=3e-4, unit="m")


@pytest.mark.slow
def test_what_is_left_out_is_of_second_order() -> None:
    """With elastic belts; a phase that is known, as the arm has it, is part of what is sure."""
    arm = lcd_arm().replace({"drive1.phase": 1.0})

    def left_out(factor: float) -> float:
        weak, phases = scaled(arm, "eccentricity", factor), random_phases(1, 5)[:2, 0]
        whole = summed(weak, imbalance(weak)[1:], elastic_belts=True)
        alone = short(with_phases(weak, whole, phases), SWING, elastic_belts=True).vibration
        assert off(vibration_at(whole, phases), alone) < 3e-4
        return float(np.abs(vibration_at(whole, phases) - alone).max())

    what, source = "what the sum over phases leaves out", "second order: a hundredth of a tenth's"
    agrees(left_out(0.1), left_out(1.0) / 100, "vibration", what, source, rtol=0.05, unit="m")


@cache
def moved() -> Response:
    return short(wavy(), SWING)


@pytest.mark.slow
def test_an_outline_ends_at_the_end_point_of_a_simulation_and_is_as_long_as_the_arm() -> None:
    shown = outline(wavy(), moved(), MOMENTS, factor=20.0)
    at = np.searchsorted(np.asarray(moved().time), MOMENTS - 1e-9)
    vibration = np.asarray(moved().vibration)[:, at]
    rest = np.asarray(moved().path + moved().displacement)[:, at] - vibration
    assert shown.time == pytest.approx(MOMENTS)
    np.testing.assert_allclose(shown.rest[:, -1], rest, atol=1e-7)
    np.testing.assert_allclose(shown.drawn[:, -1], rest + 20.0 * vibration, atol=1e-6)
    assert np.abs(20.0 * vibration).max() > 1e-4
    lengths = np.linalg.norm(np.diff(shown.rest, axis=1), axis=0)
    assert shown.rest[:, 0] == pytest.approx(np.zeros((3, len(MOMENTS))), abs=1e-12)
    for j, joint in enumerate(wavy().joints[1:]):
        assert lengths[j] == pytest.approx(np.full(len(MOMENTS), np.linalg.norm(joint.offset)))


@pytest.mark.slow
@pytest.mark.parametrize(("times", "factor"), [([0.1, 6.0], 1.0), ([], 1.0), ([0.5], 0.0)])
def test_an_outline_that_cannot_be_drawn_is_refused(times: list[float], factor: float) -> None:
    with pytest.raises(InputError):
        outline(wavy(), moved(), times, factor=factor)


@pytest.mark.slow
def test_each_part_is_that_of_its_own_source() -> None:
    """Half the eccentricity is half the part of the imbalance, a third of the error a third of its own."""
    less = summed(scaled(scaled(wavy(), "eccentricity", 1 / 2), "error", 1 / 3))
    for mine, whole in ((less.cosine, of_wavy().cosine), (less.sine, of_wavy().sine)):
        assert off(2 * mine[:3], whole[:3]) < 3e-4
        assert off(3 * mine[3:], whole[3:]) < 3e-4
        assert np.abs(whole[3:]).max() > 0.1 * of_wavy().worst.max()


def test_a_sum_of_functions_that_are_sums() -> None:
    """With each set of phases of a + b cos x + c sin x + d cos y + e sin y."""
    a, b, c, d, e = np.random.default_rng(2).normal(size=(5, 3, 4))
    x, y = (np.array([phases[name] for phases in sets_of(("x", "y"))]) for name in "xy")
    members = a[..., None] + sum(
        part[..., None] * turn for part, turn in ((b, np.cos(x)), (c, np.sin(x)), (d, np.cos(y)), (e, np.sin(y)))
    )
    for part, expected in zip(parts_of(members), (a, [b, d], [c, e]), strict=True):
        what, source = "parts of a sum over phases", "a + b cos x + c sin x + ..."
        agrees(part, expected, "vibration", what, source, rtol=1e-7, atol=1e-12)
    assert members.shape[-1] == 5
    assert sets_of(()) == [{}]


def slowly(arm: Arm) -> tuple[Arm, Motion, Superposition]:
    """At 10 %, with transmission errors of an amplitude of 3 arc seconds on all drives, as a sensor sees them."""
    arm = arm.replace({f"{drive.name}.error": np.deg2rad(3.0 / 3600) for drive in arm.drives})
    motion = stroke(arm.stroke, percent=10, dwell=1.0)
    return arm, motion, superposition(arm, motion, (*imbalance(arm), *error(arm)), measured=True)


@pytest.mark.slow
def test_what_kinematic_errors_do_to_the_first_guess() -> None:
    """What docs/paper.md says of 0, 3 and 30 arc seconds, in mm: with the phases of the file, and with the worst."""
    arm, _, whole = slowly(first_guess_arm())
    phases = np.array([float(arm.get(path)) for path in whole.unknown])
    for times, peak, worst in ((0, 0.706, 0.792), (1, 0.763, 1.252), (10, 6.203, 7.672)):
        factors = np.where(whole.of_error, times, 1.0)
        assert 1e3 * np.abs(vibration_at(whole, phases, factors)).max() == pytest.approx(peak, rel=5e-3)
        cosine, sine = (part * factors[:, None, None] for part in (whole.cosine, whole.sine))
        assert 1e3 * replace(whole, cosine=cosine, sine=sine).worst.max() == pytest.approx(worst, rel=1e-3)


@pytest.mark.slow
def test_kinematic_errors_by_the_exact_equations() -> None:
    """What docs/paper.md says of the shipped arm at the worst phases, in mm."""
    arm, motion, whole = slowly(lcd_arm())
    assert 1e3 * whole.worst.max() == pytest.approx(1.6041, rel=1e-3)
    exact = simulate(arm.replace(whole.worst_phases()), motion, method="exact")
    found, what = 1e3 * np.abs(np.asarray(exact.measured)).max(), "6 arc seconds at the worst phases, exact equations"
    agrees(found, 1.6041, "vibration", what, "sum over phases, docs/paper.md", rtol=1e-3, unit="mm")


@pytest.mark.parametrize("largest", [1.0, 1.7])
def test_peaks_leave_out_only_times_that_cannot_have_one(largest):
    """Against the vibration at every time: two bursts, of which another is larger with each phase."""
    random, time = np.random.default_rng(3), np.arange(3000) / 250
    bursts = np.exp(-(((time - 4) / 0.7) ** 2)) + np.exp(-(((time - 9) / 0.4) ** 2)) + 0.02
    cosine, sine = bursts * random.standard_normal((2, 2, 3, 3000))
    sure = np.where(time < 6, 0.8, 0.1) * random.standard_normal((3, 3000))
    whole = Superposition(time, ("a", "b"), np.zeros(2, bool), sure, cosine, sine)
    phases, factors = random.uniform(0, 2 * np.pi, (2, 200)), random.uniform(0.1, largest, (2, 200))
    for given in ((phases,), (phases, factors)):
        every = np.abs(vibration_at(whole, *given)).max(1)
        np.testing.assert_allclose(whole.peaks(*given), every, rtol=1e-12)
