"""Shapes and types are checked where the modules of ident are imported in tests, in the first calls of a function."""

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


@pytest.mark.parametrize("name", ["twice", "Pair", "inner"])
def test_a_wrong_shape_is_refused_in_the_first_calls(module, name):
    two, three = np.zeros(2), np.zeros(3)
    call = {"twice": module.twice, "Pair": lambda x: module.Pair(x, three), "inner": lambda x: module.maker()(x)}[name]
    for _ in range(10):
        call(three)
        with pytest.raises(TypeCheckError):
            call(two)


@pytest.mark.parametrize("name", ["twice", "Pair", "inner"])
def test_after_those_a_function_runs_as_it_is_written(module, name):
    two, three = np.zeros(2), np.zeros(3)
    call = {"twice": module.twice, "Pair": lambda x: module.Pair(x, three), "inner": lambda x: module.maker()(x)}[name]
    for _ in range(typecheck.CALLS):
        call(three)
    call(two)
