"""`ident.balance`: from identified imbalances and trial masses to masses that leave what is predicted."""

import json
import re
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conformance import agrees
from moving_engines import MujocoMoving
from reports import assert_one_screen, too_wide
from results import assert_comes_back, assert_plain
from source_runs import FILE, HEAD, imbalance_of, measure, one_core, true_arm, with_mass  # noqa: F401

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

from mujoco_arm import MujocoTransient

import ident
from ident.arm.chain import no_loads
from ident.description.file import ArmFile, read_arm
from ident.errors import InputError
from ident.identify.values import Values
from ident.measure.runs import TrialMass
from ident.report.report import text_of
from ident.studies.cause.trials import Tried
from ident.studies.cure.balance_report import balance_rows, balance_sections
from ident.studies.cure.balance_study import (
    Pulley,
    Rotor,
    balanced,
    calibrated,
    complex_least_squares,
    grade,
    repeatability,
)
from ident.studies.scenario import Basis
from ident.vibrate.motion import stroke
from ident.vibrate.simulate import simulate

DEGREE = np.pi / 180
MOUNTED = {"a": "40 g @ drive2 40 mm 90 deg", "b": "45 g @ drive2 40 mm 200 deg"}
STATED = MOUNTED | {"b": "45 g @ drive2 40 mm 140 deg"}
WHERE = {"radius": {"drive2": 90.0}, "holes": {"drive2": 12}, "most": {"drive1": 40.0}, "speed": 24.0}
"""Drive 1 would take 47 g where a test lets it make half of the vibration."""


def added(text):
    return sum(each.imbalance for each in TrialMass.parse(text))


def rows(stated):
    runs = {"24": "", **{f"24{name}": text for name, text in stated.items()}}
    body = [f"run{name}.csv,{way},{way},24,a,,{text}\n" for name, text in runs.items() for way in "yz"]
    return HEAD.strip() + ",trial\n" + "".join(body)


@pytest.fixture(autouse=True, scope="module")
def few_arms():
    """Simulate four draws of the arm: what is left depends on those of the imbalance, and these count all."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("ident.studies.cure.balance_study.ARMS", 4)
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place, arm = tmp_path_factory.mktemp("trials"), true_arm()
    shutil.copy(FILE, place)
    measure(place, arm, 24.0)
    for seed, (name, text) in enumerate(MOUNTED.items(), 1):
        measure(place, with_mass(arm, "drive2", added(text)), 24.0, seed=seed, name=f"24{name}")
    (place / "runs.csv").write_text(rows(STATED))
    return place


@pytest.fixture(scope="module")
def identified(folder):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "ident.studies.cause.source_study.FURTHER", (10.0,)
        )  # what a further run would tell is not looked at here
        return ident.source(folder / "runs.csv")


@pytest.fixture(scope="module")
def file(identified, tmp_path_factory):
    return identified.save(tmp_path_factory.mktemp("out"))[0]


@pytest.fixture(scope="module")
def result(file):
    return ident.balance(file, **WHERE)


@pytest.fixture(scope="module")
def part(file):
    """At the largest pulleys' radii, 50 g at most, with given rotors."""
    return ident.balance(file, speed=24.0, draws=32, rotor={"": 2.0})


def test_a_trial_mass_acts_as_stated_or_where_it_sits(identified):
    assert not identified.doubtful
    right, wrong = identified.study.tried(400)
    for tried, factor in ((right, 1.0), (wrong, np.exp(60j * DEGREE))):
        off = tried.factor / factor - 1
        assert abs(off.real) < 4 * tried.sd[0]
        assert abs(off.imag) < 4 * tried.sd[1]
        assert tried.sd[0] < 0.05
    assert right.right
    assert not wrong.right
    assert "run24b.csv: the mass on drive2 acts as 1.0" in identified.report(details=True).replace("0.99", "1.00")


