"""What absolute positions of an arm under its own weight tell of its joints, where its geometry is not known exactly.

python data/ur10/gravity.py

Linearised at arm.urdf and arm.joints.toml: position = geometry + sum of c_k times how the probe sags with compliance
k. The geometry is free: a frame of the tracker for each series, shifts and tilts of every axis, zeros of all angles,
the place of the probe; then errors of each angle too that come back once and twice a turn, as of an encoder off its
centre. What that can explain is projected out of everything.
"""

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ident.arm.arm import Arm, stiffness_paths
from ident.arm.chain import at_posture
from ident.arm.mechanics import deflection, equilibrium, straight_positions
from ident.description.file import read_arm

HERE = Path(__file__).parent
ZEROS = slice(36, 42)
"""Which numbers of the geometry are the zeros of the angles."""
RANK = 1e-6
"""Singular value, of the largest one, below which a combination of geometry moves nothing."""


def read() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the series of each pose, joint angles (6, N) [rad] and positions (N, 3) [m] in the tracker's frame."""
    text = (HERE / "poses.csv").read_text(encoding="utf-8")
    lines = [line.split(",") for line in text.splitlines() if not line.startswith("#")][1:]
    numbers = np.array([[float(x) for x in line[1:]] for line in lines])
    return np.array([line[0] for line in lines]), numbers[:, :6].T, numbers[:, 6:9] / 1e3


