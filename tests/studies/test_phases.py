"""Unknown phases of the excitation: which they are, draws of them, and amplitudes that are the worst over them."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from arms import DATA, lcd_arm
from runs import SAMPLES, STEPS, named, off, short, swing, vibration_at, with_error

from ident.arm.arm import Arm
from ident.arm.chain import no_loads
from ident.description.file import read_arm
from ident.errors import InputError
from ident.identify.values import Values
from ident.studies.basis import motion_section
from ident.studies.cure.design import DesignOptions
from ident.studies.motion_options import basis_of
from ident.studies.reading import peak_to_peak
from ident.studies.scenario import OverPhases, Unknowns, at_share, over_phases, unknowns
from ident.studies.working.resonance import ResonanceOptions
from ident.studies.working.simulate import SimulateOptions
from ident.studies.working.sweep import SweepOptions
from ident.vibrate.design import Place, verify
from ident.vibrate.evaluator import Evaluator
from ident.vibrate.motion import stroke
from ident.vibrate.simulate import Superposition, superposition
from ident.vibrate.sweep import Sensitivities, sensitivities
from ident.vibrate.variable import Variable

SWING = swing()
RATE, STEP = SAMPLES / 5.0, 5.0 / STEPS
DRIVES = tuple(drive.name for drive in lcd_arm().drives)
PHASES = tuple(f"{name}.phase" for name in DRIVES)
ALL = (*PHASES, *(f"{name}.error_phase" for name in DRIVES))
STIFFNESS = f"{lcd_arm().joints[0].name}.k_tors"
PATHS = (STIFFNESS, f"{DRIVES[1]}.ratio", f"{DRIVES[1]}.eccentricity")


pytestmark = pytest.mark.slow


@cache
def wavy() -> Arm:
    """The paper's arm with transmission errors."""
    return with_error(3.0)


@cache
def whole() -> Superposition:
    return superposition(wavy(), SWING, ALL, rate=RATE, step=STEP)


def within(path: str) -> tuple[Variable, ...]:
    present = float(lcd_arm().get(path))
    return (Variable((path,), 0.5 * present, 2.0 * present),)


@cache
def hasty() -> Evaluator:
    """The paper's way in half a second, with three equal imbalances, as in `tests/vibrate/test_worst_case.py`."""
    arm = lcd_arm().replace({f"{name}.eccentricity": 0.02 for name in DRIVES})
    motion = named(stroke(arm.stroke, percent=200, dwell=0.2))
    return Evaluator(arm, motion, within(STIFFNESS), loads=no_loads(arm), rate=200.0, step=2e-3, unknown=PHASES)


def test_phases_are_unknown_unless_they_were_seen_or_set():
    origins = dict(zip(PHASES, ("assumed", "measured", "calibrated"), strict=True))
    assert unknowns(lcd_arm(), origins, ())[1].phases == (PHASES[0], PHASES[2])
    assert unknowns(lcd_arm(), origins, (PHASES[0],))[1].phases == (PHASES[2],)
    assert unknowns(lcd_arm(), {}, ())[1].phases == PHASES, "an arm of no file has no origins"
    assert unknowns(wavy(), {}, ())[1].phases == ALL
    balanced = lcd_arm().replace({f"{DRIVES[1]}.eccentricity": 0.0})
    assert unknowns(balanced, {}, ())[1].phases == (PHASES[0], PHASES[2]), "what does not excite has no phase"


def test_peaks_over_what_is_not_known():
    over, drawn = over_phases(whole(), Unknowns(ALL), 200), Unknowns(ALL).draws(200)
    np.testing.assert_allclose(over.peaks, whole().peaks(np.stack([drawn[path] for path in ALL])), rtol=1e-12)
    np.testing.assert_allclose(over.worst, whole().worst)
    alone = wavy().replace({path: drawn[path][9] for path in ALL})
    assert off(over.peaks[:, 9], np.abs(short(alone, SWING).vibration).max(1)) < 3e-4


