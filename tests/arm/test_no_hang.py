"""Big batches end: concurrent batched LAPACK calls in jax 0.10 wait for each other for ever on two threads."""

import os
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ident.arm.arm import Arm, stiffness_paths
from ident.arm.chain import at_posture
from ident.arm.mechanics import deflection
from ident.arm.modes import damped_eigenvalues, linearize, natural_frequencies
from ident.arm.parts import Body, Joint, Point

pytestmark = pytest.mark.slow

LIMIT = 240  # s; a hang is for ever, compilation on a busy machine takes most of a minute


def body(name):
    return Body(name, 5.0, (0.4, 0.0, 0.05), np.diag([0.05, 0.2, 0.2]))


def joint(name):
    return Joint(name, offset=(0.8, 0.0, 0.1), k_bend=9e4, k_tors=7e4, tau_bend=1e-4, link=(body("b" + name),))


ARM = Arm("two", (joint("p"), joint("q")), points=(Point("tip", "q", (0.8, 0.0, 0.0)),))
PATHS = stiffness_paths(ARM)


def sets(count):
    present = jnp.stack([ARM.get(path) for path in PATHS])
    return present[:, None] * jnp.asarray(np.random.default_rng(0).uniform(0.5, 2, (len(PATHS), count)))


def chain(k):
    return at_posture(ARM.replace(dict(zip(PATHS, k, strict=True))), jnp.zeros((2,) + (1,) * (k.ndim - 1)))


def answers(k):
    system = linearize(chain(k))
    return natural_frequencies(chain(k), 3), deflection(chain(k), system.phi)[:, 0]


def damped(k):
    return jnp.abs(damped_eigenvalues(linearize(chain(k))))


def damped_and_slopes(k):
    return damped(k), jax.jvp(damped, (k,), (k,))[1]


def lapack_calls(f, k):
    return jax.jit(f).lower(k).as_text().count("@lapack")


@pytest.mark.parametrize("f", [answers, jax.vmap(jax.jacrev(answers), 1)])
def test_nothing_that_runs_side_by_side_calls_lapack(f):
    """A hang is a matter of chance; that no such call stands in the program is none."""
    assert lapack_calls(f, sets(20)) == 0


def test_the_damped_eigenvalues_do():
    assert lapack_calls(damped, sets(1)[:, 0]) == 1, "else the test above sees none"


@pytest.mark.timeout(LIMIT + 30)
def test_damped_eigenvalues_of_many_with_gradients_end():
    """Batched LAPACK hung within 400 such calls, 3 runs of 3."""
    done = subprocess.run(
        [sys.executable, __file__],
        env={**os.environ, "PJRT_NPROC": "2"},
        timeout=LIMIT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout.strip() == "ended", done.stderr


def often(f, k):
    program = jax.jit(f)
    for _ in range(300):
        found = jax.block_until_ready(program(k))
    return found


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    values, slopes = often(jax.vmap(damped_and_slopes), sets(200).T)
    assert values.shape == (200, 6)
    assert slopes.shape == (200, 6)
    assert np.isfinite(values).all()
    assert np.isfinite(slopes).all()
    print("ended")
