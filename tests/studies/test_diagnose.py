"""`ident.diagnose` from Python: its stages, that it comes back, and that an interrupted one goes on."""

import shutil
from dataclasses import replace
from html import escape
from pathlib import Path

import numpy as np
import pytest
from arms import DATA
from commands import files
from diagnose_small import CAMPAIGN, OPTIONS, SMALL
from reports import assert_one_screen, too_wide
from results import assert_comes_back, assert_plain, contents

import ident
from ident.errors import Problem
from ident.identify.validate import validate_fit
from ident.report.page import render
from ident.studies.basis import assumed
from ident.studies.cure.diagnose import DiagnoseOptions, DiagnoseResult, diagnose, discard_stages
from ident.studies.cure.diagnosis import ResonanceAssessment, stages_of
from ident.studies.handout import page_of
from ident.vibrate.binomial import BinomialEstimate

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]
STAGES = stages_of(runs=False)
ARM = ident.read_arm(DATA / "lcd_arm" / "arm.toml")
MEASURED = ident.read_campaign(CAMPAIGN)
TESTED = "the model is not tested there"


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory):
    """A diagnosis, and the folder of what it kept: in the end, behind the third stage and behind the fifth."""
    folder = tmp_path_factory.mktemp("diagnose")

    def copy(report):
        if report.number in (3, 5):
            shutil.copytree(folder / "whole", folder / str(report.number))

    return diagnose(ARM, MEASURED, OPTIONS, folder=folder / "whole", on_stage=copy), folder


@pytest.fixture(scope="module")
def result(diagnosed):
    return diagnosed[0]


@pytest.fixture(scope="module")
def page(result):
    return render(page_of(result))


def with_stages(result, **values):
    return DiagnoseResult(replace(result.diagnosis, **values), result.options)


def accepted(result):
    """The same arm where the limit is far away: no remedy is sought."""
    vibration = replace(result.diagnosis.vibration, limit=1.0, keeps=BinomialEstimate(10, 10))
    return with_stages(result, vibration=vibration, remedies=(), verifications=())


def test_each_stage_is_a_value(result):
    diagnosis = result.diagnosis
    assert diagnosis.stages == STAGES
    draws = diagnosis.task.basis.draws
    assert {len(values) for values in draws.values()} == {SMALL.draws}
    assert diagnosis.task.basis.arm.get("joint1.k_tors") == pytest.approx(float(np.median(draws["joint1.k_tors"])))
    assert {len(values) for values in diagnosis.task.fresh_draws.values()} == {20}
    assert diagnosis.resonance.branches.batch_size == SMALL.band_draws
    assert diagnosis.vibration.draws.shape == (3, SMALL.assessment_draws)
    assert diagnosis.verifications[0].keeps.draws in (19, 20), "fewer where the first ones settle it"
    assert result.verdict == diagnosis.verdict != "accept"
    assert result.advised in diagnosis.remedies


def test_the_report_is_one_screen_with_a_section_for_every_stage_in_its_details(result):
    report = result.sections()
    assert len(report.details) == len(STAGES) + 1, "and what is assumed"
    assert report.verdict.word == "NOT OK"
    assert [part.partition(":")[0] for part in report.answer][:2] == ["Cause", "Remedy"]
    assert_one_screen(result.report(), files=3)
    assert not too_wide(result.report(details=True))


def test_a_caution_counts_the_assumed_numbers_that_are_not_drawn(result):
    basis = result.diagnosis.task.basis
    count = len(set(assumed(basis)[0]) - set(basis.unknown.phases))
    assert any(finding.text.startswith(f"{count} numbers of drives") for finding in result.sections().findings)


def test_it_comes_back_as_it_was(result, tmp_path):
    paths = result.save(tmp_path)
    assert files(tmp_path) == [f"campaign.diagnose.{end}" for end in ("json", "nc")]
    assert [path.name for path in paths] == files(tmp_path)
    saved = assert_comes_back(result, tmp_path)
    assert saved.verdict == result.verdict
    assert saved.fitted.parameters == result.fitted.parameters


