"""`ident show` of an arm: numbers that look wrong, every number, a picture; its names, each of which is taken."""

import json

import pytest
from arms import lcd_arm
from commands import ARM, files
from reports import assert_one_screen

from ident.arm.modes import parse_label
from ident.measure import DEFINITIONS, DRIVE_STATES, KINDS, Load
from ident.measure.kinds import RAMPS
from ident.studies.look.show import choices
from ident.vibrate.motion import PROFILES
from ident.vibrate.spectra import WINDOWS


def test_an_arm_is_described_and_drawn(run, tmp_path):
    code, out, err = run("show", ARM)
    assert (code, err) == (0, "")
    assert files(tmp_path) == ["out/arm.show.modes.svg", "out/arm.show.png"]
    for text in ("RESULT: PLAUSIBLE", "138.8 kg", "reach 4.8 m", "4.12", "wrote out/arm.show.png"):
        assert text in out
    assert_one_screen(out)
    _, out, _ = run("show", ARM, "--no-figure", "--details")
    row = next(line for line in out.splitlines() if line.startswith("  link2.mass "))
    assert row.split() == ["link2.mass", "36.395", "kg", "calibrated"]


def test_numbers_that_look_wrong_are_counted_and_named(run, tmp_path):
    wrong = tmp_path / "wrong.toml"
    wrong.write_text(ARM.read_text().replace('[0.5, 0, 0.06], unit = "m"', '[2.5, 0, 0.06], unit = "m"', 1))
    code, out, _ = run("show", wrong, "--no-figure", "--posture=30,-60,30")
    assert code == 0
    assert "at (30, -60, 30) deg" in out
    assert_one_screen(out)
    assert "RESULT: 1 NUMBER LOOKS WRONG." in out
    line = next(n for n, words in enumerate(wrong.read_text().splitlines(), 1) if "[2.5, 0, 0.06]" in words)
    assert f"1. line {line}, link1.com: (2.5, 0, 0.06) m, 1.48 m beyond the ends" in out
    assert files(tmp_path) == ["wrong.toml"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((ARM, "--posture=1,2"), "--posture: got (1.0, 2.0), expected 3 angles"),
        ((ARM, "--posture=a"), "--posture a: got 'a'"),
        ((ARM.parent / "table1.csv",), "got a table, expected an arm description"),
        (("none.toml",), "none.toml: got no such file"),
        (("robot.urdf",), "got root links: none"),
        (("result.json", "--posture=1"), "--posture: got it for a result"),
        (("result.json", "--names"), "--names: got it for a result"),
        ((ARM, "--names", "--posture=0,0,0"), "--posture: got it with --names"),
        ((ARM.parent / "table1.csv", "--names"), "got a table, expected an arm description"),
        (("none.toml", "--names"), "none.toml: got no such file"),
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


@pytest.fixture
def listed(run):
    code, out, err = run("show", ARM, "--names", "--json", "--quiet")
    assert (code, err) == (0, "")
    return json.loads(out)


def test_every_number_is_one_of_the_arm_with_its_value(listed):
    numbers = {each["path"]: each for each in listed["numbers"]}
    assert tuple(numbers) == lcd_arm().paths()
    for path, each in numbers.items():
        assert each["value"] == float(lcd_arm().get(path))
    assert numbers["joint1.k_bend"]["origin"] == "paper"
    assert numbers["joint1.k_bend"]["unit"] == "N m/rad"


def test_what_is_listed_is_taken(run, listed):
    every = [f"--set={each['path']}={each['value']!r}" for each in listed["numbers"]]
    load = " + ".join([*listed["loads"], f"5 kg @ {listed['points'][-1]}"])
    assert str(Load.parse(load))
    _, out, _ = run("predict", ARM, f"--load={load}", "--json")
    code, again, _ = run("predict", ARM, f"--load={load}", "--json", *every)
    assert code == 0
    one, other = (json.loads(text)["table"] for text in (out, again))
    assert one == other
    assert all(parse_label(each["mode"]) for each in listed["modes"])
    assert [each["mode"] for each in listed["modes"][:2]] == ["lateral torsion 1", "vertical bending 1"]
    assert set(listed["kinds"]) == set(KINDS)
    assert listed["choices"] == {flag: list(words) for flag, words in choices().items()}
    assert "both" in choices()["simulate --method"]


def test_the_list_for_people_names_the_same(run, listed, tmp_path):
    code, out, err = run("show", ARM, "--names", "--details")
    assert (code, err, files(tmp_path)) == (0, "", [])
    words = set(out.split())
    assert {each["path"] for each in listed["numbers"]} <= words
    assert {"tip", "glass", "deflection_difference", "simulate", "fast,", "cycloid,", "brake,", "servo"} <= words


def test_names_in_short_fit_one_screen(run):
    _, out, _ = run("show", ARM, "--names")
    assert_one_screen(out)
    assert "joint1, joint2, joint3: offset.x/y/z, k_bend, k_tors, tau_bend, tau_tors" in out


def test_words_that_options_choose_from_are_those_that_are_taken(listed):
    assert set(listed["choices"]["explore --profile"]) == set(PROFILES)
    assert listed["choices"]["simulate --profile"] == listed["choices"]["explore --profile"]
    assert set(listed["choices"]["spectrum --window"]) == set(WINDOWS)
    assert listed["columns"] == {"of": list(DEFINITIONS), "drives": list(DRIVE_STATES), "ramp": list(RAMPS)}
