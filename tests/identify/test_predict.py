"""Predictions of a campaign: order, labels, loads, batches, and what does not fit the arm."""

import dataclasses
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
from arms import lcd_arm
from equinox import filter_jit
from scipy.optimize import brentq

from ident.arm.chain import at_posture
from ident.arm.modes import linearize, mode_labels, modes, parse_label
from ident.errors import InputError
from ident.identify.conditions import bind, frequencies_of_pole
from ident.identify.data_checks import Expected, check_values, contradictory_repeats
from ident.identify.padding import padded
from ident.identify.predict import predict
from ident.identify.problem import pose
from ident.inference.problem import Data
from ident.measure import DEFINITIONS, Campaign, Load, Measurement

slow = pytest.mark.slow

UNFOLDED, HALF, BENT = (0.0, 0.0, 0.0), tuple(np.deg2rad([40.0, -80.0, 40.0])), tuple(np.deg2rad([80.0, -160.0, 80.0]))
KILOGRAMS = Load.parse("5 kg @ tip")
HEAVY = "lateral torsion 2"


def frequency(value, posture=UNFOLDED, **more):
    return Measurement(kind="frequency", posture=posture, value=value, sigma=0.02, **more)


def turned(n, posture=UNFOLDED):
    """The posture turned about the vertical, which leaves its modes as they are: a state of its own."""
    return posture[0] + 0.01 * n, *posture[1:]


def sag(posture, **more):
    return Measurement(kind="deflection", posture=posture, value=0.02, sigma=0.001, point="tip", **more)


WEIGHT = -5 * float(lcd_arm().gravity[2])
PULLED = Load.parse(f"{WEIGHT} N -z @ tip")
BESIDE = sag(turned(2, BENT), direction=(0, 0.6, -0.8))
LABELLED = {
    "reversed": (
        frequency(4.0, BENT, mode="lateral torsion 1"),
        frequency(5.0, BENT, mode="vertical bending 1"),
        frequency(6.0, BENT, mode="torsion 1"),
    ),
    "left": (frequency(15.0), frequency(4.1, mode="lateral torsion 1"), frequency(4.8)),
    "difference": (
        BESIDE,
        dataclasses.replace(BESIDE, load=KILOGRAMS),
        dataclasses.replace(BESIDE, load=KILOGRAMS, kind="deflection_difference"),
    ),
    "weight": (
        sag(UNFOLDED, load=KILOGRAMS),
        sag(UNFOLDED, load=PULLED),
        frequency(3.9, load=KILOGRAMS),
        frequency(4.1, load=PULLED),
    ),
    **{
        label: tuple(frequency(20.0, turned(1), mode=label, of=of) for of in DEFINITIONS)
        for label in ("lateral torsion 1", HEAVY)
    },
    "heavy, half": tuple(frequency(15.0, HALF, mode=HEAVY, of=of) for of in DEFINITIONS[:3]),
    "vertical, half": tuple(frequency(15.0, HALF, mode="vertical bending 2", of=of) for of in DEFINITIONS[:3]),
    "lowest": tuple(frequency(4.0, turned(2 + i), of=of) for i, of in enumerate(DEFINITIONS)),
    "mixed": (frequency(4.1, turned(8), of="damped"), frequency(4.8, turned(8), mode="vertical bending 1")),
}
"""Rows of all kinds, beside labels: one campaign, and so one program."""
CLOSE = 0.1
"""Sigma [Hz] of values of which the highest one is near the next mode."""
UNLABELLED = {
    "order": (sag(UNFOLDED), frequency(14.0), frequency(4.1), frequency(4.8)),
    "drives": (
        frequency(4.1, turned(1)),
        frequency(4.0, turned(1), drives="servo"),
        frequency(4.8, turned(1)),
        frequency(4.7, turned(1), drives="servo"),
    ),
    "defined": (
        frequency(4.1, turned(2), of="damped"),
        frequency(4.8, turned(2)),
        frequency(14.0, turned(2), of="pole"),
    ),
    **{
        f"{count} close": tuple(
            dataclasses.replace(frequency(4.0 + i, turned(2 + count)), sigma=CLOSE) for i in range(count)
        )
        for count in (1, 2, 3)
    },
}
"""Rows of a campaign without any label, of which the lowest modes alone are computed."""
TAUS = tuple(f"joint{j}.tau_tors" for j in (1, 2, 3))
PATHS = ("joint1.k_bend", "joint1.k_tors", "joint2.k_tors", "joint3.k_tors", *TAUS)


