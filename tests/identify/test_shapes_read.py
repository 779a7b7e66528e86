"""Measured shapes: MuJoCo's eigenvectors, finite differences, a crossing, and campaigns that cannot be."""

from dataclasses import replace

import numpy as np
import pytest
from conformance import agrees, counted
from engines import MujocoArm, settled, stiffness
from known_shapes import CROSSING, SKEW, rows, with_elbow
from scipy.linalg import eigh
from scipy.stats import binom, chi2

from ident.errors import InputError
from ident.identify.conditions import _compared
from ident.identify.problem import pose
from ident.inference.search import evaluate, solve
from ident.measure import Campaign, Measurement
from ident.measure.reading import campaign_text, parse_campaign
from ident.studies.measuring.modal_campaign import _ratios

slow = pytest.mark.slow


@pytest.fixture(scope="module")
def arm():
    return with_elbow()


def of_poles(campaign):
    return tuple(replace(m, of="pole") for m in campaign)


@pytest.fixture(scope="module")
def campaigns(arm):
    """Those of the skew posture and near the crossing, of undamped modes and of poles: predicted by one program."""
    return {
        "skew": rows(arm, SKEW),
        "skew, poles": of_poles(rows(arm, SKEW)),
        "crossing": rows(arm, CROSSING),
        "crossing, poles": of_poles(rows(arm, CROSSING)),
    }


def together(arm, campaigns):
    return pose(arm, Campaign(measurements=tuple(m for own in campaigns.values() for m in own))).problem


@pytest.fixture(scope="module")
def found(arm, campaigns):
    """The problem, what is predicted at its start, with the derivatives, and the rows of the skew posture's modes."""
    problem = together(arm, campaigns)
    return problem, evaluate(problem), slice(0, len(campaigns["skew"]))


def start(problem):
    return np.asarray(problem.parameters.theta(problem.parameters.column("start")))


@slow
def test_ratios_are_those_of_mujocos_eigenvectors(arm, campaigns, found):
    """Points of the end only, which is where the engine has a site; eigenvectors by LAPACK."""
    other = MujocoArm(arm, SKEW)
    K = stiffness(arm, other)
    x = settled(other, K)
    _, V = eigh(other.mass_matrix(x), other.gravity_hessian(x) + K)
    h, shapes = 1e-5, V[:, ::-1][:, :4]
    moved = np.array(
        [(other.point(x + h * v) - other.point(x - h * v)) / (2 * h) for v in (shapes / np.abs(shapes).max(0)).T]
    )
    campaign, predicted = campaigns["skew"], found[1].predicted[found[2]]
    labels = [m.mode for m in campaign if m.kind == "frequency"]
    compared = 0
    for m, value in zip(campaign, predicted, strict=True):
        if m.kind == "shape" and (m.point, m.reference_point) == ("tip", "tip"):
            own = moved[labels.index(m.mode)]
            expected = own @ m.direction / (own @ m.reference_direction)
            agrees(value, expected, "modal", "ratios of mode shapes", "MuJoCo, eigenvectors by LAPACK", atol=1e-7)
            compared += 1
    assert compared >= 4


@slow
def test_slopes_are_those_of_differences(found):
    """Of undamped modes and of poles, also near the crossing."""
    problem, there, _ = found
    theta, h, shapes = start(problem), 1e-5, np.array(problem.kinds) == "shape"
    ends = [[evaluate(problem, theta + way * h * e).predicted for e in np.eye(len(theta))] for way in (1, -1)]
    differences = (np.array(ends[0]) - ends[1]).T / (2 * h)
    jacobian = np.asarray(there.jacobian)
    for own in np.split(np.arange(len(jacobian)), 4):
        assert np.abs(jacobian[own][shapes[own]]).max() > 0.1
        least, what = float(2e-8 * np.abs(jacobian[own]).max()), "slopes of mode shapes, near a crossing too"
        agrees(jacobian[own], differences[own], "modal", what, "central differences", rtol=1e-7, atol=least)


@slow
def test_shapes_tell_joints_apart_that_frequencies_do_not(found):
    """What the data of one posture say of the stiffnesses, in the units of their priors."""
    problem, there, own = found
    jacobian = (np.asarray(there.jacobian) / np.asarray(problem.sigma)[:, None])[own]
    shapes = np.array(problem.kinds)[own] == "shape"
    sd = [np.sqrt(np.diag(np.linalg.inv(J.T @ J + np.eye(J.shape[1])))) for J in (jacobian[~shapes], jacobian)]
    assert (sd[0] > 0.5).any()
    assert (sd[1] < 0.1 * sd[0]).any()
    assert (sd[1][sd[0] > 0.5] < 0.3).any()


@slow
def test_a_prediction_stays_bounded_where_its_mode_does_not_move_the_reference(arm, campaigns):
    """Shapes measured of another mode than the label says: nothing runs away, where a ratio would."""
    campaign = campaigns["skew"]
    named = {m.mode for m in campaign}
    moved = tuple(replace(m, mode=dict(zip(named, [*named][1:] + [*named][:1], strict=True))[m.mode]) for m in campaign)
    exchanged = tuple(m if m.kind == "frequency" else n for m, n in zip(campaign, moved, strict=True))
    predicted = evaluate(together(arm, {**campaigns, "skew": exchanged})).predicted[: len(exchanged)]
    for m, value in zip(exchanged, predicted, strict=True):
        if m.kind == "shape":
            own = [n.value for n in exchanged if n.kind == "shape" and n.mode == m.mode]
            whole = 1 + np.square(own).sum()
            assert abs(value - m.value) <= whole**1.5