def test_its_posterior_is_one_for_other_studies(result, tmp_path):
    from ident.studies.values import drawn_values

    result.save(tmp_path)
    drawn = drawn_values(tmp_path / "campaign.diagnose.nc", ARM.arm, SMALL.draws, result.options.seed)
    basis = result.diagnosis.task.basis
    used = {path: values for path, values in basis.draws.items() if path not in basis.unknown.phases}
    assert len(basis.unknown.phases) == len(ARM.arm.drives)
    assert set(drawn.values) == set(used)
    for path, values in drawn.values.items():
        np.testing.assert_array_equal(np.sort(values), np.sort(used[path]))


def test_its_table_has_a_row_for_each_remedy(result):
    rows = result.table()
    assert [row["rank"] for row in rows] == list(range(1, len(result.diagnosis.remedies) + 1))
    assert [row["meets_limit"] for row in rows] == [remedy.meets_limit for remedy in result.diagnosis.remedies]
    assert rows[0]["verified"] == result.diagnosis.verifications[0].holds
    assert_plain([{**row, "verified": ""} for row in rows])


def test_its_page_has_every_stage(result, page):
    assert page.startswith("<!DOCTYPE html>")
    titles = ["Answer", *(section.title for section in result.sections().details)]
    assert all(f"<h2>{number}. {escape(title)}</h2>" in page for number, title in enumerate(titles, 1))
    assert page.count("<figure>") == len(result.figures()) == 6
    assert result.advice in page
    assert "<dt>Cause</dt>" in page
    assert "<dt>Remedy</dt>" in page
    assert str(DATA) not in page


def test_a_limit_that_is_kept_needs_no_remedy(result):
    fine = accepted(result)
    assert fine.verdict == "accept"
    assert fine.advised is None
    assert (fine.table(), fine.advice) == ([], "")
    report = fine.sections()
    assert (report.verdict.word, len(report.details)) == ("OK", 6)
    assert "is within the limit of 1000 mm" in report.verdict.reason
    assert [part.partition(":")[0] for part in report.answer] == ["Cause"]
    assert 'class="verdict good"' in render(page_of(fine))
    assert "verification" not in fine.figures()


def test_it_says_how_far_to_trust_postures_that_were_not_measured(result):
    """As `ident validate` would of its fit; how right that is, is tested in `tests/identify/test_validate.py`."""
    own, ours = (
        {scope.kind: scope.half for scope in each.scopes}
        for each in (validate_fit(result.diagnosis.identification.sampled.fitted), result.diagnosis.validation)
    )
    assert ours == pytest.approx(own, rel=1e-6)
    report = result.sections()
    assert f"within {100 * ours['frequency']:.2g} % in frequency" in report.remark
    beyond = "The motion turns joint1 62 deg, joint2 124 deg, joint3 62 deg beyond all measured postures."
    assert beyond in report.details[1].parts
    worst = "the motion turns joint2 124 deg (and 2 other joints less) beyond all measured postures"
    assert any(finding.text.startswith(worst) for finding in report.findings)


def test_without_other_postures_nothing_is_predicted_and_a_motion_within_them_is_no_caution(result):
    untold = with_stages(result, trust=())
    assert "No posture can be predicted from others" in untold.report(details=True)
    assert "trust" not in untold.figures()
    assert TESTED in render(page_of(untold))
    first, *rest = MEASURED
    folded = replace(first, posture=tuple(np.radians([142.0, -284.0, 142.0])))
    identification = result.diagnosis.identification
    fitted = replace(identification.sampled.fitted, campaign=replace(MEASURED, measurements=(folded, *rest)))
    narrow = replace(identification, sampled=replace(identification.sampled, fitted=fitted))
    assert TESTED not in render(page_of(with_stages(result, identification=narrow)))


