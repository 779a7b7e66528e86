"""Names for modes by what moves: `vertical bending 1`, `lateral torsion 1`, and how a measured name finds its mode.

A mode is `bending` or `torsion` by where most of the bushings' strain energy sits, `vertical` or `lateral` by how the
arm's end point moves, and numbered in ascending frequency among the modes of the same name.
"""

import re
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ident.arm.modes import Modes

AMBIGUOUS = 0.1
"""A share this near to one half leaves the name of a mode open."""


@dataclass(frozen=True)
class Label:
    """What a measurement says of its mode.

    Attributes:
        direction: `vertical`, `lateral`, or None for either.
        kind: `bending`, `torsion`, or None for either.
        ordinal: 1 for the lowest such mode.
    """

    direction: str | None
    kind: str | None
    ordinal: int

    def admits(self, other: "Label") -> bool:
        """Whether what this says of direction and kind is true of the other."""
        return self.direction in (None, other.direction) and self.kind in (None, other.kind)

    def __str__(self) -> str:
        return " ".join(str(part) for part in (self.direction, self.kind, self.ordinal) if part)


def parse_label(text: str) -> Label | None:
    """Read a label such as `vertical bending 1`, `torsion 2` or `lateral 1`; None when it is none."""
    match = re.fullmatch(r"(?:(vertical|lateral)\s*)?(?:(bending|torsion)\s*)?(\d{1,3})", text.strip().lower())
    if not match or int(match[3]) < 1 or not (match[1] or match[2]):
        return None
    return Label(match[1], match[2], int(match[3]))


def torsion_share(modes: Modes) -> Float[Array, "m *batch"]:
    """Return the share of the strain energy in torsion."""
    return modes.tors.sum(0)


def vertical_share(modes: Modes) -> Float[Array, "m *batch"]:
    """Return the share of vertical motion in the end point's squared displacement."""
    squared = modes.motion[:, -1] ** 2
    return squared[2] / squared.sum(0)


def mode_labels(modes: Modes) -> list[Label]:
    """Name the modes of one chain (no batch), ascending."""
    return labels_of_shares(np.asarray(torsion_share(modes)), np.asarray(vertical_share(modes)))


def labels_of_shares(torsion: Float[np.ndarray, "m"], vertical: Float[np.ndarray, "m"]) -> list[Label]:
    """Name modes, ascending, by their shares of torsion and of vertical motion."""
    names = [
        ("vertical" if v > 0.5 else "lateral", "torsion" if t > 0.5 else "bending")
        for t, v in zip(torsion, vertical, strict=True)
    ]
    return [Label(*name, names[: i + 1].count(name)) for i, name in enumerate(names)]


def is_ambiguous(modes: Modes) -> Bool[Array, "m *batch"]:
    """Tell which modes are named by a near draw, so that a small change may rename them."""
    return (jnp.abs(torsion_share(modes) - 0.5) < AMBIGUOUS) | (jnp.abs(vertical_share(modes) - 0.5) < AMBIGUOUS)
