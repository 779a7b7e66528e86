"""Where and along what was measured, in words."""

import numpy as np

from ident.modal.frf import Place
from ident.present.text.words import cut


def place_in_words(place: Place) -> str:
    """Write a place as `tip -z`, or with the components of its direction."""
    axes = np.array(place.direction)
    along = np.flatnonzero(abs(axes) > 1 - 1e-9)
    if len(along):
        return f"{cut(place.point, 12)} {'-' if axes[along[0]] < 0 else ''}{'xyz'[along[0]]}"
    return f"{cut(place.point, 12)} ({' '.join(f'{each + 0.0:.2g}' for each in axes)})"
