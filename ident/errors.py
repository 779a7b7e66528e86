"""What ident says when something is wrong: one sentence that names the place and the remedy."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, TypeVar

T = TypeVar("T")
R = TypeVar("R")
LONGEST = 300
"""Characters of each part of a problem that its line shows."""
ARM_FILE = "arm file"
"""Where a number of an arm is wrong, for who knows no file; the door of the studies names it, with the line."""
LINES_MAX = 20
"""Problems that a message lists: who mends these will mend what is left by the same change."""


def one_line(text: str) -> str:
    """Escape line breaks and control characters, so that a message stays on one line."""
    return "".join(char if char.isprintable() else repr(char)[1:-1] for char in text)


@dataclass(frozen=True)
class Problem:
    """One thing wrong with an input.

    Attributes:
        where: file and row, as `file:row`, or file and key; for a value given in code its name, alone or as `column`.
        got: what was found.
        expected: what would have been right.
        remedy: what to do about it.
        column: column or field name; empty when the whole row or file is meant.
    """

    where: str
    got: str
    expected: str
    remedy: str
    column: str = ""

    def __str__(self) -> str:
        where, column, got, expected, remedy = (
            one_line(part if len(part) <= LONGEST else part[:LONGEST] + "…")
            for part in (self.where, self.column, self.got, self.expected, self.remedy)
        )
        place = ", ".join(part for part in (where, column) if part)
        prefix = f"{place}: " if place else ""
        return f"{prefix}got {got}, expected {expected}; {remedy}"


class IdentError(Exception):
    """Root of all errors that ident raises on purpose."""


class InputError(IdentError):
    """An input is wrong; `problems` has every problem that was found, the message a line for each of the first ones."""

    def __init__(self, problems: Problem | Iterable[Problem]):
        self.problems = (problems,) if isinstance(problems, Problem) else tuple(problems)
        lines = [str(problem) for problem in self.problems[:LINES_MAX]]
        if more := len(self.problems) - len(lines):
            lines.append(f"and {more} more problem{'s' if more > 1 else ''}; correct those above first")
        super().__init__("\n".join(lines))

    def __reduce__(self) -> tuple[Any, ...]:
        """Return how another process makes it again."""
        return type(self), (self.problems,)


def refusal(where: str, got: str, expected: str, remedy: str, column: str = "") -> InputError:
    """Return the error of one thing wrong, see `Problem`."""
    return InputError(Problem(where, got, expected, remedy, column))


def require(fine: object, where: str, got: str, expected: str, remedy: str, column: str = "") -> None:
    """Raise an InputError of one thing wrong, see `Problem`, unless all is fine."""
    if not fine:
        raise refusal(where, got, expected, remedy, column)


@contextmanager
def noted(problems: list[Problem]) -> Iterator[None]:
    """Add the problems of an InputError to others, so that all are reported at once."""
    try:
        yield
    except InputError as error:
        problems += error.problems


@contextmanager
def placed(where: str, column: str = "") -> Iterator[None]:
    """Give the problems of an InputError their file and row, and their column: they speak of no option then."""
    try:
        yield
    except InputError as error:
        raise InputError(replace(each, where=where, column=column or each.column) for each in error.problems) from None


def every(read: Callable[[T], R], items: Iterable[T]) -> list[R]:
    """Return what is read of each item; the problems of all are reported at once."""
    problems, found = list[Problem](), list[R]()
    for item in items:
        with noted(problems):
            found.append(read(item))
    refuse(problems)
    return found


def refuse(problems: Iterable[Problem]) -> None:
    """Raise an InputError if there is any problem."""
    if problems := tuple(problems):
        raise InputError(problems)


class NoChannelError(InputError):
    """A sound file without any data for a test."""


class LackingError(InputError):
    """A file needs a package that is not installed; files of the same format need it too."""


class ModelError(IdentError):
    """The model has no answer for these values, for example because the arm collapses."""


class ConvergenceError(ModelError):
    """A computation ended short of its own criterion: no optimum was reached, or a tolerance was not met."""