def test_masses_are_opposite_the_imbalance_and_leave_what_is_predicted(result):
    """Against the true arm with these masses, which nothing but the traces has told."""
    arm = corrected = true_arm()
    assert [rotor.drive.name for rotor in result.found.balanced] == ["drive2", "drive3"]
    for rotor in result.found.balanced:
        name, (size, turn) = rotor.drive.name, rotor.wanted_sd
        bodies = [each for each in result.table() if each["drive"] == name]
        mounted = sum(each["mass"] * each["radius"] * np.exp(1j * each["angle"]) for each in bodies)
        off = mounted / -imbalance_of(arm, name) - 1
        assert abs(off.real) < 4 * size < 0.2
        assert abs(off.imag) < 4 * turn < 0.2
        corrected = with_mass(corrected, name, mounted)
    motion = stroke(arm.stroke, percent=24.0, dwell=2.0)
    responses = [simulate(each, motion, loads=no_loads(each), rate=200.0) for each in (arm, corrected)]
    peaks = [np.abs(np.asarray(each.measured)).max() for each in responses]
    _, low, high = result.left
    assert low - 0.01 < peaks[1] / peaks[0] < high + 0.01
    assert peaks[1] < 0.7 * peaks[0]


def test_what_it_says(result, tmp_path):
    text = result.report(details=True)
    assert result.sections().verdict.word == "BALANCE"
    assert "run24b.csv: the mass on drive2 acts" in text
    assert "2 of 12 holes" in text
    assert "mm; masses do not change that." in text
    assert "not worth it" in text
    assert_one_screen(result.report(), files=2)
    assert not too_wide(text)
    assert_comes_back(result, tmp_path)  # the file has None where a rotor gets no mass
    assert_plain(result.table())
    assert [path.name for path in result.save_figures(tmp_path)] == ["arm.extend-24.balance.png"]


def test_what_does_not_fit_says_so(part):
    assert part.sections().verdict.word == "PARTLY 1 OF 2"
    assert "drive2 needs 13" in part.report()
    assert "at 30 mm, above the 50 g allowed" in part.report()
    assert_one_screen(part.report(), files=2)


