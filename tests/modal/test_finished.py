"""Files of finished modes: from UFF 55 and CSV to a campaign, and what they must say."""

import numpy as np
import pytest
import pyuff
from arms import DATA
from conformance import agrees
from reports import assert_one_screen

import ident
from ident.description.file import read_arm
from ident.errors import InputError
from ident.identify.modal_analysis import modal_analysis
from ident.measure import read_campaign
from ident.studies.following import kept_in

POSTURE = tuple(np.radians([30.0, -60.0, 30.0]))
TABLE = """file,channel,role,point,direction,q1 [deg],q2 [deg],q3 [deg],load
modes.*,1:+X,response,tip,x,30,-60,30,
modes.*,1:+Y,response,tip,y,30,-60,30,
modes.*,1:+Z,response,tip,z,30,-60,30,
"""
SIGMA = {"frequency": 0.002, "damping_ratio": 0.05, "shape": 0.02}


@pytest.fixture(scope="module")
def known():
    return modal_analysis(read_arm(DATA / "lcd_arm" / "arm.toml").arm, POSTURE, modes=4)


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "channels.csv").write_text(TABLE)
    return tmp_path


def csv_file(folder, known, *, sigma=True, unit="Hz"):
    more = ",sigma frequency [Hz],sigma damping_ratio [%],sigma 1:+X,sigma 1:+Y,sigma 1:+Z" if sigma else ""
    lines = [f"frequency [{unit}],damping_ratio [%],1:+X,1:+Y,1:+Z{more}"]
    for i in range(4):
        moved = known.modes.motion[:, -1, i] * -3.0
        cells = [known.modes.frequency[i], 100 * known.damping_ratio[i], *moved]
        size = np.abs(moved).max()
        cells += [0.01, 0.02, *[0.02 * size] * 3] if sigma else []
        lines.append(",".join(f"{cell:.12g}" for cell in cells))
    (folder / "modes.csv").write_text("\n".join(lines) + "\n")


def uff_file(folder, known):
    sets = []
    for i in range(4):
        ratio, w = known.damping_ratio[i], 2 * np.pi * known.modes.frequency[i]
        moved = known.modes.motion[:, -1, i] * (1 + 1j)
        sets.append(
            pyuff.prepare_55(
                id1="a", id2="b", id3="c", id4="d", id5="e", model_type=1, analysis_type=3, data_ch=2, spec_data_type=8,
                data_type=5, load_case=0, mode_n=i + 1, eig=complex(-ratio * w, w * np.sqrt(1 - ratio**2)),
                modal_a=1 + 0j, modal_b=1 + 0j, node_nums=[1], r1=moved[:1], r2=moved[1:2], r3=moved[2:],
            )
        )  # fmt: skip
    pyuff.UFF(str(folder / "modes.unv")).write_sets(sets, mode="overwrite")


def modal(folder, **options):
    return ident.modal_test(folder, arm=DATA / "lcd_arm" / "arm.toml", options=ident.ModalOptions(**options))


def assert_named(labels, known):
    """Three modes have their names; in arms like this one the fourth may be called otherwise, and is in doubt."""
    assert [str(label) for label in labels.given[:3]] == [str(label) for label in known.labels[:3]]
    assert labels.given[3] is None
    assert labels.why[3].startswith(str(known.labels[3]))


def test_modes_of_a_csv_file_are_named_and_become_a_campaign(folder, known, tmp_path):
    csv_file(folder, known)
    result = modal(folder, frequency_is="pole", shapes=True)
    assert_named(result.named[0].labels, known)
    result.save(tmp_path / "out")
    campaign = read_campaign(next((tmp_path / "out").glob("*.modal.csv")))
    frequencies = [m for m in campaign if m.kind == "frequency"]
    assert [m.of for m in campaign if m.kind != "damping_ratio"] == ["pole"] * (3 + 6)
    np.testing.assert_allclose([m.value for m in frequencies], known.modes.frequency[:3], rtol=1e-10)
    np.testing.assert_allclose([m.sigma for m in frequencies], np.hypot(0.01, 0.002 * known.modes.frequency[:3]))
    shape = [m for m in campaign if m.kind == "shape" and m.mode == str(known.labels[1])]
    moved = known.modes.motion[:, -1, 1]
    for m in shape:
        expected = moved @ m.direction / (moved @ m.reference_direction)
        assert m.value == pytest.approx(expected, abs=1e-9)
        assert m.sigma == pytest.approx(0.02 * np.hypot(1, expected), rel=1e-3)
    assert "finished modes" in result.report().lower()
    assert result.sections().verdict.word == "NOT CHECKED"
    assert_one_screen(result.report())
    with kept_in(tmp_path / "out"):
        assert ident.load(next((tmp_path / "out").glob("*.modal.json"))).report() == result.report()


