"""Predictions of a campaign: order, labels, loads, batches, and what does not fit the arm."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
from arms import lcd_arm
from equinox import filter_jit
from one_program import shown

from ident.arm.arm import stiffness_paths
from ident.arm.chain import at_posture
from ident.arm.modes import damped_eigenvalues, linearize, mode_labels, modes, parse_label
from ident.errors import InputError
from ident.identify.conditions import bind, frequencies_of_pole
from ident.identify.fit import fit_campaign
from ident.identify.padding import padded
from ident.identify.predict import predict
from ident.identify.problem import contradictory_repeats, pose
from ident.identify.unknowns import Unknowns, stiffness_parameters
from ident.inference.problem import Data
from ident.measure import DEFINITIONS, Campaign, Load, Measurement

pytestmark = pytest.mark.slow

UNFOLDED, BENT = (0.0, 0.0, 0.0), tuple(np.deg2rad([80.0, -160.0, 80.0]))
KILOGRAMS = Load.parse("5 kg @ tip")


def frequency(value, posture=UNFOLDED, **more):
    return Measurement(kind="frequency", posture=posture, value=value, sigma=0.02, **more)


def predicted(*measurements, parameters=None):
    return shown(lcd_arm(), Campaign(measurements=measurements), parameters)


def predicted_at(arm, k, count, sigma):
    """The lowest frequencies, without labels, for many stiffnesses; with their sigma, as a fit predicts them."""
    campaign = Campaign(measurements=tuple(frequency(4.0 + i) for i in range(count)))
    conditions = bind(arm, campaign)
    data = sigma and Data(jnp.arange(count) + 4.0, jnp.full(count, sigma))
    return np.asarray(jax.jit(lambda k: predict(arm, {"joint1.k_tors": k}, conditions, data))(jnp.asarray(k)))


@filter_jit
def at_rest(arm, posture):
    chain = at_posture(arm, posture)
    return chain, modes(chain)


def exact(posture):
    return at_rest(lcd_arm(), np.asarray(posture))


@filter_jit
def poles(chain):
    return damped_eigenvalues(linearize(chain))


def test_values_come_in_the_order_of_the_campaign_not_of_size_or_kind():
    _, found = exact(UNFOLDED)
    values = predicted(
        Measurement(kind="deflection", posture=UNFOLDED, value=0.02, sigma=0.001, point="tip"),
        frequency(14.0),
        frequency(4.1),
        frequency(4.8),
    )
    np.testing.assert_allclose(values[1:], np.asarray(found.frequency)[[2, 0, 1]], rtol=1e-12)
    assert values[0] == pytest.approx(0.0263, abs=5e-5)


def test_labels_find_their_modes_where_the_order_is_reversed():
    _, found = exact(BENT)
    names = [str(label) for label in mode_labels(found)]
    assert names[:2] == ["vertical bending 1", "lateral torsion 1"], "the two branches have crossed by 80 degrees"
    values = predicted(
        frequency(4.0, BENT, mode="lateral torsion 1"),
        frequency(5.0, BENT, mode="vertical bending 1"),
        frequency(6.0, BENT, mode="torsion 1"),
    )
    np.testing.assert_allclose(values, np.asarray(found.frequency)[[1, 0, 1]], rtol=1e-12)


def test_values_without_label_take_the_lowest_modes_that_no_label_took():
    _, found = exact(UNFOLDED)
    values = predicted(frequency(15.0), frequency(4.1, mode="lateral torsion 1"), frequency(4.8))
    np.testing.assert_allclose(values, np.asarray(found.frequency)[[2, 0, 1]], rtol=1e-12)


def test_the_highest_measured_mode_is_smooth_where_the_next_one_crosses_it():
    """Nearer than a sigma s the lower of the two is pushed down by (s - gap)^2 / 4s; none below it is."""
    arm, sigma = lcd_arm(), 0.1
    k = float(arm.get("joint1.k_tors")) * np.linspace(1.45, 1.8, 71)
    lowest = predicted_at(arm, k, 2, None)
    gap = lowest[1] - lowest[0]
    assert gap.min() < 0.01
    assert gap.max() > sigma
    (found,) = predicted_at(arm, k, 1, sigma)
    np.testing.assert_allclose(found, lowest[0] - np.maximum(sigma - gap, 0) ** 2 / (4 * sigma), rtol=1e-12)
    assert np.abs(np.diff(found, 2)).max() < np.abs(np.diff(lowest[0], 2)).max() / 5
    np.testing.assert_allclose(predicted_at(arm, k, 2, sigma), lowest, rtol=1e-12)  # both are measured


def test_damping_ratios_belong_to_the_modes_of_their_labels():
    chain, _ = exact(BENT)
    s = np.asarray(poles(chain))
    ratio = -s.real / abs(s)
    values = predicted(
        Measurement(kind="damping_ratio", posture=BENT, value=0.03, sigma=0.01, mode="lateral torsion 1"),
        Measurement(kind="damping_ratio", posture=BENT, value=0.003, sigma=0.001, mode="vertical bending 1"),
    )
    np.testing.assert_allclose(values, ratio[[1, 0]], rtol=1e-10)


def test_a_deflection_difference_is_the_difference_of_two_deflections():
    base = Measurement(kind="deflection", posture=BENT, value=0.01, sigma=0.001, point="tip", direction=(0, 0.6, -0.8))
    loaded = dataclasses.replace(base, load=KILOGRAMS)
    difference = dataclasses.replace(loaded, kind="deflection_difference")
    values = predicted(base, loaded, difference)
    assert values[2] == pytest.approx(values[1] - values[0], rel=1e-12)
    assert values[2] > 1e-3


def test_a_weight_is_a_mass_and_a_force_is_not():
    weight = -5 * float(lcd_arm().gravity[2])
    hung = Measurement(kind="deflection", posture=UNFOLDED, value=0.03, sigma=0.001, point="tip", load=KILOGRAMS)
    pulled = dataclasses.replace(hung, load=Load.parse(f"{weight} N -z @ tip"))
    values = predicted(hung, pulled, frequency(3.9, load=KILOGRAMS), frequency(4.1, load=pulled.load))
    assert values[0] == pytest.approx(values[1], rel=1e-10)
    assert values[2] < 0.98 * values[3]


def test_a_batch_of_parameters_equals_one_at_a_time():
    campaign = Campaign(measurements=(frequency(4.1, mode="torsion 1"), frequency(5.0, BENT), frequency(6.0, BENT)))
    conditions, parameters = bind(lcd_arm(), campaign), stiffness_parameters(lcd_arm())
    draws = parameters.column("start")[:, None] * np.exp(np.random.default_rng(0).normal(size=(6, 5)) * 0.3)
    values = jax.jit(lambda draws: predict(lcd_arm(), parameters.by_path(draws), conditions))
    together, alone = values(draws), [values(draws[:, i]) for i in range(5)]
    np.testing.assert_allclose(together, np.stack(alone, 1), rtol=1e-11)


def test_no_equilibrium_gives_nan_not_a_number():
    assert np.isnan(predicted(frequency(4.1), parameters={"joint1.k_bend": 10.0})).all()


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


def test_motors_that_turn_freely_are_refused():
    with pytest.raises(InputError, match=r"file\.csv:2.*drives.*turn freely, expected motors that are held"):
        pose(lcd_arm(), Campaign(measurements=(frequency(4.1, drives="off", where="file.csv:2"),)))


def test_frequencies_without_a_label_are_counted_in_each_drive_state():
    values = predicted(frequency(4.1), frequency(4.0, drives="servo"), frequency(4.8), frequency(4.7, drives="servo"))
    lowest = np.asarray(exact(UNFOLDED)[1].frequency)[:2]
    np.testing.assert_allclose(values, lowest[[0, 0, 1, 1]], rtol=1e-12)


def test_rows_of_different_drive_states_do_not_contradict_each_other():
    one, other = (frequency(hertz, mode="lateral torsion 1", drives=d) for hertz, d in ((4.1, "brake"), (3.7, "servo")))
    assert not list(contradictory_repeats(Campaign(measurements=(one, other))))
    again = dataclasses.replace(other, drives="brake")
    assert list(contradictory_repeats(Campaign(measurements=(one, again)))) == [(0, 1)]


def test_an_empty_campaign_is_refused():
    with pytest.raises(InputError, match="no measurement"):
        pose(lcd_arm(), Campaign())


HEAVY = "lateral torsion 2"


@jax.jit
def linearized(posture):
    return linearize(at_posture(lcd_arm(), posture))


def state_matrix_poles(posture):
    """The poles of the damped arm by LAPACK's eigenvalues of the state matrix, of positive imaginary part."""
    system = linearized(jnp.asarray(posture))
    M, C, H = (np.asarray(matrix) for matrix in (system.M, system.C, system.H))
    lower = -np.linalg.solve(M, np.concatenate([H, C], 1))
    upper = np.concatenate([np.zeros_like(M), np.eye(len(M))], 1)
    s = scipy.linalg.eigvals(np.concatenate([upper, lower]))
    return s[s.imag > 0]


