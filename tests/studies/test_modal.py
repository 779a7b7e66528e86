"""The shipped hammer test: its generator against an integrator, and frequency responses against the model's."""

from dataclasses import replace
from shutil import copy

import jax.numpy as jnp
import numpy as np
import pytest
from equinox import filter_jit
from hammer_files import FOLDER, HAMMER_TEST, generator
from reports import assert_one_screen
from results import assert_comes_back
from scipy.integrate import solve_ivp
from scipy.stats import chi2

import ident
from ident.arm.chain import at_posture
from ident.arm.mechanics import point_positions, static_equilibrium, unflatten
from ident.arm.modes import damped_eigenvalues, linearize, mode_labels, modes
from ident.description.file import read_arm
from ident.errors import InputError
from ident.identify.binding import loads_of
from ident.identify.problem import pose
from ident.inference.search import evaluate
from ident.measure import Load
from ident.measure.channels import read_channels
from ident.measure.recordings import read_recording
from ident.studies.measuring.modal_campaign import modal_campaign
from ident.studies.result import Result

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]  # the first test makes what the manual shows, figures too

POSTURE = np.radians([60.0, -120.0, 60.0])


@pytest.fixture(scope="module")
def arm():
    return read_arm(FOLDER / "arm.toml").arm


@pytest.fixture(scope="module")
def seen(arm):
    return generator().system(arm, POSTURE)


@pytest.fixture(scope="module")
def manual(run_here, shelf, tmp_path_factory):
    """The folder that the manual's commands have written to, what they have printed, and their results by name."""
    folder, printed, results, save = tmp_path_factory.mktemp("manual"), [], {}, Result.save
    (folder / "data").symlink_to(FOLDER.parents[1])

    def kept(self, path):
        results[self.name] = self
        return save(self, path)

    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr(Result, "save", kept)
        for words in HAMMER_TEST:
            code, out, err = shelf.put(words, run_here)
            assert (code, err) == (0, "")
            printed.append(out)
    return folder / "out", printed, results


@pytest.fixture(scope="module")
def result(manual):
    return manual[2]["hammer.modal"]


@pytest.fixture(scope="module")
def systems(arm, result):
    """What made the records, by the posture."""
    return {test.posture: generator().system(arm, np.array(test.posture)) for test in result.tests}


@pytest.fixture(scope="module")
def chosen(posture):
    """One posture, made here, with modes that were chosen by hand."""
    options = ident.ModalOptions(modes={"1": (5.66, 5.77, 15.0)})
    return ident.modal_test(FOLDER, posture, FOLDER / "arm.toml", options)


@pytest.fixture(scope="module")
def posture():
    """The channels of one posture."""
    rows = read_channels(FOLDER / "channels.csv")
    return replace(rows, rows=tuple(row for row in rows.rows if "alpha60" in row.file))


@filter_jit
def at_rest(arm, posture, loads):
    """The arm held there, its equilibrium, the equations about that, undamped modes and damped eigenvalues."""
    chain = at_posture(arm, posture, loads)
    at = static_equilibrium(chain)
    linear = linearize(chain, at)
    return chain, at, linear, modes(chain), damped_eigenvalues(linear)


def test_the_generators_modes_are_those_of_the_model(arm, seen):
    expected = np.asarray(at_rest(arm, POSTURE, loads_of(arm, Load.parse(generator().LOAD)))[-1])
    poles = seen.poles[seen.poles.imag > 0]
    assert max(min(abs(poles - each)) / abs(each) for each in expected) < 1e-9