def test_each_verdict_has_its_case(result):
    def word(**change):
        rotors = tuple(replace(each, **change) for each in result.found.rotors)
        report = balance_sections(replace(result.found, rotors=rotors))
        assert_one_screen(text_of(report, details=False), files=2)
        return report.verdict.word

    draws = result.found.rotors[0].draws
    assert word(share=0.01) == "NO GAIN"
    assert word(pulley=replace(result.found.rotors[0].pulley, most=1e-3), share=0.5) == "DOES NOT FIT"
    assert word(told=False, share=0.5) == "NOT TOLD"
    assert word(calibration=calibrated([tried(1e-3, 1.3j)], len(draws)), share=0.5) == "TRY AGAIN"
    several = [tried(1e-3, 1.3j), tried(1j, 0.8 - 0.5j, 1), tried(1 + 1j, 2.0 + 0j, 2)]
    assert word(calibration=calibrated(several, len(draws)), share=0.5) == "CONTRADICTING"
    peaks = np.stack([np.ones(len(draws)), np.tile([1.2, 0.9], len(draws) // 2)])
    assert balance_sections(replace(result.found, peaks=peaks)).verdict.word == "NO GAIN"


def test_what_is_allowed_for_is_said_and_in_which_frame(result):
    def report(trials, **change):
        mine = [each for each in trials if each.told]
        rotors = tuple(
            replace(each, calibration=calibrated(mine, len(each.draws)), **change)
            if each.drive.name == "drive2"
            else each
            for each in result.found.rotors
        )
        found = balance_sections(replace(result.found, rotors=rotors, tried=tuple(trials)))
        assert_one_screen(text_of(found, details=False), files=2)
        return found, " ".join(text_of(found, details=False).split())

    turned, one, other = 1.3 * np.exp(23j * DEGREE), 1e-3 + 0j, 1e-3 * np.exp(1.2j)
    _, text = report([tried(one, turned), tried(other, turned, 1)])
    assert "drive2: masses act as 1.30 of what is stated, 23 deg further (2 trials): allowed for" in text
    assert "but those to mount on drive2 as the column trial counts them" in text
    _, text = report([tried(w, turned * np.conj(w) / w, k) for k, w in enumerate((one, other))])
    assert "1.30 of what is stated, angles counted the other way round, 23 deg further (2 trials)" in text
    assert "as the column trial counts them" in text
    # a factor that is as good as none
    found, text = report([tried(one, 0.3 + 0j, noise=1.0)])
    assert "run0: the trial mass on drive2 tells nothing (factor 0.3 +- 1" in text
    assert "not verified" in text
    assert "column trial counts" not in text
    assert found.verdict.word == "BALANCE"
    # the same mark or sense, twice
    found, text = report([tried(one, turned), tried(-one, turned, 1)])
    assert found.verdict.word == "TRY AGAIN"
    assert found.verdict.reason.endswith("if the mark is wrong, not the sense of angles.")
    assert report([tried(one, turned)])[0].verdict.reason.endswith("if the one trial run is right.")


def test_masses_that_may_make_it_worse_are_not_listed(result):
    peaks = np.stack([np.ones(400), np.tile([1.2, 0.9], 200)])
    worse = replace(result.found, peaks=peaks)
    report = balance_sections(worse)
    assert "the vibration changes from" in report.verdict.reason
    assert len(report.answer) == 1
    assert np.isnan([row["mass"] for row in balance_rows(worse)]).all()
    assert {row["state"] for row in balance_rows(worse)} == {"no gain", "not worth it"}


def test_no_imbalance_makes_more_than_its_upper_end(result):
    rotors = [replace(each, told=False, share=0.01, sd=1.5) for each in result.found.rotors]
    report = balance_sections(replace(result.found, rotors=tuple(rotors)))
    assert report.verdict.word == "NO GAIN"
    assert "No imbalance makes more than 4 %" in report.verdict.reason  # 1 % and 1.96 times 1.5 %


def test_a_trial_mass_that_is_too_light_says_how_heavy_it_should_be(result):
    vague = tried(1e-3, 0.9 + 0j, 4, noise=0.25)
    report = text_of(balance_sections(replace(result.found, tried=(vague,))))
    heavier = float(re.search(r"take one (\S+) times as\s+heavy", report)[1])
    assert not vague.told
    assert replace(vague, draws=1 + (vague.draws - 1) / heavier).told
    assert not replace(vague, draws=1 + (vague.draws - 1) / (heavier - 0.11)).told
    assert "not verified" in report
    assert "no trial mass" not in report


def test_the_mass_of_the_rotor_is_said_to_be_assumed(result, part):
    assert result.report().count("(rotor of 0.5 kg: eccentric mass, assumed)") == 1
    assert "assumed)" not in part.report()


def test_rotors_that_get_no_mass_have_a_row_without_one(result, tmp_path):
    for table, none in ((result.table(), np.nan), (ident.load(result.save(tmp_path)[0]).table(), None)):
        rows = {row["drive"]: row for row in table}
        assert rows["drive1"]["state"] == "not worth it"
        np.testing.assert_equal([rows["drive1"][name] for name in ("mass", "angle", "hole")], [none] * 3)
        assert rows["drive2"]["hole"] in range(1, 13)


def test_numbers_are_those_with_which_the_sources_were_identified(file, tmp_path):
    with pytest.raises(InputError, match=r"set: got drive2\.phase, expected .*drop it"):
        ident.balance(file, set={"drive2.phase": 1.0})
    record = json.loads(file.read_text())
    record["options"]["set"] = {"link2.mass": 35.0, "drive2.phase": 0.1}
    other = tmp_path / "other.source.json"
    other.write_text(json.dumps(record))
    with pytest.raises(InputError, match=r"30.*35, as ident source was given"):
        ident.balance(other, set={"link2.mass": 30.0})
    taken = ident.balance(other, speed=24.0, draws=22)  # no multiple of `ARMS`
    assert taken.options.set == {"link2.mass": 35.0}
    assert float(taken.found.basis.arm.get("link2.mass")) == 35.0


def test_it_is_made_again_from_its_file(result, tmp_path):
    again = ident.rerun(result.save(tmp_path)[0])
    assert again.same


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        ({"holes": {"": 2}}, "a whole number of at least 3"),
        ({"holes": {"drive2": 6.5}}, "a whole number of at least 3"),
        ({"radius": {"drive2": -3.0}}, "a number above 0"),
        ({"radius": {"drive5": 30.0}}, "one of drive1, drive2, drive3"),
        ({"most": "heavy"}, "a finite number"),
        ({"draws": 2}, "20"),
        ({"radius": ("drive2=30", "drive2=40")}, "twice"),
    ],
)
def test_what_no_pulley_has_is_refused(file, options, complaint):
    with pytest.raises(InputError) as refused:
        ident.balance(file, **options)
    assert complaint in str(refused.value)


def test_what_is_no_usable_source_is_refused(file, tmp_path):
    with pytest.raises(InputError, match="a result file of ident"):
        ident.balance(FILE)
    with pytest.raises(InputError, match="a result of ident source"):
        ident.balance(3)
    record = json.loads(file.read_text())
    (tmp_path / "bad.source.json").write_text(json.dumps(record | {"verdict": "NOT USABLE"}))
    with pytest.raises(InputError, match="runs that are not usable"):
        ident.balance(tmp_path / "bad.source.json")
    some = {name: x for name, x in record["summary"]["phases"].items() if name != "drive3"}
    (tmp_path / "some.source.json").write_text(json.dumps(record | {"summary": record["summary"] | {"phases": some}}))
    with pytest.raises(InputError, match="no phases of drive3"):
        ident.balance(tmp_path / "some.source.json")
    hidden = [row | {"told": False} for row in record["table"]]
    (tmp_path / "hidden.source.json").write_text(json.dumps(record | {"table": hidden}))
    with pytest.raises(InputError, match="no imbalance that is told"):
        ident.balance(tmp_path / "hidden.source.json")


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (("40 g @ drive2 40 mm 90 deg", "40 g at drive2"), "terms like '12 g @ drive2 40 mm 90 deg'"),
        (("40 g @", "40 s @"), "a mass unit"),
        (("40 g @", "0 g @"), "above 0"),
        (("40 g @ drive2", "40 g @ drive7"), "one of drive1, drive2, drive3"),
        (("run24.csv,y,y,24,a", "run24.csv,y,y,24,b"), "that of"),
        ((",24,a,,\n", ",24,b,,\n"), "a run of the same group without a mass on drive2"),
    ],
)
def test_what_is_wrong_with_a_trial_is_said(folder, change, complaint):
    head, *body = rows(STATED).replace(*change).splitlines()
    stated = [f"{head},delay [s]", *(f"{line},0" for line in body)]  # no clock is sought before
    (folder / "wrong.csv").write_text("\n".join(stated))
    with pytest.raises(InputError) as refused:
        ident.source(folder / "wrong.csv")
    assert complaint in str(refused.value)