def test_modes_that_coincide_are_compared_as_their_plane():
    """Any direction of the plane of two shapes is met where they coincide, none but the own one far from there."""
    rng = np.random.default_rng(0)
    u, b = rng.normal(size=(2, 6))
    y = u + 0.3 * b
    y = (y / y[0])[:, None]
    near, far = (np.asarray(_compared(y, u[:, None], b[:, None], np.array([w]))) for w in (0.0, 1e3))
    np.testing.assert_allclose(near[1:], y[1:], atol=1e-9)
    assert np.abs(far[1:] - y[1:]).max() > 0.05


@slow
def test_rows_of_shapes_are_written_and_read_again(campaigns):
    campaign = Campaign(measurements=campaigns["skew, poles"])
    assert parse_campaign(campaign_text(campaign).encode(), "a.csv") == campaign


BLANK = {"kind": "shape", "posture": SKEW, "value": 0.5, "sigma": 0.1, "mode": "vertical bending 1", "point": "tip",
         "direction": (1.0, 0.0, 0.0), "reference_point": "tip", "reference_direction": (0.0, 0.0, 1.0)}  # fmt: skip


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"mode": None}, "the mode of a shape"),
        ({"point": None}, "the point whose motion was read"),
        ({"reference_point": None}, "the reference point of a shape"),
        ({"reference_direction": None}, "the reference direction of a shape"),
        ({"direction": (0.0, 0.0, 1.0)}, "the reference itself"),
        ({"of": "damped"}, "a shape of the damped mode"),
        ({"joint": "elbow"}, "a shape has no joint"),
        ({"kind": "frequency"}, "a frequency has no"),
    ],
)
def test_what_is_no_shape_is_refused(change, said):
    with pytest.raises(InputError, match=said):
        Measurement(**{**BLANK, **change})


def test_a_reference_that_the_arm_has_not_is_refused(arm):
    with pytest.raises(InputError, match="reference_point"):
        pose(arm, Campaign(measurements=(Measurement(**{**BLANK, "reference_point": "wrist"}),)))


def test_the_slopes_of_measured_ratios_are_those_of_differences():
    """From the complex shape that a test gives to the rows of a campaign."""
    rng = np.random.default_rng(1)
    shape = (rng.normal(size=5) + 0.1j * rng.normal(size=5)) * np.exp(0.7j)
    _, _, slopes = _ratios(shape)
    ways, h = [*np.eye(5), *(1j * np.eye(5))], 1e-6
    differences = np.array([(_ratios(shape + h * way)[1] - _ratios(shape - h * way)[1]) / (2 * h) for way in ways]).T
    what = "slopes of measured ratios"
    agrees(slopes, differences, "modal", what, "central differences", rtol=1e-7, atol=1e-8)
    np.testing.assert_allclose(_ratios(3 * shape * np.exp(1j))[1], _ratios(shape)[1], rtol=1e-12)


@slow
def test_fits_of_noisy_shapes_hold_the_truth_as_often_as_they_say(arm, campaigns, found):
    """Twelve campaigns near the crossing, one search each from the truth; rates: tests/benchmarks/shapes.py."""
    rng, campaign = np.random.default_rng(7), campaigns["crossing"]
    truth, sigma = start(found[0]), np.array([m.sigma for m in campaign])
    counts = np.repeat([name == "crossing" for name in campaigns], [len(own) for own in campaigns.values()])
    inside, squared = 0, 0.0
    for _ in range(12):
        noise = sigma * rng.standard_normal(len(sigma))
        made = tuple(replace(m, value=m.value + float(e)) for m, e in zip(campaign, noise, strict=True))
        problem = together(arm, {**campaigns, "crossing": made})
        problem = problem.with_sigma(np.where(counts, np.asarray(problem.sigma), np.inf))
        end = solve(problem, truth)
        residuals, slope = problem.weigh(np.asarray(end.predicted), np.asarray(end.jacobian), np.asarray(end.theta))
        sd = np.sqrt(np.diag(np.linalg.inv(slope.T @ slope)))
        inside += int((abs(np.asarray(end.theta) - truth) < 1.96 * sd).sum())
        squared += float(np.square(residuals[: len(counts)]).sum())
    what, source, count = (
        "stiffnesses by shapes near a crossing within their intervals",
        "95 % promised",
        12 * len(truth),
    )
    least = binom.ppf(0.001, count, 0.95)
    counted(inside, count, least, count, "verdict rates", what, source, expected=0.95 * count)
    degrees = 12 * (len(campaign) - len(truth))
    # the pair that nearly coincides says less than its rows, and priors hold what data leave open
    assert chi2.ppf(0.001, degrees - 24) < squared < chi2.ppf(0.999, degrees + 12 * len(truth))
