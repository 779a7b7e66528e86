"""How fast ident is, beside MuJoCo, SciPy and LAPACK in the same run: `python tests/benchmarks/benchmark.py [--quick]`.

Times are minimum and median over repetitions. No test depends on them.
"""

import argparse
import dataclasses
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp
import numpy as np
import scipy.linalg as sl
from compiled_peer import CompiledPeer, build
from peer import Peer
from scipy.optimize import least_squares
from shell import DATA
from sizes import MODES, predictor, sizes
from timing import machine, table, timed

from ident.arm.arm import Arm, stiffness_paths
from ident.description.file import read_arm
from ident.identify.conditions import bind
from ident.identify.predict import ArmModel
from ident.identify.unknowns import Unknowns, stiffness_parameters
from ident.inference.fit import fit
from ident.inference.problem import InverseProblem
from ident.inference.search import solve
from ident.measure import Campaign, read_campaign
from ident.programs import jit

CHUNK = 32
"""Sets computed together: as many as leave all arrays of the model in the processor's cache."""


def in_batches(f: Callable[[Any], Any], *, threads: int = 1) -> Callable[[Any], Any]:
    """Return f for a trailing batch of any size, compiled, and run chunk by chunk, some parts at the same time."""

    def in_chunks(x: Any) -> Any:
        size = x.shape[-1]
        padded = jnp.concatenate([x, jnp.repeat(x[..., -1:], -size % CHUNK, -1)], -1)
        chunks = jnp.moveaxis(padded.reshape((*x.shape[:-1], -1, CHUNK)), -2, 0)
        y = jnp.moveaxis(jax.lax.map(f, chunks), 0, -2)
        return y.reshape((*y.shape[:-2], -1))[..., :size]

    run = jit(in_chunks)

    def run_in_threads(x: Any) -> Any:
        with ThreadPoolExecutor(threads) as pool:
            each = pool.map(run, jnp.array_split(x, threads, -1))
            return jnp.concatenate([jax.block_until_ready(y) for y in each], -1)

    return run if threads == 1 else run_in_threads