@pytest.mark.parametrize("label", ["lateral torsion 1", HEAVY])
def test_a_frequency_is_what_its_row_says_of_its_damped_mode(label):
    undamped, pole, damped, displacement, acceleration = predicted(
        *(frequency(20.0, mode=label, of=of) for of in DEFINITIONS)
    )
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


HALF = tuple(np.deg2rad([40.0, -80.0, 40.0]))


@pytest.mark.parametrize(
    ("label", "posture", "pole_off", "damped_off"),
    [
        (HEAVY, UNFOLDED, 0.00039, -0.00466),
        (HEAVY, HALF, -0.00607, -0.00999),
        ("vertical bending 2", HALF, 0.00641, 0.00631),
    ],
)
def test_poles_of_neighbouring_modes_differ_from_undamped_frequencies_by_more_than_the_ratio_says(
    label, posture, pole_off, damped_off
):
    """The figures that docs/assumptions.md gives."""
    undamped, pole, damped = predicted(*(frequency(15.0, posture, mode=label, of=of) for of in DEFINITIONS[:3]))
    assert pole / undamped - 1 == pytest.approx(pole_off, abs=2e-5)
    assert damped / undamped - 1 == pytest.approx(damped_off, abs=2e-5)


def peaks_at_the_tip(label, direction):
    """Peaks [Hz] of receptance and accelerance of the whole damped arm at the tip, about a mode."""
    chain, found = exact(UNFOLDED)
    mode = list(map(str, mode_labels(found))).index(label)
    system = linearize(chain)
    M, C, H = (np.asarray(matrix) for matrix in (system.M, system.C, system.H))
    push = np.asarray(found.motion)[direction, -1] @ np.linalg.inv(np.asarray(found.shape))
    hertz = float(found.frequency[mode]) * np.linspace(0.95, 1.05, 4001)
    omega = 2 * np.pi * hertz
    receptance = np.array([abs(push @ np.linalg.solve(H - w * w * M + 1j * w * C, push)) for w in omega])
    return hertz[np.argmax(receptance)], hertz[np.argmax(receptance * omega**2)]


