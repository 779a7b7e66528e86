"""Options of studies: ranges, choices, what goes together, and the flags that the command line makes of them."""

import json
import math
import shutil
from dataclasses import replace

import numpy as np
import pytest
from arms import DATA, lcd_arm
from matplotlib.text import Text

import ident
from ident.arm.arm import on_soft_base
from ident.description.file import ArmFile
from ident.errors import InputError, Problem
from ident.identify.unknowns import stiffness_parameters
from ident.report.report import Table
from ident.studies import STUDIES as STUDY_NAMES
from ident.studies import ranges, reading
from ident.studies.following import kept_in
from ident.studies.look.predict import PredictOptions
from ident.studies.options import Options, flag_of, option, renamed, specs
from ident.studies.stiffness.check import CheckOptions
from ident.studies.stiffness.fit import FitOptions
from ident.studies.stiffness.profile import ProfileOptions
from ident.vibrate.motion import FASTEST


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
    code, out, _ = run("fleet", "--help-all")
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
        (lambda: ident.FitOptions(fix=3), "fix: got 3, expected several"),
        (lambda: ident.FitOptions(tie="joint1.k_bend"), "tie joint1.k_bend: got one parameter, expected two or more"),
        (lambda: ident.PredictOptions(posture="0,left"), "posture 0,left: got 'left', expected a finite number"),
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


def test_what_the_command_line_reads_python_reads_too():
    given = ident.FitOptions(fix="*.k_bend", tie="a.k=b.k", free=["a.mass:0.1", "b.mass"], uncertain="a.mass:5%")
    assert given == ident.FitOptions(
        fix=("*.k_bend",), tie=(("a.k", "b.k"),), free={"a.mass": 0.1, "b.mass": math.inf}, uncertain={"a.mass": "5%"}
    )
    assert ident.PredictOptions(posture="30,-60,30").posture == ((30.0, -60.0, 30.0),)
    assert ident.SimulateOptions(band="4:8").band == (4.0, 8.0)


def test_patterns_stand_for_the_names_that_fit():
    arm, every = lcd_arm(), [f"joint{i}.k_bend" for i in (1, 2, 3)]

    def names(**given):
        return stiffness_parameters(arm, ident.FitOptions(**given).unknowns).names

    assert names(fix="*.k_bend") == tuple(f"joint{i}.k_tors" for i in (1, 2, 3))
    assert names(fix=("joint2.k_bend", "*.k_bend")) == names(fix=every)
    assert names(fix="joint?.k_tors", free={"link?.mass": 0.1}) == (*every, "link1.mass", "link2.mass")
    tied = stiffness_parameters(arm, ident.FitOptions(tie=("*.k_tors=joint1.k_bend",)).unknowns).items
    assert [item.paths for item in tied if len(item.paths) > 1] == [
        ("joint1.k_tors", "joint2.k_tors", "joint3.k_tors", "joint1.k_bend")
    ]
    widths = ident.FitOptions(uncertain={"link*.mass": "5%", "link2.mass": "1%"}).unknowns_of(ArmFile(arm, "", "", {}))
    assert widths.uncertain == {"link1.mass": "5%", "link2.mass": "1%"}
    with pytest.raises(InputError, match=r"the pattern '\*\.k_bond', expected one that fits a number of the arm"):
        names(fix="*.k_bond")


STUDIES = [getattr(ident, "modal_test" if name == "modal" else name) for name in STUDY_NAMES] + [ident.explore]


@pytest.mark.parametrize("study", STUDIES, ids=lambda study: study.__name__)
def test_every_study_takes_its_options_as_keywords(study):
    """One that it has not is refused before anything is read."""
    with pytest.raises(InputError, match=f"{study.__name__}: got the option unitz, expected one of .*Options") as error:
        study("nowhere", "nowhere", unitz=1)
    assert len(str(error.value).splitlines()) == 1


def test_keywords_change_the_options_that_are_given():
    arm = lcd_arm()
    direct = ident.predict(arm, ident.PredictOptions(modes=3, load="glass"))
    for result in (
        ident.predict(arm, ident.PredictOptions(modes=3), load="glass"),
        ident.predict(arm, options=ident.PredictOptions(load="glass"), modes=3),
        ident.predict(arm, modes=3, load="glass"),
    ):
        assert result.options == direct.options
        assert result.report() == direct.report()
    with pytest.raises(InputError, match="did you mean modes"):
        ident.predict(arm, mode=3)
    with pytest.raises(InputError, match=r"got a FitOptions, expected PredictOptions"):
        ident.predict(arm, ident.FitOptions(), modes=3)


def test_figures_have_names_and_files_of_the_study_alone(tmp_path):
    result = ident.predict(lcd_arm(), posture=((0, 0, 0), (30, -60, 30)))
    figures = result.figures()
    assert list(figures) == ["predict", "2"]
    assert figures[""] is figures["predict"]
    with pytest.raises(KeyError):
        figures["3"]
    names = [path.name for path in result.save_figures(tmp_path)]
    assert names == [f"{result.name}.png", f"{result.name}.2.png"]


