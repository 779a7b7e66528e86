"""Amplitudes, limits and changes in words: what the reports of sweeps, sensitivities and designs share."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from ident.assess.basis import Basis
from ident.present.text.basis import load_in_words, motion_in_words
from ident.present.text.units import MM, unit_of
from ident.vibrate.redesign.variable import Variable
from ident.vibrate.response.amplitude import MEASURES
from ident.vibrate.response.study import DIRECTIONS


def simulated_in_words(basis: Basis, *, elastic_belts: bool, rate: float) -> Iterator[str]:
    """Say what is moved and how that is simulated."""
    yield from motion_in_words(basis)
    yield f"{load_in_words(basis, elastic_belts, rate)}; fast method"


def present_in_words(
    basis: Basis, measure: str, amplitude: Float[np.ndarray, "3"], limit: float | None, remark: str = ""
) -> Iterator[str]:
    """Tell the amplitudes [m] of the arm as it is, and whether they keep a limit."""
    sizes = ", ".join(f"{d} {mm(size)} mm" for d, size in zip(DIRECTIONS, amplitude, strict=True))
    yield f"Vibration of {basis.point}, {measure}: {MEASURES[measure]}"
    yield f"  as the arm is: {sizes}"
    if limit is not None:
        yield f"  {limit_in_words(amplitude, limit)}{remark}"


def limit_in_words(amplitude: Float[np.ndarray, "3"], limit: float) -> str:
    """Say in which directions amplitudes exceed a limit [m]."""
    beyond = [d for d, size in zip(DIRECTIONS, amplitude, strict=True) if size > limit]
    words = f"exceeded in {', '.join(beyond)}" if beyond else "kept in all directions"
    return f"limit of {MM * limit:g} mm: {words}"


def change_in_words(variable: Variable, change: float) -> str:
    """Write a change as `1.26x` or `+0.05 m`."""
    if variable.shifted:
        return f"{change:+.4g} {unit_of(variable.paths[0])}".removesuffix(" -")
    return f"{np.exp(change):.4g}x"


def mm(value: float) -> str:
    """Write a length in mm."""
    return f"{MM * value:.4f}"