def campaign_of(parts):
    return Campaign(measurements=tuple(row for rows in parts.values() for row in rows))


def split(parts, values):
    """The values of the rows of each part."""
    ends = np.cumsum([len(rows) for rows in parts.values()])
    return dict(zip(parts, np.split(np.asarray(values), ends[:-1]), strict=True))


_predict = filter_jit(predict)


@filter_jit
def _with_slope(arm, numbers, ways, conditions):
    return jax.jvp(lambda numbers: predict(arm, numbers, conditions), (numbers,), (ways,))


@cache
def conditions_as_in_a_fit():
    """Those of the rows with labels, in a program's size; and where each row is."""
    few, _, places = padded(bind(lcd_arm(), campaign_of(LABELLED)))
    return few, places


def numbers(**changed):
    """The numbers of the file, and what is changed in them; `_` stands for the dot."""
    new = {path.replace("_", ".", 1): value for path, value in changed.items()}
    return {path: np.asarray(new.get(path, lcd_arm().get(path)), float) for path in PATHS}


def seen(**changed):
    """What an arm with these numbers would show of the rows with labels."""
    few, places = conditions_as_in_a_fit()
    return split(LABELLED, np.asarray(_predict(lcd_arm(), numbers(**changed), few))[places])


@cache
def labelled():
    return seen()


FACTORS = np.array([1.0, *np.linspace(1.45, 1.8, 71)])


@cache
def unlabelled():
    """The rows without labels for the file's torsion of joint 1 and many others, with their sigmas, as a fit has it."""
    campaign = campaign_of(UNLABELLED)
    conditions = bind(lcd_arm(), campaign)
    data = Data(*(jnp.array([getattr(m, name) for m in campaign]) for name in ("value", "sigma")))
    k = jnp.asarray(float(lcd_arm().get("joint1.k_tors")) * FACTORS)
    return split(UNLABELLED, _predict(lcd_arm(), {"joint1.k_tors": k}, conditions, data))


@filter_jit
def at_rest(arm, posture):
    chain = at_posture(arm, posture)
    return linearize(chain), modes(chain)


@cache
def exact(posture):
    """The equations of motion about rest, and the undamped modes."""
    return at_rest(lcd_arm(), np.asarray(posture))


def state_matrix_poles(posture):
    """The poles of the damped arm by LAPACK's eigenvalues of the state matrix, of positive imaginary part."""
    M, C, H = (np.asarray(getattr(exact(posture)[0], name)) for name in "MCH")
    lower = -np.linalg.solve(M, np.concatenate([H, C], 1))
    upper = np.concatenate([np.zeros_like(M), np.eye(len(M))], 1)
    s = scipy.linalg.eigvals(np.concatenate([upper, lower]))
    s = s[s.imag > 0]
    return s[np.argsort(abs(s))]


@slow
def test_values_come_in_the_order_of_the_campaign_not_of_size_or_kind():
    values = unlabelled()["order"][:, 0]
    np.testing.assert_allclose(values[1:], np.asarray(exact(UNFOLDED)[1].frequency)[[2, 0, 1]], rtol=1e-12)
    assert values[0] == pytest.approx(0.0263, abs=5e-5)


@slow
def test_labels_find_their_modes_where_the_order_is_reversed():
    _, found = exact(BENT)
    names = [str(label) for label in mode_labels(found)]
    assert names[:2] == ["vertical bending 1", "lateral torsion 1"], "the two branches have crossed by 80 degrees"
    np.testing.assert_allclose(labelled()["reversed"], np.asarray(found.frequency)[[1, 0, 1]], rtol=1e-12)


