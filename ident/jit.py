"""`jit` for programs of many small kernels, as all of the arm's are."""

import os
from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ident.programs import Programs

AnyArray = jax.Array | np.ndarray
F = TypeVar("F", bound=Callable[..., Any])
SMALL_KERNELS: Any = {
    "compiler_options": {
        "xla_backend_optimization_level": 1,
        "xla_llvm_disable_expensive_passes": True,
        "xla_cpu_use_fusion_emitters": False,
        "xla_cpu_experimental_ynn_fusion_type": "LIBRARY_FUSION_TYPE_INDIVIDUAL_CONVOLUTION",
    }
}
"""Less optimisation, which takes a quarter off the compilation and costs these programs nothing. XLA's other CPU code
generator (jax 0.10): 20 % fewer kernels, compiled together, so a third faster to compile. And nothing left to its
library of neural networks, which hands out sums of a few terms to threads: convolutions, of which there are none."""
LONG_LOOPS: Any = {
    "compiler_options": {
        **SMALL_KERNELS["compiler_options"],
        "xla_backend_optimization_level": 3,
        "xla_llvm_disable_expensive_passes": False,
    }
}
"""For a program that goes round one loop a hundred thousand times: a third less time for no more of compilation. For
the samples of the fast method, too: a seventh less. Its integration gains nothing, slopes lose a tenth."""
RUNS_ONCE: Any = {"compiler_options": {**SMALL_KERNELS["compiler_options"], "xla_backend_optimization_level": 0}}
"""For a program that runs once or twice, on few numbers: half the compilation."""


def cores() -> int:
    """Return how many cores this process may use: a container or `taskset` may leave it fewer than there are."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def jit(f: F, options: Any = SMALL_KERNELS) -> F:
    """Compile f at its first call; arrays in its arguments are traced, all else is static.

    What was traced in an earlier process is read from a file, see `ident.programs`. Within another program that is
    being traced or differentiated, f is a part of that: jax admits compiler options at the outermost one only.
    """
    outermost, within, known = eqx.filter_jit(f, **options), eqx.filter_jit(f), Programs(f, options)

    @wraps(f)
    def call(*args: Any, **more: Any) -> Any:
        leaves, tree = jax.tree.flatten((args, more))  # once: of a model it takes longer than its prediction
        if is_traced(leaves):
            return within(*args, **more)
        program = known.find(args, more, (leaves, tree))
        return program(leaves) if program else outermost(*args, **more)

    return cast("F", call)


def is_traced(leaves: list[Any]) -> bool:
    """Return whether any of these is traced, or a program is being: then what is made anew is a tracer, too."""
    return any(isinstance(leaf, jax.core.Tracer) for leaf in leaves) or isinstance(jnp.zeros(()), jax.core.Tracer)


def library(*values: Any) -> Any:
    """Return jax's NumPy where anything is traced, else NumPy: each operation of jax would be a program of its own."""
    return jnp if any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(values)) else np


def concrete(tree: Any) -> Any:
    """Return a tree with NumPy's arrays, where nothing is traced."""
    return tree if library(tree) is jnp else jax.tree.map(np.asarray, tree)
