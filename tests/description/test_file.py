import re
from pathlib import Path

import jax
import numpy as np
import pytest

from ident.arm.arm import on_soft_base
from ident.arm.fields import ALPHA
from ident.description.file import parse_arm, parse_document, read_arm, update_arm, update_file
from ident.description.rewriting import arm_text
from ident.errors import InputError
from ident.identify.unknowns import scaled_inertia

jax.config.update("jax_enable_x64", True)

PAPER_ARM = Path(__file__).parents[2] / "data" / "lcd_arm" / "arm.toml"

TEXT = """\
format = "ident-arm/1"
name = "two joints"

[[joint]]
name = "joint1"
offset = { value = [0, 0, 0], unit = "m", origin = "assumed" }
k_bend = { value = 1.0, unit = "N*mm/deg", origin = "paper" }
k_tors = { value = 2, unit = "N*m/rad", origin = "datasheet" }

[[joint.link]]
name = "link1"
mass = { value = 2.0, unit = "kg", origin = "measured" }
com = { value = [500, 0, 0], unit = "mm", origin = "assumed" }
inertia = { value = [0.1, 0.2, 0.2], unit = "kg*m^2", origin = "measured" }

[[joint]]
name = "joint2"
axis = { value = [0, 3, 4], origin = "assumed" }
offset = { value = [1, 0, 0], unit = "m", origin = "assumed" }
k_bend = { value = 1e5, unit = "N*m/rad", origin = "paper" }
k_tors = { value = 1e5, unit = "N*m/rad", origin = "paper" }
tau_tors = { value = 2, unit = "ms", origin = "paper" }
limits = { value = [-90, 90], unit = "deg", origin = "assumed" }

[[joint.shaft]]
name = "shaft2"
mass = { value = 6.0, unit = "kg", origin = "assumed" }
com = { value = [0, 0, 0], unit = "m", origin = "assumed" }
shape = { kind = "cylinder", radius = 0.2, length = 1.0, axis = "x", unit = "m", origin = "assumed" }

[[joint.link]]
name = "hand"
mass = { value = 12.0, unit = "kg", origin = "assumed" } # weighed next week
com = { value = [0.1, 0, 0], unit = "m", origin = "assumed" }
shape = { kind = "box", size = [10, 20, 30], unit = "cm", origin = "assumed" }

[[joint.link]]
name = "bolt"
mass = { value = 0, unit = "kg", origin = "assumed" }
com = { value = [0.1, 0, 0], unit = "m", origin = "assumed" }
shape = { kind = "point" }

[[point]]
name = "tip"
joint = "joint2"
position = { value = [1, 0, 0], unit = "m", origin = "assumed" }

[[payload]]
name = "glass"
joint = "joint2"
mass = { value = 1.0, unit = "lb", origin = "assumed" }
com = { value = [0.1, 0, 0], unit = "m", origin = "assumed" }
inertia = { value = [[2, 0.1, 0], [0.1, 2, 0], [0, 0, 3]], unit = "kg*m^2", origin = "derived" }
"""


K_TORS = 'k_tors = { value = 2, unit = "N*m/rad", origin = "datasheet" }'
TAU = '{ value = 2, unit = "ms", origin = "paper" }'


def problems(text):
    with pytest.raises(InputError) as caught:
        parse_arm(text, "arm.toml")
    return [str(problem) for problem in caught.value.problems]


def changed(old, new):
    assert TEXT.count(old) >= 1
    return TEXT.replace(old, new, 1)


def test_numbers_arrive_in_si():
    arm = parse_arm(TEXT)
    assert arm.get("joint1.k_bend") == pytest.approx(0.0572957795, rel=1e-9)
    assert arm.get("joint1.k_tors") == 2.0
    assert arm.get("link1.com.x") == pytest.approx(0.5)
    assert arm.get("joint2.tau_tors") == pytest.approx(0.002)
    assert arm.get("glass.mass") == pytest.approx(0.45359237)
    assert arm.joints[1].limits == pytest.approx((-np.pi / 2, np.pi / 2))
    np.testing.assert_allclose(arm.joints[1].axis, [0, 0.6, 0.8])


def test_defaults_are_a_vertical_axis_no_damping_and_no_limits():
    joint = parse_arm(TEXT).joints[0]
    np.testing.assert_array_equal(joint.axis, [0, 0, 1])
    assert (joint.tau_bend, joint.tau_tors, joint.driven) == (0, 0, True)
    assert joint.limits == (-np.inf, np.inf)


def test_inertia_follows_from_its_four_notations():
    arm = parse_arm(TEXT)
    np.testing.assert_allclose(arm.joints[0].link[0].inertia, np.diag([0.1, 0.2, 0.2]))
    np.testing.assert_allclose(arm.joints[1].shaft[0].inertia, np.diag([0.12, 0.56, 0.56]))
    np.testing.assert_allclose(arm.joints[1].link[0].inertia, np.diag([0.13, 0.10, 0.05]))
    np.testing.assert_array_equal(arm.joints[1].link[1].inertia, np.zeros((3, 3)))
    np.testing.assert_allclose(arm.payloads[0].body.inertia, [[2, 0.1, 0], [0.1, 2, 0], [0, 0, 3]])