def test_the_generators_response_is_that_of_an_integrator(arm, seen):
    """M x'' + C x' + H x = J' f by DOP853 with the static deflection, shifts of the tip by differences."""
    made = generator()
    chain, at, linear, *_ = at_rest(arm, POSTURE, loads_of(arm, Load.parse(made.LOAD)))
    M, C, H = (np.asarray(each) for each in (linear.M, linear.C, linear.H))
    small, tip = 1e-6, [point.name for point in arm.points].index("tip")
    shifts, places = [small * np.asarray(unflatten(each)) for each in jnp.eye(len(M))], filter_jit(point_positions)
    phi = np.asarray(at.phi)
    J = np.array([np.asarray(places(chain, phi + d) - places(chain, phi - d))[:, tip] for d in shifts])
    J = J.T / (2 * small)
    pulse, peak = 0.025, 150.0
    push = lambda t: peak * np.sin(np.pi * t / pulse) * (t < pulse)  # noqa: E731

    def rate(t, x):
        return np.concatenate([x[9:], np.linalg.solve(M, -J[2] * push(t) - C @ x[9:] - H @ x[:9])])

    time = np.linspace(0, 0.4, 81)
    first = solve_ivp(rate, (0, pulse), np.zeros(18), "DOP853", rtol=1e-10, atol=1e-13)
    rest = solve_ivp(rate, (pulse, 0.4), first.y[:, -1], "DOP853", t_eval=time[time > pulse], rtol=1e-10, atol=1e-13)
    expected = np.array([J @ rate(t, x)[9:] for t, x in zip(rest.t, rest.y.T, strict=True)]).T
    answer = seen.response(time, peak, pulse, list(made.FORCES).index("z"))[:3, time > pulse]
    turned = made._about_z(0.0) @ answer
    np.testing.assert_allclose(turned, expected, rtol=0, atol=1e-6 * abs(expected).max())


def test_the_generators_accelerance_is_that_of_its_response(seen):
    """By a Fourier transform of a long response, no window."""
    time = np.arange(2**15) / 800.0
    push = generator().half_sine(time, 0.025)
    answers = np.fft.rfft(seen.response(time, 1.0, 0.025, 1)) / 800.0
    force = np.fft.rfft(push) / 800.0
    lines = np.fft.rfftfreq(len(time), 1 / 800.0)
    inside = (lines > 2) & (lines < 30)
    expected = seen.accelerance(2j * np.pi * lines[inside])[:, 1]
    np.testing.assert_allclose(answers[:, inside] / force[inside], expected, rtol=0, atol=2e-3 * abs(expected).max())


def test_the_shipped_files_are_those_of_the_generator(arm):
    made = generator()
    pushed, answers = made.records(made.system(arm, np.zeros(3)), 0, "z", np.random.default_rng(made.SEED))
    channels = {each.name: each.values for each in read_recording(FOLDER / made.name(0, "z")).channels}
    np.testing.assert_allclose(channels["1:-Z force"], pushed, rtol=1e-6, atol=1e-5)
    np.testing.assert_allclose(channels["2:+Y acceleration"], answers[4], rtol=1e-6, atol=1e-6)


def test_the_arm_beside_the_test_is_the_papers_with_one_point_more(arm):
    assert (FOLDER / "arm.toml").read_text() == generator().arm_text()
    plain = read_arm(FOLDER.parent / "arm.toml").arm
    assert [point.name for point in arm.points] == ["elbow", *(point.name for point in plain.points)]


def test_each_fault_of_the_test_is_rejected_and_nothing_else(result):
    (overload,) = result.rejected  # the double hit counts with its whole force
    assert overload.partition(":")[0] == "alpha60_y.unv, hit 2"
    assert "overload of the force: 250 of a full scale of 250 N" in overload
    assert result.hits == 40
    assert not result.doubtful
    assert all("mains at 60 Hz" in " ".join(test.remarks) for test in result.tests)


def test_frequency_responses_are_those_of_the_model_on_the_line_of_the_window(systems, result):
    for test in result.tests:
        order = [1 if place.direction[2] == 0 else 0 for place in test.frf.references]
        s = test.frf.decay + 2j * np.pi * test.frf.frequency
        expected = systems[test.posture].accelerance(s)[:, order]
        sd = test.frf.hits.std(0, ddof=1) / np.sqrt(5)
        off = np.sqrt(np.mean(abs(test.frf.mean - expected) ** 2 / sd**2))
        assert 1.0 < off < 1.3, "Student's t of five complex values has a variance of 4 / 3"


