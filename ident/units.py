"""Units as people write them: the one place that asks pint."""

import re
from functools import cache, lru_cache
from typing import Any

import pint

_FACTOR = r"(?:°|[^\W\d]\w*)(?:(?:\^|\*\*)-?[0-9])?"
# Checked before pint sees the text: pint would evaluate numbers, and 9**9**9 takes for ever.
_EXPRESSION = re.compile(rf"(?:1\s*/\s*)?{_FACTOR}(?:\s*[*/ ]\s*{_FACTOR})*")


@cache
def registry() -> pint.UnitRegistry:
    """Return the one unit registry; it takes a moment to build and is kept."""
    return pint.UnitRegistry()


@lru_cache(maxsize=256)
def parse_unit(text: str) -> pint.Unit | None:
    """Return the unit that is written as `mm`, `N*mm/deg` or `kg*m^2`; None when it is none."""
    if len(text) > 60 or not _EXPRESSION.fullmatch(text):
        return None
    try:
        return registry().parse_units(text)
    except Exception:  # pint raises many types on bad text, AttributeError and tokenizer errors among them
        return None


@lru_cache(maxsize=256)
def in_base_units(unit: pint.Unit) -> tuple[float, Any]:
    """Return a unit's factor to SI base units, and these; the radian counts as one, so N m is not N m/rad."""
    factor: Any
    factor, base = registry().get_base_units(unit)
    return float(factor), base