@slow
def test_values_without_label_take_the_lowest_modes_that_no_label_took():
    _, found = exact(UNFOLDED)
    np.testing.assert_allclose(labelled()["left"], np.asarray(found.frequency)[[2, 0, 1]], rtol=1e-12)


@slow
def test_the_highest_measured_mode_is_smooth_where_the_next_one_crosses_it():
    """Nearer than a sigma s the lower of the two is pushed down by (s - gap)^2 / 4s; none below it is."""
    (found,), both, lowest = (unlabelled()[f"{count} close"] for count in (1, 2, 3))
    np.testing.assert_allclose(lowest[:, 0], np.asarray(exact(UNFOLDED)[1].frequency)[:3], rtol=1e-12)
    found, both, lowest = found[1:], both[:, 1:], lowest[:2, 1:]
    gap = lowest[1] - lowest[0]
    assert gap.min() < 0.01
    assert gap.max() > CLOSE
    np.testing.assert_allclose(found, lowest[0] - np.maximum(CLOSE - gap, 0) ** 2 / (4 * CLOSE), rtol=1e-12)
    assert np.abs(np.diff(found, 2)).max() < np.abs(np.diff(lowest[0], 2)).max() / 5
    np.testing.assert_allclose(both, lowest, rtol=1e-12)  # both are measured


@slow
def test_a_deflection_difference_is_the_difference_of_two_deflections():
    values = labelled()["difference"]
    assert values[2] == pytest.approx(values[1] - values[0], rel=1e-12)
    assert values[2] > 1e-3


@slow
def test_a_weight_is_a_mass_and_a_force_is_not():
    values = labelled()["weight"]
    assert values[0] == pytest.approx(values[1], rel=1e-10)
    assert values[2] < 0.98 * values[3]


@slow
def test_a_batch_of_parameters_equals_one_at_a_time_and_frequencies_have_derivatives():
    """By each definition: of a damped mode with a label, and of the lowest one without."""
    rng, tau, step = np.random.default_rng(0), 2e-3, 1e-6

    def along(x):
        return {"joint1_tau_tors": x, "joint2_k_tors": 2e5 * (1 + x)}

    draws = {path: float(value) * np.exp(0.3 * rng.normal(size=5)) for path, value in numbers().items()}
    batch = {path: np.array([value, *draws[path]]) for path, value in numbers(**along(tau)).items()}
    ways = {path: np.full(6, {"joint1.tau_tors": 1.0, "joint2.k_tors": 2e5}.get(path, 0.0)) for path in PATHS}
    few, places = conditions_as_in_a_fit()
    together, slope = (np.asarray(x)[places] for x in _with_slope(lcd_arm(), batch, ways, few))
    for i in range(1, 6):
        alone = np.asarray(_predict(lcd_arm(), {path: x[i] for path, x in batch.items()}, few))[places]
        np.testing.assert_allclose(together[:, i], alone, rtol=1e-11)
    ahead, behind = seen(**along(tau + step)), seen(**along(tau - step))
    for name in (HEAVY, "lowest"):
        expected = (ahead[name] - behind[name])[1:] / (2 * step)
        np.testing.assert_allclose(split(LABELLED, slope[:, 0])[name][1:], expected, rtol=1e-5)


@slow
def test_no_equilibrium_gives_nan_not_a_number():
    assert np.isnan(np.concatenate([*seen(joint1_k_bend=10.0).values()])).all()


@pytest.mark.parametrize("text", ["vertical bending 1", "Lateral  Torsion 2", "torsion 3", "vertical 2"])
def test_labels_are_read(text):
    assert str(parse_label(text)) == " ".join(text.lower().split())


@pytest.mark.parametrize("text", ["", "1", "bending", "bending 0", "sideways bending 1", "bending 1 2"])
def test_other_labels_are_not(text):
    assert parse_label(text) is None