def test_phases_that_a_share_does_not_exceed():
    phases = np.random.default_rng(9).uniform(0.0, 2 * np.pi, (len(ALL), 2000))
    fresh = whole().peaks(phases).max(0)
    for share in (0.05, 0.95):
        chosen = wavy().replace(at_share(wavy(), whole(), Unknowns(ALL), share))
        alone = np.abs(np.asarray(short(chosen, SWING).vibration)).max()
        assert (fresh <= alone).mean() == pytest.approx(share, abs=3 * np.sqrt(share * (1 - share) / 800))


def test_over_phases_counts():
    peaks = np.array([[1.0, 2.0, 3.0, 4.0], [4.0, 1.0, 1.0, 1.0], [0.0, 0.0, 0.0, 0.0]])
    each, any_of = OverPhases(peaks, peaks, np.zeros((3, 3))).exceeds(2.5)
    np.testing.assert_array_equal(each, [0.5, 0.25, 0.0])
    assert any_of == 0.75


def test_draws_of_phases():
    phases = Unknowns(ALL).draws(500, seed=3)
    assert tuple(phases) == ALL
    assert all(((values >= 0) & (values < 2 * np.pi)).all() for values in phases.values())
    assert Unknowns().draws(10) == {}


def test_kinematic_errors_between_bounds():
    """Draws of the error's size are as much simulations as those of the phases: of errors of 1 to 3 arc seconds."""
    arm, own = wavy(), float(wavy().get(f"{DRIVES[0]}.error"))
    ends = np.rad2deg([own / 3, own]) * 2 * 3600
    errors = unknowns(arm, {f"{DRIVES[1]}.error": "datasheet"}, (), errors=tuple(ends))[1].errors
    assert list(errors) == [f"{DRIVES[0]}.error", f"{DRIVES[2]}.error"]
    unknown = Unknowns(ALL, errors)
    drawn = [values for path, values in unknown.draws(200).items() if path in errors]
    assert all(((values >= own / 3) & (values <= own)).all() for values in drawn)
    over = over_phases(whole(), unknown, 300)
    assert (over.peaks <= over.worst[:, None]).all()
    assert over.worst == pytest.approx(whole().worst)
    larger = over_phases(whole(), Unknowns(ALL), 300)
    assert (over.peaks.mean(1) < larger.peaks.mean(1)).all()
    chosen = arm.replace(at_share(arm, whole(), unknown, 0.95))
    sizes = [float(chosen.get(f"{name}.error")) for name in DRIVES]
    assert sizes[1] == own
    assert all(own / 3 <= size <= own for size in sizes)
    alone = np.abs(np.asarray(short(chosen, SWING).vibration)).max()
    below = over_phases(whole(), unknown, 1000).peaks.max(0) <= alone * (1 + 1e-3)
    assert below.mean() == pytest.approx(0.95, abs=0.01)


def test_what_the_options_leave_unknown():
    """What is set, or taken from the file, is known; catalogues have errors peak to peak."""
    arm_file, numbers = read_arm(DATA / "lcd_arm" / "arm.toml"), {PHASES[0]: 0.3, f"{DRIVES[1]}.error": 1e-6}
    options = SimulateOptions(set=numbers, errors=(30.0, 60.0))
    basis = basis_of(arm_file, options)
    arcsec = np.deg2rad(1 / 3600)
    assert set(basis.unknown.errors) == {f"{DRIVES[0]}.error", f"{DRIVES[2]}.error"}
    for path, bounds in basis.unknown.errors.items():
        assert bounds == pytest.approx((15 * arcsec, 30 * arcsec))
        assert float(basis.arm.get(path)) == bounds[1]
    assert float(basis.arm.get(f"{DRIVES[1]}.error")) == 1e-6
    assert set(basis.unknown.phases) == set(ALL[1:])
    section = motion_section(basis, elastic_belts=False, rate=500.0, method="fast")
    assert any("30 to 60 arc seconds peak to peak" in sentence for sentence in section.parts)
    for sweeping in (SweepOptions(), DesignOptions()):
        own = basis_of(arm_file, sweeping)
        assert sweeping.evaluator(own).unknown == own.unknown.phases == PHASES
    plain = basis_of(arm_file, SimulateOptions(phases="file"))
    assert plain.unknown == Unknowns()
    assert basis_of(arm_file, ResonanceOptions()).unknown == Unknowns()