def test_modes_are_those_of_the_model_within_their_joint_covariance(systems, result):
    """Chi-squared of all rows of the campaign, which have a name, against the poles of the model."""
    repeatable = modal_campaign("hammer.modal", result.tests, result.identified)
    rows = repeatable.measurements
    off = []
    for row in rows:
        hertz = next(r.value for r in rows if (r.posture, r.mode, r.kind) == (row.posture, row.mode, "frequency"))
        poles = systems[row.posture].poles
        pole = min(poles[poles.imag > 0], key=lambda p, hertz=hertz: abs(abs(p) / (2 * np.pi) - hertz))
        off.append(row.value - (abs(pole) / (2 * np.pi) if row.kind == "frequency" else -pole.real / abs(pole)))
    joint = sum(
        part @ np.linalg.solve(R, part)
        for places, R in repeatable.correlated
        for part in [np.array(off)[list(places)] / [rows[i].sigma for i in places]]
    )
    assert chi2.ppf(0.025, len(rows)) < joint < chi2.ppf(0.975, len(rows))


def test_sigmas_are_repeatability_and_reproducibility(result):
    """The data are synthetic, and repeat exactly: only what is assumed is added, half of it common to a posture."""
    repeatable = modal_campaign("hammer.modal", result.tests, result.identified)
    for before, after in zip(repeatable, result.campaign, strict=True):
        share = {"frequency": 0.002, "damping_ratio": 0.05}[after.kind]
        assert after.sigma == pytest.approx(np.hypot(before.sigma, share * after.value), rel=1e-12)
    words = " ".join(result.report(details=True).split())
    assert "0.2 % of each frequency (assumed), 5 % of each damping ratio (assumed)" in words
    (table,) = result.sections().answer
    by_name = {(row.mode, row.kind, row.posture): row.sigma for row in result.campaign}
    posture = result.tests[0].posture
    assert table.rows[0][3] == pytest.approx(by_name[(table.rows[0][1], "frequency", posture)], rel=1e-12)
    assert table.rows[0][5] == pytest.approx(100 * by_name[(table.rows[0][1], "damping_ratio", posture)], rel=1e-12)


def test_intervals_cover_what_a_mounting_error_common_to_a_posture_moves(result):
    """2000 tests along a straight line at the truth, mounted again at each posture: 95 % by the new sigmas alone."""
    repeatable = modal_campaign("hammer.modal", result.tests, result.identified)
    problem = pose(result.arm.arm, result.campaign).problem
    J = np.asarray(evaluate(problem).jacobian)
    values, kinds = np.array([(m.value) for m in result.campaign]), np.array([m.kind for m in result.campaign])
    covariances = []
    for campaign in (repeatable, result.campaign):
        sigma, whole = np.array([m.sigma for m in campaign]), np.eye(len(values))
        for places, R in campaign.correlated:
            whole[np.ix_(places, places)] = R
        covariances.append(whole * np.outer(sigma, sigma))
    rng, count = np.random.default_rng(5), 2000
    errors = rng.standard_normal((count, len(values))) @ np.linalg.cholesky(covariances[0]).T
    share = np.where(kinds == "frequency", 0.002, 0.05) * values / np.sqrt(2)
    for places, _ in result.campaign.correlated:
        for kind in set(kinds):
            own = np.array([i for i in places if kinds[i] == kind])
            errors[:, own] += share[own] * np.sqrt(12) * (rng.random((count, 1)) - 0.5)
    errors += share * rng.standard_normal(errors.shape)
    inside = []
    stiff = np.flatnonzero(kinds != "damping_ratio")  # the others move no stiffness
    for C in covariances:
        precision = np.linalg.inv(C[np.ix_(stiff, stiff)])
        known = np.linalg.inv(J.T @ precision @ J)
        off = errors[:, stiff] @ precision @ J @ known / np.sqrt(np.diag(known))
        inside.append((np.abs(off) < 1.96).mean(0)[:6])
    band = 4 * np.sqrt(0.05 * 0.95 / count)
    assert (np.abs(inside[1] - 0.95) < band).all(), inside[1]
    assert (inside[0] < 0.5).all(), inside[0]