def test_box_and_cylinder_agree_with_integration():
    text = changed("size = [10, 20, 30]", "size = [0, 0, 100]").replace("radius = 0.2", "radius = 0")
    rod = parse_arm(text).joints[1]
    np.testing.assert_allclose(rod.link[0].inertia, np.diag([1.0, 1.0, 0.0]), atol=1e-12)
    np.testing.assert_allclose(rod.shaft[0].inertia, np.diag([0.0, 0.5, 0.5]), atol=1e-12)


def test_undriven_joint_keeps_its_place_without_a_pin():
    arm = parse_arm(changed('name = "joint1"', 'name = "joint1"\ndriven = false'))
    assert [joint.name for joint in arm.joints] == ["joint1", "joint2"]
    assert [joint.name for joint in arm.driven] == ["joint2"]


def test_every_number_has_an_origin(tmp_path):
    path = tmp_path / "arm.toml"
    path.write_text(TEXT)
    file = read_arm(path)
    assert set(file.origins) == set(file.arm.paths())
    assert file.origins["joint1.k_bend"] == "paper"
    assert file.origins["joint1.k_tors"] == "datasheet"
    assert file.origins["link1.inertia.xx"] == "measured"
    assert file.origins["hand.inertia.xx"] == "derived"
    assert file.origins["joint1.tau_bend"] == "assumed"


def test_sha256_is_of_the_bytes(tmp_path):
    path = tmp_path / "arm.toml"
    path.write_bytes(TEXT.encode())
    one = read_arm(path).sha256
    path.write_bytes(TEXT.encode() + b"# more\n")
    assert len(one) == 64
    assert read_arm(path).sha256 != one


def test_paper_arm_is_valid_and_carries_table_1():
    file = read_arm(PAPER_ARM)
    factor = 180 / np.pi * 1e-3
    bending = [file.arm.get(f"joint{n}.k_bend") / factor for n in (1, 2, 3)]
    torsion = [file.arm.get(f"joint{n}.k_tors") / factor for n in (1, 2, 3)]
    np.testing.assert_allclose(bending, [12.52e6, 5.51e6, 1.81e6], rtol=1e-12)
    np.testing.assert_allclose(torsion, [6.28e6, 5.65e6, 4.54e6], rtol=1e-12)
    assert {file.origins[f"joint{n}.{k}"] for n in (1, 2, 3) for k in ("k_bend", "k_tors")} == {"paper"}
    assert [len(joint.link) for joint in file.arm.joints] == [1, 1, 2]
    assert file.arm.points[-1].name == "tip"


