"""Programs of a fit compiled with half the effort: there are hundreds of them here, and each runs for moments.

To be imported before the rooms of the package. What runs long keeps its options: simulations, and the chains of a
sampler.
"""

from typing import Any

from ident import jit

OF_FITS = ("ident.identify.", "ident.inference.least_squares", "ident.inference.fit_many")
plain = jit.jit


def quick(f: Any, options: Any = jit.SMALL_KERNELS) -> Any:
    """Compile f as `ident.jit.jit` does, a part of a fit in half the time."""
    return plain(f, jit.RUNS_ONCE if f.__module__.startswith(OF_FITS) else options)


jit.jit = quick
