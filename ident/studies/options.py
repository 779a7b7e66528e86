"""Options of a study as a value: each with its help, unit and range in one place.

Both `ident --help` and the checks of command line and Python follow from these.
"""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass, replace
from numbers import Integral, Real
from types import NoneType, UnionType
from typing import Any, ClassVar, Self, dataclass_transform, get_args, get_origin

from ident.errors import Problem, refusal, refuse
from ident.text import did_you_mean

INPUTS = ("path", "fit", "posterior", "trace", "against", "arm", "restart", "force", "posture")
"""Inputs of studies that the command line takes as flags, too."""
GONE = ("batch", "dask", "revolutions")
"""Options of earlier versions that a record may contain."""
WORDS: dict[Any, tuple[type, str]] = {
    bool: (bool, "True or False"),
    int: (Integral, "a whole number"),
    float: (Real, "a number"),
    str: (str, "a text"),
    tuple: (tuple | list, "several values, as (one,) or (one, two)"),  # type: ignore[dict-item]
    dict: (Mapping, "a mapping, as {name: value}"),
}
"""Accepted types for each type of option, and their description."""


@dataclass(frozen=True)
class Spec:
    """Description of an option.

    Attributes:
        help: one clause, with the unit in brackets.
        low: least allowed value.
        above: value that it must exceed.
        high: largest allowed value: for a number of repetitions, what an hour and the memory can hold.
        choices: allowed words.
        flag: name on the command line; by default the option's own.
        short: one letter with a dash, as a further name.
        argument: the library's name for it, where error messages use another name.
        repeated: whether the flag may be given several times.
        read: converts the flag's text, or all its texts, to the value; the flag's name is for errors.
        text: the default as text, for options that are read from text.
    """

    help: str
    low: float | None = None
    above: float | None = None
    high: float = math.inf
    choices: tuple[str, ...] = ()
    flag: str = ""
    short: str = ""
    argument: str = ""
    repeated: bool = False
    text: str = ""
    read: Callable[[Any, str], Any] | None = None

    def problem(self, value: Any) -> str:
        """Say which value would be right; empty if this one is."""
        if self.choices and value not in (*self.choices, None):
            return f"one of {', '.join(self.choices)}"
        if isinstance(value, Real) and not isinstance(value, bool):
            value = _as_float(value)
            if self.above is not None and not (self.above < value <= self.high and value < math.inf):
                return f"a number above {self.above:g}" + (f", at most {self.high:g}" if self.high < math.inf else "")
            if self.low is not None and not (self.low <= value <= self.high and value < math.inf):
                return f"a number from {self.low:g}" + (f" to {self.high:g}" if self.high < math.inf else "")
            if not math.isfinite(value):
                return "a finite number"
        return ""


def option(default: Any, help: str, **more: Any) -> Any:
    """Return a field of an `Options` class; `more` is as in `Spec`."""
    spec = {"spec": Spec(help, **more)}
    if isinstance(default, dict | list):
        return field(default_factory=lambda: type(default)(default), metadata=spec)
    return field(default=default, metadata=spec)


def repeated(default: Any, help: str, **more: Any) -> Any:
    """Return an option whose flag may be given several times; `read` converts all its texts to the value."""
    return option(default, help, repeated=True, **more)


def seed_of_draws() -> Any:
    """Return the option that chooses draws of a posterior at random."""
    return option(None, "choose the draws at random; default: spread evenly over the chains", low=0, high=1e18)


@dataclass_transform(kw_only_default=True, frozen_default=True)
@dataclass(frozen=True, kw_only=True)
class Options:
    """Options of a study, checked at construction: a frozen dataclass of keywords, as each of its subclasses.

    Raises:
        InputError: a value out of its range, with the option's name.
    """

    refuses: ClassVar[tuple[str, ...]] = ()
    """Shared options that this study does not accept: help does not offer them."""
    instead: ClassVar[str] = "leave it out; `ident fit` takes it"
    """Remedy for such an option."""

    def __init_subclass__(cls, **more: Any) -> None:
        super().__init_subclass__(**more)
        dataclass(frozen=True, kw_only=True)(cls)

    def __post_init__(self) -> None:
        problems = []
        for each, spec in specs(type(self)):
            value = getattr(self, each.name)
            if spec.read and _is_text(value, spec.repeated):
                value = spec.read((value,) if spec.repeated and isinstance(value, str) else value, each.name)
                object.__setattr__(self, each.name, value)
            if expected := _misfit(value, each.type) or spec.problem(value):
                number = isinstance(value, Real) and not isinstance(value, bool)
                got = f"{_as_float(value):g}" if number else f"{value!r:.60}"
                remedy = did_you_mean(value, spec.choices, "correct it") if isinstance(value, str) else "correct it"
                problems.append(Problem(each.name, got, expected, remedy))
        refuse(problems or self.problems())

    @classmethod
    def of(cls, options: "Self | None") -> Self:
        """Return the given options of a study, or the default ones.

        Raises:
            InputError: options of another study.
        """
        if isinstance(options, cls | None):
            return options or cls()
        raise refusal("options", f"a {type(options).__name__}", f"{cls.__name__}(...)", "give those")

    def problems(self) -> list[Problem]:
        """Return the contradictory or unsupported options; `where` of each is an option's name."""
        given = [name for name in self.refuses if getattr(self, name)]
        return [Problem(name, "it", f"no `{name}` in this study", self.instead) for name in given]

    def recorded(self) -> dict[str, Any]:
        """Return the options as result files record them."""
        return {each.name: getattr(self, each.name) for each, _ in specs(type(self))}

    @classmethod
    def restored(cls, recorded: Mapping[str, Any]) -> Self:
        """Return options from the record of a result file; newer options and addresses get their default.

        Raises:
            InputError: options of no such study, or out of range.
        """
        types = {each.name: each.type for each, _ in specs(cls)}
        own = {name: value for name, value in recorded.items() if name not in GONE}
        if unknown := [name for name in own if name not in types]:
            raise refusal("options", f"the option {unknown[0]}", f"one of {cls.__name__}", "correct it")
        return cls(**{name: _restored(value, types[name]) for name, value in own.items()})