# Each row: what is replaced, by what, the place, and words that the message must contain.
BAD = [
    (
        "mass = { value = 2.0,",
        "mass = { value = -2.0,",
        "arm.toml:12, joint[0] 'joint1'.link[0] 'link1'.mass",
        ">= 0",
    ),
    ("mass = { value = 2.0,", "mass = { value = nan,", "arm.toml:12", "finite"),
    ("mass = { value = 2.0,", "mass = { value = inf,", "arm.toml:12", "finite"),
    ("mass = { value = 2.0,", "mass = { value = 1e999,", "arm.toml:12", "finite"),
    ("mass = { value = 2.0,", "mass = { value = 1e300,", "arm.toml:12", "magnitudes up to"),
    ("mass = { value = 2.0,", f"mass = {{ value = 1{'0' * 400},", "arm.toml:12", "number"),
    ("mass = { value = 2.0,", "mass = { value = true,", "arm.toml:12", "got true, expected a number"),
    ("mass = { value = 2.0,", 'mass = { value = "2",', "arm.toml:12", "got '2', expected a number"),
    ("mass = { value = 2.0,", "mass = { value = [2.0],", "arm.toml:12", "expected a number"),
    (
        'mass = { value = 2.0, unit = "kg", origin = "measured" }',
        "mass = 2.0",
        "arm.toml:12",
        "write mass = { value",
    ),
    (
        'mass = { value = 2.0, unit = "kg", origin = "measured" }',
        "",
        "arm.toml:10, joint[0] 'joint1'.link[0]",
        "mass",
    ),
    ("com = { value = [500, 0, 0]", "com = { value = [500, 0]", "arm.toml:13", "at least 3"),
    ("com = { value = [500, 0, 0]", "com = { value = [500, 0, 0, 0]", "arm.toml:13", "at most 3"),
    (
        "com = { value = [500, 0, 0]",
        "com = { value = [500, 0, false]",
        "arm.toml:13",
        "com.value[2]: got false",
    ),
    ('unit = "mm"', 'unit = "furlon"', "arm.toml:13", "unknown unit 'furlon'"),
    ('unit = "mm"', 'unit = "kg"', "arm.toml:13", "'kg', expected a unit such as m"),
    ('unit = "mm"', 'unit = "mm ("', "arm.toml:13", "unknown unit"),
    ('unit = "mm", ', "", "arm.toml:13", 'add unit = "..."'),
    ('unit = "N*mm/deg"', 'unit = "N-mm/deg"', "arm.toml:7", "did you mean N*mm/deg"),
    ('unit = "N*mm/deg"', 'unit = "N*mm"', "arm.toml:7, joint[0] 'joint1'.k_bend.unit", "such as N*m/rad"),
    ('unit = "deg"', 'unit = ""', "arm.toml:23", "such as rad"),
    (', origin = "measured" }', " }", "arm.toml:12", "one of paper, assumed"),
    ('origin = "measured"', 'origin = "guessed"', "arm.toml:12", "'guessed', expected 'paper'"),
    (
        "value = [0.1, 0.2, 0.2]",
        "value = [0.1, 0.2, 0.4]",
        "arm.toml:10, joint[0] 'joint1'.link[0]",
        "sum of the",
    ),
    ("value = [0.1, 0.2, 0.2]", "value = [-0.1, 0.2, 0.2]", "arm.toml:10", "positive moments"),
    ("[0.1, 2, 0], [0, 0, 3]", "[0.2, 2, 0], [0, 0, 3]", "payload[0] 'glass'", "asymmetric"),
    ("[0.1, 2, 0], [0, 0, 3]", "[0.1, 2], [0, 0, 3]", "payload[0] 'glass'.inertia.value[1]", "at least 3"),
    ('shape = { kind = "point" }', "", "joint[1] 'joint2'.link[1] 'bolt'", "neither inertia nor shape"),
    ('kind = "point"', 'kind = "ball"', "'bolt'.shape", "'box', 'cylinder', 'point'"),
    ("size = [10, 20, 30]", "size = [10, -20, 30]", "'hand'.shape.size[1]", ">= 0"),
    ("[0, 3, 4]", "[0, 0, 0]", "arm.toml:18, joint[1] 'joint2'.axis", "a direction"),
    ("value = 1e5", "value = 0", "arm.toml:20", "got 0, expected a number > 0"),
    ("value = 1e5", "value = -1e5", "arm.toml:20", "> 0"),
    ('value = 2, unit = "ms"', 'value = -2, unit = "ms"', "arm.toml:22", "tau_tors.value: got -2"),
    ("[-90, 90]", "[90, -90]", "arm.toml:23", "lower limit < upper limit"),
    ('name = "hand"', 'name = "link1"', "arm.toml:32", "'link1' again"),
    ('name = "tip"', 'name = "a.b"', "arm.toml:44, point[0] 'a.b'.name", "letters, digits"),
    ('name = "tip"', r'name = "a\u0007"', "arm.toml:44", r"'a\x07'"),
    ('name = "tip"', 'name = ""', "arm.toml:44", "letters, digits"),
    ('joint = "joint2"', 'joint = "joint3"', "arm.toml:45", "one of joint1, joint2; did you mean joint2"),
    ('format = "ident-arm/1"', 'format = "ident-arm/2"', "arm.toml:1, format", "'ident-arm/1'"),
    ('format = "ident-arm/1"', "", "arm.toml:1", 'begin the file with format = "ident-arm/1"'),
    ('name = "two joints"', 'name = "x"\n"a\\nb" = 1', r"arm.toml:1, 'a\nb'", r"unknown key 'a\nb'"),
    ('name = "two joints"', "name = 2", "arm.toml:2, name", "text in quotes"),
    ('name = "two joints"', 'name = "two joints"\ngravty = 1', "arm.toml:3, gravty", "did you mean gravity?"),
    ('name = "joint1"', 'name = "joint1"\ndriven = 1', "arm.toml:6", "driven: got 1, expected true or false"),
    ('name = "two joints"', "name = two joints", "arm.toml:2, column 8", "TOML"),
    (K_TORS, 'k_tors = "stiff"', "arm.toml:8, joint[0] 'joint1'.k_tors", "got 'stiff', expected 'rigid'"),
    (f"{K_TORS}\n", f'k_tors = "rigid"\ntau_tors = {TAU}\n', "arm.toml:4", "take tau_tors out"),
    ('name = "two joints"', 'name = "two\nname = "two"', "arm.toml:2", "TOML"),
    ('[[point]]\nname = "tip"', '[point]\nname = "tip"', "arm.toml:43, point", "a list"),
]


@pytest.mark.parametrize(("old", "new", "place", "words"), BAD)
def test_a_wrong_input_is_named_with_place_and_remedy(old, new, place, words):
    (message,) = problems(changed(old, new))
    assert place in message
    assert words in message
    assert "\n" not in message


