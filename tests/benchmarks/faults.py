"""Faults, one a capability, and the tier that finds each: `python tests/benchmarks/faults.py --resume FILE`.

Each is put into a copy of the tree by an exact replacement of text, and the tests listed with it are run to their first
failure; a fault that they do not find has the whole tier run (`--whole`). Two minutes a fault and tier.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
TIERS = {"quick": "not slow", "slow": "slow"}
FAILED, NOTHING = 1, (0, 5)
"""Exit codes of pytest: tests failed; all passed, or none was chosen. Any other is no answer."""


class Fault(NamedTuple):
    """A fault, and the tests that should find it."""

    capability: str
    file: str
    old: str
    new: str
    tests: str


# fmt: off
FAULTS = (
    Fault("weight in equilibrium", "arm/mechanics.py",
          "[outer(arm, gravity), pulls]", "[outer(gravity, arm), pulls]", "arm/test_against_engines.py"),
    Fault("mass matrix", "arm/mechanics.py",
          "+ mass * outer(p_i, p_j)", "- mass * outer(p_i, p_j)", "arm/test_against_engines.py"),
    Fault("derivative of the equilibrium", "arm/mechanics.py",
          "(phi - _solve(W,", "(phi + _solve(W,", "arm/test_springs.py arm/test_gradients.py"),
    Fault("motors held by servos", "arm/mechanics.py",
          "(2 * along + spin)", "(along + spin)", "arm/test_servo.py arm/test_motors.py"),
    Fault("loss factors", "arm/chain.py",
          "bend * eta_bend + tors * eta_tors", "bend * eta_bend", "arm/test_losses.py"),
    Fault("damping ratio, derivative", "arm/modes.py",
          "+ s * s * dM[:, :, None]", "+ s * dM[:, :, None]", "arm/test_gradients.py arm/test_losses.py"),
    Fault("curved springs", "arm/parts.py",
          "self.cubic * s", "2 * self.cubic * s", "arm/test_springs.py"),
    Fault("elastic belts", "arm/multibody.py",
          "(e + belts.tau * e_dot)", "(e - belts.tau * e_dot)", "arm/test_belts.py arm/test_stiff_belts.py"),
    Fault("Coriolis terms", "arm/multibody.py",
          "axis * pin.acceleration + cross(w, turn)", "axis * pin.acceleration", "arm/test_multibody.py"),
    Fault("rotating unbalance", "arm/multibody.py",
          "bob) + cross(drives.height", "bob) - cross(drives.height", "arm/test_multibody.py"),
    Fault("transmission error", "arm/multibody.py",
          "slopes = [order * drives", "slopes = [drives", "arm/test_multibody.py arm/test_belts.py"),
    Fault("names of modes", "arm/modes.py",
          '"vertical" if v > 0.5', '"vertical" if v < 0.5', "identify/test_predict.py identify/test_mode_labels.py"),
    Fault("unit of stiffness", "units.py",
          "1e-3 * 180 / math.pi", "180 / math.pi", "test_units.py description"),
    Fault("MuJoCo file written", "description/mjcf_writing.py",
          "(0, 1), (0, 2), (1, 2)", "(0, 2), (0, 1), (1, 2)", "description/test_mjcf_writing.py"),
    Fault("unit of a campaign", "measure/reading.py",
          "else factor * said[name]", "else said[name] / factor", "measure"),
    Fault("frame of a tracker", "identify/predict.py",
          "(origin[:, k] * direction)", "(-origin[:, k] * direction)", "identify/test_setups.py"),
    Fault("correlated errors", "inference/problem.py",
          "np.linalg.inv(L), 0.0)", "np.linalg.inv(L).swapaxes(1, 2), 0.0)", "inference/test_correlation.py"),
    Fault("prior", "inference/parameters.py",
          "return beyond / self.sd,", "return beyond * self.sd,",
          "inference/test_priors.py inference/test_parameters.py"),
    Fault("score test", "inference/information.py",
          "else 2 * tail", "else tail", "inference/test_score.py"),
    Fault("profile", "inference/profile.py",
          "half_width(level) ** 2", "half_width(level)", "inference/test_profile.py"),
    Fault("sampler's steps", "inference/sample.py",
          "- np.where(self.positive, step", "+ np.where(self.positive, step",
          "inference/test_moves.py inference/test_sample.py"),
    Fault("experiments", "inference/design.py",
          "return own - between", "return own + between", "identify/test_plan.py inference/test_information.py"),
    Fault("fleet", "inference/population.py",
          "centre / variance - weight * mean", "centre / variance + weight * mean", "inference/test_population.py"),
    Fault("change between fits", "inference/change.py",
          "weights = levels / (1 + levels)", "weights = levels", "inference/test_change.py"),
    Fault("fast method", "vibrate/fast.py",
          "f = sum((slopes[:, pin]", "f = sum((-slopes[:, pin]", "vibrate/test_one_joint.py vibrate/test_exact.py"),
    Fault("waves of an imbalance", "vibrate/fast.py",
          "sine * turned[1]", "sine * turned[0]", "vibrate/test_one_joint.py vibrate/test_exact.py"),
    Fault("sines of commanded angles", "vibrate/fast.py",
          "np.stack([np.cos(q), np.sin(q)])", "np.stack([np.cos(q), -np.sin(q)])",
          "vibrate/test_one_joint.py vibrate/test_exact.py"),
    Fault("slopes over phases", "vibrate/evaluator.py",
          "solve.excited(now.set_in(arm, own), linear)", "solve.excited(now.set_in(arm), linear)",
          "vibrate/test_worst_case.py"),
    Fault("exact method", "vibrate/exact.py",
          "v + h * once", "v + 0.99 * h * once", "vibrate/test_one_joint.py vibrate/test_exact.py"),
    Fault("input shaping", "vibrate/shaping.py",
          "2 * (1 - v), 1 + v)", "2 * (1 + v), 1 + v)", "vibrate/test_shaping.py"),
    Fault("peaks of a spectrum", "vibrate/spectra.py",
          "0.5 * (left - right) / curvature", "0.5 * (right - left) / curvature", "vibrate/test_spectrum.py"),
    Fault("hammer test", "modal/frf.py",
          "return af / ff", "return af.conj() / ff", "modal/test_estimate.py modal/test_estimates.py"),
    Fault("operational modes", "modal/operational.py",
          "np.log(root[kept]) / step", "np.log(root[kept]) * step", "modal/test_operational.py"),
)
# fmt: on


def put(fault: Fault, tree: Path) -> None:
    """Put a fault into a tree whose other files are as they were."""
    shutil.copytree(ROOT / "ident", tree / "ident", dirs_exist_ok=True, ignore=shutil.ignore_patterns("__pycache__"))
    path = tree / "ident" / fault.file
    text = path.read_text(encoding="utf-8")
    if text.count(fault.old) != 1:
        sys.exit(f"{fault.file}: {text.count(fault.old)} times {fault.old!r} instead of once; correct the table")
    path.write_text(text.replace(fault.old, fault.new), encoding="utf-8")


def finds(tier: str, tests: str, tree: Path) -> bool:
    """Tell whether these tests of a tier fail in a tree."""
    paths = [f"tests/{each}" for each in tests.split()]
    words = [sys.executable, "-m", "pytest", "-qx", "-p", "no:cacheprovider", "-m", TIERS[tier], *paths]
    env = {**os.environ, "PYTHONPATH": str(tree), "JAX_COMPILATION_CACHE_DIR": str(tree.with_name("programs"))}
    done = subprocess.run(words, cwd=tree, env=env, capture_output=True, text=True)
    if done.returncode not in (FAILED, *NOTHING):
        sys.exit(f"pytest ended with {done.returncode}:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    return done.returncode == FAILED


def main() -> None:
    """Print for each fault the first tier that finds it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--resume", type=Path, help="JSON lines to go on with, or to begin")
    parser.add_argument("--tier", choices=TIERS, action="append", help="only this one")
    parser.add_argument("--only", help="faults whose capability contains this")
    parser.add_argument("--whole", action="store_true", help="run the whole tier where the listed tests find nothing")
    options = parser.parse_args()
    lines = options.resume.read_text().splitlines() if options.resume and options.resume.exists() else []
    known = {tuple(key): found for key, found in map(json.loads, lines)}
    counts = dict.fromkeys(TIERS, 0)
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        shutil.copytree(ROOT, tree, ignore=shutil.ignore_patterns(".git", "__pycache__", ".venv", "out"))
        for fault in FAULTS:
            if options.only and options.only not in fault.capability:
                continue
            put(fault, tree)
            answer = "none"
            for tier in options.tier or TIERS:
                key = (fault.capability, tier)
                if key not in known:
                    known[key] = finds(tier, fault.tests, tree) or (options.whole and finds(tier, "", tree))
                    if options.resume:
                        with open(options.resume, "a", encoding="utf-8") as file:
                            print(json.dumps([key, known[key]]), file=file)
                if known[key]:
                    answer = tier
                    counts[tier] += 1
                    break
            print(f"{fault.capability:32}{answer}", flush=True)
    print(", ".join(f"{tier} {count}" for tier, count in counts.items()))


if __name__ == "__main__":
    main()