def test_an_arm_and_a_campaign_print_as_short_tables():
    file = ident.read_arm(DATA / "lcd_arm" / "arm.toml")
    lines = str(file).splitlines()
    assert lines[0] == "LCD transfer arm: 3 driven joints"
    assert lines[1].split() == ["joint", "axis", "offset", "[m]", "k_bend,", "k_tors", "[N", "m/rad]", "mass", "[kg]"]
    assert lines[3].split() == ["joint2", *["0", "0", "1", "1", "0", "0.12", "3.157e+05,", "3.237e+05", "46.4"]]
    assert lines[-1] == f"file: {file.path}"
    assert str(file.arm).splitlines() == lines[:-1]
    assert "(no pin)" in str(on_soft_base(file.arm, 0.5))
    assert str(file.arm.replace({"link2.mass": np.array([1.0, 2.0])})).startswith("Arm("), "draws of an arm are none"
    campaign = ident.read_campaign(DATA / "lcd_arm" / "campaign.csv")
    lines = str(campaign).splitlines()
    assert lines[0] == "campaign: 20 measurements at 4 postures"
    assert lines[6].split() == ["11", "deflection", "tip", "0,", "0,", "0", "own", "weight", "26.58", "0.53", "mm"]
    assert (len(lines), lines[-1]) == (15, "and 8 more")
    assert max(map(len, lines)) <= 100
    assert str(ident.Campaign()) == "campaign: 0 measurements at 0 postures"


@pytest.fixture(scope="module")
def narrow():
    """A fit that stays near the arm's own stiffnesses, in another unit."""
    campaign = DATA / "lcd_arm" / "table1.csv"
    return ident.fit(lcd_arm(), campaign, starts=1, no_explain=True, prior_sd=1e-3, units="Nmm/deg")


@pytest.mark.parametrize(
    ("units", "name", "k"),
    [
        ("N m/rad", "N m/rad", "3.157e5"),
        ("Nmm/deg", "N mm/deg", "5.51e6"),
        ("N*m/arcmin", "N m/arcmin", "91.83"),
    ],
)
def test_one_unit_of_stiffness_for_all_media(narrow, units, name, k, tmp_path):
    """Value of joint2.k_bend by hand: 315699.745 N m/rad, times pi / 180 / 1e-3, or pi / 180 / 60."""
    options = replace(narrow.options, units=units)
    result = replace(narrow, options=options)
    assert options.units == name
    others = {"N m/rad", "N mm/deg", "N m/arcmin"} - {name}
    texts = [result.report(), *(text.get_text() for text in result.figures()["fit"].findobj(Text))]
    (table,) = [part for part in result.sections().answer if isinstance(part, Table)]
    assert table.head[1] == f"value [{name}]"
    (start,) = [row[-2] for row in table.rows if row[0] == "joint2.k_bend"]
    assert start == k
    assert any(name in text for text in texts[1:])
    assert not [text for text in texts if any(other in text for other in others)]
    assert result.table()[0]["unit"] == "N m/rad"
    assert result.parameters["joint2.k_bend"] == pytest.approx(315699.745, rel=2e-3), "in SI, whatever is shown"
    with kept_in(tmp_path):
        assert ident.load(result.save(tmp_path)[0]).report() == result.report()
    page = ident.explore(lcd_arm(), units=units).save(tmp_path)[0].read_text()
    assert f'"name":"{name}"' in page


def test_another_unit_is_refused_and_the_defaults_file_may_choose(run, tmp_path):
    with pytest.raises(InputError, match=r"units: got 'N m/turn', expected one of N m/rad, N mm/deg, N m/arcmin"):
        ident.PredictOptions(units="N m/turn")
    shutil.copy(DATA / "lcd_arm" / "arm.toml", tmp_path)
    (tmp_path / "ident.toml").write_text('units = "N mm/deg"')
    code, out, _ = run("predict", "arm.toml", "--json")
    assert code == 0
    assert json.loads(out)["options"]["units"] == "N mm/deg"
    code, out, _ = run("predict", "arm.toml", "--json", "--units", "Nm/arcmin")
    assert json.loads(out)["options"]["units"] == "N m/arcmin"


@pytest.mark.parametrize(
    ("read", "one", "two"),
    [
        (reading.numbers, "a.mass=1", "b.mass=2"),
        (reading.widths, "a.mass:0.1", "b.mass"),
        (reading.ties, "a.k_tors=b.k_tors", "a.k_bend=b.k_bend"),
        (reading.priors, "a.k_tors=log-normal:1e5:1", "b.k_tors=log-normal:2e5:1"),
        (reading.each_of, "a.k_bend", "*.k_tors"),
        (ranges.ranges, "a.k_bend=1:2", "b.k_bend=0.5x:2x:3"),
    ],
)
def test_commas_part_what_may_be_repeated(read, one, two):
    assert read([f"{one},{two}"], "--flag") == read([f"{one}, {two}"], "--flag") == read([one, two], "--flag")
    assert len(read([one, two], "--flag")) == 2


def test_commas_within_a_value_stay():
    assert reading.frequencies(["2=4.45,5.01"], "--modes") == {"2": (4.45, 5.01)}
    with pytest.raises(InputError, match="'1,5', expected a finite number"):
        reading.numbers(["a.mass=1,5"], "--set")
