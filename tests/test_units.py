"""Units: factors against textbook numbers, and the refusals."""

import math
import subprocess
import sys
import time
from pathlib import Path

import pytest

from ident.errors import InputError
from ident.units import COMMON, NMM_PER_DEG, registry, sensor_factor, si_factor, to_si


@pytest.mark.parametrize(
    ("value", "unit", "quantity", "expected"),
    [
        (3.0, "Hz", "frequency", 3.0),
        (3.0, "kHz", "frequency", 3000.0),
        (2 * math.pi, "rad/s", "frequency", 1.0),
        (60.0, "rpm", "frequency", 1.0),
        (360.0, "deg/s", "frequency", 1.0),
        (180.0, "deg", "angle", math.pi),
        (180.0, "°", "angle", math.pi),
        (1.0, "turn", "angle", 2 * math.pi),
        (5.0, "mrad", "angle", 0.005),
        (2.0, "mm", "length", 0.002),
        (2.0, "µm", "length", 2e-6),
        (1.0, "in", "length", 0.0254),
        (5.0, "mil", "length", 1.27e-4),
        (5.0, "mils", "length", 1.27e-4),
        (5.0, "mil/s", "velocity", 1.27e-4),
        (500.0, "g", "mass", 0.5),
        (2.0, "kN", "force", 2000.0),
        (1.5, "mrad", "rotation", 1.5e-3),
        (1.5, "mm/m", "rotation", 1.5e-3),
        (1.5, "um/m", "rotation", 1.5e-6),
        (180.0, "deg", "rotation", math.pi),
        (1.5, "%", "damping_ratio", 0.015),
        (1.5, "percent", "damping_ratio", 0.015),
        (0.015, "1", "damping_ratio", 0.015),
        (0.015, "-", "damping_ratio", 0.015),
        (0.015, "", "damping_ratio", 0.015),
    ],
)
def test_to_si(value, unit, quantity, expected):
    assert to_si(value, unit, quantity) == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize(
    ("unit", "quantity"),
    [
        ("mmm", "length"),
        ("kg", "length"),
        ("mm", "angle"),
        ("1", "angle"),
        ("%", "angle"),
        ("sr", "angle"),
        ("", "length"),
        ("deg", "length"),
        ("MHZ", "frequency"),
        ("orders", "frequency"),
        ("mil", "angle"),
        ("Hz*Hz", "frequency"),
        ("kg", "force"),
        ("mm", "damping_ratio"),
        ("2 mm", "length"),
        ("9**9**9", "length"),
        ("mm**(9**9**9)", "length"),
        ("__import__('os')", "length"),
        ("m" * 1000, "length"),
    ],
)
def test_wrong_units_are_refused_at_once(unit, quantity):
    start = time.perf_counter()
    registry()
    with pytest.raises(InputError, match=r"^got .*, expected .*; correct the unit$"):
        si_factor(unit, quantity)
    assert time.perf_counter() - start < 10


@pytest.mark.parametrize(
    ("units", "quantity", "factor"),
    [
        (["m/s2", "m/s²", "m/s**2", "m/s/s", "m/sec2"], "acceleration", 1),
        (["ms-2", "ms^-2", "m s-2", "m s^-2", "m.s-2", "m·s⁻²"], "acceleration", 1),
        (["mm/s2", "mm/s/s", "mms-2", "mm s^-2"], "acceleration", 1e-3),
        (["um/s2", "µm/s2", "μm/s2"], "acceleration", 1e-6),
        (["in/s2", "in/s/s", "in/sec2"], "acceleration", 0.0254),
        (["ms-1", "m s-1", "ms^-1", "m/sec"], "velocity", 1),
        (["mms-1", "mm s^-1"], "velocity", 1e-3),
        (["Newton", "Newtons", "NEWTON", "Newton(s)", "newtons"], "force", 1),
        (["lbf"], "force", 4.4482216152605),
    ],
)  # fmt: skip
def test_labels_of_equipment(units, quantity, factor):
    """`ms-2` is m s^-2: per square millisecond it would be a million times as much, and no acceleration."""
    for unit in units:
        assert si_factor(unit, quantity) == pytest.approx(factor, rel=1e-12), unit
        assert sensor_factor(unit, quantity) == si_factor(unit, quantity)


def test_g_and_lb_of_sensors_are_no_masses_and_elsewhere_nothing_else():
    for unit in ("g", "G", "g's", "gn"):
        assert sensor_factor(unit, "acceleration") == 9.80665
    for unit in ("lb", "LB", "lbs"):
        assert sensor_factor(unit, "force") == pytest.approx(0.45359237 * 9.80665, rel=1e-12)
    assert sensor_factor("g", "force") is None
    assert sensor_factor("V", "acceleration") is None
    assert sensor_factor("", "acceleration") is None
    assert (si_factor("g", "mass"), si_factor("lb", "mass")) == (1e-3, pytest.approx(0.45359237))
    for unit, quantity in (("g", "acceleration"), ("lb", "force"), ("ms-2", "velocity"), ("ms-2", "frequency")):
        with pytest.raises(InputError):
            si_factor(unit, quantity)


@pytest.mark.parametrize("unit", ["1/s", "Bq", "1 / s", "s**-1", "1/min"])
def test_a_frequency_per_time_is_ambiguous(unit):
    with pytest.raises(InputError, match=r"ambiguous.*write Hz .*or rad/s"):
        si_factor(unit, "frequency")


def test_stiffness_in_newton_millimetres_per_degree():
    assert pytest.approx(0.0572957795130823, rel=1e-14) == NMM_PER_DEG


@pytest.mark.parametrize("unit", COMMON)
def test_common_units_are_as_pint_has_them(unit):
    factor, base = registry().get_base_units(unit)
    assert COMMON[unit] == (float(factor), str(base))


def test_the_shipped_data_are_read_without_pint():
    data = Path(__file__).parents[1] / "data" / "lcd_arm"
    lines = f"import sys, ident; ident.read_arm({str(data / 'arm.toml')!r}); "
    lines += f"ident.read_campaign({str(data / 'campaign.csv')!r}); print('pint' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", lines], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"