@pytest.mark.parametrize(
    ("old", "new", "missing", "unknown"),
    [
        ("mass = { value = 2.0", "mass = { valu = 2.0", "the key value", "unknown key 'valu'"),
        ('kind = "box", size', 'kind = "box", sizes', "the key size", "unknown key 'sizes'"),
    ],
)
def test_a_misspelt_key_is_missing_and_unknown(old, new, missing, unknown):
    first, second = problems(changed(old, new))
    assert missing in first
    assert unknown in second
    assert f"did you mean {missing.split()[-1]}?" in second


def test_a_rigid_direction_is_a_word_and_no_number():
    text = changed(K_TORS, 'k_tors = "rigid"')
    arm = parse_arm(text)
    assert (arm.joints[0].k_tors, arm.joints[0].tau_tors, arm.degrees_of_freedom) == (None, None, 5)
    assert not {"joint1.k_tors", "joint1.tau_tors"} & set(arm.paths())
    with pytest.raises(InputError, match="k_tors, which is rigid, expected a number of the arm"):
        arm.replace({"joint1.k_tors": 5.0})
    updated = update_file(text, {"joint1.k_bend": 3.0}, origin="calibrated")
    assert 'k_tors = "rigid"' in updated
    assert parse_arm(arm_text(arm, origin="assumed")).joints[0].k_tors is None
    based = parse_arm(update_arm(text, on_soft_base(arm, 0.5), origin="calibrated"))
    np.testing.assert_allclose(
        [based.get("base.k_bend"), based.get("base.k_tors")], [10 * arm.get("joint1.k_bend"), 1e6]
    )


RATIO, LOST = '{ value = 0.01, origin = "measured" }', '{ value = { bend = 0.03 }, origin = "paper" }'
MS = '{ value = { tors = 2 }, unit = "ms", origin = "assumed" }'
FIELDS = ("tau_bend", "tau_tors", "loss_bend", "loss_tors")


def with_damping(words, joint=""):
    """The text with a table of damping, and words of joint 1."""
    text = TEXT.replace("[[joint]]", f"[damping]\n{words}\n\n[[joint]]", 1) if words else TEXT
    return text.replace('name = "joint1"\n', f'name = "joint1"\n{joint}\n', 1)


def damping(text):
    return [tuple(getattr(joint, field) for field in FIELDS) for joint in parse_arm(text).joints]


@pytest.mark.parametrize(
    ("words", "joint", "expected"),
    [
        (f"ratio = {RATIO}", "", [(0, 0, 0.02, 0.02), (0, 0.002, 0.02, None)]),
        (f"loss_factor = {LOST}", "", [(0, 0, 0.03, None), (0, 0.002, 0.03, None)]),
        (f"time = {MS}\nratio = {LOST}", "", [(0, 0.002, 0.06, None)] * 2),
        (f"ratio = {RATIO}", f"loss_factor = {LOST}", [(0, 0, 0.03, 0.02), (0, 0.002, 0.02, None)]),
        ("", f"time = {MS}", [(0, 0.002, None, None)] * 2),
        (
            f"ratio = {RATIO}",
            f"tau_bend = {TAU}\nloss_bend = {RATIO}",
            [(0.002, 0, 0.01, 0.02), (0, 0.002, 0.02, None)],
        ),
    ],
)
def test_damping_in_the_fields_words_is_of_bushings_that_say_none(words, joint, expected):
    assert damping(with_damping(words, joint)) == expected


@pytest.mark.parametrize(
    ("words", "joint", "line"),
    [
        (f"ratio = {RATIO}\ntime = {MS}", "", "arm.toml:4, damping: got ratio and time"),
        ("", f"ratio = {RATIO}\ntau_tors = {TAU}", "arm.toml:4, joint[0] 'joint1': got ratio and tau_tors"),
        ("", f"ratio = {LOST}\nloss_factor = {LOST}", "arm.toml:4, joint[0] 'joint1': got ratio and loss_factor"),
        ('ratio = { value = 1.5, origin = "paper" }', "", "arm.toml:5, damping.ratio.value: got 1.5, expected"),
        (
            f"ratio = {LOST.replace('0.03', '-1')}",
            "",
            "arm.toml:5, damping.ratio.value.bend: got -1, expected a number >=",
        ),
        (
            f"ratio = {LOST.replace('bend', 'bending')}",
            "",
            "unknown key 'bending', expected one of bend, tors; did you",
        ),
        (
            'ratio = { value = 0.01, unit = "-", origin = "paper" }',
            "",
            "got unknown key 'unit', expected one of origin, note, value; did you mean note?",
        ),
        (
            "ratio = 0.01",
            "",
            'damping.ratio: got 0.01, expected a table; write ratio = { value = ..., origin = "..." }',
        ),
        (
            f"ratios = {RATIO}",
            "",
            "unknown key 'ratios', expected one of ratio, loss_factor, time, alpha; did you mean ratio?",
        ),
    ],
)
def test_a_wrong_word_of_damping_is_told_in_one_line(words, joint, line):
    (message,) = problems(with_damping(words, joint))
    assert line in message


