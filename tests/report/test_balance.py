"""What balancing says: masses with their own errors, a radius that fits, what masses cannot change."""

from dataclasses import replace

import numpy as np
import pytest
from arms import DATA

import ident
from ident.report.report import text_of
from ident.studies.cure.balance_report import _findings, _masses, _remark, _rotors, balance_rows, balance_sections
from ident.studies.cure.balance_study import Balance, Calibration, Pulley, Rotor
from ident.studies.scenario import Basis
from ident.vibrate.motion import stroke

FILE = ident.read_arm(DATA / "lcd_arm" / "arm.toml")
ARM = FILE.arm
DRIVE = ARM.drives[1]
SIZE, TURN = 0.002, np.radians(0.5)
"""Standard errors of an imbalance: of its size, as a share of it, and of its angle [rad]."""

CONTRADICTING = Calibration(np.ones(4000, complex), state="contradicting")


@pytest.fixture
def balance():
    """4 kg mm at 334 deg, to be balanced in holes at 90 mm, 30 deg apart."""
    found = 4e-3 * np.exp(1j * np.radians(334))
    off = np.random.default_rng(4).standard_normal((2, 4000))
    draws = found * (1 + SIZE * off[0] + 1j * TURN * off[1])
    pulley = Pulley(0.09, float(DRIVE.height), 0.05, 0.5, holes=12)
    calibration = Calibration(np.ones(len(draws.T), complex))
    rotor = Rotor(DRIVE, pulley, found, draws, True, SIZE, np.nan, calibration, 8.0, 7e-4, 0.9)
    basis = Basis(FILE, ARM, stroke(ARM.stroke, percent=10.0), 10.0)
    before, after = np.full((3, 2), 8e-4), np.full((3, 2), 3e-4)
    peaks = np.array([[8e-4] * 20, [3e-4] * 20])
    return Balance(basis, (rotor,), (), np.arange(2.0), before, after, peaks, peaks, 4e-4, 1e-5)


def test_each_hole_has_the_error_of_its_own_mass(balance):
    """By hand: 154 deg lies 4 deg past hole 6 (150 deg), so m6 = m sin 26 / sin 30 and m7 = m sin 4 / sin 30."""
    (table,) = _masses(balance)
    shown = [dict(zip(table.head, row, strict=True)) for row in table.rows]
    assert [row["hole"] for row in shown] == ["6 of 12", "7 of 12"]
    mass = 1e3 * 4.0 / 90.0  # g
    sin, cos = ({k: f(np.radians(k)) / 0.5 for k in (4, 26)} for f in (np.sin, np.cos))
    for row, past, record in zip(shown, (26, 4), balance_rows(balance), strict=True):
        assert row["mass [g]"] == pytest.approx(mass * sin[past])
        assert row["+- [g]"] == pytest.approx(mass * np.hypot(SIZE * sin[past], TURN * cos[past]), rel=0.05)
        assert record["mass_sd"] == pytest.approx(row["+- [g]"] / 1e3)
        assert "+- [deg]" not in row, "a hole's angle has no error"
    whole = dict(zip(_rotors(balance).head, _rotors(balance).rows[0], strict=True))
    assert (whole["+- [%]"], whole["+- [deg]"]) == (pytest.approx(100 * SIZE), pytest.approx(0.5, rel=0.05))


def test_the_advised_radius_fits(balance):
    """4 kg mm in one piece of 50 g: 80.2 mm would do at 4.01, so 81 mm is advised, and 81 mm fits."""
    (rotor,) = balance.rotors
    heavy = replace(rotor, found=rotor.found * 4.01 / 4, pulley=replace(rotor.pulley, radius=0.06, holes=0))
    assert heavy.state == "does not fit"
    (finding, *_) = _findings(replace(balance, rotors=(heavy,)))
    assert finding.remedy.startswith("mount at 81 mm (--radius drive2=81)")
    assert replace(heavy, pulley=replace(heavy.pulley, radius=0.081)).state == "balance"


def test_what_is_left_may_be_less_than_transmission_errors_make(balance):
    assert _remark(balance).endswith("masses do not change that. What else is left cancels part of it.")
    assert _remark(replace(balance, errors=2e-4)).endswith("masses do not change that.")


def test_the_first_screen_says_once_what_verifies_it(balance):
    text = text_of(balance_sections(balance))
    assert "Next: mount it, measure, name it in the column trial: ident source {runs} --arm {arm}" in text
    assert text.count("column trial") == 1
    assert "no trial mass: mark, sense and model are not verified\n" in text


def test_the_tables_heads_take_one_line(balance):
    """A first screen has 25 lines: what fits 100 columns is not broken."""
    (rotor,) = balance.rotors
    words = text_of(balance_sections(replace(balance, rotors=(replace(rotor, calibration=CONTRADICTING),))))
    assert "  Rotor   imbalance [g mm]  +- [%]  at [deg]  +- [deg]  grade  after  makes [mm]  correction\n" in words
    assert "trials contradict" in words
