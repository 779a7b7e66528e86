"""Options of studies: ranges, choices, what goes together, and the flags that the command line makes of them."""

import math
from dataclasses import dataclass

import numpy as np
import pytest
from arms import lcd_arm

import ident
from ident.errors import InputError, Problem
from ident.studies import reading
from ident.studies.check import CheckOptions
from ident.studies.fit import FitOptions
from ident.studies.options import Options, flag_of, option, renamed, specs
from ident.studies.predict import PredictOptions
from ident.studies.profile import ProfileOptions
from ident.vibrate.motion.motion import FASTEST


@dataclass(frozen=True, kw_only=True)
class Drawn(Options):
    count: int = option(3, "how many", low=1)
    step_size: float = option(0.5, "how far [mm]", above=0.0, flag="--by", argument="step")
    shape: str | None = option(None, "which", choices=("round", "square"))
    width: dict[str, float] = option({}, "widths", repeated=True, read=reading.widths)
    unseen: int = 0

    def problems(self):
        return [Problem("count", "4", "no 4", "drop `shape`")] if self.count == 4 and self.shape else []


def refusal(**values):
    with pytest.raises(InputError) as error:
        Drawn(**values)
    return str(error.value)


@pytest.mark.parametrize("speed", [0.0, -1.0, 1000.5, math.nan, math.inf])
def test_a_speed_is_refused_by_the_name_of_its_option(speed):
    with pytest.raises(InputError, match=rf"^speed: got {speed:g}, expected a number above 0, at most 1000; "):
        ident.ResonanceOptions(speed=speed)
    assert ident.ResonanceOptions(speed=FASTEST).speed == 1000, "as fast as a motion may be"


def test_defaults_are_fine_and_nobodys_dict_is_shared():
    assert Drawn() == Drawn(count=3, step_size=0.5, shape=None, width={})
    assert Drawn().width is not Drawn().width


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"count": 0}, "count: got 0, expected a number from 1; correct it"),
        ({"count": math.inf}, "count: got inf, expected a whole number; correct it"),
        ({"step_size": 0.0}, "step_size: got 0, expected a number above 0; correct it"),
        ({"step_size": math.nan}, "step_size: got nan, expected a number above 0; correct it"),
        ({"shape": "oval"}, "shape: got 'oval', expected one of round, square; correct it"),
        ({"count": 4, "shape": "round"}, "count: got 4, expected no 4; drop `shape`"),
    ],
)
def test_what_is_out_of_range_is_refused(values, words):
    assert refusal(**values) == words


def test_everything_that_is_wrong_is_said_at_once():
    assert len(refusal(count=0, step_size=-1.0, shape="oval").splitlines()) == 3


def test_all_options_are_recorded_by_name():
    assert Drawn(shape="round").recorded() == {"count": 3, "step_size": 0.5, "shape": "round", "width": {}}


def test_flags_follow_from_names():
    assert [flag_of(each) for each, _ in specs(Drawn)] == ["--count", "--by", "--shape", "--width"]


@pytest.mark.parametrize(
    ("problem", "words"),
    [
        (Problem("step_size", "-1", "more", "correct it"), "--by: got -1, expected more; correct it"),
        (Problem("", "-1", "more", "correct it", "step"), "--by: got -1, expected more; correct it"),
        (Problem("a.csv:3", "-1", "more", "correct it", "value"), "a.csv:3, value: got -1, expected more; correct it"),
        (Problem("a", "`step_size`", "`shape`", "give `path`"), "a: got --by, expected --shape; give --path"),
        (Problem("a", "-1", "more", "as `ident fit`, `other`"), "a: got -1, expected more; as `ident fit`, `other`"),
    ],
)
def test_complaints_name_the_flags(problem, words):
    assert str(renamed(Drawn, problem)) == words


def test_help_offers_no_flag_that_is_refused(run):
    code, out, _ = run("fleet", "--help")
    assert code == 0
    assert "--workers" in out
    assert not [flag for flag in ("--uncertain", "--robust", "--no-explain") if f"{flag} " in out]
    code, out, err = run("fleet", "nowhere", "--robust=t")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "--robust: got it, expected no --robust in this study; leave it out; `ident fit` takes it" in err


@pytest.mark.parametrize("kind", [CheckOptions, FitOptions, PredictOptions, ProfileOptions])
def test_every_option_has_help_and_a_default_in_its_range(kind):
    made = kind()
    flags = [flag_of(each) for each, _ in specs(kind)]
    assert len(set(flags)) == len(flags) > 3
    for each, spec in specs(kind):
        assert spec.help
        assert not spec.problem(getattr(made, each.name))
        if spec.repeated:
            assert spec.read, "what is repeated is read from several texts"


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: ident.FitOptions(starts="4"), "starts: got '4', expected a whole number"),
        (lambda: ident.FitOptions(starts=2.5), "starts: got 2.5, expected a whole number"),
        (
            lambda: ident.FitOptions(fix="joint1.k_bend"),
            r"fix: got 'joint1.k_bend', expected several",
        ),
        (lambda: ident.ResonanceOptions(margin="10"), "margin: got '10', expected a number"),
        (lambda: ident.SimulateOptions(retract=1), "retract: got 1, expected True or False"),
        (lambda: ident.SimulateOptions(speed=True), "speed: got True, expected a number"),
        (lambda: ident.FitOptions.of(ident.CheckOptions()), r"got a CheckOptions, expected FitOptions\(...\)"),
    ],
)
def test_what_is_of_another_type_is_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()


def test_numbers_of_numpy_are_numbers():
    assert ident.FitOptions(starts=np.int64(4), prior_sd=np.float64(0.5)).starts == 4
    with pytest.raises(InputError, match="a number from 1"):
        ident.FitOptions(starts=np.int64(0))


def test_inputs_are_values_or_files():
    with pytest.raises(InputError, match="arm: got a int"):
        ident.fit(3, 4)
    with pytest.raises(InputError, match="campaign: got a int"):
        ident.fit(lcd_arm(), 5)
    with pytest.raises(InputError, match=r"nowhere\.toml"):
        ident.check("nowhere.toml", "nowhere.csv")