@pytest.mark.parametrize("drive", ["drive1", "drive2", "drive3"])
def test_a_body_against_the_imbalance_balances_the_rotor_in_another_engine(drive):
    """MuJoCo's equations with the body itself on the turning pulley, whichever way that turns."""
    arm = true_arm().replace({f"{drive}.phase": 0.9})
    pulley, rng = Pulley(0.09, 0.05, 1.0, 0.5, 7, 0.3), np.random.default_rng(2)
    assert float(arm.get(f"{drive}.height")) == pulley.height
    unbalanced = imbalance_of(arm, drive)
    bodies = [(body.mass, 0.09 * np.exp(1j * body.angle), 0.05) for body in pulley.split(-unbalanced)]
    still = arm.replace({f"{drive}.eccentricity": 0.0})
    plain, without = MujocoMoving(arm), MujocoMoving(still)
    corrected = MujocoMoving(arm, added={drive: bodies})
    wrong = MujocoMoving(arm, added={drive: [(m, np.conj(place), height) for m, place, height in bodies]})
    halves = [(m / 2, sign * place, height) for m, place, height in bodies for sign in (1, -1)]
    weight = MujocoMoving(still, added={drive: halves})
    for _ in range(4):
        command = np.stack([rng.uniform(-1, 1, 3), rng.uniform(-1, 1, 3), np.zeros(3)])
        y, zero = 1e-3 * rng.standard_normal(9), np.zeros(9)
        at = [engine.residual(command, y, zero, zero) for engine in (plain, without, corrected, weight, wrong)]
        made, left = np.abs(at[0] - at[1]).max(), np.abs(at[2] - at[3]).max()
        what, source = f"what a correction of {drive} leaves of the imbalance", "MuJoCo, the body on its pulley"
        agrees(left / made, 0, "balancing", what, source, atol=0.02)
        assert np.abs(at[4] - at[3]).max() > 0.1 * made


