"""Values as plain data: every kind comes back as it was, foreign ones are refused, and so are hostile documents."""

import json
import math
from functools import reduce
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from arms import lcd_arm

from ident.codec import CodecError, decode, encode
from ident.errors import Problem
from ident.inference.optima import Ending, Point
from ident.inference.parameters import Parameter, Parameters
from ident.inference.priors import Prior
from ident.measure import Load


def through_json(value, arrays=None):
    """Write a value as strict JSON and read it again."""
    return decode(json.loads(json.dumps(encode(value, arrays), allow_nan=False)), arrays)


@pytest.mark.parametrize(
    "value",
    [
        *(None, True, False, 0, -7, 2**70, 0.1, -0.0, 5e-324, math.inf, -math.inf, "", "größe", "float"),
        *([], [1, [2.0, "x"]], (), (1,), ((1, 2), [3]), frozenset(), frozenset({"a", "b"})),
        *({}, {"a": 1}, {"map": {"tuple": [1]}}, {1: "x", (1, 2): "y", None: "z", 0.5: ()}),
        *(slice(None), slice(1, None, 2), Path("out/a.json")),
        *(Ending.OPEN, Ending.MODEL, {Ending.OPEN: 1}),
        Prior(1.0, 2.0, 0.5),
        Load.parse("glass + 5 kg @ tip + 20 N -z @ tip"),
        Problem("a", "b", "c", "d"),
    ],
    ids=lambda value: type(value).__name__,
)
def test_plain_values_come_back(value):
    again = through_json(value)
    assert again == value
    assert type(again) is type(value)
    if not isinstance(value, frozenset):  # which has no order
        assert repr(again) == repr(value), "to the sign of a zero"


def test_nan_comes_back():
    assert math.isnan(through_json([math.nan])[0])


ARRAYS = [
    np.array(1.5),
    np.arange(6).reshape(2, 3),
    np.arange(6.0).reshape(2, 3).T,
    np.array([math.nan, -math.inf, -0.0, 5e-324]),
    np.zeros((0, 3)),
    np.array([True, False]),
    np.array([1 + 2j]),
    np.array([1, 2], ">i4"),
    np.array(["a", "größe"]),
    np.arange(3, dtype=np.float32),
]


@pytest.mark.parametrize("array", ARRAYS, ids=str)
def test_arrays_come_back_to_the_last_bit(array):
    again = through_json(array)
    assert type(again) is np.ndarray
    assert again.dtype == array.dtype.newbyteorder("=")
    assert again.shape == array.shape
    assert again.tobytes() == array.astype(again.dtype).tobytes()


@pytest.mark.parametrize("scalar", [np.float64(0.1), np.float64(math.inf), np.int32(3), np.bool_(True), np.str_("a")])
def test_scalars_of_numpy_come_back_as_such(scalar):
    again = through_json(scalar)
    assert type(again) is type(scalar)
    assert again == scalar


def test_arrays_of_jax_come_back_as_such():
    array = jnp.array([0.1, math.nan])
    again = through_json(array)
    assert isinstance(again, type(array))
    assert again.dtype == array.dtype
    assert np.asarray(again).tobytes() == np.asarray(array).tobytes()


def test_large_arrays_are_kept_apart_where_there_is_a_place_for_them():
    large, small = np.linspace(0, 1, 1000), np.arange(3.0)
    arrays = {}
    document = encode([large, small, jnp.asarray(large), large > 0.5, large * 1j], arrays)
    assert len(arrays) == 4, "those of a thousand numbers"
    assert {each.dtype.kind for each in arrays.values()} <= {"f", "b"}, "netCDF knows no complex numbers"
    assert len(json.dumps(document)) < 300
    first, second, third, fourth, fifth = decode(document, arrays)
    np.testing.assert_array_equal(fifth, large * 1j)
    np.testing.assert_array_equal(first, large)
    np.testing.assert_array_equal(second, small)
    np.testing.assert_array_equal(third, large)
    np.testing.assert_array_equal(fourth, large > 0.5)


def test_named_tuples_and_nested_modules_come_back():
    point = through_json(Point(np.array([1.0]), 0.5, True, np.array([0.0])))
    assert type(point) is Point
    assert point[1:3] == (0.5, True)
    arm = lcd_arm()
    again = through_json(arm)
    assert type(again) is type(arm)
    assert again.paths() == arm.paths()
    assert all(float(again.get(path)) == float(arm.get(path)) for path in arm.paths())


def test_an_object_that_is_held_twice_comes_back_as_one():
    item = Parameter(("a",), True, 1.0, 1.0)
    value = {"items": Parameters((item, item)), "first": item, "other": Parameter(("a",), True, -0.0, 1.0)}
    text = json.dumps(encode(value))
    assert text.count('"inference.parameters:Parameter"') == 2
    assert text.count('{"same": 1}') == 2
    again = through_json(value)
    assert again["items"].items[0] is again["items"].items[1] is again["first"]
    assert again["other"] is not again["first"]