def with_slopes(f: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Return f and its derivatives by all entries of its argument's first axis, one after the other."""

    def both(k: Any) -> Any:
        def along(e: Any) -> Any:
            return jax.jvp(f, (k,), (jnp.broadcast_to(e[:, None], k.shape),))

        y, slopes = jax.vmap(along, out_axes=(None, 0))(jnp.eye(len(k)))
        return jnp.concatenate([y[None], slopes]).reshape(-1, k.shape[-1])

    return both


def predictions(arm: Arm, quick: bool) -> None:
    """Many stiffness sets at one posture."""
    count, repeat = (512, 3) if quick else (4096, 15)
    posture, paths = np.deg2rad([30.0, -60.0, 30.0]), stiffness_paths(arm)
    start = np.array([float(arm.get(path)) for path in paths])
    sets = start[:, None] * np.exp(0.5 * np.random.default_rng(0).standard_normal((len(paths), count)))
    k, f, peer = jnp.asarray(sets), predictor(arm, posture[:, None]), Peer(arm, posture)
    one, two, slopes = in_batches(f), in_batches(f, threads=2), in_batches(with_slopes(f))
    some, found = 100 if not quick else 20, np.asarray(one(k))
    exact = np.array([np.append(*peer.exact(s, MODES)) for s in sets.T[:some]]).T
    off = np.abs(found[:, :some] / exact - 1)
    frequencies, drop = off[:MODES].max(), off[MODES].max()
    print(f"\nident and MuJoCo + SciPy agree to {frequencies:.1e} in frequency, {drop:.1e} in deflection")
    assert off.max() < 1e-7
    mass = np.stack([a @ a.T + np.eye(9) for a in np.random.default_rng(1).standard_normal((count, 9, 9))])
    lapack = {"eigvals_only": True, "subset_by_index": [0, MODES - 1]}
    K = np.diag(start[peer.pick])

    def each(f: Callable[[Any], Any], items: Any) -> tuple[float, float]:
        return timed(lambda: [f(item) for item in items[:some]], repeat, some)

    library = build()
    compiled = None if isinstance(library, str) else CompiledPeer(library, arm, posture)
    if compiled is not None:
        balls = sets[peer.pick]
        off = np.abs(np.asarray(one(k)) / compiled(balls, MODES) - 1).max()
        print(f"ident and Pinocchio + Eigen agree to {off:.1e} in all sets")
        assert off < 1e-9
    rows = [
        ("ident, two threads", timed(lambda: two(k), repeat, count)),
        ("ident, one thread", timed(lambda: one(k), repeat, count)),
        ("ident, with all six derivatives of all five, one thread", timed(lambda: slopes(k), repeat, count)),
        *(
            []
            if compiled is None
            else [("Pinocchio + Eigen, C++, one thread", timed(lambda: compiled(balls, MODES), repeat, count))]
        ),
        ("MuJoCo + SciPy, the same numbers", each(lambda x: peer.exact(x, MODES), sets.T)),
        ("MuJoCo + SciPy, linearized at phi = 0: other numbers", each(lambda x: peer.lean(x, MODES), sets.T)),
        (
            "LAPACK, eigenvalues only (numpy eigvalsh, 9 x 9 stack)",
            timed(lambda: np.linalg.eigvalsh(mass), repeat, count),
        ),
        ("LAPACK, pairs (numpy eigh, 9 x 9 stack)", timed(lambda: np.linalg.eigh(mass), repeat, count)),
        ("LAPACK, 4 of K v = lambda M v (scipy eigh, each)", each(lambda M: sl.eigh(K, M, **lapack), mass)),
    ]
    table(f"Four frequencies and a deflection, {count} stiffness sets, one posture", rows)
    if compiled is None:
        print(f"  compiled C++ is left out: {library}")
    print(f"  six derivatives cost {rows[2][1][0] / rows[1][1][0]:.2f} predictions, the prediction included")


def warm_fit(arm: Arm, quick: bool) -> None:
    """Six parameters of the shipped campaign; modes in ascending order, as the peer can."""
    read = read_campaign(DATA / "campaign.csv")
    campaign = Campaign(read.path, measurements=tuple(dataclasses.replace(m, mode=None) for m in read))
    names, known = stiffness_parameters(arm).names, np.array([m.value for m in campaign])
    sigma = np.array([m.sigma for m in campaign])
    kinds = tuple(m.kind for m in campaign)
    model, unknown = ArmModel(arm, bind(arm, campaign)), stiffness_parameters(arm, Unknowns(prior_sd=np.inf))
    problem = InverseProblem(model, jnp.asarray(known), jnp.asarray(sigma), unknown, kinds)
    postures = list(dict.fromkeys(m.posture for m in campaign))
    peers = [Peer(arm, np.array(posture)) for posture in postures]
    places = [[i for i, m in enumerate(campaign) if m.posture == p and m.kind == "frequency"] for p in postures]
    drops = [[i for i, m in enumerate(campaign) if m.posture == p and m.kind == "deflection"] for p in postures]

    def residuals(theta: np.ndarray) -> np.ndarray:
        values = np.zeros(len(known))
        for peer, rows, drop in zip(peers, places, drops, strict=True):
            hertz, fall = peer.exact(np.exp(theta), len(rows))
            values[np.array(rows)[np.argsort(known[rows])]] = hertz
            values[drop] = fall
        return (values - known) / sigma

    start = np.log([float(arm.get(path)) for path in names])
    ours = fit(problem, starts=1)
    options = {"method": "lm", "x_scale": "jac", "xtol": 1e-12, "ftol": 1e-12}
    theirs = least_squares(residuals, start, **options)
    print(f"\nThe two optima differ by {np.abs(ours.best.theta - theirs.x).max():.1e} in ln(stiffness)")
    print(f"and by {abs(ours.best.cost / (2 * theirs.cost) - 1):.1e} of the cost")
    assert np.abs(ours.best.theta - theirs.x).max() < 1e-5
    repeat = 3 if quick else 10
    rows = [
        ("ident, one search", timed(lambda: solve(problem, start), 3 * repeat)),
        ("ident, a fit with its verdicts", timed(lambda: fit(problem, starts=1), repeat)),
        ("SciPy's MINPACK on MuJoCo, differences", timed(lambda: least_squares(residuals, start, **options), 3)),
    ]
    table("Warm fit of six stiffnesses to 16 frequencies and 4 deflections", rows)


def main() -> None:
    """Run all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer sets and repetitions, in a minute or two")
    quick = parser.parse_args().quick
    print(machine())
    arm = read_arm(DATA / "arm.toml").arm
    predictions(arm, quick)
    warm_fit(arm, quick)
    sizes(quick)
    print(f"\nload at the end {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
