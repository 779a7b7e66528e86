"""Two campaigns on the paper's arm: a stiffness that has changed is found, and none where none has."""

from dataclasses import replace

import numpy as np
import pytest
from arms import DATA, lcd_arm

from ident import InputError, read_campaign
from ident.arm.arm import stiffness_paths
from ident.identify.compare import compare_fits
from ident.identify.fit import fit_campaign
from ident.identify.problem import pose
from ident.identify.unknowns import Unknowns
from ident.inference.search import evaluate

pytestmark = pytest.mark.slow

NAMES = stiffness_paths(lcd_arm())


def fitted(seed, unknowns=None, **factors):
    """A fit to a campaign that is simulated with the arm's stiffnesses, some of them multiplied."""
    campaign = read_campaign(DATA / "lcd_arm" / "campaign.csv")
    problem = pose(lcd_arm(), campaign).problem
    stiffness = np.array([float(lcd_arm().get(name)) * factors.get(name.replace(".", "_"), 1.0) for name in NAMES])
    scatter = np.asarray(problem.sigma) * np.random.default_rng(seed).standard_normal(len(campaign))
    values = evaluate(problem, np.log(stiffness)).predicted + scatter
    measured = tuple(replace(m, value=float(v)) for m, v in zip(campaign.measurements, values, strict=True))
    return fit_campaign(lcd_arm(), replace(campaign, measurements=measured), unknowns, starts=1)


@pytest.fixture(scope="module")
def before():
    return fitted(1)


@pytest.fixture(scope="module")
def softened():
    return fitted(2, joint2_k_tors=0.85)


@pytest.fixture(scope="module")
def other_noise():
    return fitted(2)


def test_a_softened_joint_is_found_and_how_much(before, softened):
    found = compare_fits(before, softened).change
    assert found.seen
    assert dict(zip(found.names, found.changed, strict=True)) == {name: name == "joint2.k_tors" for name in NAMES}
    place = NAMES.index("joint2.k_tors")
    low, high = np.exp(found.interval[place])
    assert low < 0.85 < high < 1
    assert found.alone[place] > 0.01
    assert np.delete(found.alone, place).max() < 1e-3


def test_nothing_has_changed_where_only_noise_differs(before, other_noise):
    found = compare_fits(before, other_noise).change
    assert not found.seen
    assert not found.changed.any()
    assert found.mean == pytest.approx(6.0, abs=0.01)
    assert np.abs(found.change / found.sd).max() < 3


def test_what_is_known_to_be_the_same_is_shared(before, softened):
    found = compare_fits(before, softened, [name for name in NAMES if name != "joint2.k_tors"]).change
    assert found.names == ("joint2.k_tors",)
    assert np.exp(found.interval[0]) == pytest.approx([0.85, 0.85], abs=0.03)
    assert found.sd[0] < 0.5 * compare_fits(before, softened).change.sd[NAMES.index("joint2.k_tors")]


def test_an_uncertain_mass_that_both_share_counts_once(before, other_noise):
    """Alone, each fit leaves the mass open to 20 %; the change of a stiffness does not feel it."""
    free = Unknowns(free={"link2.mass": 0.2})
    found = compare_fits(fitted(1, free), fitted(2, free)).change
    assert found.names == NAMES
    assert found.sd.max() < 1.5 * compare_fits(before, other_noise).change.sd.max()


def test_other_numbers_of_the_arm_and_other_priors_are_named(before):
    other = replace(before, arm=before.arm.replace({"link2.mass": 30.0}))
    assert compare_fits(before, other).unlike == ("link2.mass",)
    assert compare_fits(before, fitted(1, Unknowns(prior_sd=0.5))).priors_differ
    assert not compare_fits(before, before).priors_differ


@pytest.mark.parametrize(
    ("same", "words"),
    [(["joint2.k_tor"], "did you mean joint2.k_tors"), (list(NAMES), "no stiffness that both have fitted")],
)
def test_names_that_can_not_be_are_refused(before, same, words):
    with pytest.raises(InputError, match=words):
        compare_fits(before, before, same)