@pytest.mark.slow
def test_a_correction_at_another_height_leaves_what_another_engine_leaves():
    """Over a whole stroke, by MuJoCo with the bodies on the pulley: the couple, which no quick test has."""
    arm = true_arm().replace({f"drive{k}.error": 1e-15 for k in (1, 2, 3)})  # none, by the program of the runs
    motion, unbalanced, height = stroke(arm.stroke, percent=12.0, dwell=1.0), imbalance_of(arm, "drive2"), 0.3
    count = 2
    same = {path: np.full(count, float(arm.get(path))) for path in ("joint1.k_tors", "drive2.phase")}
    basis = Basis(ArmFile(arm, "", "", {}), arm, motion, 12.0, posterior=Values("", "", same))
    pulley = Pulley(0.09, height, 1.0, 0.5, 12, 0.2)
    draws = np.full(count, unbalanced)
    ours = Rotor(arm.drives[1], pulley, unbalanced, draws, True, 0.01, np.nan, calibrated([], count), 8.0)
    after = [balanced(basis, [replace(ours, pulley=replace(pulley, height=h))], [], {}).after for h in (height, 0.06)]
    bodies = [(body.mass, 0.09 * np.exp(1j * body.angle), height) for body in ours.bodies]

    def table(time):
        return tuple(np.asarray(part) for part in motion(time))

    theirs = MujocoTransient(arm, table, float(motion.breaks[-1]) - 5e-3, added={"drive2": bodies}).run(1e-3, 5)
    count = theirs.displacement.shape[1]
    vibration = (
        theirs.displacement - np.asarray(simulate(arm, motion, loads=no_loads(arm), rate=200.0).quasi_static)[:, :count]
    )
    off = [np.abs(part[:, :count] - vibration).max() for part in after]
    what, source = "what a correction at another height leaves", "MuJoCo over a whole stroke"
    theirs = vibration / np.abs(vibration).max()
    agrees(after[0][:, :count] / np.abs(vibration).max(), theirs, "balancing", what, source, atol=0.02)
    assert off[1] > 0.2 * np.abs(vibration).max()  # almost without the couple


def test_two_holes_make_what_is_wanted():
    rng = np.random.default_rng(0)
    for holes in (3, 6, 12):
        pulley = Pulley(0.04, 0.0, 1.0, 1.0, holes, 0.3)
        for _ in range(20):
            wanted = complex(*rng.standard_normal(2))
            bodies = pulley.split(wanted)
            assert len(bodies) <= 2
            made, what = sum(b.mass * 0.04 * np.exp(1j * b.angle) for b in bodies), "two holes of a pulley"
            agrees(made, wanted, "balancing", what, "sum of m r e^(i angle)", rtol=1e-6)
            for body in bodies:
                assert body.mass > 0
                assert np.exp(1j * body.angle) == pytest.approx(
                    np.exp(1j * (0.3 + (body.hole - 1) * 2 * np.pi / holes))
                )


