"""What looks odd about an arm: sound arms pass, each mistake is named by its number."""

import jax
import numpy as np
import pytest
from arms import DATA
from conformance import agrees
from mistakes import KINDS, sound
from mistakes import found as found_mistakes

from ident.arm.arm import Arm
from ident.arm.parts import Body, Joint, Point
from ident.arm.plausibility import MOST_GIVING, behaviour_oddities, oddities
from ident.arm.sizes import carried, reach_of, to_box, to_segment
from ident.description.file import parse_document, read_arm
from ident.errors import InputError

jax.config.update("jax_enable_x64", True)

TEXT = (DATA / "lcd_arm" / "arm.toml").read_text()
LINK1 = 'com = { value = [0.5, 0, 0.06], unit = "m"'
BOX1 = 'shape = { kind = "box", size = [1.0, 0.20, 0.10], unit = "m"'
K1 = '12.52e6, unit = "N*mm/deg"'
MISTAKES = [
    (LINK1, 'com = { value = [2.5, 0, 0.06], unit = "m"', "link1.com", "beyond the ends of its link"),
    (LINK1, 'com = { value = [-1.5, 0, 0.06], unit = "m"', "link1.com", "1.48 m beyond the ends"),
    (LINK1, 'com = { value = [500, 0, 60], unit = "m"', "link1.com", 'unit = "mm"?'),
    (LINK1, 'com = { value = [0.5, 1.3, 0.06], unit = "m"', "link1.com", "away from its link"),
    (K1, '1e4, unit = "N*m/rad"', "joint1.k_bend", "carries 139 kg at 1.3 m: bent 10 deg"),
    (K1, '12.52e6, unit = "N*m/deg"', "joint1.k_bend", "median of all other k_bend"),
    ('[-150, 150], unit = "deg"', '[-150, 150], unit = "rad"', "joint1.limits", 'unit = "deg"'),
    ("offset = { value = [1.0, 0, 0.12]", "offset = { value = [1000, 0, 0.12]", "joint2.offset", "at most 20 m"),
    ("position = { value = [2.79, 0, 0.05]", "position = { value = [0.00279, 0, 0]", "tip.position", "2.79 m"),
    (BOX1, BOX1.replace('"m"', '"mm"'), "link1.mass", "at most 23,000 kg/m^3"),
    ("mass = { value = 42.0,", "mass = { value = 0.01,", "link1.mass", "above 10 kg/m^3"),
    ("mass = { value = 42.0,", "mass = { value = 42e3,", "link1.mass", "kg/m^3"),
    ("ratio = { value = 161,", "ratio = { value = 160,", "belt1", "drive2.ratio = -159"),
    ("ratio = { value = 161,", "ratio = { value = 1.61,", "drive1.ratio", "30 to 320"),
    ('8.0, unit = "mm"', '8.0, unit = "m"', "drive1.eccentricity", "millimetres"),
    ('error = { value = 0, unit = "arcsec"', 'error = { value = 30, unit = "deg"', "drive1.error", "arc minutes"),
    (BOX1, 'inertia = { value = [0.1, 3, 3], unit = "kg*mm^2"', "link1.inertia", "radius of gyration"),
    (BOX1, 'inertia = { value = [1e5, 3e6, 3e6], unit = "kg*m^2"', "link1.inertia", "radius of gyration"),
]

NAMED = {
    "a length in mm, given as m": 1.0,
    "a length in m, given as mm": 0.5,
    "a mass in g, given as kg": 1.0,
    "a mass in kg, given as g": 1.0,
    "a stiffness 1000 times too high": 1.0,
    "a stiffness 1000 times too low": 1.0,
}
"""Share of mistakes in the paper's arm that are named: small bodies on shafts hardly move when they are wrong."""


def found(text):
    document = parse_document(text)
    return oddities(document.arm, document.extents())


def test_the_shipped_arm_is_sound():
    assert found(TEXT) == ()


@pytest.mark.parametrize(("old", "new", "path", "words"), MISTAKES, ids=[f"{m[2]}-{i}" for i, m in enumerate(MISTAKES)])
def test_a_mistake_is_named_by_its_number_and_alone(old, new, path, words):
    assert old in TEXT
    odd = found(TEXT.replace(old, new, 1))
    others = {"belt1", "belt2"} if path == "drive1.ratio" else set()
    assert {each.path for each in odd} - others == {path}
    assert words in str(next(each for each in odd if each.path == path))


