"""`ident list`: every name that it gives is taken."""

import json

import pytest
from arms import DATA, lcd_arm
from commands import ARM, files

from ident.arm.labels import parse_label
from ident.measure import DEFINITIONS, DRIVE_STATES, KINDS, Load
from ident.studies.names import choices
from ident.vibrate.motion.stroke import PROFILES
from ident.vibrate.signal.windows import WINDOWS


@pytest.fixture
def listed(run):
    code, out, err = run("list", ARM, "--json", "--quiet")
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
    code, out, err = run("list", ARM)
    assert (code, err, files(tmp_path)) == (0, "", [])
    words = set(out.split())
    assert {each["path"] for each in listed["numbers"]} <= words
    assert {"tip", "glass", "deflection_difference", "simulate", "fast,", "cycloid", "servo,"} <= words


def test_words_that_options_choose_from_are_those_that_are_taken(listed):
    assert set(listed["choices"]["explore --profile"]) == set(PROFILES)
    assert listed["choices"]["simulate --profile"] == listed["choices"]["explore --profile"]
    assert set(listed["choices"]["spectrum --window"]) == set(WINDOWS)
    assert listed["columns"] == {"of": list(DEFINITIONS), "drives": list(DRIVE_STATES)}


def test_a_table_is_no_arm(run):
    code, out, err = run("list", DATA / "lcd_arm" / "table1.csv")
    assert (code, out) == (2, "")
    assert "expected an arm description" in err