def test_no_name_is_wrong(arm, result):
    """The names of the arm that made the data, at the frequencies that it has there."""
    given = 0
    for test, each in zip(result.tests, result.identified, strict=True):
        *_, right, s = at_rest(arm, np.array(test.posture), loads_of(arm, test.load))
        poles = np.abs(np.asarray(s)) / (2 * np.pi)
        for frequency, label in zip(each.modes.frequency, each.labels.given, strict=True):
            given += label is not None
            assert label in (None, mode_labels(right)[int(np.argmin(abs(poles - frequency)))])
    assert given >= 20


def test_the_fit_recovers_table_1_within_its_joint_covariance(arm, manual):
    """Of the campaign as it is written, with its covariance beside it."""
    fit = ident.load(manual[0] / "hammer.modal.fit.json")
    assert not fit.doubts
    known = fit.fitted.information
    true = np.array([float(arm.get(name.split("=")[0])) for name in known.names])
    off = np.log(np.array([fit.parameters[name] for name in known.names]) / true)
    joint = off @ np.linalg.solve(known.covariance, off)
    assert joint < chi2.ppf(0.975, len(off)), "below also: the data are synthetic, and repeat exactly"


def test_a_campaign_in_memory_is_fitted_as_the_one_that_is_written(result, manual):
    fit = ident.fit(result.arm, result.campaign, ident.FitOptions(starts=1))
    written = ident.load(manual[0] / "hammer.modal.fit.json")
    assert dict(fit.parameters) == pytest.approx(dict(written.parameters), rel=1e-5)


def test_the_figures_and_the_table_have_each_mode(result):
    kinds = ("", "modes", "shapes")
    assert list(result.figures()) == [f"{kind}{number}" or "modal" for kind in kinds for number in ("", 2, 3, 4)]
    rows = result.table()
    assert len(rows) == sum(len(each.modes.frequency) for each in result.identified)
    assert rows[0]["label"] == "lateral torsion 1"
    assert "Rejected: alpha60_y.unv, hit 2: overload" in result.report(details=True)


def test_the_first_screen_has_a_line_for_each_mode_and_says_what_is_in_doubt(result):
    said = result.sections()
    (table,) = said.answer
    assert len(table.rows) == len(result.table())
    assert (said.verdict.word, said.verdict.kind) == ("GOOD", "good")
    assert (result.doubtful, result.short) == (False, False)
    unnamed = [row for row in result.table() if not row["label"]]
    assert sum(finding.text.startswith("no certain name") for finding in said.findings) == len(unnamed)
    assert_one_screen(result.report(), files=16, extra=len(table.rows))
    first, *others = result.identified
    short = replace(first, modes=replace(first.modes, converged=False))
    unfinished = replace(result, identified=(short, *others))
    assert unfinished.short
    assert unfinished.sections().verdict.word == "NOT CONVERGED"


def test_the_campaign_and_its_covariance_are_written_beside_each_other(result, tmp_path):
    names = [path.name for path in result.save(tmp_path)]
    assert names == ["hammer.modal.csv", "hammer.modal.covariance.csv", "hammer.modal.nc", "hammer.modal.json"]
    assert ident.read_campaign(tmp_path / names[0]) == result.campaign
    for each, (places, R) in zip(result.identified, result.campaign.correlated, strict=True):
        named = [i for i, label in enumerate(each.labels.given) if label is not None]
        at = [*named, *(len(each.labels.given) + i for i in named)]
        rows = [result.campaign.measurements[i] for i in places]
        sigma = np.array([row.sigma for row in rows])
        added = result.reproducibility.covariance([(row.kind, row.value) for row in rows])
        whole = each.modes.covariance[np.ix_(at, at)] + added
        np.testing.assert_allclose(R * np.outer(sigma, sigma), whole, rtol=1e-12)


def test_the_choice_of_modes_can_be_overruled(chosen, posture):
    (each,) = chosen.identified
    inside = each.modes.frequency[each.modes.frequency < 20]
    np.testing.assert_allclose(inside, (5.66, 5.77, 15.0), rtol=0.01)
    with pytest.raises(InputError, match="got posture 2, expected 1 to 1"):
        ident.modal_test(FOLDER, posture, FOLDER / "arm.toml", ident.ModalOptions(modes={"2": (5.0,)}))