@pytest.mark.parametrize(
    ("measurement", "column", "words"),
    [
        (frequency(4.0, (0.0, 0.0)), "posture", "2 joint angles"),
        (frequency(4.0, mode="first wobble"), "mode", "vertical bending 1"),
        (frequency(4.0, mode="bending 10"), "mode", "bending 10"),
        (
            Measurement(kind="damping_ratio", posture=UNFOLDED, value=0.02, sigma=0.01),
            "mode",
            "damping ratio without mode",
        ),
        (frequency(4.0, load=Load.parse("glas")), "load", "did you mean glass"),
        (frequency(4.0, load=Load.parse("5 kg @ top")), "load", "one of tip"),
        (
            Measurement(kind="deflection", posture=UNFOLDED, value=0.02, sigma=0.001, point="tipp"),
            "point",
            "did you mean tip",
        ),
    ],
)
def test_what_does_not_fit_the_arm_is_named(measurement, column, words):
    placed = dataclasses.replace(measurement, where="c.csv:7")
    with pytest.raises(InputError) as error:
        pose(lcd_arm(), Campaign(measurements=(placed,)))
    assert str(error.value).startswith(f"c.csv:7, {column}: ")
    assert words in str(error.value)
    assert "\n" not in str(error.value)


@slow
def test_frequencies_without_a_label_are_counted_in_each_drive_state():
    lowest = np.asarray(exact(UNFOLDED)[1].frequency)[:2]
    np.testing.assert_allclose(unlabelled()["drives"][:, 0], lowest[[0, 0, 1, 1]], rtol=1e-12)


def test_rows_of_different_drive_states_do_not_contradict_each_other():
    one, other = (frequency(hertz, mode="lateral torsion 1", drives=d) for hertz, d in ((4.1, "brake"), (3.7, "servo")))
    assert not list(contradictory_repeats(Campaign(measurements=(one, other))))
    again = dataclasses.replace(other, drives="brake")
    assert list(contradictory_repeats(Campaign(measurements=(one, again)))) == [(0, 1)]


def test_an_empty_campaign_is_refused():
    with pytest.raises(InputError, match="no measurement"):
        pose(lcd_arm(), Campaign())


@slow
@pytest.mark.parametrize("label", ["lateral torsion 1", HEAVY])
def test_a_frequency_is_what_its_row_says_of_its_damped_mode(label):
    undamped, pole, damped, displacement, acceleration = labelled()[label]
    s = state_matrix_poles(UNFOLDED)
    s = s[np.argmin(abs(abs(s) / (2 * np.pi) - pole))]
    size, ratio = abs(s), -s.real / abs(s)
    np.testing.assert_allclose([pole, damped], np.array([size, s.imag]) / (2 * np.pi), rtol=1e-10)
    assert undamped == pytest.approx(pole, rel=0.02)
    # peaks of a single mode's response, found on a fine grid
    omega = size * np.linspace(0.9, 1.1, 2_000_001)
    receptance = 1 / abs(size**2 - omega**2 + 2j * ratio * size * omega)
    found = [omega[np.argmax(response)] / (2 * np.pi) for response in (receptance, receptance * omega**2)]
    np.testing.assert_allclose([displacement, acceleration], found, rtol=1e-6)


@slow
@pytest.mark.parametrize(
    ("rows", "pole_off", "damped_off"),
    [(HEAVY, 0.00039, -0.00466), ("heavy, half", -0.00607, -0.00999), ("vertical, half", 0.00641, 0.00631)],
)
def test_poles_of_neighbouring_modes_differ_from_undamped_frequencies_by_more_than_the_ratio_says(
    rows, pole_off, damped_off
):
    """The figures that docs/assumptions.md gives."""
    undamped, pole, damped = labelled()[rows][:3]
    assert pole / undamped - 1 == pytest.approx(pole_off, abs=2e-5)
    assert damped / undamped - 1 == pytest.approx(damped_off, abs=2e-5)


def peaks_at_the_tip(label, direction):
    """Peaks [Hz] of receptance and accelerance of the whole damped arm at the tip, about a mode."""
    system, found = exact(UNFOLDED)
    mode = list(map(str, mode_labels(found))).index(label)
    M, C, H = (np.asarray(matrix) for matrix in (system.M, system.C, system.H))
    push = np.asarray(found.motion)[direction, -1] @ np.linalg.inv(np.asarray(found.shape))
    hertz = float(found.frequency[mode]) * np.linspace(0.95, 1.05, 4001)
    omega = 2 * np.pi * hertz
    receptance = np.array([abs(push @ np.linalg.solve(H - w * w * M + 1j * w * C, push)) for w in omega])
    return hertz[np.argmax(receptance)], hertz[np.argmax(receptance * omega**2)]


