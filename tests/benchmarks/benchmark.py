"""How fast ident is, beside MuJoCo, SciPy and LAPACK in the same run: `python tests/benchmarks/benchmark.py [--quick]`.

Times are minimum and median over repetitions. No test depends on them.
"""

import argparse
import dataclasses
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax

jax.config.update("jax_enable_x64", True)

import equinox as eqx  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
import scipy.linalg as sl  # noqa: E402
from peer import Peer  # noqa: E402
from scipy.optimize import least_squares  # noqa: E402

from ident.arm.arm import Arm, Body, Joint, Point, stiffness_paths  # noqa: E402
from ident.arm.chain import hold  # noqa: E402
from ident.arm.equilibrium import deflection  # noqa: E402
from ident.arm.file import read_arm  # noqa: E402
from ident.arm.modes import linearize, lowest_eigenpairs, to_hertz  # noqa: E402
from ident.identify.batch import in_batches  # noqa: E402
from ident.identify.conditions import bind  # noqa: E402
from ident.identify.fit import fit  # noqa: E402
from ident.identify.parameters import stiffness_parameters  # noqa: E402
from ident.identify.predict import ArmModel  # noqa: E402
from ident.identify.problem import InverseProblem  # noqa: E402
from ident.measure import Campaign, read_campaign  # noqa: E402

ROOT = Path(__file__).parents[2]
DATA = ROOT / "data" / "lcd_arm"
MODES = 4


def timed(f: Callable[[], Any], repeat: int, per: int = 1) -> tuple[float, float]:
    """Return minimum and median time [us] of one of `per` results."""
    f()
    times = []
    for _ in range(repeat):
        start = time.perf_counter()
        jax.block_until_ready(f())
        times.append((time.perf_counter() - start) / per * 1e6)
    return min(times), float(np.median(times))


def table(title: str, rows: list[tuple[str, tuple[float, float]]], reference: int = 0) -> None:
    """Print times and their ratio to one of the rows."""
    print(f"\n{title}\n{'':58s}{'min us':>11s}{'median us':>11s}{'ratio':>9s}")
    for name, (low, middle) in rows:
        print(f"  {name:56s}{low:11.4g}{middle:11.4g}{low / rows[reference][1][0]:9.3g}")


def predictor(arm: Arm, posture: np.ndarray) -> Callable[[Any], Any]:
    """Return frequencies and the last point's drop as a function of the stiffnesses (P, *batch)."""
    paths = stiffness_paths(arm)

    def predict(k: Any) -> Any:
        q = jnp.asarray(posture).reshape(posture.shape + (1,) * (k.ndim - posture.ndim))
        chain = hold(arm.replace(dict(zip(paths, k, strict=True))), q)
        system = linearize(chain)
        values = to_hertz(lowest_eigenpairs(system.H, system.M, min(MODES, system.H.shape[0]))[0])
        return jnp.concatenate([values, -deflection(chain, system.phi)[2, -1:]])

    return predict


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
    print(
        f"\nident and MuJoCo + SciPy agree to {off[:MODES].max():.1e} in frequency, {off[MODES].max():.1e} in deflection"
    )
    assert off.max() < 1e-7
    mass = np.stack([a @ a.T + np.eye(9) for a in np.random.default_rng(1).standard_normal((count, 9, 9))])
    rows = [
        ("ident, two threads", timed(lambda: two(k), repeat, count)),
        ("ident, one thread", timed(lambda: one(k), repeat, count)),
        ("ident, with all six derivatives of all five, one thread", timed(lambda: slopes(k), repeat, count)),
        ("MuJoCo + SciPy, the same numbers", timed(lambda: [peer.exact(s, MODES) for s in sets.T[:some]], repeat, some)),
        ("MuJoCo + SciPy, linearized at phi = 0: other numbers", timed(lambda: [peer.lean(s, MODES) for s in sets.T[:some]], repeat, some)),
        ("LAPACK's eigenvalues only (numpy eigvalsh, 9 x 9 stack)", timed(lambda: np.linalg.eigvalsh(mass), repeat, count)),
        ("LAPACK's pairs only (numpy eigh, 9 x 9 stack)", timed(lambda: np.linalg.eigh(mass), repeat, count)),
        ("LAPACK's 4 of K v = lambda M v (scipy eigh, one by one)", timed(lambda: [sl.eigh(np.diag(start[peer.pick]), m, eigvals_only=True, subset_by_index=[0, 3]) for m in mass[:some]], repeat, some)),
    ]  # fmt: skip
    table(f"Four frequencies and a deflection, {count} stiffness sets, one posture", rows)
    print(f"  six derivatives cost {rows[2][1][0] / rows[1][1][0]:.2f} predictions, the prediction included")


