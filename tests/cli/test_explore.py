"""`ident explore`: the file that it leaves, and bad input."""

import pytest
from commands import ARM, files, posterior
from reports import assert_one_screen

import ident

pytestmark = pytest.mark.slow


def test_a_page_is_written_and_named(run, tmp_path):
    posterior(tmp_path / "draws.nc")
    code, out, err = run("explore", ARM, "--posterior=draws.nc", "--load=glass", "--posture=30,-60,30", "--out=pages")
    assert (code, err) == (0, "")
    assert files(tmp_path) == ["draws.nc", "pages/arm.explore.html"]
    assert "6 stiffnesses, mass of glass up to 14.6 kg, place on the stroke and speed" in out
    assert "Marks of 5 to 95 % at 2 stiffnesses" in out
    assert "wrote pages/arm.explore.html" in out
    assert_one_screen(out)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--posterior=none.nc"], "none.nc"),
        (["--fit=none.json"], "none.json"),
        (["--campaign=none.csv"], "none.csv"),
        (["--load=glas"], "glas"),
        (["--payload=glas"], "--payload: got 'glas', expected one of glass, tip; did you mean glass?"),
        (["--posture=1,2"], "--posture: got 2 joint angles, expected 3"),
        (["--posture=0,0,10"], "--posture"),
        (["--posture=1e9,0,0"], "--posture"),
        (["--speed=0"], "--speed"),
        (["--profile=scurve"], "did you mean s-curve"),
        (["--set=joint1.k_bend=-1"], "--set"),
    ],
)
def test_bad_input_is_one_line(run, tmp_path, options, words):
    code, out, err = run("explore", ARM, *options)
    assert (code, out) == (2, "")
    assert words in err
    assert err.count("\n") == 1
    assert files(tmp_path) == []


def test_a_posterior_of_another_arm_is_refused(run, tmp_path):
    import arviz
    import numpy as np

    other = arviz.from_dict(posterior={"shoulder.k_tors": np.ones((2, 10))})
    other.to_netcdf(str(tmp_path / "draws.nc"), engine="h5netcdf")
    code, out, err = run("explore", ARM, "--posterior=draws.nc")
    assert (code, out) == (2, "")
    assert "only shoulder.k_tors" in err
    assert err.count("\n") == 1


def test_a_campaign_of_another_arm_is_refused(run, tmp_path):
    (tmp_path / "two.csv").write_text("kind,q1 [deg],q2 [deg],value,unit,sigma\nfrequency,0,0,4,Hz,0.1\n")
    code, out, err = run("explore", ARM, "--campaign=two.csv")
    assert (code, out) == (2, "")
    assert "2 joint angles, expected 3" in err


def test_a_campaign_with_a_load_that_the_arm_has_not_is_refused_with_its_row(run, tmp_path):
    row = "frequency,0,0,0,glas,4,Hz,0.1"
    (tmp_path / "c.csv").write_text(f"kind,q1 [deg],q2 [deg],q3 [deg],load,value,unit,sigma\n{row}\n")
    code, out, err = run("explore", ARM, "--campaign=c.csv")
    assert (code, out) == (2, "")
    assert err == "ident: c.csv:2, load: got 'glas', expected one of glass; did you mean glass?\n"
    assert files(tmp_path) == ["c.csv"]


def test_an_arm_that_collapses_has_no_page(run, tmp_path):
    code, out, err = run("explore", ARM, *(f"--set=joint{j}.k_bend=1" for j in (1, 2, 3)))
    assert (code, out) == (1, "")
    assert "no stable equilibrium" in err
    assert files(tmp_path) == []


def test_the_same_arm_gives_the_same_page(tmp_path):
    pages = [ident.explore(ARM).page() for _ in range(2)]
    assert pages[0] == pages[1]
