"""One cell of text, read as a number."""

import math
import re

from ident.errors import InputError, Problem
from ident.text import quoted

NUMBER = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?"
"""Regular expression of a plain number with a decimal point."""


def format_number(value: float) -> str:
    """Write a number with all its digits and no idle `.0`; reading it back gives the same float."""
    return repr(float(value)).removesuffix(".0")


def parse_number(text: str, decimal: str = ".") -> float:
    """Read a finite number.

    Args:
        text: the number as written, without blanks around it.
        decimal: the decimal mark in use, `.` or `,`; the other mark is refused, never skipped.

    Returns:
        The number.
    """
    if not re.fullmatch(NUMBER, text.replace(",", ".") if decimal == "," else text) or (decimal == "," and "." in text):
        raise InputError(_not_a_number(text, decimal))
    number = float(text.replace(",", "."))
    if math.isinf(number):
        raise InputError(Problem("", quoted(text), "a finite number", "correct the number"))
    return number


def parse_fraction(text: str, decimal: str = ".") -> float:
    """Read a fraction between 0 and 1, exclusive: `0.005` or `0.5%`."""
    percent = text.endswith("%")
    fraction = parse_number(text.removesuffix("%").rstrip(), decimal) / (100 if percent else 1)
    if not 0 < fraction < 1:
        remedy = "write 2% if percent is meant, or give an absolute sigma"
        raise InputError(Problem("", quoted(text), "a fraction between 0 and 1", remedy))
    return fraction


def _not_a_number(text: str, decimal: str) -> Problem:
    if text.lower().lstrip("+-") in ("nan", "inf", "infinity"):
        return Problem("", quoted(text), "a finite number", "give the number or delete the row")
    if not text:
        return Problem("", "nothing", "a number", "fill the cell")
    if "." in text and "," in text:
        remedy = "remove the thousands separators"
        return Problem("", quoted(text), "a number with at most one decimal mark", remedy)
    name, other = ("point", ",") if decimal == "." else ("comma", ".")
    if other in text:
        remedy = f"write the decimal {name} throughout the file, and no thousands separators"
        return Problem("", quoted(text), f"a number with a decimal {name}", remedy)
    return Problem("", quoted(text), "a number", f"write a plain number such as 12{decimal}5 or 1e-3")