def test_the_first_guess_says_that_its_belts_cannot_run():
    arm_file = read_arm(DATA / "lcd_arm" / "first_guess.toml")
    assert [each.path for each in oddities(arm_file.arm, arm_file.extents)] == ["belt1", "belt2"]


def test_all_lengths_in_the_wrong_unit_are_one_finding():
    def long(factor):
        arm = read_arm(DATA / "lcd_arm" / "arm.toml").arm
        paths = [p for p in arm.paths() if p.split(".")[1] in ("com", "offset", "position")]
        return oddities(arm.replace({path: factor * arm.get(path) for path in paths}))

    assert [each.path for each in long(1000.0) if "belt" not in each.path] == ["reach"]
    assert [each.path for each in long(0.001) if "belt" not in each.path] == ["reach"]


def test_an_inertia_of_no_body_is_refused_when_it_is_read():
    with pytest.raises(InputError, match="none above the sum of the other two"):
        found(TEXT.replace(BOX1, 'inertia = { value = [1, 1, 3], unit = "kg*m^2"', 1))


@pytest.mark.parametrize(("kind", "share"), NAMED.items())
def test_mistakes_are_named(kind, share):
    arm_file = read_arm(DATA / "lcd_arm" / "arm.toml")
    made, seen, named = found_mistakes(arm_file.arm, arm_file.extents, *KINDS[kind])
    assert made >= 6
    assert named == seen, "whatever is seen is named by its number"
    assert named >= share * made


def test_sound_arms_are_seldom_warned_of():
    arm_file, rng = read_arm(DATA / "lcd_arm" / "arm.toml"), np.random.default_rng(4)
    warned = sum(bool(oddities(sound(arm_file.arm, rng), arm_file.extents)) for _ in range(25))
    assert warned <= 2  # 2 of 300 in tests/benchmarks/oddities.py


def six_links(bodies, lengths=(0.4, 1.1, 0.2, 1.2, 0.15, 0.2)):
    """An upright arm of the links of a big robot, with these bodies."""
    joints = [
        Joint(
            f"j{n}",
            axis=(0.0, float(n % 2), float(not n % 2)),
            offset=(0.0, 0.0, length),
            k_bend=1e7,
            k_tors=1e7,
            link=(body,),
        )
        for n, (length, body) in enumerate(zip((0.5, *lengths), bodies, strict=False))
    ]
    return Arm("six", tuple(joints), (Point("tool", "j5", (0.0, 0.0, lengths[-1])),))


def filled(masses, lengths=(0.4, 1.1, 0.2, 1.2, 0.15, 0.2), share=0.5, at=0.5):
    """Bodies as boxes of a share of their links' length, their mass centres at a share of it."""
    for n, (mass, length) in enumerate(zip(masses, lengths, strict=True)):
        across = mass / 12 * ((share * length) ** 2 + 0.15**2)
        yield Body(f"b{n}", mass, (0.0, 0.0, at * length), np.diag([across, across, mass / 6 * 0.15**2]))


MASSES = (40.0, 60.0, 30.0, 25.0, 8.0, 4.0)


@pytest.mark.parametrize(
    ("bodies", "paths"),
    [
        ([Body(f"b{n}", 2.0, (0.0,) * 3, 0.01 * np.eye(3)) for n in range(6)], {"bodies.inertia", "bodies.com"}),
        ([Body(f"b{n}", m, (0.0, 0.0, 0.1), np.eye(3)) for n, m in enumerate(MASSES)], {"bodies.inertia"}),
        (list(filled(MASSES, at=0.0)), {"bodies.com"}),
        ([Body(f"b{n}", m, (0, 0, 0.1), 2e-4 * m * np.eye(3)) for n, m in enumerate(MASSES)], {"bodies.inertia"}),
        (list(filled(MASSES)), set()),
        ([*list(filled(MASSES))[:4], *[Body(f"w{n}", 5.0, (0.0,) * 3, 0.02 * np.eye(3)) for n in range(2)]], set()),
    ],
    ids=["placeholders", "one inertia", "mass centres at the joints", "specks", "filled in", "spherical wrist"],
)
def test_bodies_that_nobody_has_filled_in_are_named_together(bodies, paths):
    assert {each.path for each in oddities(six_links(bodies)) if each.path.startswith("bodies")} == paths
    if not paths:
        assert oddities(six_links(bodies)) == ()