def test_grades_and_repeatability():
    found, grades = [grade(x) for x in (0.4, 0.41, 6.3, 4000.0)], [0.4, 1.0, 6.3, 4000.0]
    agrees(found, grades, "balancing", "balance quality grades", "ISO 21940-11", unit="mm/s")
    assert grade(4001.0) == np.inf
    mean, sd = repeatability([3.1, -3.1], [0.01, 0.01])  # across 180 degrees
    assert mean == pytest.approx(np.pi - 3.1)
    expected = np.sqrt(2 * (np.pi - 3.1) ** 2 - 1e-4)
    what, source = "repeatability of a phase across 180 deg", "two groups of equal errors, closed form"
    agrees(sd, expected, "balancing", what, source, rtol=1e-6, unit="rad")
    assert np.isnan(repeatability([1.0], [0.1])[1])
    assert repeatability([1.0, 1.05], [0.1, 0.1])[1] == 0.0


def tried(stated, factor, seed=0, noise=0.01):
    rng = np.random.default_rng(seed)
    draws = factor + noise * (rng.standard_normal(400) + 1j * rng.standard_normal(400))
    return Tried(f"run{seed}", "drive2", stated, factor, draws)


def test_what_trial_masses_tell_of_mark_sense_and_model():
    one, other = 1e-3 * np.exp(0.4j), 2e-3 * np.exp(2.0j)
    turned, wanted = 0.8 * np.exp(0.5j), 5e-3 * np.exp(1.0j)
    assert calibrated([], 400).factor == 1
    alone = calibrated([tried(one, turned)], 400)
    assert alone.state == "one trial"
    both = calibrated([tried(one, turned), tried(other, turned + 0.005, 1)], 400)
    assert not both.state
    assert both.factor == pytest.approx(turned, abs=0.01)
    assert both.factor * both.against(np.array(wanted), np.array(both.factor)) == pytest.approx(-wanted)
    # counted the other way round: a body stated at w sits at its conjugate
    mirror = calibrated([tried(w, turned * np.conj(w) / w, k) for k, w in enumerate((one, other))], 400)
    assert mirror.mirrored
    mounted = complex(mirror.against(np.array(wanted), np.array(mirror.factor)))
    assert turned * np.conj(mounted) == pytest.approx(-wanted, rel=0.02)
    assert mirror.acts(mounted).mean() == pytest.approx(-wanted, rel=0.02)
    assert calibrated([tried(one, turned), tried(other, 1.4j, 1)], 400).state == "contradicting"
    odd = calibrated([tried(one, 1.01 + 0j), tried(other, turned, 1)], 400)
    assert [each.run for each in odd.odd] == ["run1"]
    assert odd.factor == 1


@pytest.mark.parametrize(
    ("apart", "noise", "state"),
    [(0, 0.01, "one trial"), (180, 0.01, "one trial"), (10, 0.01, ""), (10, 0.1, "one trial"), (90, 0.1, "")],
)
@pytest.mark.parametrize("mirrored", [False, True])
def test_trials_at_one_angle_do_not_tell_a_wrong_mark_from_a_wrong_sense(apart, noise, state, mirrored):
    turned, stated = 0.8 * np.exp(0.5j), 1e-3 * np.exp(1j * (0.4 + np.array([0, apart * DEGREE])))
    factors = turned * np.conj(stated) / stated if mirrored else np.full(2, turned)
    found = calibrated([tried(w, f, k, noise) for k, (w, f) in enumerate(zip(stated, factors, strict=True))], 400)
    assert found.state == state
    assert len(found.odd) == 2 * bool(state)
    assert found.mirrored == (mirrored and not state)
    assert found.trials == 2


