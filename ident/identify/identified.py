"""What a fit or a posterior says of the numbers of an arm, to be written elsewhere."""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Identified:
    """Numbers of an arm by path, with where they come from.

    Attributes:
        values: fitted value, or median of the draws [SI]; tied numbers each by its own path.
        intervals: 95 % interval of each [SI].
        supported: those of which the data support an interval.
        doubts: what speaks against the fit.
        sources: what they were made from: a word, path and SHA-256 of each file.
    """

    values: Mapping[str, float]
    intervals: Mapping[str, tuple[float, float]]
    supported: frozenset[str]
    doubts: tuple[str, ...]
    sources: tuple[tuple[str, str, str], ...]
