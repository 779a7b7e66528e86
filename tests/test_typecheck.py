"""Shapes and types are checked where the modules of ident are imported in tests, in the first calls of a function."""

import importlib
import inspect
import pkgutil
import sys

import numpy as np
import pytest
import typecheck
from jaxtyping import TypeCheckError, install_import_hook

MODULE = """
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


def twice(x: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    return 2 * x


def maker():
    def inner(x: Float[np.ndarray, "3"]) -> float:
        return float(x.sum())

    return inner


@dataclass
class Pair:
    a: Float[np.ndarray, "n"]
    b: Float[np.ndarray, "n"]
"""


@pytest.fixture
def module(tmp_path, monkeypatch):
    (tmp_path / "checked_module.py").write_text(MODULE)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "checked_module", raising=False)
    with install_import_hook(["checked_module"], "typecheck.checked"):
        import checked_module
    return checked_module


def call(module, name, x):
    if name == "Pair":
        return module.Pair(x, np.zeros(3))
    return (module.maker() if name == "inner" else module.twice)(x)


@pytest.mark.parametrize("name", ["twice", "Pair", "inner"])
def test_a_wrong_shape_is_refused_in_the_first_calls(module, name):
    for _ in range(10):
        call(module, name, np.zeros(3))
        with pytest.raises(TypeCheckError):
            call(module, name, np.zeros(2))


@pytest.mark.parametrize("name", ["twice", "Pair", "inner"])
def test_after_those_a_function_runs_as_it_is_written(module, name):
    for _ in range(typecheck.CALLS):
        call(module, name, np.zeros(3))
    call(module, name, np.zeros(2))


@pytest.mark.parametrize("room", [*typecheck.ROOMS, *typecheck.COMPUTING])
def test_every_room_is_checked(room):
    """Its functions are those of the checker."""
    package = importlib.import_module(f"ident.{room}")
    every = pkgutil.walk_packages(getattr(package, "__path__", ()), f"{package.__name__}.")
    modules = [package, *(importlib.import_module(module.name) for module in every)]
    own = (f for m in modules for f in vars(m).values() if inspect.isfunction(f) and f.__module__ == m.__name__)
    assert any(f.__code__.co_filename == typecheck.__file__ for f in own)