def test_the_peak_of_a_mode_alone_is_the_arms_where_no_neighbour_adds_to_it():
    kinds = DEFINITIONS[3:]
    alone = predicted(*(frequency(4.1, mode="lateral torsion 1", of=of) for of in kinds))
    np.testing.assert_allclose(peaks_at_the_tip("lateral torsion 1", 1), alone, rtol=4e-4)
    displacement, acceleration = predicted(*(frequency(16.0, mode=HEAVY, of=of) for of in kinds))
    moved = np.array(peaks_at_the_tip(HEAVY, 1)) / [displacement, acceleration] - 1
    np.testing.assert_allclose(moved, [0.0145, 0.0145], atol=2e-3)


def test_frequencies_without_a_label_are_what_their_rows_say():
    blank = predicted(frequency(4.1, of="damped"), frequency(4.8), frequency(14.0, of="pole"))
    s = np.sort(np.abs(state_matrix_poles(UNFOLDED)))[:3], np.asarray(exact(UNFOLDED)[1].frequency)
    damped = np.sort(state_matrix_poles(UNFOLDED).imag)[0] / (2 * np.pi)
    np.testing.assert_allclose(blank, [damped, s[1][1], s[0][2] / (2 * np.pi)], rtol=1e-10)
    mixed = predicted(frequency(4.1, of="damped"), frequency(4.8, mode="vertical bending 1", of="undamped"))
    np.testing.assert_allclose(mixed, [damped, s[1][1]], rtol=1e-10)