def test_a_trial_mass_that_tells_nothing_neither_verifies_nor_outvotes():
    vague = tried(1e-3, 0.3 + 0j, 1, noise=1.0)
    assert not vague.told
    assert not vague.right
    assert vague.spread == pytest.approx(1.0, rel=0.1)
    sharp = tried(1e-3, 0.8 * np.exp(0.5j))
    assert calibrated([vague], 400).state == ""
    found = calibrated([vague, sharp], 400)
    assert found.state == "one trial"
    assert found.odd == (sharp,)
    # at the limit: 95 % of a normal distribution in the plane lie within 2.448 of its standard deviations
    assert tried(1e-3, 1 + 0j, 2, noise=0.09).right
    assert not tried(1e-3, 1 + 0j, 2, noise=0.12).right
    far = tried(1e-3, 3 + 0j, 3, noise=0.3)  # wide, but not 1
    assert far.told
    assert not far.right


def test_what_a_trial_tells_is_said_even_by_two_draws():
    alike = Tried("run", "drive2", 1e-3, 1 + 0j, np.ones(2, complex))
    assert alike.right
    two = Tried("run", "drive2", 1e-3, 1.5 + 0j, np.array([1.49, 1.51]) + 0j)
    assert two.chance < 1e-6
    assert calibrated([two, replace(two, stated=1e-3j)], 2).factor == pytest.approx(1.5)


def polar(*pairs):
    """Return complex numbers of sizes and angles [deg]."""
    return np.array([size * np.exp(1j * DEGREE * angle) for size, angle in pairs])


def printed(values, *pairs, what, source, size=5e-3, angle=0.5):
    """Check sizes and angles [deg] against what a publication has printed, to half of its last digits."""
    expected = polar(*pairs)
    agrees(np.abs(values), np.abs(expected), "balancing", f"{what}: sizes", source, atol=size)
    off = np.degrees(np.angle(values / expected))
    agrees(off, 0 * off, "balancing", f"{what}: angles, apart", source, atol=angle, unit="deg")


def test_influence_coefficients_of_a_published_case():
    """Two planes, as printed in the README of the package hsbalance 0.5."""
    before, weights = polar((170, 112), (53, 78)), np.diag(polar((1.15, 0), (1.15, 0)))
    after = np.array([polar((235, 94), (58, 68)), polar((185, 115), (77, 104))])  # of each trial, at both sensors
    source = "hsbalance 0.5, example of two planes"
    coefficients = complex_least_squares(weights, after - before)[0].T
    small, what = {"size": 6e-4, "angle": 0.06, "source": source}, "influence coefficients of"
    printed(coefficients[0] / 10, (7.8433, 58.4), (1.534, 145.3), what=f"{what} sensor 1", **small)
    printed(coefficients[1], (9.462, 10.2), (32.56, 142.4), what=f"{what} sensor 2", source=source, angle=0.06)
    corrections = complex_least_squares(coefficients, -before[:, None])[0][:, 0]
    printed(corrections, (1.979, 236.2), (1.071, 121.8), what="corrections in two planes", **small)


def test_least_squares_of_goodman():
    """Goodman, J. Eng. Ind. 86(3), 1964, tables 1 and 2: plain, then each location weighted by what was left there."""
    coefficients = np.array([[3, -2], [5, -2], [5, -3]], complex)
    before = np.array([[1], [-1], [0]], complex)
    plain, squares = complex_least_squares(coefficients, -before)
    source = "Goodman 1964, tables 1 and 2"
    printed(plain[:, 0], (0.81, 0), (1.48, 0), what="corrections by least squares", source=source)
    left = (before + coefficients @ plain)[:, 0]
    what = "vibration left by least squares"
    printed(left, (0.476, 0), (0.0952, 0), (0.381, 180), size=5e-4, what=what, source=source)
    agrees(squares[0], 0.381, "balancing", "sum of squares left", source, atol=5e-4)
    weighted, _ = complex_least_squares(coefficients, -before, np.diag(np.tile(1 / np.abs(left), 2)))
    printed(weighted[:, 0], (1.00, 0), (1.80, 0), what="corrections, weighted", source=source)
    left, what = (before + coefficients @ weighted)[:, 0], "vibration left, weighted"
    printed(left, (0.4, 0), (0.4, 0), (0.4, 180), size=5e-4, what=what, source=source)


