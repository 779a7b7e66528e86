"""How many fresh draws keep a limit at the speeds that `ident motion` finds, all of them by the exact equations.

    python tests/benchmarks/schedules.py [--limit 0.5] [--time 25] [--draws 200] [--seed 0] [--resume FILE]

`ident motion` takes the least vibration in that time for the worst phases, judged by 50 draws. The fresh ones, from the
fit's normal approximation to the shipped campaign, have phases of their own; twenty are integrated side by side, by the
equations and the tolerance of `ident.vibrate.exact`.
"""

import argparse
from functools import cache
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import resumable
from timing import commit, machine

import ident
from ident.identify.values import Values
from ident.studies.motion import MotionResult
from ident.vibrate import exact
from ident.vibrate.fast import displacement, repeated
from ident.vibrate.linear import filled_up
from ident.vibrate.motion import Motion
from ident.vibrate.simulate import simulate

HERE = Path(__file__).parents[2] / "data" / "lcd_arm"
ABREAST, JUDGING = 20, 50


@cache
def fitted() -> ident.FitResult:
    """Return the fit of the shipped campaign."""
    return ident.fit(HERE / "arm.toml", HERE / "campaign.csv", ident.FitOptions(no_explain=True))


def drawn(count: int, seed: int) -> Values:
    """Return draws of the stiffnesses."""
    fit, rng = fitted(), np.random.default_rng(seed)
    names, scale = fit.fitted.information.names, np.linalg.cholesky(fit.fitted.information.covariance)
    each = np.exp(scale @ rng.standard_normal((len(names), count)))
    values = {(name,): fit.parameters[name] * x for name, x in zip(names, each, strict=True)}
    return Values.of_arm(values, fit.fitted_arm)


@cache
def proposed(limit: float, time: float) -> MotionResult:
    """Return the motion."""
    options = ident.MotionOptions(limit=limit, time=time, draws=JUDGING, fresh=0)
    return ident.motion(HERE / "arm.toml", options, posterior=drawn(JUDGING, 1_000_000))


@eqx.filter_jit
def solved(model: object, motion: Motion, start: tuple[jax.Array, ...], times: jax.Array) -> tuple[jax.Array, ...]:
    """Integrate a section of the exact equations for several arms."""

    def one(model: object, start: tuple[jax.Array, ...]) -> tuple[jax.Array, ...]:
        return exact._solve(model, motion, start, times, 1e-7, 1e-10, "Dopri8", exact.MAX_STEPS)

    return eqx.filter_vmap(one)(model, start)


def work(first: int, limit: float, time: float, seed: int) -> list[float]:
    """Return the peaks [m] of some draws."""
    study = proposed(limit, time).motions
    basis, held = study.basis, study.schedule.motion.dwell(study.scheduling.dwell)
    draws = basis.drawn(drawn(ABREAST, seed + first), seed + first)
    arms = [basis.arm.replace({path: x[k] for path, x in draws.items()}) for k in range(ABREAST)]
    every = [simulate(arm, held, rate=250.0) for arm in arms]
    models, time_of = [each.model for each in every], np.asarray(every[0].time)
    stacked = jax.tree.map(lambda *x: jnp.stack(x) if eqx.is_array(x[0]) else x[0], *models)
    y = jnp.stack([jnp.asarray(each.y[:, 0]) for each in every])
    state, parts = (y, jnp.zeros_like(y)), [y[..., None]]
    motion = filled_up(held)
    for section in exact._sections(time_of):
        good, y, rate, _ = solved(stacked, motion, state, jnp.asarray(section))
        assert np.asarray(good).all()
        state = y[..., -1], rate[..., -1]
        parts.append(y[..., 1:])
    times, count = repeated(time_of), len(time_of)
    whole = np.concatenate(parts, -1)[..., :count]
    whole = np.pad(whole, ((0, 0), (0, 0), (0, len(times) - count)), mode="edge")
    moved = [
        np.asarray(displacement(model, motion, times, y))[:, :count] for model, y in zip(models, whole, strict=True)
    ]
    return [float(np.abs(m - each.quasi_static).max()) for m, each in zip(moved, every, strict=True)]


def main() -> None:
    """Print how many draws keep the limit."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--limit", type=float, default=0.5, help="[mm]")
    parser.add_argument("--time", type=float, default=25.0, help="[s]")
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--resume", type=Path, metavar="FILE", help="JSON lines to go on with, or to begin")
    asked = parser.parse_args()
    print(f"{machine()}, seed {asked.seed}, commit {commit()}")
    wanted = [(k, asked.limit, asked.time, asked.seed) for k in range(0, asked.draws, ABREAST)]
    about = {"limit": asked.limit, "time": asked.time, "seed": asked.seed}
    peaks = 1e3 * np.concatenate(list(resumable.run(work, wanted, about, asked.resume, 1).values()))
    kept, (low, high) = int((peaks <= asked.limit).sum()), np.quantile(peaks, (0.05, 0.95))
    print(f"{asked.limit:g} mm in {asked.time:g} s: kept by {kept} of {len(peaks)}; 5 to 95 %: {low:.3f} to {high:.3f}")


if __name__ == "__main__":
    main()
