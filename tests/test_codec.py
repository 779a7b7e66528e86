"""Values as plain data: every kind comes back as it was, foreign ones are refused, and so are hostile documents."""

import math
import sys
from functools import reduce
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from arms import lcd_arm

from ident.codec import CodecError, decode, encode, read_item, value_digest, write_item
from ident.errors import Problem
from ident.inference.optima import Ending, Point
from ident.inference.priors import Prior
from ident.measure import Load


@pytest.fixture
def again(tmp_path):
    """Writes a value into a file and reads it."""

    def through(value):
        write_item(tmp_path / "item", value)
        return read_item(tmp_path / "item")

    return through


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
def test_plain_values_come_back(value, again):
    read = again(value)
    assert read == value
    assert type(read) is type(value)
    if not isinstance(value, frozenset):  # which has no order
        assert repr(read) == repr(value), "to the sign of a zero"


def test_nan_comes_back(again):
    assert math.isnan(again([math.nan])[0])


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
def test_arrays_come_back_to_the_last_bit(array, again):
    read = again(array)
    assert type(read) is np.ndarray
    assert read.dtype == array.dtype
    assert read.shape == array.shape
    assert read.tobytes() == array.tobytes()


@pytest.mark.parametrize("scalar", [np.float64(0.1), np.float64(math.inf), np.int32(3), np.bool_(True), np.str_("a")])
def test_scalars_of_numpy_come_back_as_such(scalar, again):
    read = again(scalar)
    assert type(read) is type(scalar)
    assert read == scalar


def test_arrays_of_jax_come_back_as_such(again):
    array = jnp.array([0.1, math.nan])
    read = again(array)
    assert isinstance(read, type(array))
    assert read.dtype == array.dtype
    assert np.asarray(read).tobytes() == np.asarray(array).tobytes()


def test_named_tuples_and_nested_modules_come_back(again):
    point = again(Point(np.array([1.0]), 0.5, True, np.array([0.0])))
    assert type(point) is Point
    assert point[1:3] == (0.5, True)
    arm = lcd_arm()
    read = again(arm)
    assert type(read) is type(arm)
    assert read.paths() == arm.paths()
    assert all(float(read.get(path)) == float(arm.get(path)) for path in arm.paths())


def test_a_digest_depends_on_values_alone(again):
    """Not on which of them were one object: what is read again has that of what has never been away."""
    point = Point(np.linspace(0, 1, 1000), math.nan, True, jnp.arange(3.0))
    value = {"arm": lcd_arm(), "points": [point, point], "names": frozenset("abcdefgh")}
    assert value_digest(value) == value_digest(again(value))


@pytest.mark.parametrize(
    ("one", "other"),
    [
        *((0.0, -0.0), (1, 1.0), (True, 1), ((1,), [1]), (np.arange(2), np.arange(2.0))),
        *((np.zeros((0, 2)), np.zeros((2, 0))), (np.array(["a"]), np.array(["b"]))),
        (Load(("glass",)), Load(("tray",))),
    ],
)
def test_what_differs_has_another_digest(one, other):
    assert value_digest(Point(one, 0.0, True, None)) != value_digest(Point(other, 0.0, True, None))


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
        np.linalg.eigh(np.eye(2)),
    ):
        with pytest.raises(CodecError):
            encode({"a": [value]}, [])


def test_a_document_can_be_read():
    prior, arrays = Prior(1.0, 2.0, 0.5), []
    document = encode({"posture": (0.0, -60.0), "prior": prior, "array": np.arange(2)}, arrays)
    record = {"record": ["inference.priors:Prior", vars(prior)]}
    pairs = [["posture", {"tuple": [0.0, -60.0]}], ["prior", record], ["array", {"array": 0}]]
    assert document == {"map": [{"tuple": pair} for pair in pairs]}
    assert arrays[0].tolist() == [0, 1]


HOSTILE = {
    "empty": {},
    "a list": [],
    "an unknown tag": {"pickle": "x"},
    "two tags": {"list": [], "tuple": []},
    "an array that is not there": {"array": 1},
    "too deep": reduce(lambda inner, _: {"list": [inner]}, range(5000), 0),
    "a record that is none": {"record": 3},
    "a map with mappings as keys": {"map": [{"tuple": [{"map": []}, 2]}]},
    "half a pair": {"map": [{"tuple": [1]}]},
    "a path that is none": {"path": [3]},
    "a member that is none": {"member": ["inference.profile_path:Ending", "X"]},
    "members of no enumeration": {"member": ["measure.load:Load", "X"]},
}


@pytest.mark.parametrize("case", HOSTILE)
def test_a_hostile_document_is_refused(case):
    with pytest.raises(CodecError):
        decode(HOSTILE[case], [np.zeros(1)])


@pytest.mark.parametrize(
    "name",
    [
        *("os:system", "subprocess:Popen", "builtins:eval", ":eval", "", "errors", "errors:", "errors:nowhere"),
        *("codec:Path", "codec:sys", "codec:sys.modules", "codec:encode", ".os:system", "..os:x"),
        *("__main__:main", "cli.app:app", "errors:Problem.__init__", "errors:__builtins__", "errors:IdentError"),
    ],
)
def test_only_records_that_are_ours_are_made(name):
    with pytest.raises(CodecError):
        decode({"record": [name, {}]}, [])


def test_a_file_imports_nothing():
    before = set(sys.modules)
    with pytest.raises(CodecError, match="no record"):
        decode({"record": ["__main__:Main", {}]}, [])
    assert set(sys.modules) == before


def test_other_fields_are_those_of_another_version():
    document = encode(Prior(1.0, 2.0, 0.5), [])
    values = document["record"][1]
    values["more"] = 1
    with pytest.raises(CodecError, match="another version"):
        decode(document, [])
    del values["more"], values["sd"]
    with pytest.raises(CodecError, match="another version"):
        decode(document, [])