def test_equal_modules_and_a_turret_about_its_joint_are_sound():
    equal = [Body(f"b{n}", 3.0, (0.0, 0.0, 0.15), np.diag([0.025, 0.025, 0.005])) for n in range(6)]
    assert oddities(six_links(equal, (0.3,) * 6)) == ()
    turret = [Body("b0", 40.0, (0.0,) * 3, np.diag([1.0, 1.0, 1.0])), *list(filled(MASSES))[1:]]
    assert oddities(six_links(turret)) == ()


def test_stiffnesses_are_compared_with_their_own_kind_and_only_those_that_are_fitted():
    """Springs about the axes of an arm that is rigid across them; then one that is 1000 times too soft, or fixed."""

    def odd(free=None, **k):
        arm = six_links(list(filled(MASSES)))
        names = [joint.name for joint in arm.joints]
        numbers = {f"{name}.k_bend": 1e11 for name in names}
        numbers |= {f"{name}.k_tors": x for name, x in zip(names, (4e6, 5e6, 3e6, 6e5, 5e5, 3e5), strict=True)}
        return {
            each.path for each in oddities(arm.replace(numbers | {f"{p}.k_tors": x for p, x in k.items()}), free=free)
        }

    torsion = [f"j{n}.k_tors" for n in range(6)]
    assert odd() == odd(torsion) == set()
    assert odd(j3=6e8) == odd(torsion, j3=6e8) == {"j3.k_tors"}
    assert odd(torsion[:3], j3=6e8) == set()


@pytest.mark.parametrize(
    "path",
    [
        "lcd_arm/arm.toml",
        "six_axis/arm.xml",
        "ur10/arm.urdf",
        "../ident/description/templates/scara.toml",
        "../ident/description/templates/six-axis.toml",
    ],
)
def test_shipped_arms_are_sound(path):
    arm_file = read_arm(DATA / path)
    assert oddities(arm_file.arm, arm_file.extents) == ()


def rod(mass, length, k, axis=(0.0, 1.0, 0.0)):
    """A rod on one bushing, its mass at its end."""
    tip = Body("tip_mass", mass, (length, 0, 0), 1e-3 * mass * length**2 * np.eye(3))
    return Arm(
        "rod", (Joint("root", axis=axis, k_bend=k, k_tors=k, link=(tip,)),), (Point("end", "root", (length, 0, 0)),)
    )


def test_ten_kilograms_at_three_metres_on_a_soft_bushing():
    assert {each.path for each in oddities(rod(10.0, 3.0, 1e4))} == {"root.k_bend", "root.k_tors"}
    enough = 1.01 * 10.0 * 9.80665 * 3.0 / MOST_GIVING
    assert oddities(rod(10.0, 3.0, enough)) == ()


def test_weight_never_turns_a_vertical_axis():
    assert {each.path for each in oddities(rod(10.0, 3.0, 1e4, axis=(0.0, 0.0, 1.0)))} == {"root.k_bend"}


def test_what_a_bushing_carries_is_that_of_points():
    arm = rod(2.0, 3.0, 1e5)
    (root,) = carried(arm)
    assert (root.mass, root.distance) == pytest.approx((2.0, 3.0))
    assert root.inertia == pytest.approx(2.0 * 9.0 * 1.001)
    every = carried(read_arm(DATA / "lcd_arm" / "arm.toml").arm)
    # by hand: masses of arm.toml; first moment over mass of all that joint 3 carries
    masses = [each.mass for each in every]
    agrees(
        masses,
        [138.7708, 84.7708, 38.3758],
        "mechanics",
        "mass that each joint carries",
        "by hand",
        rtol=1e-6,
        unit="kg",
    )
    moment = np.array([8 * 0.0 + 19.1122 * 0.145 + 11.2636 * 1.54, 8 * 0.03 + 19.1122 * 0.04 + 11.2636 * 0.05])
    expected, what = np.linalg.norm(moment) / 38.3758, "distance of the mass that joint 3 carries"
    agrees(every[2].distance, expected, "mechanics", what, "first moment over mass, by hand", rtol=1e-6, unit="m")
    assert reach_of(arm) == 3.0


