"""A joint's numbers from its own logs: against the equations of two masses, solved by SciPy, and a closed form."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from conformance import agrees, counted
from joint_logs import Truth, clamped_log
from joint_logs import joint_log as new_log
from scipy.stats import binom

from ident.errors import InputError
from ident.identify.joint import QUANTITIES, TwistSetting, joint_twist
from ident.studies.stiffness.joint_report import joint_sections

joint_log = cache(new_log)
TRUTH = Truth()
LOOSE = Truth(backlash=2e-4, gravity=50.0)
LOAD = ("motor", "link", "load")


def found_in(truth, log, **more):
    return joint_twist("joint", [log] if not isinstance(log, list) else log, TwistSetting(truth.motor, **more))


@cache
def plainly(truth):
    """What a truth's first log tells."""
    return found_in(truth, joint_log(truth))


def assert_right(truth, found, told):
    """Of what is told within twice its interval, of the rest within it: one log in 20 may be outside."""
    assert [name for name in QUANTITIES if found.told(name)] == told
    for name in QUANTITIES:
        number, expected = found.numbers[name], truth.expected(name, found.parted)
        if not np.isnan(number.value):
            assert abs(number.value - expected) < number.high - number.low


def test_the_motor_s_torque_tells_stiffness_and_coulomb_friction():
    found = plainly(TRUTH)
    assert_right(TRUTH, found, ["stiffness", "coulomb", "delay"])
    assert not found.parted
    source = "two masses integrated by SciPy"
    for name, unit, expected, rel in (
        ("stiffness", "N m/rad", 2e5, 0.02),
        ("coulomb", "N m", 60, 0.03),
        ("delay", "s", 3e-3 - 120 / 2e5, 0.02),  # less viscous / stiffness
    ):
        what = f"{name} of a joint from its own logs"
        agrees(found.numbers[name].value, expected, "inference", what, source, rtol=rel, unit=unit)


def test_a_joint_that_moves_alone_tells_viscous_friction_from_delay():
    found = found_in(TRUTH, joint_log(TRUTH), alone=True)
    assert_right(TRUTH, found, ["stiffness", "coulomb", "viscous", "delay"])
    assert found.numbers["viscous"].value == pytest.approx(120, rel=0.05)
    assert found.numbers["delay"].value == pytest.approx(3e-3, rel=0.01)


@pytest.mark.parametrize("channels", [LOAD, (*LOAD, "torque")], ids=["load", "both"])
def test_the_torque_in_the_joint_tells_damping_and_backlash(channels):
    truth = replace(LOOSE, damping=2000.0)
    found = found_in(truth, joint_log(truth, channels=channels, noise=0.3))
    friction = ["coulomb", "viscous"] if "torque" in channels else []
    assert_right(truth, found, ["stiffness", "damping", *friction, "backlash", "delay"])
    source = "two masses integrated by SciPy"
    for name, unit, expected, rel in (("backlash", "rad", 2e-4, 0.1), ("damping", "N m s/rad", 2000, 0.2)):
        what = f"{name} of a joint from its own logs"
        agrees(found.numbers[name].value, expected, "inference", what, source, rtol=rel, unit=unit)


def test_damping_is_more_by_viscous_friction_where_they_are_not_parted():
    """The shift that the delay lacks by viscous friction turns into damping."""
    truth = replace(TRUTH, damping=200.0, viscous=1000.0)
    found = found_in(truth, joint_log(truth, noise=0.01))
    assert found.numbers["damping"].value == pytest.approx(1200.0, rel=0.1)


def test_a_link_ahead_of_its_motor_has_a_delay_below_0():
    truth = replace(TRUTH, delay=-3e-3)
    found = found_in(truth, joint_log(truth), alone=True)
    assert found.told("delay")
    assert found.numbers["delay"].value == pytest.approx(-3e-3, rel=0.01)


def test_a_torque_that_keeps_its_sign_tells_no_backlash():
    found = found_in(replace(TRUTH, backlash=2e-4), joint_log(replace(TRUTH, backlash=2e-4), channels=LOAD))
    assert np.isnan(found.numbers["backlash"].value)
    assert found.numbers["stiffness"].value == pytest.approx(2e5, rel=0.02)


def test_backlash_counts_as_compliance_only_where_the_motor_s_torque_reverses():
    """Its interval does not contain the spring's stiffness then; where the torque keeps its sign it does."""
    reversing = plainly(LOOSE)
    assert reversing.loose
    verdict = joint_sections([reversing], [joint_log(LOOSE)]).verdict
    assert (verdict.word, verdict.kind) == ("IDENTIFIED", "caution")
    assert verdict.reason.endswith("Any backlash of joint counts as compliance.")
    assert reversing.numbers["stiffness"].high < 0.95 * LOOSE.stiffness
    assert not found_in(LOOSE, joint_log(LOOSE), alone=True).loose
    keeping = found_in(replace(TRUTH, backlash=2e-4), joint_log(replace(TRUTH, backlash=2e-4)))
    assert not keeping.loose
    assert keeping.numbers["stiffness"].value == pytest.approx(TRUTH.stiffness, rel=0.02)


