"""What the fits of ten thousand robots cost: `python tests/benchmarks/fleet_batch.py [--robots 10000] [--batch 256]`.

Robots of the shipped arm's design, 16 frequencies and 4 deflections each, fitted together (`ident fleet --batch`) in
this process; in CPU seconds, which other work on the machine changes little. Files are stated apart, from some robots.
"""

import argparse
import resource
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np
from timing import commit, machine

TESTS = Path(__file__).parents[1]
DESIGN = TESTS.parent / "data" / "lcd_arm"
sys.path.append(str(DESIGN))

from synthesize import synthesize

from ident.description.file import read_arm
from ident.identify.fit import fit_campaign
from ident.identify.fleet import SourceFile, robot_of
from ident.identify.fleet_batch import Given, robots_together
from ident.identify.problem import pose
from ident.identify.unknowns import Unknowns
from ident.measure import Campaign, read_campaign, write_campaign

SPREAD, WITH_FILES, ALONE = 0.08, 300, 10


def fleet(arm, count: int, rng: np.random.Generator) -> tuple[list[Campaign], np.ndarray]:
    """Return campaigns of so many robots, and the truths of ln(stiffness)."""
    like = synthesize(arm, 1)
    like = Campaign(measurements=tuple(replace(m, mode=None) for m in like))
    problem = pose(arm, like, Unknowns()).problem
    start = np.asarray(problem.parameters.theta(problem.parameters.column("start")))
    truth = start[:, None] + SPREAD * rng.standard_normal((len(start), count))
    predict = jax.jit(lambda theta: problem.predict(theta))
    parts = [np.asarray(predict(part)) for part in np.array_split(truth, max(1, count // 500), axis=1)]
    sigma = np.array([m.sigma for m in like])[:, None]
    values = np.concatenate(parts, 1) + sigma * rng.standard_normal((len(sigma), count))
    rows = ((replace(m, value=float(v)) for m, v in zip(like, each, strict=True)) for each in values.T)
    return [Campaign(measurements=tuple(each)) for each in rows], truth.T


def main() -> None:
    """Print times, memory, and how far the fits are from the truth."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, default=10_000)
    parser.add_argument("--batch", type=int, default=256)
    options = parser.parse_args()
    arm = read_arm(DESIGN / "arm.toml").arm
    campaigns, truth = fleet(arm, options.robots, np.random.default_rng(0))
    print(f"{machine()}, commit {commit()}: {options.robots} robots of {len(campaigns[0])} values")
    one_file = SourceFile("arm.toml", "the same")
    given = [Given(f"{i:06d}", each, arm, SourceFile(), one_file) for i, each in enumerate(campaigns)]
    batches = [given[i : i + options.batch] for i in range(0, len(given), options.batch)]
    before = time.process_time()
    robots_together(batches[0], Unknowns(), options.batch)
    print(f"the first batch, its program compiled or loaded: {time.process_time() - before:.1f} s")
    held = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    before, found = time.process_time(), {}
    for batch in batches:
        found |= robots_together(batch, Unknowns(), options.batch)
    took = time.process_time() - before
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(f"fitted together: {len(found)} in {took:.1f} CPU s, {1e3 * took / len(given):.2f} ms each")
    print(f"memory at most {most / 2**20:.2f} GB; {(most - held) / 2**10:.0f} MB more than after the first batch")
    off = np.array(
        [(found[g.name].theta - t) / found[g.name].sd for g, t in zip(given, truth, strict=True) if g.name in found]
    )
    print(f"(estimate - truth) / sd: mean {off.mean():+.3f}, sd {off.std():.3f}")
    rest = [each for each in given if each.name not in found]
    _alone(arm, rest[:ALONE], len(rest))
    _together_or_alone(arm, given[:ALONE], found)
    _files(campaigns[:WITH_FILES])


def _alone(arm, some: list[Given], count: int) -> None:
    if not some:
        return
    fit_campaign(arm, some[0].campaign, Unknowns(), starts=4)
    before = time.process_time()
    for each in some:
        fit_campaign(arm, each.campaign, Unknowns(), starts=4)
    each = (time.process_time() - before) / len(some)
    print(f"the other {count}, each by itself: {each:.2f} s each (of {len(some)}), {count * each:.0f} s for all")


def _together_or_alone(arm, some: list[Given], found) -> None:
    apart = []
    for each in some:
        if each.name in found:
            own = robot_of(fit_campaign(arm, each.campaign, Unknowns(), starts=4), "", SourceFile(), SourceFile())
            apart.append(np.abs(own.theta - found[each.name].theta).max())
    print(f"fitted together and alone differ by at most {max(apart):.1e} in ln(stiffness), of {len(apart)}")


def _files(campaigns: list[Campaign]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / f"{i}.csv" for i in range(len(campaigns))]
        for campaign, path in zip(campaigns, paths, strict=True):
            write_campaign(campaign, path, header_comments=(), relative_sigma=True)
        before = time.process_time()
        for path in paths:
            read_campaign(path)
        print(f"a CSV file is read in {1e3 * (time.process_time() - before) / len(paths):.1f} ms of CPU")


if __name__ == "__main__":
    main()