def test_damping_that_is_common_keeps_its_origin_and_is_revised_in_its_joint():
    text = with_damping(f"ratio = {RATIO}")
    assert parse_document(text).origins()["joint1.loss_tors"] == "measured"
    assert damping(changed(K_TORS, 'k_tors = "rigid"').replace("[[j", f"[damping]\nratio = {RATIO}\n[[j", 1))[0] == (
        *(0, None, 0.02, None),
    )
    revised = update_file(text, {"joint1.loss_bend": 0.05}, origin="calibrated")
    assert damping(revised) == [(0, 0, 0.05, 0.02), (0, 0.002, 0.02, None)]
    own = update_file(with_damping("", f"ratio = {RATIO}"), {"joint1.tau_bend": 0.001}, origin="calibrated")
    assert damping(own)[0] == (0.001, 0, 0.02, 0.02)
    assert parse_document(own).origins()["joint1.tau_bend"] == "calibrated"


def test_damping_that_no_bushing_takes_is_refused():
    rigid = re.sub(
        r"tau_.*\n", "", re.sub(r"(k_(bend|tors)) = .*", r'\1 = "rigid"', with_damping("", f"ratio = {RATIO}"), count=2)
    )
    assert "joint[0] 'joint1': got ratio and a rigid bushing, expected damping where it gives" in problems(rigid)[0]
    everywhere = re.sub(r"(k_tors = .*\n)", rf"\1tau_bend = {TAU}\ntau_tors = {TAU}\n", re.sub(r"tau_.*\n", "", TEXT))
    text = everywhere.replace("[[joint]]", f"[damping]\nratio = {RATIO}\n\n[[joint]]", 1)
    assert "got [damping] ratio, expected a bushing without damping of its own" in problems(text)[0]
    assert (
        "got no direction, expected bend, tors or both"
        in problems(with_damping('ratio = { value = {}, origin = "paper" }'))[0]
    )


def test_a_loss_factor_gets_its_place_where_a_file_has_none():
    revised = update_file(TEXT, {"joint1.loss_bend": 0.05}, origin="calibrated")
    assert parse_arm(revised).get("joint1.loss_bend") == 0.05
    assert parse_arm(revised).get("joint1.tau_tors") == parse_arm(TEXT).get("joint1.tau_tors")
    common = update_file(with_damping(f"ratio = {RATIO}"), {"joint1.tau_bend": 0.001}, origin="calibrated")
    assert parse_document(common).origins()["joint2.loss_bend"] == "measured", "as the ratio that it follows from"
    keys = [line.partition(" =")[0] for line in common.splitlines() if line.startswith(("tau_", "loss_"))]
    assert keys[:4] == ["tau_bend", "tau_tors", "loss_bend", "loss_tors"]


def test_damping_by_mass_is_read_and_gets_its_place_where_a_file_has_none():
    table = '[damping]\nalpha = { value = 30, unit = "1/min", origin = "measured" }'
    text = with_damping(table.partition("\n")[2])
    assert parse_arm(text).get(ALPHA) == pytest.approx(0.5)
    assert parse_document(text).origins()[ALPHA] == "measured"
    for before in (text, TEXT):
        updated = update_file(before, {ALPHA: 0.25}, origin="calibrated")
        assert parse_arm(updated).get(ALPHA) == pytest.approx(0.25)
        assert parse_document(updated).origins()[ALPHA] == "calibrated"
    assert ALPHA not in parse_arm(TEXT).paths()


def test_an_arm_that_gives_nowhere_is_refused():
    everywhere = re.sub(r"tau_.*\n", "", re.sub(r"(k_(bend|tors)) = .*", r'\1 = "rigid"', TEXT))
    assert "got every stiffness rigid, expected an arm that gives somewhere" in problems(everywhere)[0]


def test_what_a_rigid_bushing_carries_moves_with_the_one_before():
    light = changed('mass = { value = 2.0, unit = "kg"', 'mass = { value = 0.0, unit = "kg"')
    light = light.replace("inertia = { value = [0.1, 0.2, 0.2]", "inertia = { value = [0, 0, 0]", 1)
    assert "no mass on the bushing" in problems(light)[0]
    held = re.sub(r"(k_(bend|tors)) = \{ value = 1e5.*", r'\1 = "rigid"', light)
    assert parse_arm(re.sub(r"tau_.*\n", "", held)).degrees_of_freedom == 3


def test_all_problems_are_listed_in_the_order_of_the_file():
    text = changed("value = 2.0", "value = -2").replace("[-90, 90]", "[9, -9]").replace('"tip"', '"link1"')
    text = text.replace("[10, 20, 30]", "[10, 20]")
    assert [message.split(",")[0] for message in problems(text)] == [f"arm.toml:{n}" for n in (12, 23, 35, 44)]


