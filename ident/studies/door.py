"""The one door of the studies: inputs of a user become values once, by parameter name."""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import wraps
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from ident.errors import InputError, Problem, refuse
from ident.studies.options import default_of, specs
from ident.studies.shared import UnitOptions, as_campaign, as_file, as_log
from ident.studies.values import drawn_values, fitted_values
from ident.text import did_you_mean
from ident.units import stiffness_in

if TYPE_CHECKING:
    from ident.identify.values import Values
    from ident.measure import Log, Trace

R = TypeVar("R")
"""Result of a study."""
DEFAULT: Any = None
"""Stands for the default options of a study."""


class Input(NamedTuple):
    """An input of studies.

    Attributes:
        value: type that the study receives, its annotation of the parameter.
        given: type that a user may give, as `help` shows it.
        read: converts the input, given the inputs that were read before, `options` and `arm` among them.
    """

    value: str
    given: str
    read: Callable[[Any, Mapping[str, Any]], Any]


def _fitted(fit: Any, known: Mapping[str, Any]) -> "Values":
    return fitted_values(fit, known["arm"], known["options"])


def _draws(posterior: Any, known: Mapping[str, Any]) -> "Values | None":
    options = known["options"]
    return drawn_values(posterior, known["arm"], options.draws, getattr(options, "seed", None), options)


def _log(path: Any, known: Mapping[str, Any]) -> "Log":
    return as_log(path, known["arm"].arm, known["options"].columns)


def _trace(trace: Any, known: Mapping[str, Any]) -> "Trace":
    from ident.measure import Trace, read_trace

    return trace if isinstance(trace, Trace) else read_trace(trace, known["options"].columns)


CAMPAIGN = Input("Campaign", "Campaign | pandas.DataFrame | str | Path", lambda campaign, known: as_campaign(campaign))
INPUTS = {
    "arm": Input("ArmFile", "Arm | ArmFile | str | Path", lambda arm, known: as_file(arm, known["options"].soft_base)),
    "campaign": CAMPAIGN,
    "measured": CAMPAIGN,
    "fit": Input("Values", "Values | FitResult | str | Path", _fitted),
    "posterior": Input("Values", "Values | SampleResult | str | Path", _draws),
    "path": Input("Log", "Log | str | Path", _log),
    "trace": Input("Trace", "Trace | str | Path", _trace),
}
"""Inputs by the parameter's name, in the order in which they are read."""


def study(function: Callable[..., R]) -> Callable[..., R]:
    """Make a study from a function of values: users may also give files and results, and options as keywords.

    A parameter of `INPUTS` is read if the function annotates it with the value's type; others are passed on unread.
    Keywords as in `fit(arm, campaign, fix="*.k_bend")` update the given or the default options. Signature and `help`
    show these, and the types that users may give.

    Raises:
        InputError: a keyword that is no option of the study, or an unreadable input.
    """
    own = inspect.signature(function)
    kind: type[UnitOptions] = own.parameters["options"].annotation
    read = {
        name: each
        for name, each in INPUTS.items()
        if name in own.parameters and own.parameters[name].annotation in (each.value, f"{each.value} | None")
    }

    @wraps(function)
    def call(*given: Any, **named: Any) -> R:
        keywords = {name: named.pop(name) for name in list(named) if name not in own.parameters}
        options_of = [each.name for each, _ in specs(kind)]
        where, expected = function.__name__, f"one of {kind.__name__}"
        refuse(
            Problem(where, f"the option {name}", expected, did_you_mean(name, options_of, "drop it"))
            for name in keywords
            if name not in options_of
        )
        inputs = own.bind(*given, **named)
        inputs.apply_defaults()
        known = inputs.arguments
        options = known["options"] = replace(kind.of(known["options"]), **keywords)
        with stiffness_in(options.units):
            for name, each in read.items():
                if known[name] is not None or own.parameters[name].default is inspect.Parameter.empty:
                    known[name] = each.read(known[name], known)
            try:
                return function(*inputs.args, **inputs.kwargs)
            except InputError as error:
                if known.get("arm") is None or "arm" not in read:
                    raise
                raise InputError(map(known["arm"].placed, error.problems)) from None

    def shown(parameter: inspect.Parameter) -> inspect.Parameter:
        if parameter.name == "options":
            return parameter.replace(annotation=kind | None)
        if parameter.name not in read:
            return parameter
        none = " | None" * parameter.annotation.endswith(" | None")
        return parameter.replace(annotation=read[parameter.name].given + none)

    offered = [(each, spec) for each, spec in specs(kind) if each.name not in (*kind.refuses, *own.parameters)]
    keywords = [
        inspect.Parameter(each.name, inspect.Parameter.KEYWORD_ONLY, default=default_of(each), annotation=each.type)
        for each, _ in offered
    ]
    signature = own.replace(parameters=[*map(shown, own.parameters.values()), *keywords])
    lines = "".join(f"\n        {each.name}: {spec.help}." for each, spec in offered)
    call.__doc__ = inspect.cleandoc(function.__doc__ or "") + f"\n\nKeyword Args:{lines}".replace("\n    ", "\n")
    call.__signature__ = signature  # type: ignore[attr-defined]
    given_types = {each.name: each.annotation for each in signature.parameters.values()}
    call.__annotations__ = call.__annotations__ | given_types
    return call