def test_a_document_does_not_depend_on_which_objects_were_one():
    """What is read again, as a stage of an interrupted run, is written as what has never been away."""
    point = Point(np.linspace(0, 1, 1000), math.nan, True, jnp.arange(3.0))
    value = {"arm": lcd_arm(), "points": [point, point], "names": frozenset("abcdefgh")}
    whole, apart = {}, {}
    one = encode({"first": value, "second": value, "third": lcd_arm()}, whole)
    other = encode({"first": value, "second": through_json(value), "third": through_json(lcd_arm())}, apart)
    assert json.dumps(one) == json.dumps(other)
    assert {name: array.tobytes() for name, array in whole.items()} == {n: a.tobytes() for n, a in apart.items()}
    assert json.dumps(one).count('"arm.arm:Arm"') == 1


@pytest.mark.parametrize(
    ("one", "other"),
    [
        *((0.0, -0.0), (1, 1.0), (True, 1), ((1,), [1]), (np.float64(1), 1.0), (np.arange(2), np.arange(2.0))),
        *((np.zeros(1), jnp.zeros(1)), (np.zeros((0, 2)), np.zeros((2, 0))), (np.array(["a"]), np.array(["b"]))),
    ],
)
def test_what_differs_is_not_taken_for_the_same(one, other):
    first, second = through_json([Point(one, 0.0, True, None), Point(other, 0.0, True, None)])
    for before, after in ((one, first[0]), (other, second[0])):
        assert type(after) is type(before)
        assert repr(after) == repr(before)


def test_of_two_equal_loads_each_keeps_its_place():
    first, second = through_json([Load(("glass",)), Load(("glass",))])
    assert first == second


class Foreign:
    pass


def test_what_is_not_ours_is_refused():
    for value in (
        lambda: 1,
        print,
        Foreign(),
        Foreign,
        object(),
        1j,
        b"bytes",
        {1, 2},
        iter([]),
        np.array([Foreign()]),
    ):
        with pytest.raises(CodecError):
            encode({"a": [value]})


def test_a_document_can_be_read():
    prior, array = encode(Prior(1.0, 2.0, 0.5)), np.array([[0.1, math.inf], [1e-300, -0.0]])
    assert prior == {"class": "inference.priors:Prior", **vars(Prior(1.0, 2.0, 0.5))}
    assert encode(array) == {"numpy": [[0.1, "inf"], [1e-300, -0.0]]}
    assert encode(np.arange(2)) == {"numpy": [0, 1], "dtype": "<i8"}
    assert encode({"posture": (0.0, -60.0)}) == {"map": {"posture": [0.0, -60.0]}}


HOSTILE = {
    "empty": {},
    "an unknown tag": {"pickle": "x"},
    "no such object": {"same": 1},
    "an object of itself": {"class": "inference.parameters:Parameters", "as": 1, "items": [{"same": 1}]},
    "too deep": reduce(lambda inner, _: [inner], range(5000), 0),
    "a class that is none": {"class": 3},
    "a map with mappings as keys": {"map": [[{"map": {}}, 2]]},
    "half a pair": {"map": [[1]]},
    "a number that is none": {"float": "x"},
    "a path that is none": {"path": 3},
    "no numbers": {"numpy": ["x", 1.0]},
    "rows of several lengths": {"numpy": [[1.0], [1.0, 2.0]]},
    "objects in an array": {"numpy": [1.0], "dtype": "O"},
    "a type that is none": {"numpy": [1.0], "dtype": "(1,"},
    "another shape": {"numpy": [1.0, 2.0], "shape": [3]},
    "a huge shape": {"numpy": [], "shape": [10**30]},
    "half a complex number": {"numpy": [1.0], "dtype": "<c16"},
    "an array that is not there": {"numpy": {"apart": "a0"}},
    "text for jax": {"jax": ["a"], "dtype": "<U2"},
    "a member that is none": {"enum": "inference.profile_path:Ending", "member": "X"},
    "members of no enumeration": {"enum": "measure.load:Load", "member": "X"},
}


@pytest.mark.parametrize("case", HOSTILE)
def test_a_hostile_document_is_refused(case):
    with pytest.raises(CodecError):
        decode(HOSTILE[case])


@pytest.mark.parametrize(
    "name",
    [
        *("os:system", "subprocess:Popen", "builtins:eval", ":eval", "", "errors", "errors:", "errors:nowhere"),
        *("codec:Path", "codec:importlib", "codec:importlib.import_module", "codec:encode", ".os:system", "..os:x"),
        *("__main__:main", "cli.app:app", "errors:Problem.__init__", "errors:__builtins__", "errors:IdentError"),
    ],
)
def test_only_classes_of_values_that_are_ours_are_made(name):
    with pytest.raises(CodecError):
        decode({"class": name})


def test_other_fields_are_those_of_another_version():
    document = encode(Prior(1.0, 2.0, 0.5))
    document["more"] = 1
    with pytest.raises(CodecError, match="another version"):
        decode(document)
    del document["more"], document["sd"]
    with pytest.raises(CodecError, match="another version"):
        decode(document)
