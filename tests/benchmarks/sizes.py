"""A prediction, and what it costs for arms of other sizes."""

import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from timing import timed

from ident.arm.arm import Arm, stiffness_paths
from ident.arm.chain import at_posture
from ident.arm.mechanics import deflection, static_equilibrium
from ident.arm.modes import lowest_eigenpairs, to_hertz
from ident.arm.parts import Body, Joint, Point

MODES = 4


def predictor(arm: Arm, posture: np.ndarray) -> Callable[[Any], Any]:
    """Return frequencies and the last point's drop as a function of the stiffnesses (P, *batch)."""
    paths = stiffness_paths(arm)

    def predict(k: Any) -> Any:
        q = jnp.asarray(posture).reshape(posture.shape + (1,) * (k.ndim - posture.ndim))
        chain = at_posture(arm.replace(dict(zip(paths, k, strict=True))), q)
        at = static_equilibrium(chain)
        values = to_hertz(lowest_eigenpairs(chain, at, count=min(MODES, at.W.shape[0]))[0])
        return jnp.concatenate([values, -deflection(chain, at.phi)[2, -1:]])

    return predict


def column(joints: int) -> Arm:
    """Return an arm of equal joints, its axes in turn y and z."""
    body = {"mass": 20 / joints, "com": (0.5 / joints, 0.0, 0.02), "inertia": np.diag([0.05, 0.2, 0.2]) / joints}
    axes = [(0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
    return Arm(
        f"column{joints}",
        tuple(
            Joint(
                f"j{j}",
                axis=axes[j % 2],
                offset=(1 / joints, 0.0, 0.02),
                k_bend=3e5,
                k_tors=2e5,
                link=(Body(f"l{j}", **body),),
            )
            for j in range(joints)
        ),
        points=(Point("tip", f"j{joints - 1}", (1 / joints, 0.0, 0.0)),),
    )


def sizes(quick: bool) -> None:
    """Cost against the number of joints and of postures."""
    print("\nOne compiled prediction of an arm of N joints at S postures: us for each posture, and CPU s to compile")
    postures = (1, 8) if quick else (1, 4, 16, 64)
    print("  N \\ S" + "".join(f"{s:>20d}" for s in postures))
    for joints in (1, 3, 6) if quick else (1, 2, 3, 4, 6, 8, 12):
        arm, line = column(joints), f"{joints:7d}"
        for size in postures:
            q = np.random.default_rng(0).uniform(-1, 1, (joints, size))
            k = jnp.asarray([arm.get(path) for path in stiffness_paths(arm)])
            f, begin = predictor(arm, q), time.process_time()
            program = jax.jit(lambda k, f=f: f(k[:, None])).lower(k).compile()
            spent = time.process_time() - begin
            line += f"{timed(lambda: program(k), 20, size)[0]:12.4g} ({spent:4.1f})"  # noqa: B023
        print(line, flush=True)
