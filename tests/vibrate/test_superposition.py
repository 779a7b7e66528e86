"""The vibration as a sum over what excites it, against simulations with those phases by both methods."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from arms import first_guess_arm, lcd_arm
from driven_arms import driven_arm
from runs import SAMPLES, STEPS, off, scaled, short, still, swing, with_error

from ident.arm.arm import Arm
from ident.vibrate.motion import Motion, stroke
from ident.vibrate.simulate import Superposition, parts_of, sets_of, simulate, superposition

SWING = swing()
RATE, STEP = SAMPLES / 5.0, 5.0 / STEPS


def imbalance(arm: Arm) -> tuple[str, ...]:
    return tuple(f"{drive.name}.phase" for drive in arm.drives)


def error(arm: Arm) -> tuple[str, ...]:
    return tuple(f"{drive.name}.error_phase" for drive in arm.drives)


def summed(arm: Arm, unknown: tuple[str, ...] | None = None, motion: Motion = SWING, **options) -> Superposition:
    """With the phases of all drives unknown, unless they are named."""
    unknown = (*imbalance(arm), *error(arm)) if unknown is None else unknown
    return superposition(arm, motion, unknown, rate=RATE, step=STEP, **options)


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
@pytest.mark.parametrize("elastic", [False, True], ids=["rigid belts", "elastic belts"])
def test_the_sum_is_the_simulation_with_those_phases(elastic: bool) -> None:
    whole = summed(wavy(), elastic_belts=True) if elastic else of_wavy()
    phases = random_phases(1, 1)[:, 0]
    assert (
        off(whole.at(phases), short(with_phases(wavy(), whole, phases), SWING, elastic_belts=elastic).vibration) < 3e-4
    )


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3, 4])
def test_the_sum_is_the_exact_simulation_with_those_phases(seed: int) -> None:
    """As close as the fast method itself comes to the exact one."""
    phases = random_phases(1, seed)[:, 0]
    exact = simulate(with_phases(wavy(), of_wavy(), phases), SWING, method="exact", rate=RATE).vibration
    assert off(of_wavy().at(phases), exact) < 5e-3


@pytest.mark.slow
def test_what_is_left_out_is_of_second_order_for_any_arm() -> None:
    """Axes, offsets and bodies at random, ratios of either sign, mounted at any angle."""
    arm, phases = scaled(driven_arm(np.random.default_rng(5), 2), "ratio", 0.3), random_phases(1, 5)[:4, 0]
    motion = replace(SWING, coefficients=SWING.coefficients[:, :, :2])

    def left_out(factor: float) -> float:
        weak = scaled(scaled(arm, "eccentricity", factor), "error", factor)
        whole = summed(weak, motion=motion)
        return float(np.abs(whole.at(phases) - short(with_phases(weak, whole, phases), motion).vibration).max())

    assert left_out(0.02) < 1e-8
    assert left_out(0.002) == pytest.approx(left_out(0.02) / 100, rel=0.05)


@pytest.mark.slow
def test_no_phases_exceed_the_worst_and_some_reach_it() -> None:
    whole, phases = of_wavy(), random_phases(400)
    peaks = whole.peaks(phases)
    assert (peaks <= whole.worst[:, None]).all()
    assert (peaks.max(1) > 0.7 * whole.worst).all()
    reached = np.abs(np.asarray(short(wavy().replace(whole.worst_phases()), SWING).vibration)).max()
    assert reached == pytest.approx(whole.worst.max(), rel=3e-4)
    np.testing.assert_allclose(peaks[:, 7], np.abs(whole.at(phases[:, 7])).max(1), rtol=1e-12)


@pytest.mark.slow
def test_the_parts_of_the_worst_add_up_to_it() -> None:
    whole = of_wavy()
    np.testing.assert_allclose(whole.division.sum(0), whole.worst, rtol=1e-12)
    none = summed(still(lcd_arm()))
    np.testing.assert_allclose(none.worst, np.abs(short(still(lcd_arm()), SWING).vibration).max(1), rtol=1e-9)
    np.testing.assert_allclose(none.division[1:], 0, atol=1e-12 * none.worst.max())


@pytest.mark.slow
def test_known_phases_are_part_of_what_is_sure() -> None:
    """The sum over some phases is that over all with the others as the arm has them."""
    arm, all_of_it = wavy(), of_wavy()
    some = summed(arm, all_of_it.unknown[1:3])
    phases = random_phases(1, 7)[:, 0]
    phases[[0, 3, 4, 5]] = [float(arm.get(all_of_it.unknown[k])) for k in (0, 3, 4, 5)]
    assert off(some.at(phases[1:3]), all_of_it.at(phases)) < 3e-4
    assert (some.worst < all_of_it.worst).all()


@pytest.mark.slow
def test_the_error_is_no_part_of_what_the_imbalance_does() -> None:
    """With errors beside it the parts of the imbalance are the same, to second order."""
    without, scale = summed(lcd_arm()), of_wavy().worst.max()
    assert off(without.cosine[:3], of_wavy().cosine[:3]) < 3e-4
    assert off(without.sine[:3], of_wavy().sine[:3]) < 3e-4
    np.testing.assert_allclose(without.cosine[3:], 0, atol=1e-12 * scale)
    assert np.abs(of_wavy().cosine[3:]).max() > 0.1 * scale


@pytest.mark.slow
def test_half_the_eccentricity_is_half_the_part_of_the_imbalance() -> None:
    half = summed(scaled(wavy(), "eccentricity", 0.5))
    assert off(2 * half.cosine[:3], of_wavy().cosine[:3]) < 3e-4


def test_a_sum_of_functions_that_are_sums() -> None:
    """With each set of phases of a + b cos x + c sin x + d cos y + e sin y."""
    a, b, c, d, e = np.random.default_rng(2).normal(size=(5, 3, 4))
    x, y = (np.array([phases[name] for phases in sets_of(("x", "y"))]) for name in "xy")
    members = a[..., None] + sum(
        part[..., None] * turn for part, turn in ((b, np.cos(x)), (c, np.sin(x)), (d, np.cos(y)), (e, np.sin(y)))
    )
    for part, expected in zip(parts_of(members), (a, [b, d], [c, e]), strict=True):
        np.testing.assert_allclose(part, expected, atol=1e-12)
    assert members.shape[-1] == 5
    assert sets_of(()) == [{}]


@pytest.mark.slow
@pytest.mark.parametrize(("arcsec", "peak", "worst"), [(0.0, 0.706, 0.792), (3.0, 0.763, 1.252), (30.0, 6.203, 7.672)])
def test_what_kinematic_errors_do_to_the_first_guess(arcsec: float, peak: float, worst: float) -> None:
    """At 10 %, in mm: with the phases of the file, and with the worst ones; `arcsec` is an amplitude."""
    arm, radians = first_guess_arm(), np.deg2rad(arcsec / 3600)
    arm = arm.replace({f"{drive.name}.error": radians for drive in arm.drives}) if arcsec else arm
    motion, unknown = stroke(arm.stroke, percent=10, dwell=2.0), (*imbalance(arm), *(error(arm) if arcsec else ()))
    whole = superposition(arm, motion, unknown)
    alone = whole.at(np.array([float(arm.get(path)) for path in unknown]))
    assert 1e3 * np.abs(alone).max() == pytest.approx(peak, rel=5e-3)
    assert 1e3 * whole.worst.max() == pytest.approx(worst, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arm", "arcsec", "expected"),
    [(first_guess_arm, 3.0, 1.252), (first_guess_arm, 30.0, 6.2025), (lcd_arm, 3.0, 1.6041)],
)
def test_kinematic_errors_by_the_exact_equations(arm: Callable[[], Arm], arcsec: float, expected: float) -> None:
    """What docs/paper.md says, at 10 %, in mm: with 3 arc seconds at the worst phases, with 30 at those of the file."""
    here = arm().replace({f"{drive.name}.error": np.deg2rad(arcsec / 3600) for drive in arm().drives})
    motion = stroke(here.stroke, percent=10, dwell=1.0)
    if arcsec == 3.0:
        here = here.replace(superposition(here, motion, (*imbalance(here), *error(here))).worst_phases())
    exact = simulate(here, motion, method="exact")
    assert 1e3 * np.abs(np.asarray(exact.vibration)).max() == pytest.approx(expected, rel=1e-3)
