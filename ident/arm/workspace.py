"""Where an arm may be held, besides its joint limits."""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Workspace:
    """The postures in which an arm can be measured: on a line, in a list, above a height.

    Attributes:
        line: (driven,) shares of the pins in the one motion that belts or couplings allow; None where all turn freely.
        postures: (driven,) [rad] each, where no others can be held; empty for all.
        lowest: [m] height in the base frame below which no bushing and no named point may come.
    """

    line: tuple[float, ...] | None = None
    postures: tuple[tuple[float, ...], ...] = ()
    lowest: float = -math.inf


ANYWHERE = Workspace()
"""Within the joint limits only."""