@pytest.mark.parametrize("of", DEFINITIONS[1:])
def test_damped_frequencies_have_derivatives(of):
    arm, campaign = lcd_arm(), Campaign(measurements=(frequency(20.0, mode=HEAVY, of=of), frequency(4.0, of=of)))
    conditions = bind(arm, campaign)

    @jax.jit
    def seen(tau):
        return predict(arm, {"joint1.tau_tors": tau, "joint2.k_tors": 2e5 * (1 + tau)}, conditions)

    tau, step = 2e-3, 1e-6
    slope = jax.jit(jax.jacfwd(seen))(tau)
    np.testing.assert_allclose(slope, (seen(tau + step) - seen(tau - step)) / (2 * step), rtol=1e-5)


def test_a_damped_frequency_gives_the_true_stiffness_and_taken_as_undamped_one_too_low():
    """By twice the 0.47 % in frequency over the joint's share of the mode's strain energy, 62 %: 1.5 %."""
    path = "joint3.k_tors"
    truth = float(lcd_arm().get(path))
    arm = lcd_arm().replace({path: truth / 1.1})
    damped = state_matrix_poles(UNFOLDED).imag / (2 * np.pi)
    measured = damped[np.argmin(abs(damped - 16.1))]
    fixed = tuple(other for other in stiffness_paths(arm) if other != path)

    def fitted(of):
        campaign = Campaign(measurements=(dataclasses.replace(frequency(measured, mode=HEAVY), of=of),))
        return fit_campaign(arm, campaign, Unknowns(fixed=fixed, prior_sd=np.inf), starts=1).parameters[path]

    assert fitted("damped") / truth - 1 == pytest.approx(0, abs=1e-6)
    assert fitted("undamped") / truth - 1 == pytest.approx(-0.0152, abs=0.0005)


@pytest.mark.parametrize(("ratio", "has_one"), [(0.699, True), (0.701, False)])
def test_a_peak_ends_at_a_damping_ratio_of_0_7(ratio, has_one):
    _, damped, displacement, acceleration = map(float, frequencies_of_pole(jnp.exp(1j * (np.pi - np.arccos(ratio)))))
    assert damped == pytest.approx(np.sqrt(1 - ratio**2) / (2 * np.pi))
    expected = np.sqrt(1 - 2 * ratio**2) if has_one else 0.0
    assert displacement == pytest.approx(expected / (2 * np.pi))
    assert acceleration == pytest.approx(1 / expected / (2 * np.pi) if has_one else 0.0)


def test_the_peak_of_a_mode_that_is_damped_too_much_is_refused():
    arm = lcd_arm().replace({f"joint{j}.tau_tors": 0.1 for j in (1, 2, 3)})
    rows = (frequency(4.1, mode="lateral torsion 1", of="displacement peak", where="file.csv:2"),)
    with pytest.raises(InputError, match=r"file.csv:2.*damped too much.*expected a damping ratio up to 0.7"):
        fit_campaign(arm, Campaign(measurements=rows), starts=1)


def test_padded_campaigns_keep_what_their_frequencies_are():
    rows = [frequency(20.0, mode=HEAVY, of="damped"), frequency(4.8, of="pole"), frequency(4.1, of="damped")]
    rows += [Measurement(kind="damping_ratio", posture=UNFOLDED, value=0.03, sigma=0.01, mode=HEAVY)]
    arm, conditions = lcd_arm(), bind(lcd_arm(), Campaign(measurements=tuple(rows)))
    few, _, places = padded(conditions)
    more = np.asarray(jax.jit(lambda: predict(arm, {}, few))())
    np.testing.assert_allclose(more[places], predicted(*rows), rtol=1e-12)
    plain = bind(arm, Campaign(measurements=tuple(dataclasses.replace(row, of=None) for row in rows)))
    assert plain.definitions is None
    assert padded(plain)[0].definitions is None