def test_a_clamped_joint_needs_no_link():
    truth = replace(LOOSE, backlash=4e-4)
    found = found_in(truth, clamped_log(truth), locked=True)
    assert {"stiffness", "coulomb", "backlash"} <= {name for name in QUANTITIES if found.told(name)}
    for name, rel in (("stiffness", 0.01), ("coulomb", 0.05), ("backlash", 0.1)):
        assert found.numbers[name].value == pytest.approx(getattr(truth, name), rel=rel)
    both = found.numbers["viscous"]
    assert both.low < truth.viscous + truth.damping < both.high
    log = clamped_log(replace(truth, coulomb=0.0, viscous=0.0, motor=0.0, damping=2000.0))
    columns = log.columns["joint"]
    inside = replace(log, columns={"joint": {"motor": columns["motor"], "load": columns["torque"]}})
    found = found_in(truth, inside, locked=True)
    assert [name for name in QUANTITIES if found.told(name)] == ["stiffness", "damping", "backlash"]
    assert found.numbers["damping"].value == pytest.approx(2000, rel=0.05)
    assert found.numbers["backlash"].value == pytest.approx(4e-4, rel=0.05)


def test_what_a_model_without_an_effect_says():
    """A delay that is left out counts as compliance that the joint does not have."""
    found = plainly(TRUTH)
    assert abs(found.without["delay"].value / 2e5 - 1) > 0.2
    assert abs(found.without["friction"].value / 2e5 - 1) > 5 * abs(found.numbers["stiffness"].value / 2e5 - 1)
    assert {*found_in(TRUTH, joint_log(TRUTH), centred=True).without} == {"delay", "friction"}


def test_an_unknown_inertia_is_fitted():
    found = joint_twist("joint", [joint_log(TRUTH)], TwistSetting())
    known = plainly(TRUTH)
    assert found.numbers["stiffness"].low < 2e5 < found.numbers["stiffness"].high
    assert found.numbers["stiffness"].high > known.numbers["stiffness"].high


def test_logs_of_different_joints_disagree():
    logs = [joint_log(TRUTH, 0), joint_log(TRUTH, 1)]
    assert not found_in(TRUTH, logs).disagree
    other = found_in(TRUTH, [logs[0], joint_log(replace(TRUTH, stiffness=1.6e5), 1)])
    assert other.disagree
    assert not other.told("stiffness")


def test_parallel_columns_tell_nothing():
    """One sine of a joint without gravity: angle, acceleration and torque are the same curve."""
    log, omega = joint_log(TRUTH, channels=LOAD), 2.0
    angle = 0.5 * np.sin(omega * log.time)
    load = -120 * omega**2 * angle
    columns = {"motor": angle, "link": angle - load / 2e5, "load": load}
    found = found_in(TRUTH, replace(log, columns={"joint": columns}))
    assert not any(found.told(name) for name in QUANTITIES if name != "delay")


def test_a_slow_log_is_refused():
    log = joint_log(TRUTH)
    slow = replace(log, time=log.time * 10)
    with pytest.raises(InputError, match=r"25 samples a second, expected at least .* for `upto`"):
        found_in(TRUTH, slow)


@cache
def simulated(truth, seed):
    """A log of all channels, for all who look at some of them."""
    return joint_log(truth, seed, channels=("motor", "link", "torque", "load"))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("truth", "channels", "alone"),
    [(TRUTH, ("motor", "link", "torque"), False), (LOOSE, ("motor", "link", "torque"), True), (LOOSE, LOAD, False)],
    ids=["motor", "alone", "load"],
)
def test_intervals_cover(truth, channels, alone):
    """Of 24 logs with coloured noise; no quick test finds intervals that are too narrow.

    Half as wide, 19 of 24 would hold the truth once in seven times: not for all of a dozen numbers.
    """
    inside = {name: [] for name in QUANTITIES}
    for seed in range(24):
        log = simulated(truth, seed)
        seen = {name: log.columns["joint"][name] for name in channels}
        found = found_in(truth, replace(log, columns={"joint": seen}), alone=alone)
        for name in QUANTITIES:
            number, expected = found.numbers[name], truth.expected(name, found.parted)
            if not np.isnan(number.value) and not (name == "damping" and not found.parted):
                inside[name].append(number.low <= expected <= number.high)
    for name, each in inside.items():
        if each:
            what, seen = (
                f"{name} of a joint within its interval",
                "alone" if alone else "load" if channels == LOAD else "motor",
            )
            least, share = binom.ppf(0.001, len(each), 0.95), 0.95 * len(each)
            source = f"95 % promised, logs of the {seen}"
            counted(sum(each), len(each), least, len(each), "verdict rates", what, source, expected=share)
            assert len(each) > 19