def test_a_chain_that_ends_without_mass_is_refused():
    text = changed("value = 6.0", "value = 0").replace("value = 12.0", "value = 0")
    (message,) = problems(text)
    assert "arm.toml:16, joint[1] 'joint2'" in message
    assert "no mass beyond the bushing" in message


def test_a_rotation_that_moves_no_mass_is_refused():
    text = changed("value = 6.0", "value = 0").replace('kind = "box", size = [10, 20, 30], unit = "cm", origin', "#")
    text = text.replace('shape = { # = "assumed" }', 'shape = { kind = "point" }')
    assert "a rotation that moves no mass" in problems(text)[0]


def test_an_arm_without_joints_is_refused():
    (message,) = problems('format = "ident-arm/1"\nname = "x"\n')
    assert "describe each joint in a table [[joint]]" in message
    (message,) = problems('format = "ident-arm/1"\nname = "x"\njoint = []\n')
    assert "arm.toml:3, joint" in message


def test_lines_are_right_after_a_multi_line_text():
    text = changed('name = "two joints"', 'name = "two joints"\ndescription = """\nmass = 3\n[[joint]]\n"""')
    assert problems(text.replace("value = 2.0", "value = -2"))[0].startswith("arm.toml:16, joint[0]")


@pytest.mark.parametrize("text", ["a = " + "[" * 5000, "a = 1" + "0" * 5000, "a = '''", "[[joint]]\n[joint]", "a = 1e"])
def test_hostile_toml_is_a_sentence(text):
    assert "expected TOML" in problems(text)[0]


@pytest.mark.parametrize(
    "text",
    [
        "joint = 3",
        "joint = [3]",
        "joint = {}",
        "joint = [{link = 1}]",
        "point = [{joint = 1, name = 2}]",
        "name = {}",
    ],
)
def test_wrong_structure_is_a_sentence(text):
    for message in problems('format = "ident-arm/1"\n' + text):
        assert message.startswith("arm.toml:")


def written(tmp_path, data):
    path = tmp_path / "arm.toml"
    path.write_bytes(data)
    return path


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "an empty file"),
        (b" \n", "an empty file"),
        (b"name = 1\nname2 = \xff", "arm.toml:2: got the byte 0xff, which is no UTF-8"),
        (b"\x00", "expected a text file in UTF-8"),
    ],
)
def test_a_file_that_is_no_text_is_refused(tmp_path, data, words):
    with pytest.raises(InputError, match=words):
        read_arm(written(tmp_path, data))


def test_an_absent_file_and_a_folder_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"nothing\.toml: got no such file"):
        read_arm(tmp_path / "nothing.toml")
    with pytest.raises(InputError, match="got a directory"):
        read_arm(tmp_path)
    with pytest.raises(InputError, match="null"):
        read_arm("a\0b")


def test_a_byte_order_mark_is_read_over(tmp_path):
    assert read_arm(written(tmp_path, b"\xef\xbb\xbf" + TEXT.encode())).arm.name == "two joints"


def test_revised_text_changes_the_numbers_and_nothing_else():
    values = {"hand.mass": 11.5, "link1.com.x": 0.6, "link1.inertia.yy": 0.25, "hand.shape.size.z": 0.4}
    text = update_file(TEXT, values, origin="calibrated")
    lines = [(a, b) for a, b in zip(TEXT.splitlines(), text.splitlines(), strict=True) if a != b]
    assert [new for _, new in lines] == [
        'com = { value = [600.0, 0, 0], unit = "mm", origin = "calibrated" }',
        'inertia = { value = [0.1, 0.25, 0.2], unit = "kg*m^2", origin = "calibrated" }',
        'mass = { value = 11.5, unit = "kg", origin = "calibrated" } # weighed next week',
        'shape = { kind = "box", size = [10, 20, 40.0], unit = "cm", origin = "calibrated" }',
    ]
    assert parse_arm(text).get("hand.mass") == 11.5
    assert parse_document(text).origins()["hand.mass"] == "calibrated"


def test_revising_finds_what_has_no_unit_and_the_stroke():
    text = PAPER_ARM.read_text()
    values = {"drive2.ratio": -77.0, "stroke.folded": 0.5}
    arm = parse_arm(update_file(text, values, origin="designed"))
    assert {path: float(arm.get(path)) for path in values} == pytest.approx(values)


def test_revising_a_full_tensor_finds_its_diagonal():
    assert parse_arm(update_file(TEXT, {"glass.inertia.yy": 2.5}, origin="measured")).get("glass.inertia.yy") == 2.5


def test_revising_every_written_number_to_itself_keeps_the_arm():
    arm = parse_arm(TEXT)
    derived = ("shaft2.inertia", "hand.inertia", "bolt.inertia", "joint1.tau", "joint2.tau_bend")
    values = {path: float(arm.get(path)) for path in arm.paths() if not path.startswith(derived)}
    again = parse_arm(update_file(TEXT, values, origin="measured"))
    assert len(values) > 30
    for path in arm.paths():
        assert again.get(path) == pytest.approx(float(arm.get(path)), rel=1e-11)


