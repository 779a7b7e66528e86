"""Whether a motion that should keep a limit does, over simulated arms that differ from what their campaigns tell.

    python tests/benchmarks/cures.py [--arms 20] [--seed 5] [--limit 0.5]

Each true arm has stiffnesses within 5 % (log-normal) of arm.toml's and phases of its own; its campaign is synthesized
with the noise of `synthesize.py` and fitted, and the speed along its path is chosen by draws of the fit's normal
approximation, as `ident diagnose` does by draws of its sampler. Then the true arm itself moves at these speeds, and it
is counted how often it keeps the limit. Exit code 1 where that is outside the 99.8 % band of the probabilities that
were given.
"""

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np
from timing import commit, machine

sys.path.append(str(Path(__file__).parents[2] / "data" / "lcd_arm"))

from synthesize import synthesize

import ident
from ident.identify.values import Values
from ident.studies.cure.cures import along_path
from ident.studies.cure.diagnose import DiagnoseOptions
from ident.studies.cure.effort import DiagnosisEffort
from ident.studies.cure.remedies import Task, at_confidence, carried_out
from ident.studies.motion_options import basis_of

HERE = Path(__file__).parents[2] / "data" / "lcd_arm"
SPREAD, DRAWS = 0.05, 200


def one(arm_file: ident.ArmFile, rng: np.random.Generator, limit: float) -> tuple[float, bool, float]:
    """Return the probability that a motion keeps the limit, whether it does on the true arm, and its time [s]."""
    paths = [f"joint{j}.{k}" for j in (1, 2, 3) for k in ("k_bend", "k_tors")]
    true = arm_file.arm.replace({p: float(arm_file.arm.get(p)) * np.exp(SPREAD * rng.normal()) for p in paths})
    true = true.replace({f"{drive.name}.phase": rng.uniform(0, 2 * np.pi) for drive in true.drives})
    fit = ident.fit(arm_file, synthesize(true, int(rng.integers(2**31))), ident.FitOptions(starts=2, no_explain=True))
    names, scale = fit.fitted.information.names, np.linalg.cholesky(fit.fitted.information.covariance)
    drawn = np.exp(scale @ rng.standard_normal((len(names), DRAWS)))
    values = {(name,): fit.parameters[name] * x for name, x in zip(names, drawn, strict=True)}
    options = DiagnoseOptions(limit=1e3 * limit)
    basis = basis_of(arm_file, options, posterior=Values.of_arm(values, arm_file.arm))
    task = at_confidence(Task(basis, limit, DiagnosisEffort(draws=DRAWS, assessment_draws=100)))
    remedy = along_path(task)
    assert remedy is not None
    _, evaluator, _ = carried_out(task, remedy)
    peaks = replace(evaluator, arm=true, draws={}).amplitudes(np.zeros((1, 0)))
    return remedy.keeps.share, bool(peaks.max() <= limit), remedy.time


def main() -> int:
    """Simulate the arms, and count."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arms", type=int, default=20)
    parser.add_argument("--seed", type=int, default=5)
    parser.add_argument("--limit", type=float, default=0.5, help="[mm]")
    given = parser.parse_args()
    arm_file, rng = ident.read_arm(HERE / "arm.toml"), np.random.default_rng(given.seed)
    print(f"{machine()}, {commit()}; limit {given.limit:g} mm", flush=True)
    every = []
    for k in range(given.arms):
        every.append(one(arm_file, rng, given.limit / 1e3))
        probability, kept, time = every[-1]
        print(f"{k + 1}: {100 * probability:.3g} % in {time:.2f} s, {'kept' if kept else 'NOT kept'}", flush=True)
    share, kept = np.array([each[0] for each in every]), sum(each[1] for each in every)
    drawn = (np.random.default_rng(0).random((100_000, len(share))) < share).sum(1)
    low, high = np.quantile(drawn, (0.001, 0.999))
    print(f"kept by {kept} of {len(share)} arms; {share.sum():.1f} expected, band {low:.0f} to {high:.0f}")
    return int(not low <= kept <= high)


if __name__ == "__main__":
    sys.exit(main())
