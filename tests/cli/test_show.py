"""`ident show` of an arm: what looks odd, every number, a picture."""

import pytest
from commands import ARM, files


def test_an_arm_is_described_and_drawn(run, tmp_path):
    code, out, err = run("show", ARM)
    assert (code, err) == (0, "")
    assert files(tmp_path) == ["out/arm.show.modes.svg", "out/arm.show.png"]
    for text in ("Nothing looks odd", "138.8 kg", "reach when stretched 4.8 m", "4.12 Hz", "wrote out/arm.show.png"):
        assert text in out
    row = next(line for line in out.splitlines() if line.startswith("  link2.mass "))
    assert row.split() == ["link2.mass", "36.395", "kg", "calibrated"]


def test_what_looks_odd_is_said_first(run, tmp_path):
    wrong = tmp_path / "wrong.toml"
    wrong.write_text(ARM.read_text().replace('[0.5, 0, 0.06], unit = "m"', '[2.5, 0, 0.06], unit = "m"', 1))
    code, out, _ = run("show", wrong, "--no-figure", "--posture=30,-60,30")
    assert code == 0
    assert "at (30, -60, 30) deg" in out
    assert out.index("WARNING: link1.com: (2.5, 0, 0.06) m, 1.48 m beyond the ends") < out.index("Numbers")
    assert files(tmp_path) == ["wrong.toml"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((ARM, "--posture=1,2"), "--posture: got (1.0, 2.0), expected 3 angles"),
        ((ARM, "--posture=a"), "--posture a: got 'a'"),
        ((ARM.parent / "table1.csv",), "got a table, expected an arm description"),
        (("none.toml",), "none.toml: got no such file"),
        (("robot.urdf",), "got root links: none"),
        (("result.json", "--posture=1"), "--posture: got a posture for a result"),
    ],
)
def test_what_is_no_arm_is_one_line(run, tmp_path, arguments, words):
    (tmp_path / "robot.urdf").write_text("<robot name='r'/>")
    before = files(tmp_path)
    code, out, err = run("show", *arguments)
    assert (code, out) == (2, "")
    assert words in err
    assert len(err.splitlines()) == 1
    assert files(tmp_path) == before