@pytest.mark.parametrize(
    ("frequency", "damping", "sag", "words"),
    [
        ([0.3, 5.0], [0.01, 0.01], 0.001, "0.3 Hz, 70 %"),
        ([500.0, 900.0], [0.01, 0.01], 0.001, "500 Hz"),
        ([5.0, 9.0], [0.01, 0.6], 0.001, "damping ratio of 60 %"),
        ([5.0, 9.0], [0.01, 0.01], 0.3, "sags by 300 mm"),
        ([5.0, 9.0], [0.01, 0.01], 0.001, None),
    ],
)
def test_how_an_arm_behaves_is_checked(frequency, damping, sag, words):
    energy = np.array([[0.3], [0.7]])
    odd = [*behaviour_oddities(rod(1.0, 3.0, 1e6), np.array(frequency), np.array(damping), energy, sag)]
    assert len(odd) == (words is not None)
    assert words is None or words in str(odd[0])


def test_distances_to_a_link():
    end = np.array([2.0, 0.0, 0.0])
    assert to_segment(np.array([1.0, 3.0, 0.0]), end) == pytest.approx(3.0)
    assert to_segment(np.array([6.0, 3.0, 0.0]), end) == pytest.approx(5.0)
    assert to_segment(np.array([0.0, 3.0, 4.0]), np.zeros(3)) == pytest.approx(5.0)
    assert to_box(end, np.array([[0.5, 1.0, -1.0], [1.0, 2.0, 1.0]])) == pytest.approx(1.0)
    assert to_box(end, np.array([[3.0, 1.0, 0.0], [4.0, 2.0, 1.0]])) == pytest.approx(np.sqrt(2.0))
    assert to_box(end, np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])) == 0.0


def three_links(masses, points=(("tip", "j2", 0.4),), fingers=0.0):
    """An arm of three links of 0.4 m, the last one with two fingers to its side."""
    bodies = [Body(f"link{n}", m, [0.2, 0, 0], m * np.diag([1e-3, 0.014, 0.014])) for n, m in enumerate(masses)]
    beside = [Body(f"finger{n}", fingers, [0.4, y, 0.3], fingers * 1e-3 * np.eye(3)) for n, y in enumerate((-1.2, 1.2))]
    joints = [
        Joint(
            f"j{n}",
            axis=[0, 1, 0],
            offset=[0.4 * (n > 0), 0, 0],
            k_bend=1e6,
            k_tors=1e6,
            link=(body, *beside * (n == 2)),
        )
        for n, body in enumerate(bodies)
    ]
    return Arm("three", tuple(joints), points=tuple(Point(name, joint, [x, 0, 0]) for name, joint, x in points))


ELBOW = (("tip", "j2", 0.4), ("elbow", "j0", 0.4))


@pytest.mark.parametrize(
    ("arm", "words"),
    [
        (three_links((20e3, 12e3, 5e3)), ('bodies.mass: 3.7e+04 kg on a reach of 1.2 m; expected 37 kg; unit = "g"',)),
        (three_links((0.02, 0.012, 0.005)), ('bodies.mass: 0.037 kg on a reach of 1.2 m; expected 37 kg; unit = "t"',)),
        (three_links((20, 0.042, 5)), ('link1.mass: 42 g between 20 and 5 kg; expected 42 kg; unit = "kg"?',)),
        (three_links((20, 0.4, 5)), ()),
        (three_links((20, 12, 5), fingers=1e-6), ()),
        (three_links((20, 12, 5), ELBOW), ("end point: elbow, 0.4 m of 1.2 m reach; expected the hand's",)),
        (three_links((20, 12, 5), ELBOW[::-1]), ()),
    ],
)
def test_masses_of_another_unit_and_an_end_point_at_the_elbow_are_named(arm, words):
    found = list(map(str, oddities(arm)))
    assert len(found) == len(words)
    assert all(word in each for word, each in zip(words, found, strict=True))