@pytest.mark.parametrize(
    "path", ["hand", "hand.mas", "nobody.mass", "hand.inertia.xx", "hand.mass.x", "joint1.tau_tor"]
)
def test_revising_what_is_not_written_is_refused(path):
    with pytest.raises(InputError, match="a number of this file"):
        update_file(TEXT, {path: 1.0}, origin="calibrated")


def inertia(arm, name):
    return next(np.asarray(part.inertia) for part in arm.parts() if part.name == name)


def same_arm(text, arm):
    again = parse_arm(text)
    assert again.numbers().keys() == arm.numbers().keys()
    for path, value in arm.numbers().items():
        assert float(again.get(path)) == pytest.approx(float(value), rel=1e-11, abs=1e-15)
    for name in ("link1", "shaft2", "hand", "glass"):
        np.testing.assert_allclose(inertia(again, name), inertia(arm, name), rtol=1e-9, atol=1e-15)


def test_a_fitted_mass_leaves_the_inertia_in_place_of_the_shape_that_would_change_it():
    arm = parse_arm(TEXT).replace({"hand.mass": 13.0, "joint1.k_tors": 3.0})
    text = update_arm(TEXT, arm, origin="calibrated")
    same_arm(text, arm)
    assert 'shape = { kind = "box"' not in text
    assert 'shape = { kind = "cylinder"' in text
    assert parse_document(text).origins()["hand.inertia.xx"] == "calibrated"


def test_an_uncertain_mass_takes_its_inertia_along_products_and_all():
    masses = {"hand.mass": 13.0, "glass.mass": 0.5}
    arm = scaled_inertia(parse_arm(TEXT), masses, ("hand", "glass")).replace(masses)
    assert inertia(arm, "glass")[0, 1] == pytest.approx(0.1 * 0.5 / 0.45359237)
    text = update_arm(TEXT, arm, origin="calibrated")
    same_arm(text, arm)
    assert 'shape = { kind = "box"' in text


def test_a_base_that_gives_stands_before_the_first_joint():
    arm = on_soft_base(parse_arm(TEXT), 0.5).replace({"base.k_bend": 7.0, "joint2.k_bend": 2e5})
    text = update_arm(TEXT, arm, origin="calibrated")
    same_arm(text, arm)
    assert not parse_arm(text).joints[0].driven
    origins = parse_document(text).origins()
    assert [origins[path] for path in ("base.k_bend", "base.k_tors", "joint1.offset.z")] == ["calibrated"] + 2 * [
        "assumed"
    ]


def test_revising_to_an_impossible_number_is_refused():
    with pytest.raises(InputError, match=r"'hand'\.mass"):
        update_file(TEXT, {"hand.mass": -1.0}, origin="calibrated")


def test_revising_a_text_that_is_wrong_already_names_its_problem():
    with pytest.raises(InputError, match="expected TOML"):
        update_file("a = ", {}, origin="calibrated")


def test_extents_are_corners_about_the_mass_centre_in_the_file():
    extents = read_arm(PAPER_ARM).extents
    np.testing.assert_allclose(extents["bracket"], [[0, -0.5, 0], [0.29, 0.5, 0.08]], atol=1e-12)
    np.testing.assert_allclose(extents["shaft2"], [[-0.09, -0.09, -0.03], [0.09, 0.09, 0.09]], atol=1e-12)
    np.testing.assert_allclose(extents["glass"], [[0.44, -0.95, 0.06265], [2.64, 0.95, 0.06335]], atol=1e-12)


def test_a_body_without_shape_and_a_point_have_no_extent():
    text = PAPER_ARM.read_text()
    lying = text.replace(
        'shape = { kind = "cylinder", radius = 0.09, length = 0.12, unit = "m"',
        'shape = { kind = "cylinder", radius = 90, length = 120, axis = "x", unit = "mm"',
    )
    found = parse_document(lying).extents()
    np.testing.assert_allclose(found["shaft1"], [[-0.06, -0.09, -0.06], [0.06, 0.09, 0.12]], atol=1e-12)
    box = 'shape = { kind = "box", size = [1.0, 0.20, 0.10], unit = "m", origin = "assumed" }'
    assert "link1" in found
    assert "link1" not in parse_document(text.replace(box, 'shape = { kind = "point" }')).extents()
    given = 'inertia = { value = [1, 2, 2], unit = "kg*m^2", origin = "assumed" }'
    assert "link1" not in parse_document(text.replace(box, given)).extents()


WORKSPACE = """
[workspace]
postures = { value = [[0, 0], [30, -60]], unit = "deg", origin = "measured" }
lowest = { value = 200, unit = "mm", origin = "assumed" }
"""


