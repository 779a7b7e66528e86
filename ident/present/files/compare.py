"""Changes between two campaigns as rows."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ident.identify.compare import Comparison
from ident.present.text.units import unit_of


def compare_rows(comparisons: Sequence[Comparison], unpaired: Sequence[str] = ()) -> list[dict[str, Any]]:
    """Return a row for each stiffness: both values [SI], their ratio with its 95 % interval, p, and the verdict."""
    several = len(comparisons) > 1
    return [({"campaigns": each.name} if several else {}) | row for each in comparisons for row in _rows(each)]


def _rows(comparison: Comparison) -> list[dict[str, Any]]:
    change = comparison.change
    low, high = np.exp(change.interval).T
    return [
        {
            "parameter": name,
            "unit": unit_of(name),
            "before": float(change.first[i]),
            "after": float(change.second[i]),
            "ratio": float(np.exp(change.change[i])),
            "low_95": float(low[i]),
            "high_95": float(high[i]),
            "p": float(change.p_values[i]),
            "changed": bool(change.changed[i]),
            "open": bool(change.open[i]),
        }
        for i, name in enumerate(change.names)
    ]