def test_draws_of_the_excitation_go_with_those_of_a_posterior():
    values = Values("", "", {STIFFNESS: np.full(7, 1e5)})
    basis = basis_of(read_arm(DATA / "lcd_arm" / "arm.toml"), SimulateOptions(errors=(30.0, 30.0)), posterior=values)
    assert {len(column) for column in basis.draws.values()} == {7}
    assert set(basis.draws) == {STIFFNESS, *basis.unknown.phases, *basis.unknown.errors}
    fresh = basis.drawn(values, seed=1)
    assert not np.isclose(fresh[PHASES[0]], basis.draws[PHASES[0]]).any()


@pytest.mark.parametrize("text", ["60:30", "a", "1:2:3", "-1:2"])
def test_kinematic_errors_that_are_none(text):
    with pytest.raises(InputError):
        peak_to_peak(text, "--errors")
    assert peak_to_peak("30", "--errors") == (30.0, 30.0)


def swinging(**options) -> Evaluator:
    return Evaluator(wavy(), SWING, within(STIFFNESS), rate=RATE, step=STEP, unknown=ALL, **options)


def test_an_rms_is_in_the_mean_over_the_phases():
    mine = swinging(measure="rms").amplitudes(np.zeros((1, 1)))[:, 0, 0]
    drawn = vibration_at(whole(), np.random.default_rng(0).uniform(0.0, 2 * np.pi, (len(ALL), 1000)))
    np.testing.assert_allclose(mine, np.sqrt((drawn**2).mean((1, 2))), rtol=0.02)


@cache
def sensitive() -> Sensitivities:
    return sensitivities(replace(hasty(), draws=Unknowns(PHASES).draws(2)), PATHS)


@pytest.mark.parametrize("path", PATHS)
def test_sensitivities_over_the_phases_and_of_draws_which_have_their_own(path):
    """Against differences of the worst case, and of each draw of the phases, as parts of the largest.

    A ratio shifts all in time by many radians, the end point's arc, y^2 over twice the arm's length, by twice as many:
    what the sum over the phases leaves out is a fifth of its slope in x, which is nothing against that in y.
    """
    small, each, (variable,), place = 1e-4, sensitive(), within(path), PATHS.index(path)
    own = replace(hasty(), variables=(variable,), draws=Unknowns(PHASES).draws(2))
    present = variable.present(own.arm)
    changes = [float(variable.change(own.arm, present * (1 + by))) for by in (-small, 0.0, small)]
    below, now, above = own.amplitudes(np.array(changes)[:, None]).swapaxes(0, 1)
    expected = (above - below) / (2 * small) / now
    assert off(each.amplitude, now[:, 0]) < 1e-9
    assert off(each.elasticity[place], expected[:, 0]) < 3.5e-3
    assert off(each.draws[place], expected[:, 1:]) < 3.5e-3


def test_a_design_is_verified_with_its_worst_phases():
    """Both by the exact method, before and after the change, against the amplitude that the search has seen."""
    own = swinging()
    change = np.array([0.1])
    place = Place(change, own.values(change), np.zeros(3), 0.1, 4.0, 0.02)
    checks = verify(own, place)
    seen = own.amplitudes(np.array([[0.0], [0.1]]))[:, :, 0].max(0)
    np.testing.assert_allclose(seen[0], whole().worst.max(), rtol=1e-9)
    for check, largest in zip((checks.before, checks.after), seen, strict=True):
        assert check.amplitude.max() == pytest.approx(largest, rel=5e-3)
        assert np.abs(check.difference).max() < 5e-3
    alone = np.abs(np.asarray(short(wavy(), SWING).vibration)).max()
    assert alone < 0.99 * checks.before.amplitude.max(), "by more than the methods differ"