def test_repeated_files_of_a_posture_show_the_reproducibility(folder, known, tmp_path):
    """Three tests whose frequencies differ by 1 %: it is estimated, unless it is said; their rows agree in a fit."""
    csv_file(folder, known)
    for number, factor in ((2, 0.99), (3, 1.01)):
        lines = (folder / "modes.csv").read_text().splitlines()
        rows = [line.partition(",") for line in lines[1:]]
        text = [lines[0], *(f"{float(hertz) * factor},{rest}" for hertz, _, rest in rows)]
        (folder / f"modes.{number}.csv").write_text("\n".join(text) + "\n")
    result = modal(folder, frequency_is="pole")
    found = result.reproducibility
    within = np.mean([(0.01 / f) ** 2 for f in known.modes.frequency[:3]])
    scatter = 3 * (np.log([0.99, 1.0, 1.01]).var(ddof=1) - within) * 2
    assert found.share["frequency"] == pytest.approx(np.sqrt((4 * 0.002**2 + scatter) / (4 + 6)), rel=1e-3)
    assert found.freedom["frequency"] == 6
    assert "of each frequency (from repeated tests, 6 d.o.f.)" in " ".join(result.report(details=True).split())
    assert len(result.campaign.correlated) == 3, "each test has a common part of its own"
    said = modal(folder, frequency_is="pole", reproducibility={"frequency": 0.003})
    assert said.reproducibility.share["frequency"] == 0.003


def test_modes_of_a_universal_file_are_those_of_their_poles(folder, known):
    uff_file(folder, known)
    result = modal(folder, sigma=SIGMA)
    modes = result.named[0].modes
    assert modes.of == "pole"
    source = "pyuff, UFF 55"
    agrees(
        modes.frequency, known.modes.frequency, "formats", "frequencies of finished modes", source, rtol=1e-5, unit="Hz"
    )
    agrees(modes.damping, known.damping_ratio, "formats", "damping ratios of finished modes", source, rtol=1e-4)
    np.testing.assert_allclose(modes.sigma[0], 0.002 * modes.frequency)
    assert_named(result.named[0].labels, known)


@pytest.mark.parametrize("kind", SIGMA)
def test_missing_standard_deviations_are_asked_for_by_name(folder, known, kind):
    csv_file(folder, known, sigma=False)
    given = {name: value for name, value in SIGMA.items() if name != kind}
    with pytest.raises(InputError, match=f"{kind} without a standard deviation"):
        modal(folder, frequency_is="pole", sigma=given)


def test_what_frequencies_are_is_asked_for(folder, known):
    csv_file(folder, known)
    with pytest.raises(InputError, match="what they are of a damped mode"):
        modal(folder)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("frequency [Hz]", "frequency", "no unit"),
        ("sigma 1:+X", "sigma 1:+W", "a column of the file"),
        ("1:+Z", "2:+Z", "a channel of each mode"),
        ("\n4", "\n-4", "a frequency above 0"),
        ("\n4", "\nnan,4", "cells|columns"),
    ],
)
def test_what_is_no_file_of_modes_is_refused(folder, known, old, new, said):
    csv_file(folder, known)
    text = (folder / "modes.csv").read_text()
    assert old in text
    (folder / "modes.csv").write_text(text.replace(old, new))
    with pytest.raises(InputError, match=said):
        modal(folder, frequency_is="pole")


def test_a_table_of_modes_without_a_mode_is_refused(folder, known):
    csv_file(folder, known)
    head = (folder / "modes.csv").read_text().splitlines()[0]
    (folder / "modes.csv").write_text(head + "\n")
    with pytest.raises(InputError, match=r"modes.csv:1: got a header without a row, expected a row for each mode"):
        modal(folder, frequency_is="pole")


def test_a_sensitivity_has_no_meaning_there(folder, known):
    csv_file(folder, known)
    text = TABLE.replace("load", "sensitivity").replace("30,\n", "30,2\n")
    (folder / "channels.csv").write_text(text)
    with pytest.raises(InputError, match="a sensitivity"):
        modal(folder, frequency_is="pole")