def test_where_nothing_turns_there_is_no_chart_of_resonance(result, page):
    undriven = with_stages(result, resonance=ResonanceAssessment())
    assert "resonance" not in undriven.figures()
    assert any("no [[drive]]" in part for part in undriven.sections().details[2].parts)
    assert render(page_of(undriven)).count("<figure>") == page.count("<figure>") - 1


def items(folder):
    """What is kept of each stage, by its name."""
    return {file.stem: file.read_bytes() for file in folder.glob("*.item")}


def going_on(folder, stop_behind):
    """Go on in a folder up to a stage; return what was reported."""
    reports = []

    def stop(report):
        reports.append((report.number, report.resumed))
        if report.number == stop_behind:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        diagnose(ARM, MEASURED, OPTIONS, folder=folder, on_stage=stop)
    return reports


def test_an_interrupted_one_goes_on_and_comes_to_the_same(diagnosed, tmp_path):
    """From what lay there behind the third stage and behind the fifth, all that follows but the fifth is the same."""
    result, behind = diagnosed
    part = Path(shutil.copytree(behind / "3", tmp_path / "part"))
    assert going_on(part, 3) == [(number, True) for number in (1, 2, 3)]
    assert going_on(part, 4) == [*((number, True) for number in (1, 2, 3)), (4, False)]
    assert items(part) == {name: kept for name, kept in items(behind / "whole").items() if name in STAGES[:4]}
    shutil.copytree(behind / "5", part, dirs_exist_ok=True)
    reports = []
    resumed = diagnose(ARM, MEASURED, OPTIONS, folder=part, on_stage=reports.append)
    assert [(report.number, report.resumed) for report in reports] == [(i, i < 6) for i in range(1, 8)]
    assert items(part) == items(behind / "whole")
    assert resumed.sections() == result.sections()
    np.testing.assert_equal(resumed.table(), result.table())
    for one, other in zip(resumed.diagnosis.remedies, result.diagnosis.remedies, strict=True):
        assert one.values == other.values
    first = [contents(path) for path in resumed.save(tmp_path / "saved")]  # the same folder, which Next: names
    np.testing.assert_equal(first, [contents(path) for path in result.save(tmp_path / "saved")])
    discard_stages(part)
    assert not part.exists()


@pytest.mark.parametrize("good", [False, True], ids=["not accepted", "accepted"])
def test_without_a_folder_nothing_is_kept(result, good, tmp_path, monkeypatch):
    """With stages that are known already in the place of what computes them."""
    expected, reports = accepted(result) if good else result, []
    known = expected.diagnosis
    for computes, value in {
        "ident.studies.cure.diagnose._identified": known.identification,
        "ident.studies.cure.diagnosis.assess_trust": known.trust,
        "ident.studies.cure.diagnosis.assess_resonance": known.resonance,
        "ident.studies.cure.remedies.assess_vibration": known.vibration,
        "ident.vibrate.sweep.sensitivities": known.sensitivities,
        "ident.studies.cure.cures.cures": known.remedies,
        "ident.studies.cure.remedies.verify_in_turn": known.verifications,
    }.items():
        monkeypatch.setattr(computes, lambda *_, value=value: value)
    monkeypatch.chdir(tmp_path)
    assert diagnose(ARM, MEASURED, OPTIONS, on_stage=reports.append).sections() == expected.sections()
    counts = (7, 7, 7, 5, 5) if good else (7,) * 7
    assert [(each.number, each.count, each.name) for each in reports] == list(
        zip(range(1, 8), counts, STAGES, strict=False)
    )
    assert not list(tmp_path.iterdir())