def test_a_saved_result_is_the_same(chosen, result, manual, tmp_path):
    assert_comes_back(chosen, tmp_path)
    assert manual[1][0].startswith(result.report()), "the whole test, as it was printed when it was made"


def test_options_act_and_a_result_repeats(tmp_path):
    options = ident.ModalOptions(estimator="hv", band=(3.0, 20.0), window_end=1.0, no_modes=True)
    other = ident.modal_test(FOLDER, options=options)
    assert (other.identified, other.campaign) == ((), None)
    assert list(other.figures()) == ["modal", "2", "3", "4"]
    assert other.table() == []
    path = next(each for each in other.save(tmp_path) if each.suffix == ".json")
    assert ident.rerun(path).same
    assert {test.frf.decay for test in other.tests} == {0.0, 0.3}, "that of the analyser stays"
    assert all(3 <= test.frf.frequency[0] < 3.1 and 19.9 < test.frf.frequency[-1] <= 20 for test in other.tests)
    with pytest.raises(InputError, match="estimator"):
        ident.ModalOptions(estimator="h3")


def test_a_folder_without_table_or_arm(tmp_path):
    copy(FOLDER / "alpha00_z.unv", tmp_path)
    with pytest.raises(InputError, match=r"channels.csv: got no such file"):
        ident.modal_test(tmp_path)
    copy(FOLDER / "channels.csv", tmp_path)
    with pytest.raises(InputError, match=r"arm.toml: got no such file"):
        ident.modal_test(tmp_path)
    with pytest.raises(InputError) as caught:
        ident.modal_test(tmp_path, arm=FOLDER / "arm.toml")
    assert "got 'alpha30_z.unv', expected a file of the test" in str(caught.value)


def test_a_table_may_be_a_value(result, posture):
    (test,) = ident.modal_test(FOLDER, posture, FOLDER / "arm.toml", ident.ModalOptions(no_modes=True)).tests
    np.testing.assert_array_equal(test.frf.hits, result.tests[2].frf.hits)


def test_one_damping_ratio_in_all_modes_to_the_posterior(monkeypatch, tmp_path):
    """Recordings of an arm that loses 1 % in each mode, which its file does not say: C = 0.02 M (M^-1 H)^(1/2)."""
    made, of_the_file = generator(), generator()._matrices

    def matrices(*given):
        M, _, H, *maps = map(np.asarray, of_the_file(*given))
        L = np.linalg.cholesky(M)
        squared, shapes = np.linalg.eigh(np.linalg.solve(L, np.linalg.solve(L, H).T))
        return M, 0.02 * (L @ shapes * np.sqrt(squared)) @ (L @ shapes).T, H, *maps

    monkeypatch.setattr(made, "_matrices", matrices)
    # at 1 % the arm still rings at the end of a record: the analyser's window
    for name, value in {"ALPHA": (0, 60), "HITS": 3, "FAULTS": {}, "WINDOW": {0: 0.3, 60: 0.3}}.items():
        monkeypatch.setattr(made, name, value)
    made.main(tmp_path)
    modes = ident.modal_test(tmp_path)
    assert modes.sections().verdict.word == "GOOD"
    fit = ident.fit(modes.arm, modes.campaign)
    said, damping = fit.sections(), fit.fit.damping
    assert said.verdict.word.startswith("GOOD")
    assert not any("damping" in finding.text for finding in said.findings)
    assert "Damping: 1 % in all modes; it does not change with frequency." in fit.report()
    assert damping.predicted == pytest.approx(0.01, rel=0.02)
    assert fit.doubts == ()
    assert not damping.marked.any()
    for path, value in fit.parameters.items():
        assert value == pytest.approx(float(modes.arm.arm.get(path)), rel=0.01)
    sampled = ident.sample(modes.arm, modes.campaign, steps=500)
    assert sampled.sections().verdict.word.startswith("GOOD")
    for paths, drawn in sampled.sample.damping.items():
        assert np.median(drawn) == pytest.approx(0.02 if "loss" in paths[0] else 0.0, rel=0.1)
    sampled.save(tmp_path)