def warm_fit(arm: Arm, quick: bool) -> None:
    """Six parameters of the shipped campaign; modes in ascending order, as the peer can."""
    read = read_campaign(DATA / "campaign.csv")
    campaign = Campaign(read.path, measurements=tuple(dataclasses.replace(m, mode=None) for m in read))
    paths, known = stiffness_parameters(arm), np.array([m.value for m in campaign])
    sigma = np.array([m.sigma for m in campaign])
    kinds = tuple(m.kind for m in campaign)
    problem = InverseProblem(
        ArmModel(arm, bind(arm, campaign)), jnp.asarray(known), jnp.asarray(sigma), stiffness_parameters(arm, prior_sd=np.inf), kinds
    )  # fmt: skip
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

    start = np.log([float(arm.get(path)) for path in paths.names])
    ours = fit(problem, starts=1)
    theirs = least_squares(residuals, start, method="lm", x_scale="jac", xtol=1e-12, ftol=1e-12)
    print(f"\nThe two optima differ by {np.abs(ours.best.theta - theirs.x).max():.1e} in ln(stiffness)")
    print(f"and by {abs(ours.best.cost / (2 * theirs.cost) - 1):.1e} of the cost")
    assert np.abs(ours.best.theta - theirs.x).max() < 1e-5
    repeat = 3 if quick else 10
    rows = [
        ("ident, one start", timed(lambda: fit(problem, starts=1), 3 * repeat)),
        ("SciPy's MINPACK on MuJoCo, finite differences", timed(lambda: least_squares(residuals, start, method="lm", x_scale="jac", xtol=1e-12, ftol=1e-12), min(repeat, 3))),
    ]  # fmt: skip
    table("Warm fit of six stiffnesses to 16 frequencies and 4 deflections", rows)


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
            f, begin = eqx.filter_jit(predictor(arm, q)), time.process_time()
            program = jax.jit(lambda k, f=f: f(k[:, None])).lower(k).compile()
            spent = time.process_time() - begin
            line += f"{timed(lambda: program(k), 20, size)[0]:12.4g} ({spent:4.1f})"  # noqa: B023
        print(line, flush=True)


STAGES = """
import time; t = [time.perf_counter()]
import ident.cli as cli; cli._start()
import jax, equinox as eqx
from pathlib import Path
from ident.arm.file import read_arm; from ident.measure import read_campaign
from ident.identify import fit as stage; from ident.identify.conditions import bind
from ident.identify.parameters import stiffness_parameters; from ident.identify.predict import ArmModel
from ident.identify.problem import InverseProblem
t.append(time.perf_counter())
import jax.numpy as jnp
arm, campaign = read_arm("ARM"), read_campaign("CAMPAIGN")
p = stiffness_parameters(arm)
column = lambda field: jnp.asarray([getattr(m, field) for m in campaign])
problem = InverseProblem(ArmModel(arm, bind(arm, campaign)), column("value"), column("sigma"), p, tuple(m.kind for m in campaign))
start = p.theta(p.column("start"))
t.append(time.perf_counter())
lowered = stage._solve.lower(problem, start)
t.append(time.perf_counter())
program = lowered.compile()
t.append(time.perf_counter())
jax.block_until_ready(program(problem, start))
t.append(time.perf_counter())
import ident.present.figures
t.append(time.perf_counter())
names = "imports", "read and bind", "trace and lower", "compile or load", "one start", "import matplotlib"
print(", ".join(f"{n} {b - a:.2f}" for n, a, b in zip(names, t, t[1:])))
"""


def command() -> None:
    """`ident fit` from the shell, the first time and the next."""
    print("\n`ident fit` from the shell [s], and the stages of one start in a process of its own")
    with tempfile.TemporaryDirectory() as folder:
        caches = [{**os.environ, "JAX_COMPILATION_CACHE_DIR": str(Path(folder) / name)} for name in ("shell", "stages")]
        line = [sys.executable, "-m", "ident", "fit", str(DATA / "table1.csv"), "--out", folder]
        script = STAGES.replace("ARM", str(DATA / "arm.toml")).replace("CAMPAIGN", str(DATA / "table1.csv"))
        for run in ("first", "next"):
            begin = time.perf_counter()
            done = subprocess.run(line, env=caches[0], cwd=ROOT, capture_output=True, text=True, check=False)
            spent = time.perf_counter() - begin
            shown = subprocess.run([sys.executable, "-c", script], env=caches[1], cwd=ROOT, capture_output=True, text=True, check=False)  # fmt: skip
            print(f"  {run:6s}{spent:6.2f} (exit {done.returncode})   {shown.stdout.strip() or shown.stderr[-300:]}")


def machine() -> str:
    """Say what the times were taken on."""
    model = next((x.split(":")[1].strip() for x in open("/proc/cpuinfo") if x.startswith("model name")), "?") if sys.platform == "linux" else platform.processor()  # fmt: skip  # noqa: SIM115
    load = ", ".join(f"{x:.1f}" for x in os.getloadavg())
    return f"{model}, {os.cpu_count()} cores, load {load}; Python {platform.python_version()}, jax {jax.__version__}, numpy {np.__version__}"


def main() -> None:
    """Run all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer sets and repetitions, in a minute or two")
    quick = parser.parse_args().quick
    print(machine())
    arm = read_arm(DATA / "arm.toml")
    predictions(arm, quick)
    warm_fit(arm, quick)
    sizes(quick)
    command()
    print(f"\nload at the end {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