def _restored(value: Any, kind: Any) -> Any:
    """Return a value of an option from JSON, in which tuples are lists and infinite numbers null."""
    if isinstance(value, Mapping):
        (_, own) = get_args(kind) if get_origin(kind) is dict else (None, None)
        if isinstance(own, type) and is_dataclass(own):
            return {name: own(**each) if isinstance(each, Mapping) else each for name, each in value.items()}
        return {name: math.inf if each is None else _restored(each, own) for name, each in value.items()}
    return tuple(_restored(each, None) for each in value) if isinstance(value, list) else value


def _is_text(value: Any, repeated: bool) -> bool:
    """Whether an option is given as on the command line: as a text, or as several if it is repeated."""
    several = repeated and isinstance(value, tuple | list) and bool(value)
    return isinstance(value, str) or (several and all(isinstance(each, str) for each in value))


def _as_float(value: Any) -> float:
    """Return a number as a float; an integer may exceed the range of floats."""
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


def _misfit(value: Any, kind: Any) -> str:
    """Say which type a value should have, if it has the wrong one; empty if not."""
    kinds = get_args(kind) if isinstance(kind, UnionType) else (kind,)
    wanted = [WORDS[get_origin(one) or one] for one in kinds if (get_origin(one) or one) in WORDS]
    fits = [type_ for type_, _ in wanted]
    if not wanted or (value is None and NoneType in kinds) or isinstance(value, tuple(fits)):
        return "" if not isinstance(value, bool) or bool in fits or not wanted else wanted[0][1]
    return " or ".join(words for _, words in wanted)


def specs(kind: type[Options]) -> list[tuple[Field[Any], Spec]]:
    """Return the options of a class in order, each with its description."""
    return [(each, each.metadata["spec"]) for each in fields(kind) if "spec" in each.metadata]


def default_of(each: Field[Any]) -> Any:
    """Return the default of an option."""
    return each.default if each.default is not MISSING else each.default_factory()  # type: ignore[operator]


def flag_of(each: Field[Any]) -> str:
    """Return the command-line flag of an option."""
    spec: Spec = each.metadata["spec"]
    return spec.flag or f"--{each.name.replace('_', '-')}"


def renamed(kind: type[Options], problem: Problem) -> Problem:
    """Return an error message about options, or about `options` in backticks, with the names of the flags.

    A message with both a place and a column is about a file, whatever the column's name.
    """
    flags = {each.name: flag_of(each) for each, _ in specs(kind)}
    flags |= {name: f"--{name}" for name in INPUTS} | {"folder": "--out"}
    flags |= {spec.argument: flag_of(each) for each, spec in specs(kind) if spec.argument}

    def in_words(text: str) -> str:
        return re.sub(r"`(\w+)`", lambda match: flags.get(match[1], match[0]), text)

    plain = replace(problem, where=in_words(problem.where), got=in_words(problem.got))
    plain = replace(plain, expected=in_words(problem.expected), remedy=in_words(problem.remedy))
    flag = flags.get("" if problem.column and problem.where else problem.column or problem.where)
    return replace(plain, where=flag, column="") if flag else plain


# -------- Words
# Choices of options from rooms that are too heavy to import for `ident --help`.

STROKE_PROFILES = ("s-curve", "trapezoid", "cycloid", "minimum-jerk")
"""The profiles of `ident.arm.parts`."""
WINDOWS = ("hann", "boxcar", "hamming", "blackmanharris", "flattop")
"""The windows of `ident.vibrate.spectra`."""
MEASURES = ("peak", "rms", "residual")
"""The measures of `ident.vibrate.simulate`."""