def test_trial_masses_that_stay_mounted():
    """Feese and Grazier, "Balance this!", 33rd Turbomachinery Symposium, 2004: a compressor with four probes."""
    before = polar((0.68, 32), (0.56, 86), (1.94, 231), (2.07, 335))
    first = polar((1.31, 1), (1.25, 75), (0.93, 251), (1.0, 342))  # 11.1 g at 35 deg on the aft plane
    both = polar((0.54, 9), (0.52, 75), (0.81, 196), (0.90, 296))  # and 3.7 g at 135 deg on the forward one
    aft, forward = polar((11.1, 35), (3.7, 135))
    masses = np.array([[aft, 0], [aft, forward]])
    coefficients = complex_least_squares(masses, np.array([first - before, both - before]))[0].T
    corrections = complex_least_squares(coefficients, -before[:, None])[0][:, 0]
    source = "Feese and Grazier 2004"
    printed(corrections, (15.3, 3), (6.6, 113), size=0.05, what="corrections of a compressor", source=source)
    left, what = before + coefficients @ corrections, "vibration left of a compressor"
    printed(left, (0.08, 138), (0.09, 49), (0.05, 231), (0.05, 166), what=what, source=source)


@pytest.mark.parametrize(
    ("second", "third", "expected"),
    [
        ((2 + 1j, 4 + 2j, 2 + 1j, 3 + 2j), (3 + 2j, 2 + 1j, 4 + 3j, 4 + 2j), ((1.39, -4), (1.25, -144), (0.98, 168))),
        ((3 + 2j, 2 + 1j, 4 + 3j, 3 + 2j), (3 + 2j, 2 + 1j, 4 + 3j, 4 + 2j), ((0.87, 101), (4.74, 100), (5.08, -87))),
        ((3 + 2j, 2 + 1j, 4 + 3j, 4 + 2j), None, ((0.51, 46), (1.13, -155))),
    ],
    ids=["independent planes", "nearly dependent planes", "without one of them"],
)
def test_planes_of_darlow(second, third, expected):
    """Darlow, "Identification and elimination of non-independent balance planes", Turbo Expo 1982; three examples."""
    columns = [each for each in ((1 + 1j, 1 + 3j, 2 + 2j, 3 + 1j), second, third) if each]
    before = np.array([[1 + 3j], [3 + 1j], [4 + 1j], [2 + 5j]])
    found = complex_least_squares(np.array(columns).T, -before)[0][:, 0]
    planes = (
        "two planes" if third is None else "independent planes" if second[0] == 2 + 1j else "nearly dependent planes"
    )
    printed(found, *expected, what=f"corrections in {planes}", source="Darlow 1982")


def test_weights_count():
    """Weighted by precision as a mean is: closed form."""
    matrix, values = np.ones((2, 1), complex), np.array([[1.0 + 1j], [3.0 + 2j]])
    x, chi = complex_least_squares(matrix, values, np.diag([1.0, 4.0, 1.0, 4.0]))
    expected, source = (4 * values[0, 0] + values[1, 0]) / 5, "weighted mean, closed form"
    agrees(x[0, 0], expected, "balancing", "a mass by two sensors", source, rtol=1e-6)
    expected, what = abs(values[1, 0] - values[0, 0]) ** 2 / 5, "chi-squared of two sensors"
    agrees(chi[0], expected, "balancing", what, source, rtol=1e-6)


def test_the_arm_that_it_is_of_comes_out_of_the_file(result):
    assert result.found.basis.arm.name == read_arm(FILE).arm.name
    assert set(result.inputs) >= {"arm", "source"}