@slow
def test_the_peak_of_a_mode_alone_is_the_arms_where_no_neighbour_adds_to_it():
    np.testing.assert_allclose(peaks_at_the_tip("lateral torsion 1", 1), labelled()["lateral torsion 1"][3:], rtol=4e-4)
    moved = np.array(peaks_at_the_tip(HEAVY, 1)) / labelled()[HEAVY][3:] - 1
    np.testing.assert_allclose(moved, [0.0145, 0.0145], atol=2e-3)


@slow
def test_frequencies_without_a_label_are_what_their_rows_say():
    s, hertz = state_matrix_poles(UNFOLDED), np.asarray(exact(UNFOLDED)[1].frequency)
    damped = s[0].imag / (2 * np.pi)
    expected = [damped, hertz[1], abs(s[2]) / (2 * np.pi)]
    np.testing.assert_allclose(unlabelled()["defined"][:, 0], expected, rtol=1e-10)
    np.testing.assert_allclose(labelled()["mixed"], [damped, hertz[1]], rtol=1e-10)


@slow
def test_a_damped_frequency_gives_the_true_stiffness_and_taken_as_undamped_one_too_low():
    """By twice the 0.47 % in frequency over the joint's share of the mode's strain energy, 62 %: 1.5 %."""
    truth = float(lcd_arm().get("joint3.k_tors"))
    damped = state_matrix_poles(UNFOLDED).imag / (2 * np.pi)
    measured = damped[np.argmin(abs(damped - 16.1))]

    def taken_as(of):
        place = DEFINITIONS.index(of)
        return brentq(lambda x: seen(joint3_k_tors=truth * (1 + x))[HEAVY][place] - measured, -0.1, 0.05, xtol=1e-9)

    assert taken_as("damped") == pytest.approx(0, abs=1e-6)
    assert taken_as("undamped") == pytest.approx(-0.0152, abs=0.0005)


@pytest.mark.parametrize(("ratio", "has_one"), [(0.699, True), (0.701, False)])
def test_a_peak_ends_at_a_damping_ratio_of_0_7(ratio, has_one):
    _, damped, displacement, acceleration = map(float, frequencies_of_pole(jnp.exp(1j * (np.pi - np.arccos(ratio)))))
    assert damped == pytest.approx(np.sqrt(1 - ratio**2) / (2 * np.pi))
    expected = np.sqrt(1 - 2 * ratio**2) if has_one else 0.0
    assert displacement == pytest.approx(expected / (2 * np.pi))
    assert acceleration == pytest.approx(1 / expected / (2 * np.pi) if has_one else 0.0)


@slow
def test_the_peak_of_a_mode_that_is_damped_too_much_is_refused(monkeypatch):
    taus = dict.fromkeys((path.replace(".", "_") for path in TAUS), 0.1)
    assert seen(**taus)["lateral torsion 1"][3:].tolist() == [0.0, 0.0]
    monkeypatch.setattr("ident.identify.data_checks._by_labels", lambda *_: (Expected(*np.zeros((4, 1))), set()))
    rows = (frequency(4.1, mode="lateral torsion 1", of="displacement peak", where="file.csv:2"),)
    with pytest.raises(InputError, match=r"file.csv:2.*damped too much.*expected a damping ratio up to 0.7"):
        check_values(pose(lcd_arm(), Campaign(measurements=rows)))


def test_where_no_frequency_is_of_a_damped_mode_a_program_has_no_definitions():
    rows = tuple(dataclasses.replace(row, of=None) for row in campaign_of(LABELLED))
    plain = bind(lcd_arm(), Campaign(measurements=rows))
    assert plain.definitions is None
    assert padded(plain)[0].definitions is None
