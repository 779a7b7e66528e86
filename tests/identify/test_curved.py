"""Curved springs in campaigns: K1 to K3 and T1, T2 recovered, a straight model contradicted, and what check says."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from conformance import agrees
from one_program import shown

from ident.arm.arm import Arm
from ident.arm.parts import Body, CubicSpring, Joint, Point, Spring
from ident.errors import InputError
from ident.identify.check import check_campaign, check_springs
from ident.identify.problem import pose
from ident.identify.unknowns import Unknowns
from ident.inference.fit import fit
from ident.measure import Campaign, Load, Measurement
from ident.studies.look.exploration import exploration
from ident.studies.stiffness.check_report import springs_in_words

pytestmark = pytest.mark.slow

TRUTH = {
    "j.k_bend": 2e5,
    "j.k_tors": 8e3,
    "s.ratio2": 1.5,
    "s.ratio3": 2.2,
    "s.torque1": 150.0,
    "s.torque2": 400.0,
}
GUESS = {
    "j.k_bend": 1.6e5,
    "j.k_tors": 7e3,
    "s.ratio2": 1.3,
    "s.ratio3": 1.8,
    "s.torque1": 120.0,
    "s.torque2": 330.0,
}
OWN = tuple(path for path in TRUTH if path.startswith("s."))
RELATIVE = {"frequency": 0.002, "twist": 0.003, "deflection": 0.003}
MASSES = (0.0, 2.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 40.0, 50.0)
SIDEWAYS = Load(forces=(((0.0, 300.0, 0.0), "tip"),))


def bar(*springs: Spring | CubicSpring) -> Arm:
    """A bar of 20 kg on a horizontal pin."""
    body = Body("bar", 20.0, (0.5, 0.0, 0.0), np.diag([0.01, 1.6, 1.6]))
    joint = Joint("j", axis=(0.0, 1.0, 0.0), k_bend=2e5, k_tors=8e3, link=(body,))
    return Arm("bar", (joint,), (Point("tip", "j", (1.0, 0.0, 0.0)),), springs=springs)


@cache
def true_arm() -> Arm:
    return bar(Spring("s", "j", "torsion", **{path[2:]: TRUTH[path] for path in OWN}))


@cache
def campaign(seed: int = 0) -> Campaign:
    """Twists and first frequencies under up to 590 N m in two postures, and one deflection across."""
    loads = [Load(masses=((mass, "tip"),)) if mass else Load() for mass in MASSES]
    blank = {"value": 1.0, "sigma": 1.0}
    rows = [
        row
        for angle in (0.0, 1.2)
        for load in loads
        for row in (
            Measurement(kind="twist", posture=(angle,), joint="j", load=load, **blank),
            Measurement(kind="frequency", posture=(angle,), load=load, **blank),
        )
    ]
    rows.append(
        Measurement(kind="deflection", posture=(0.0,), point="tip", direction=(0, 1, 0), load=SIDEWAYS, **blank)
    )
    exact = shown(true_arm(), Campaign(measurements=tuple(rows)))
    sigma = np.array([RELATIVE[m.kind] for m in rows]) * np.abs(exact)
    values = exact + sigma * np.random.default_rng(seed).normal(size=len(exact))
    each = zip(rows, values.tolist(), sigma.tolist(), strict=True)
    return Campaign(measurements=tuple(replace(m, value=value, sigma=spread) for m, value, spread in each))


FREE = Unknowns(free=dict.fromkeys(OWN, 0.5))


def test_a_springs_numbers_are_recovered_from_twists_and_frequencies():
    found = fit(pose(true_arm().replace(GUESS), campaign(), FREE).problem, starts=2)
    names = found.problem.parameters.names
    assert set(names) == set(TRUTH)
    low, high = found.interval(0.99).T
    truth = np.array([TRUTH[name] for name in names])
    assert ((low < truth) & (truth < high)).all()
    assert (high / low < 1.05).all()
    assert found.p_value > 0.01
    assert not found.contradictory


def test_a_straight_model_contradicts_itself_on_the_same_data():
    straight = fit(pose(replace(true_arm().replace(GUESS), springs=()), campaign()).problem, starts=1)
    assert straight.contradictory
    assert straight.p_value < 1e-6


def test_check_tells_whether_the_data_can_tell_the_spring_from_a_straight_one():
    seen = check_campaign(true_arm(), campaign(), FREE)
    assert not seen.contradictory
    (spring,) = seen.springs
    assert spring.told
    assert not spring.unloaded
    assert spring.chi_squared > 1e4
    # the load at rest by statics: 20 kg at half the bar, and 50 kg at its end, less what it sinks
    found, expected = spring.at_rest[1], 9.80665 * 60
    agrees(found, expected, "statics", "torque of a loaded spring at rest", "weight times arm", rtol=0.01, unit="N m")
    far = true_arm().replace({"s.torque1": 7e3, "s.torque2": 2e4})
    (spring,) = check_springs(pose(far, campaign()))
    assert not spring.told
    assert spring.unloaded
    assert spring.chi_squared < 1e-6
    (section,) = springs_in_words([spring])
    said = "\n".join(section.parts)
    assert "s: NO" in said
    assert "K1 alone" in said


def test_a_page_that_computes_with_straight_springs_refuses_others():
    with pytest.raises(InputError, match=r"a curved spring \(s\)") as refused:
        exploration(true_arm(), Load())
    assert "\n" not in str(refused.value)


def test_a_straight_springs_cost_is_that_of_the_best_straight_arm():
    """Found by SciPy over one stiffness, of twists alone, from the pendulum's own equation."""
    from scipy.optimize import brentq, minimize_scalar

    twists = tuple(m for m in campaign() if m.kind == "twist")
    cubic = bar(CubicSpring("s", "j", "torsion", 3e6))
    (spring,) = check_springs(
        pose(cubic, Campaign(measurements=twists), Unknowns(fixed=("j.k_bend",))), Unknowns(fixed=("j.k_bend",))
    )

    def twist(m: Measurement, k: float, c: float) -> float:
        weight = 9.80665 * (10.0 + sum(mass for mass, _ in m.load.masses))
        return brentq(lambda x: k * x + c * x**3 - weight * np.cos(m.posture[0] + x), 0, 0.3, xtol=1e-15)

    sigma, exact = np.array([(m.sigma, twist(m, 8e3, 3e6)) for m in twists]).T

    def cost(log_k: float) -> float:
        return float((((np.array([twist(m, np.exp(log_k), 0.0) for m in twists]) - exact) / sigma) ** 2).sum())

    best = minimize_scalar(cost, bounds=np.log([4e3, 2e4]), method="bounded", options={"xatol": 1e-10}).fun
    assert best > 100
    # the weak prior of the stiffness takes part in the fit
    what, source = "cost of a straight spring for a curved one", "SciPy's brentq and minimize_scalar"
    agrees(spring.chi_squared, best, "inference", what, source, rtol=1e-4)
