"""From a recording without force to a campaign by the same door as a hammer test, and what is refused."""

import numpy as np
import pytest
from ambient_records import shaken, write_folder
from reports import assert_one_screen
from results import assert_comes_back

import ident
from ident.errors import InputError

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def values():
    arm = shaken(600.0)
    return arm, arm.record(np.random.default_rng(21), [(8.0, 0.4)])


@pytest.fixture(scope="module")
def folder(values, tmp_path_factory):
    return write_folder(tmp_path_factory.mktemp("shop"), values[1], speeds="8.02 Hz @ pulley 1 + 1450 rpm @ pump")


@pytest.fixture(scope="module")
def result(folder):
    return ident.modal_test(folder)


def test_modes_have_the_names_that_the_arm_gives_them(values, result):
    """By shapes alone: vertical bending 1 and lateral torsion 1 are 2 % apart."""
    arm, _ = values
    (found,) = result.identified
    named = {str(label): f for label, f in zip(found.labels.given, found.modes.frequency, strict=True) if label}
    for label, k in (("lateral torsion 1", 0), ("vertical bending 1", 1), ("vertical bending 2", 3)):
        assert named[label] == pytest.approx(arm.frequency[k], rel=0.01)
    rows = result.campaign.measurements
    assert {row.kind for row in rows} == {"frequency", "damping_ratio"}
    assert all(row.of == "pole" for row in rows if row.kind == "frequency")
    (places, R), *_ = result.campaign.correlated
    assert len(places) == len(rows)
    assert np.linalg.eigvalsh(np.array(R)).min() > 0


def test_the_report_names_harmonics_and_what_shapes_are(result):
    text = result.report(details=True)
    assert "Ambient test at 1 posture: 599 s of responses without a force" in text
    assert "Shapes are not scaled" in text
    assert "Harmonic, not a mode: pulley 1 at 8 Hz" in text
    assert "no line of pump at 24.17 Hz or its multiples is seen" in text
    assert result.sections().verdict.word == ("DOUBTFUL" if result.doubtful else "GOOD")
    assert_one_screen(result.report())
    assert (result.hits, result.rejected) == (0, ())


def test_figures_files_and_a_saved_result(result, tmp_path):
    assert list(result.figures()) == ["modal", "modes", "shapes"]
    written = result.save(tmp_path)
    assert [path.name for path in written][:2] == [f"{result.name}.csv", f"{result.name}.covariance.csv"]
    assert ident.read_campaign(written[0]) == result.campaign
    assert_comes_back(result, tmp_path)
    assert len(result.table()) == len(result.identified[0].modes.frequency)


def test_references_and_modes_can_be_chosen(folder, values, tmp_path):
    roles = ("reference", "reference", "reference", "response", "response", "response")
    other = write_folder(tmp_path, values[1], roles=roles)
    options = ident.ModalOptions(modes={"1": (5.66, 5.77)}, band=(2.0, 20.0))
    result = ident.modal_test(other, options=options)
    assert result.tests[0].references == (0, 1, 2)
    np.testing.assert_allclose(result.identified[0].modes.frequency, (5.66, 5.77), rtol=0.01)
    assert result.tests[0].band == (2.0, 20.0)


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("8.02 Hz @ pulley 1", "8.02 @ pulley 1", "harmonics: got '8.02 @ pulley 1', expected terms joined by"),
        ("8.02 Hz", "8.02 kg", "harmonics: got"),
        ("8.02 Hz", "0 Hz", "expected a speed above 0"),
        (",response,tip,y", ",force,tip,y", "unit: got 'm/s^2' of channel 'tip y'"),
    ],
)
def test_a_wrong_table_is_refused_in_one_line(folder, tmp_path, old, new, line):
    text = (folder / "channels.csv").read_text()
    assert old in text
    table = tmp_path / "channels.csv"
    table.write_text(text.replace(old, new))
    with pytest.raises(InputError) as caught:
        ident.modal_test(folder, table)
    assert line in str(caught.value)


def test_a_reference_beside_a_force_is_refused(folder, tmp_path):
    text = (folder / "channels.csv").read_text()
    rows = text.replace(",response,tip,x,body,m/s^2", ",force,tip,x,body,N").replace(
        ",response,tip,y", ",reference,tip,y"
    )
    (tmp_path / "channels.csv").write_text(rows)
    with pytest.raises(InputError, match="got a reference in a test with force, expected responses to the force"):
        ident.modal_test(folder, tmp_path / "channels.csv")


def test_a_dead_channel_and_a_record_that_is_too_short_are_refused(values, tmp_path):
    still = values[1].copy()
    still[2] = 0.0
    with pytest.raises(InputError, match=r"got 'tip z' of 'ambient\.h5' without any motion"):
        ident.modal_test(write_folder(tmp_path, still))
    with pytest.raises(InputError, match="got 10 s of responses without a force, expected at least 40 s"):
        ident.modal_test(write_folder(tmp_path, values[1][:, :1000]))