def test_a_workspace_is_read_in_si(tmp_path):
    (tmp_path / "arm.toml").write_text(TEXT + WORKSPACE)
    workspace = read_arm(tmp_path / "arm.toml").arm.workspace
    np.testing.assert_allclose(workspace.postures, np.deg2rad([[0, 0], [30, -60]]))
    assert workspace.lowest == pytest.approx(0.2)
    assert workspace.line is None
    assert read_arm(PAPER_ARM).arm.workspace.line == (1.0, -2.0, 1.0)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[30, -60]]", "[30, -95]]", "workspace.postures: got joint2 at -95 deg, expected -90 to 90 deg"),
        ("[30, -60]]", "[30]]", "workspace.postures: got 1 numbers, expected 2"),
        ("[[0, 0], [30, -60]]", "[]", "workspace.postures.value: got \\[\\], expected at least 1 entries"),
        ("postures", "line", "workspace.line"),
        ('"mm"', '"kg"', "workspace.lowest"),
    ],
)
def test_a_wrong_workspace_is_told_with_its_line(old, new, words):
    with pytest.raises(InputError, match=words) as caught:
        parse_arm(TEXT + WORKSPACE.replace(old, new))
    first, last = len(TEXT.splitlines()) + 2, len(TEXT.splitlines()) + 5
    assert all(first <= int(p.where.rpartition(":")[2]) <= last for p in caught.value.problems)


def test_the_profile_of_the_stroke_is_read_and_a_wrong_one_is_told():
    text = re.sub(r"(?m)^profile = .*\n", "", PAPER_ARM.read_text())
    assert parse_arm(text).stroke.profile == "s-curve"
    profiled = text.replace("[stroke]\n", '[stroke]\nprofile = { value = "cycloid", origin = "assumed" }\n')
    assert parse_arm(profiled).stroke.profile == "cycloid"
    line = 1 + profiled[: profiled.index("profile = ")].count("\n")
    with pytest.raises(InputError, match="expected 's-curve', 'trapezoid', 'cycloid' or 'minimum-jerk'") as caught:
        parse_arm(profiled.replace('"cycloid"', '"cosine"'))
    assert [p.where for p in caught.value.problems] == [f"arm.toml:{line}"]


def test_a_stroke_beyond_the_joint_limits_is_told_with_its_line():
    text = re.sub(r"(?m)^folded = \{ value = [\d.]+", "folded = { value = 179", PAPER_ARM.read_text())
    with pytest.raises(InputError) as caught:
        parse_arm(text)
    line = 1 + text[: text.index("folded = ")].count("\n")
    assert [p.where for p in caught.value.problems] == [f"arm.toml:{line}"] * 3
    low, high = np.rad2deg(parse_arm(PAPER_ARM.read_text()).joints[1].limits)
    expected = f"{low:.4g} to {high:.4g} deg, its limits"
    assert (caught.value.problems[1].got, caught.value.problems[1].expected) == ("joint2 at -358 deg", expected)


def uncertain(mass: str = "", com: str = "", more: str = "") -> str:
    """The two joints, with what is said of a mass, a mass centre and a stiffness."""
    said = {
        'unit = "kg", origin = "measured"': mass,
        'value = [500, 0, 0], unit = "mm", origin = "assumed"': com,
        'value = 1.0, unit = "N*mm/deg", origin = "paper"': more,
    }
    text = TEXT
    for number, added in said.items():
        text = text.replace(number, number + added)
    return text


def test_a_number_may_say_how_well_it_is_known(tmp_path):
    """A mass, and each component of a position; nothing else is uncertain."""
    path = tmp_path / "arm.toml"
    path.write_text(uncertain(', uncertainty = "5%"', ', uncertainty = "2 mm"'))
    widths = {"link1.mass": "5%", **{f"link1.com.{axis}": "2 mm" for axis in "xyz"}}
    assert read_arm(path).uncertain == widths
    path.write_text(TEXT)
    assert read_arm(path).uncertain == {}


BAD_WIDTHS = [
    ({"mass": ', uncertainty = "2mm"'}, "a standard deviation such as 5% or 2kg"),
    ({"mass": ', uncertainty = "-5%"'}, "a standard deviation such as 5% or 2kg"),
    ({"mass": ", uncertainty = 0.05"}, "text"),
    ({"com": ', uncertainty = "5%"'}, "a standard deviation such as 2mm"),
    ({"com": ', uncertainty = "0mm"'}, "a standard deviation such as 2mm"),
    ({"more": ', uncertainty = "5%"'}, "uncertainty"),
]


@pytest.mark.parametrize(("said", "expected"), BAD_WIDTHS)
def test_a_bad_uncertainty_is_refused_in_its_line(said, expected):
    with pytest.raises(InputError) as refused:
        parse_arm(uncertain(**said))
    assert len(refused.value.problems) == 1
    assert expected in str(refused.value)
    assert re.match(r"arm.toml:\d+", str(refused.value))
