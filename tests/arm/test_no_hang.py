"""Big batches end: concurrent batched LAPACK calls in jax 0.10 wait for each other for ever on two threads."""

import os
import subprocess
import sys

import pytest

pytestmark = pytest.mark.slow

LIMIT = 240  # s; a hang is for ever, compilation on a busy machine takes most of a minute
HEAD = """
import jax
jax.config.update("jax_enable_x64", True)
import jax.numpy as jnp
import numpy as np
from ident.arm.arm import Arm, stiffness_paths
from ident.arm.parts import Body, Joint, Point
from ident.arm.chain import at_posture
from ident.arm.equilibrium import deflection
from ident.arm.modes import damped_eigenvalues, linearize, natural_frequencies

body = lambda n: Body(n, 5.0, (0.4, 0.0, 0.05), np.diag([0.05, 0.2, 0.2]))
joint = lambda n: Joint(n, offset=(0.8, 0.0, 0.1), k_bend=9e4, k_tors=7e4, tau_bend=1e-4, link=(body("b" + n),))
arm = Arm("two", (joint("p"), joint("q")), points=(Point("tip", "q", (0.8, 0.0, 0.0)),))
paths = stiffness_paths(arm)
old = jnp.stack([arm.get(path) for path in paths])
many = lambda n: old[:, None] * jnp.asarray(np.random.default_rng(0).uniform(0.5, 2, (len(paths), n)))

def often(f, k):
    # a hang is a matter of chance: batched LAPACK hung within 400 such calls, 3 runs of 3
    program = jax.jit(f)
    for _ in range(300):
        found = jax.block_until_ready(program(k))
    return found

def answers(k):
    chain = at_posture(arm.replace(dict(zip(paths, k, strict=True))), jnp.zeros((2,) + (1,) * (k.ndim - 1)))
    system = linearize(chain)
    return natural_frequencies(chain, 3), deflection(chain, system.phi)[:, 0]
"""
PROGRAMS = {
    "2000 stiffness sets, native batch": """
f, d = often(answers, many(2000))
assert f.shape == (3, 2000) and d.shape == (3, 2000)
""",
    "2000 stiffness sets, vmap": """
f, d = often(jax.vmap(answers), many(2000).T)
assert f.shape == (2000, 3) and d.shape == (2000, 3)
""",
    "gradients of 500": """
f, d = often(jax.vmap(jax.jacrev(answers)), many(500).T)
assert f.shape == (500, 3, 4) and d.shape == (500, 3, 4)
""",
    "damped eigenvalues of 500, vmap, with gradients": """
def damped(k):
    chain = at_posture(arm.replace(dict(zip(paths, k, strict=True))), jnp.zeros(2))
    return jnp.abs(damped_eigenvalues(linearize(chain)))
f, d = often(jax.vmap(lambda k: (damped(k), jax.jacfwd(damped)(k))), many(500).T)
assert f.shape == (500, 6) and d.shape == (500, 6, 4)
""",
}


@pytest.mark.timeout(LIMIT + 30)
@pytest.mark.parametrize("program", PROGRAMS)
def test_ends(program: str) -> None:
    check = "\nassert np.isfinite(f).all() and np.isfinite(d).all()\nprint('ended')"
    done = subprocess.run(
        [sys.executable, "-c", HEAD + PROGRAMS[program] + check],
        env={**os.environ, "PJRT_NPROC": "2"},
        timeout=LIMIT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout.strip() == "ended", done.stderr
