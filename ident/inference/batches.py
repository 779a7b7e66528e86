"""One function over many parameter sets: as fast for a million of them as for a hundred."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ident.jit import jit

CHUNK = 64
"""Sets computed together: as many as leave all arrays of the model in the processor's cache."""


def in_batches(
    f: Callable[[Float[Array, "P batch"]], Float[Array, "D batch"]], *, chunk: int = CHUNK, threads: int = 1
) -> Callable[[Float[Array, "P batch"]], Float[Array, "D batch"]]:
    """Return f for a trailing batch of any size, compiled, and run chunk by chunk.

    Keep what is returned: every call of `in_batches` compiles anew, as does another size of batch.

    Args:
        f: works on a trailing batch; `InverseProblem.predict` does. Differentiate f, not what is returned.
        chunk: entries computed together.
        threads: parts of the batch that are computed at the same time; f must not call LAPACK then.
    """

    def in_chunks(x: Array) -> Array:
        size = x.shape[-1]
        missing = -size % chunk
        padded = jnp.concatenate([x, jnp.repeat(x[..., -1:], missing, -1)], -1)
        chunks = jnp.moveaxis(padded.reshape((*x.shape[:-1], -1, chunk)), -2, 0)
        y = jnp.moveaxis(jax.lax.map(f, chunks), 0, -2)
        return y.reshape((*y.shape[:-2], -1))[..., :size]

    run = jit(in_chunks)

    def run_in_threads(x: Array) -> Array:
        parts = jnp.array_split(x, threads, -1)
        with ThreadPoolExecutor(threads) as pool:
            return jnp.concatenate([jax.block_until_ready(y) for y in pool.map(run, parts)], -1)

    return run if threads == 1 else run_in_threads
