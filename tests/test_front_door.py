"""The front door: light to import, the same names wherever they are listed, each with a docstring and its units."""

import ast
import importlib
import inspect
import re
import subprocess
import sys
from pathlib import Path

import pytest

import ident
from ident.studies import MODULES, module_of
from ident.studies.options import specs
from ident.studies.result import Alias

HERE = Path(__file__).parents[1]
SOURCE = ast.parse((HERE / "ident" / "__init__.py").read_text(encoding="utf-8"))
REFERENCE = (HERE / "docs" / "reference.md").read_text(encoding="utf-8")
QUANTITY = re.compile(r"\bfloat\b|\bFloat\b|\bArray\b|\bndarray\b|\bcomplex\b")
"""Annotation of what has a unit."""
NO_QUANTITY = re.compile(r"table|fields|recorded|figures")
"""Members whose numbers have units of their own, said beside each."""
by_name = pytest.mark.parametrize("name", ident.__all__)


def names_for_type_checkers():
    block = next(node for node in SOURCE.body if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING")
    return {alias.name: node.module for node in block.body for alias in node.names}


def of_the_door(module):
    program = f"import sys, {module}; print(*sorted(sys.modules))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


def test_the_door_opens_without_a_library():
    loaded = of_the_door("ident")
    assert "ident.errors" in loaded
    assert not loaded & {"numpy", "jax", "matplotlib", "scipy", "pydantic", "typer"}


def test_a_fit_loads_neither_the_sampler_nor_what_vibrates():
    loaded = of_the_door(
        "ident.studies.stiffness.fit, ident.identify.fit, ident.studies.result_values, "
        "ident.studies.stiffness.fit_report"
    )
    assert "ident.inference.fit" in loaded
    others = "emcee", "scipy.stats", "scipy.optimize", "arviz", "optimistix", "ident.vibrate"
    assert not {name for name in loaded if name.startswith(others)}


def test_a_prediction_loads_what_fits_only_where_it_fits():
    loaded = of_the_door(
        "ident.studies.look.predict, ident.identify.values, ident.studies.look.prediction, "
        "ident.studies.look.predict_report"
    )
    assert "ident.studies.look.prediction" in loaded
    assert not {name for name in loaded if name.startswith(("optimistix", "scipy.optimize", "matplotlib", "rich"))}


def test_help_and_a_campaign_that_is_refused_load_neither_jax_nor_numpy():
    loaded = of_the_door(
        "ident.cli, ident.measure.reading, ident.studies.stiffness.fit, ident.studies.working.spectrum"
    )
    assert "ident.measure.campaign" in loaded
    assert not loaded & {"numpy", "jax", "scipy", "matplotlib", "rich", "jaxtyping"}


def test_the_first_name_switches_to_double_precision():
    program = "import ident; ident.Load; import jax; print(jax.config.jax_enable_x64)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True"]


def test_what_is_no_name_is_refused():
    with pytest.raises(AttributeError, match=r"no attribute 'fitt'; did you mean fit\?"):
        ident.fitt  # noqa: B018


def test_type_checkers_see_the_names_of_the_door():
    errors = {"ConvergenceError", "IdentError", "InputError", "ModelError"}
    assert {*names_for_type_checkers(), *errors} == set(ident.__all__)
    assert set(ident.__all__) <= set(dir(ident))


@pytest.mark.parametrize(("name", "module"), names_for_type_checkers().items())
def test_each_name_is_that_of_its_module(name, module):
    assert getattr(ident, name) is getattr(importlib.import_module(module), name)


def test_the_reference_lists_the_same_names():
    listed = re.findall(r"^\.\. auto\w+:: ident\.(\w+)$", REFERENCE, re.MULTILINE)
    assert sorted(listed) == sorted(ident.__all__)


def test_the_docstring_lists_every_function_in_the_order_of_the_reference():
    functions = [name for name in ident.__all__ if inspect.isfunction(getattr(ident, name))]
    listed = re.findall(r"^    (\w+)  +\S", ident.__doc__, re.MULTILINE)
    assert sorted(listed) == sorted(functions)
    assert re.findall(r"^\.\. autofunction:: ident\.(\w+)$", REFERENCE, re.MULTILINE) == listed


@by_name
def test_each_name_has_a_docstring(name):
    value = getattr(ident, name)
    missing = [member for member, each in [(name, value), *members(value)] if not inspect.getdoc(each)]
    assert not missing


@pytest.mark.parametrize("study", [name for name in MODULES if name not in ("export", "show")])
def test_help_shows_the_keywords_of_a_study(study):
    module = module_of(study)
    function, kind = getattr(module, study), getattr(module, f"{study.capitalize()}Options")
    own = inspect.signature(function.__wrapped__).parameters
    shown = inspect.signature(function).parameters
    assert {*own} <= {*shown}
    offered = {each.name for each, _ in specs(kind)} - {*kind.refuses}
    assert offered <= {*shown}
    assert not {*shown} & {*kind.refuses}
    assert all(f"\n    {name}: " in function.__doc__ for name in shown)
    assert shown["units"].default == kind().units


@by_name
def test_each_quantity_has_a_unit(name):
    value = getattr(ident, name)
    quantities = [each for each in [(name, value), *members(value)] if gives_quantity(*each)]
    assert not [member for member, each in quantities if not unit(inspect.getdoc(each))]
    assert not [field for field, text in quantity_fields(value) if not unit(text)]


def members(value):
    """Public methods and properties that a class of this house defines, inherited ones included."""
    if not inspect.isclass(value):
        return []
    own = [base for base in value.__mro__ if base.__module__.startswith("ident")]
    defined = {name: each for base in reversed(own) for name, each in vars(base).items() if not name.startswith("_")}
    return [(name, plain(each)) for name, each in defined.items() if plain(each)]


def plain(member):
    """The function of a property or method, or an alias; none for a field."""
    if isinstance(member, Alias):
        return member
    inner = getattr(member, "fget", None) or getattr(member, "func", None) or getattr(member, "__func__", None)
    inner = inspect.unwrap(inner or member) if callable(inner or member) else None
    return inner if inspect.isfunction(inner) else None


def gives_quantity(name, value):
    annotation = str(getattr(value, "__annotations__", {}).get("return", ""))
    return bool(QUANTITY.search(annotation)) and not NO_QUANTITY.fullmatch(name)


def quantity_fields(value):
    """Fields with a quantity of a class, each with its line in the docstring; options say their units in their help."""
    if not inspect.isclass(value) or name_of_options(value):
        return
    section = re.split(r"^Attributes:$", inspect.getdoc(value) or "", flags=re.MULTILINE)[-1]
    lines = dict(re.findall(r"^    (\w+): (.*(?:\n        .*)*)", section, re.MULTILINE))
    for field, annotation in inspect.get_annotations(value).items():
        if QUANTITY.search(str(annotation)) and not field.startswith("_"):
            yield field, lines.get(field, "")


def name_of_options(value):
    return value.__name__.endswith("Options")


def unit(text):
    return bool(text) and "[" in text


def test_the_checks_see_what_they_look_for():
    class Sample:
        """A value.

        Attributes:
            force: (3,) [N] one
                that acts.
            mass: of a body.
        """

        force: float
        mass: float

    assert [(field, unit(text)) for field, text in quantity_fields(Sample)] == [("force", True), ("mass", False)]
    assert gives_quantity("intervals", plain(vars(ident.FitResult)["intervals"]))
    assert "parameters" in dict(members(ident.FitResult))
    assert {"save", "report"} <= dict(members(ident.FitResult)).keys()