def procrustes(model: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """Return positions (N, 3) turned and shifted as a whole to where they are nearest the model's."""
    a, b = model - model.mean(0), measured - measured.mean(0)
    u, _, vt = np.linalg.svd(a.T @ b)
    turn = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
    return b @ turn.T + model.mean(0)


def sags(arm: Arm, postures: jax.Array) -> np.ndarray:
    """Return how the probe sags with each compliance [m per rad/(N m)], (N, 3, 12): all bending, then torsion."""
    paths = stiffness_paths(arm)

    def sag(compliance: jax.Array) -> jax.Array:
        chain = at_posture(arm.replace({path: 1 / c for path, c in zip(paths, compliance, strict=True)}), postures)
        return deflection(chain, equilibrium(chain))[:, -1]

    start = jnp.array([1 / float(arm.get(path)) for path in paths])
    return np.asarray(jax.jit(jax.jacfwd(sag))(start)).transpose(1, 0, 2)


def geometry(arm: Arm, postures: jax.Array, series: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return where the rigid arm puts the probe (N, 3) [m], and how that moves with its geometry (N, 3, n)."""

    def probe(change: jax.Array) -> jax.Array:
        offset, axis, zero, tip = jnp.split(change, (18, ZEROS.start, ZEROS.stop))
        joints = tuple(
            eqx.tree_at(lambda j: (j.offset, j.axis), joint, (joint.offset + o, _unit(joint.axis + a)))
            for joint, o, a in zip(arm.joints, offset.reshape(6, 3), axis.reshape(6, 3), strict=True)
        )
        end = eqx.tree_at(lambda p: p.position, arm.points[-1], arm.points[-1].position + tip)
        other = eqx.tree_at(lambda arm: (arm.joints, arm.points), arm, (joints, (*arm.points[:-1], end)))
        return straight_positions(at_posture(other, postures + zero[:, None]))[:, -1]

    at = np.asarray(probe(jnp.zeros(45))).T
    moves = np.asarray(jax.jit(jax.jacfwd(probe))(jnp.zeros(45))).transpose(1, 0, 2)
    return at, np.concatenate([moves, *_frames(at, series)], 2)


def _unit(vector: jax.Array) -> jax.Array:
    return vector / jnp.linalg.norm(vector)


def _frames(at: np.ndarray, series: np.ndarray) -> Iterator[np.ndarray]:
    """Yield how a shift and a turn of each series' frame move the probe."""
    for name in np.unique(series):
        own = (series == name)[:, None, None]
        yield own * np.broadcast_to(np.eye(3), (len(at), 3, 3))
        yield own * np.stack([np.cross(e, at) for e in np.eye(3)], 2)


def turns(moves: np.ndarray, postures: np.ndarray) -> np.ndarray:
    """Return how the probe moves with errors of each angle that come back once and twice a turn, (N, 3, 24)."""
    waves = [wave(n * postures) for n in (1, 2) for wave in (np.sin, np.cos)]
    return np.concatenate([moves[:, :, ZEROS] * wave.T[:, None] for wave in waves], 2)


@dataclass(frozen=True)
class Seen:
    """What is left of data and compliances when a nuisance is taken out.

    Attributes:
        rank: numbers of the nuisance that move anything.
        before, after: root mean square [m] of what is left of the data, without and with compliances fitted.
        columns: (3 N, 12) [m] what is left of each compliance's sag.
        sd: () of each combination of compliances, best seen first, as a share of the guess.
        value: what the data give for each, as a share of the guess.
        combinations: (n, 12) the combinations.
    """

    rank: int
    before: float
    after: float
    columns: np.ndarray
    sd: np.ndarray
    value: np.ndarray
    combinations: np.ndarray


def seen(nuisance: np.ndarray, off: np.ndarray, sag: np.ndarray) -> Seen:
    """Take out of data and compliances all that a nuisance can explain, and fit what is left."""
    size = np.linalg.norm(nuisance, axis=0)
    u, s, _ = np.linalg.svd(nuisance[:, size > 1e-9] / size[size > 1e-9], full_matrices=False)
    u = u[:, s > RANK * s[0]]
    rest, columns = off - u @ (u.T @ off), sag - u @ (u.T @ sag)
    freedom = len(off) - u.shape[1]
    w, s, combinations = np.linalg.svd(columns, full_matrices=False)
    w, s, combinations = w[:, s > RANK * s[0]], s[s > RANK * s[0]], combinations[s > RANK * s[0]]
    turn = np.sign(combinations[np.arange(len(s)), np.abs(combinations).argmax(1)])
    w, combinations = w * turn, combinations * turn[:, None]
    left = rest - w @ (w.T @ rest)
    before, after = np.sqrt(rest @ rest / freedom), np.sqrt(left @ left / (freedom - len(s)))
    return Seen(u.shape[1], before, after, columns, after / s, w.T @ rest / s, combinations)


def main() -> None:
    """Print what is known of each compliance: geometry known, geometry free, and what the data give."""
    series, postures, measured = read()
    arm = read_arm(HERE / "arm.urdf").arm
    paths = stiffness_paths(arm)
    at, moves = geometry(arm, jnp.asarray(postures), series)
    off = np.zeros_like(at)
    for name in np.unique(series):
        own = series == name
        off[own] = procrustes(at[own], measured[own]) - at[own]
    sag = sags(arm, jnp.asarray(postures)) / np.array([float(arm.get(path)) for path in paths])
    print(f"{len(at)} poses, off by {1e3 * rms(off):.2f} mm as the arm stands (rms, all three directions)")
    print("\nSag by each bushing as guessed [mm rms], and what is left of it beside a geometry that is free")
    nuisances = {"geometry": moves, "geometry and turns": np.concatenate([moves, turns(moves, postures)], 2)}
    cases = {words: seen(flat(each), off.ravel(), flat(sag)) for words, each in nuisances.items()}
    for k, path in enumerate(paths):
        left = "".join(f"{1e3 * rms(case.columns[:, k].reshape(-1, 3)):10.4f}" for case in cases.values())
        print(f"  {path:28s} {1e3 * rms(sag[:, :, k]):10.4f}{left}")
    for words, each in nuisances.items():
        print(f"\nFree: {words}")
        show(cases[words], paths)
        for name in np.unique(series):
            own = series == name
            best = cases[words].combinations[:2]
            case = seen(flat(each[own]), off[own].ravel(), flat(sag[own] @ best.T))
            value = case.combinations.T @ case.value
            sd = np.sqrt((case.combinations.T**2) @ case.sd**2)
            known = ", ".join(f"{v:+.2f} with sd {s:.2f}" for v, s in zip(value, sd, strict=True))
            print(f"  the best two by series {name} alone: {known}")


def show(case: Seen, paths: tuple[str, ...]) -> None:
    """Print the combinations of compliances that the data see to better than their guess."""
    left, with_compliances = 1e3 * case.before, 1e3 * case.after
    print(f"  {case.rank} numbers leave {left:.3f} mm in each direction, with compliances {with_compliances:.3f} mm")
    print("  combinations of compliances as a share of the guess: sd, and what the data give")
    for sd, value, combination in zip(case.sd, case.value, case.combinations, strict=True):
        words = [f"{x:+.2f} {path}" for x, path in zip(combination, paths, strict=True) if abs(x) > 0.2]
        print(f"  {sd:8.2g} {value:+8.2f}  {' '.join(words)}")
    print(f"  nothing at all: {len(paths) - len(case.sd)} combinations")


def flat(columns: np.ndarray) -> np.ndarray:
    """Return columns (N, 3, n) as (3 N, n)."""
    return columns.reshape(-1, columns.shape[2])


def rms(points: np.ndarray) -> float:
    """Return the root mean square length of vectors (N, 3)."""
    return float(np.sqrt(np.mean(np.sum(points**2, 1))))


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    sys.exit(main())