def test_stages_of_other_inputs_are_refused_and_can_be_thrown_away(tmp_path, monkeypatch):
    def stopped(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("ident.identify.sample.sample_campaign", stopped)
    with pytest.raises(KeyboardInterrupt):
        diagnose(ARM, MEASURED, OPTIONS, folder=tmp_path / "part")
    other = replace(OPTIONS, limit=7.0)
    with pytest.raises(ident.InputError, match=r"another set of options.*`restart`"):
        diagnose(ARM, MEASURED, other, folder=tmp_path / "part")
    fewer = replace(MEASURED, measurements=MEASURED.measurements[1:])
    with pytest.raises(ident.InputError, match="another campaign"):
        diagnose(ARM, fewer, OPTIONS, folder=tmp_path / "part")
    stiffer = replace(ARM, arm=ARM.arm.replace({"joint1.k_bend": 1e6}))
    with pytest.raises(ident.InputError, match="another arm file"):
        diagnose(stiffer, MEASURED, OPTIONS, folder=tmp_path / "part")
    with pytest.raises(KeyboardInterrupt):
        diagnose(ARM, MEASURED, other, folder=tmp_path / "part", restart=True)


def test_with_other_runs_a_diagnosis_goes_on_behind_the_stiffnesses(tmp_path, monkeypatch):
    """Where its runs are refused, which only the search for what excites the arm tells."""
    taken = []

    def refused(job, store, on_stage):
        taken.append(store.read("stiffness"))
        store.write("stiffness", 1)
        raise ident.InputError([Problem("run7.csv", "a clock", "another", "check it")])

    monkeypatch.setattr("ident.studies.cure.diagnose.carry_out", refused)
    runs = shutil.copytree(DATA / "lcd_arm" / "runs", tmp_path / "runs") / "runs.csv"
    for _ in range(2):
        with pytest.raises(ident.InputError, match="run7"):
            diagnose(ARM, MEASURED, OPTIONS, runs=runs, folder=tmp_path / "part")
        runs.write_text("\n".join(line for line in runs.read_text().splitlines() if "run7" not in line) + "\n")
    assert taken == [None, 1]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"limit": 0.0}, "limit: got 0"),
        ({"limit": float("inf")}, "limit: got inf"),
        ({"starts": 0}, "starts: got 0"),
        ({"set": {"link2.mass": -1.0}}, "set: got link2.mass=-1"),
    ],
)
def test_options_are_checked_when_they_are_made(options, words):
    with pytest.raises(ident.InputError, match=words):
        DiagnoseOptions(**options)


def test_what_does_not_fit_is_refused_before_anything_is_computed(tmp_path):
    for options in (DiagnoseOptions(smoothing=1.0), DiagnoseOptions(load="glas"), DiagnoseOptions(fix=("joint1.k",))):
        with pytest.raises(ident.InputError):
            diagnose(ARM, MEASURED, options, folder=tmp_path / "part")
        assert not (tmp_path / "part").exists()


def test_what_is_left_after_the_dwell_is_judged_by_the_exact_equations():
    """The vibration after the dwell is that of `simulate`, which says too that the end settles later."""
    limit, dwell = 0.05, OPTIONS.dwell
    result = diagnose(ARM, MEASURED, replace(OPTIONS, limit=None, settled=limit))
    vibration, basis = result.diagnosis.vibration, result.diagnosis.task.basis
    assert (vibration.measure, vibration.limit) == ("settled", pytest.approx(1e-3 * limit))
    held = float(basis.motion.breaks[-1] - basis.motion.arrival)
    moved = ident.simulate(
        basis.arm, speed=basis.percent, dwell=held, method="exact", phases="file", rate=250.0, settled=limit
    )
    late = np.abs(moved.vibration[:, moved.time >= moved.arrival + dwell - 1e-9]).max(1)
    np.testing.assert_allclose(vibration.peak, late, rtol=0.02, atol=1e-7)
    assert max(row["settled"] for row in moved.table()) > moved.arrival + dwell, "so it is not settled in time"
    assert not vibration.accepted
    assert result.verdict == "reject"
    report = result.sections()
    assert report.verdict.word == "NOT OK"
    assert f"exceeds the limit of {limit} mm for what is left after the dwell" in report.verdict.reason
    assert f"--settled {limit}" in report.next
