"""How often what is wrong on purpose is noticed by a fit, and how often what would reconcile the data names it first.

`python tests/benchmarks/explanations.py [--arm lcd|six] [--draws 10] [--seed 0] [--only TEXT] [--resume FILE]`

The rows of a shipped campaign (data/lcd_arm, data/six_axis), measured on arms whose stiffnesses are drawn about the
file's (a tenth), one thing wrong. `--noticed` leaves out the search for explanations, which takes most of the time.

`--once` searches from one start only, and leaves out what compares kinds of data and starts. It says how often rows,
chi-squared, labels or assumptions ring, by z and by residual / sigma, and how often swapped values are named first, or
the wrong row has the largest z.

`--rows` does the same for single wrong rows by linear algebra: one Jacobian at the arm file's stiffnesses, `--draws`
draws of noise for each row, which is 6 sigma off, and as many of right campaigns; beside what the leverages say. Exit
code 1 where a rate lies outside its binomial band. First it prints for each thing wrong how often rows and chi-squared
ring, likewise by linear algebra, at the arm file's stiffnesses.
"""

import argparse
import sys

import jax

jax.config.update("jax_enable_x64", True)

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import resumable
from scipy.stats import binom, chi2, norm
from timing import commit, machine

from ident.arm.arm import Arm, on_soft_base, stiffness_paths
from ident.arm.parts import Body, Payload, Spring
from ident.description.file import read_arm
from ident.identify.conditions import bind
from ident.identify.explanations import explain
from ident.identify.fit import fit_campaign
from ident.identify.predict import predict
from ident.measure import Campaign, Load, read_campaign
from ident.programs import jit

DATA = Path(__file__).parents[2] / "data"
FILES = {"lcd": ("lcd_arm/arm.toml", "lcd_arm/campaign.csv"), "six": ("six_axis/arm.xml", "six_axis/campaign.csv")}
SPREAD = 0.1
LARGEST = 1790.0, 752.0, 197.0
"""Bending moments [N m] of the three joints in the paper's arm's campaign."""
HEIGHT = 0.5
"""Of bushing 1 above the point about which a base gives [m]."""
OFF = 6.0
"""Sigmas by which a wrong row is off."""
BAND = 0.999
PREDICT = jit(lambda arm, conditions: predict(arm, {}, conditions))

Cause = tuple[str, str, tuple[int, ...]]
"""Kind, what it is of, and rows of the change that is to be named; empty where any will do."""


class Fault(NamedTuple):
    """One thing wrong: how the true arm is, how the rows are really loaded, how values are spoilt, what is to be named.

    A spoiling gets the places that were drawn for it, and returns values in sigma, or exchanges.
    """

    arm: Callable[[Arm], Arm] = lambda arm: arm
    rows: Callable[[Campaign], Campaign] = lambda campaign: campaign
    spoil: Callable[[Campaign, np.random.Generator], tuple[Campaign, tuple[int, ...]]] = lambda campaign, _: (
        campaign,
        (),
    )
    cause: tuple[str, str] = ("", "")


def heavier(arm: Arm) -> Arm:
    """Make the fingers 30 % heavier."""
    return arm.replace({"fingers.mass": 1.3 * float(arm.get("fingers.mass"))})


def heavy_link(arm: Arm) -> Arm:
    """Make link 2 a tenth heavier, its inertia with it."""
    own = tuple(f"{body.name}.{part}" for body in arm.joints[1].link for part in ("mass", "inertia"))
    return arm.replace({path: 1.1 * float(arm.get(path)) for path in arm.paths() if path.startswith(own)})


def soft(times: float) -> Callable[[Arm], Arm]:
    """Put an arm on a base so many times as stiff as joint 1."""

    def on_base(arm: Arm) -> Arm:
        first = arm.joints[0].name
        stiffness = {f"base.{k}": times * float(arm.get(f"{first}.{k}")) for k in ("k_bend", "k_tors")}
        return on_soft_base(arm, HEIGHT).replace(stiffness)

    return on_base


def hardening(arm: Arm) -> Arm:
    """Let all bending springs harden, their transitions within the data."""
    ends = {"ratio2": 1.2, "ratio3": 1.4}
    springs = [
        Spring(f"s{n}", f"joint{n}", "bending", torque1=0.6 * m, torque2=0.9 * m, **ends)
        for n, m in enumerate(LARGEST, 1)
    ]
    return replace(arm, springs=tuple(springs))


def gauge(campaign: Campaign, rng: np.random.Generator) -> tuple[Campaign, tuple[int, ...]]:
    """Read all deflections as 0.93 of what they are."""
    rows = (replace(m, value=0.93 * m.value) if m.kind == "deflection" else m for m in campaign)
    return replace(campaign, measurements=tuple(rows)), ()


def misread(campaign: Campaign, rng: np.random.Generator) -> tuple[Campaign, tuple[int, ...]]:
    """Read the first deflection as 1.2 of what it is."""
    place = next(i for i, m in enumerate(campaign) if m.kind == "deflection")
    rows = (replace(m, value=1.2 * m.value) if i == place else m for i, m in enumerate(campaign))
    return replace(campaign, measurements=tuple(rows)), (place,)


def row_off(campaign: Campaign, rng: np.random.Generator) -> tuple[Campaign, tuple[int, ...]]:
    """Let a row that is drawn be off."""
    place, sign = int(rng.integers(len(campaign))), rng.choice([-1.0, 1.0])
    rows = (replace(m, value=m.value + sign * OFF * m.sigma) if i == place else m for i, m in enumerate(campaign))
    return replace(campaign, measurements=tuple(rows)), (place,)


def swapped(campaign: Campaign, rng: np.random.Generator) -> tuple[Campaign, tuple[int, ...]]:
    """Exchange two values of one state: labelled frequencies, or what was read of two directions."""
    rows = list(campaign.measurements)
    states = [(m.kind, m.posture, m.load) for m in rows]
    own = [i for i, m in enumerate(rows) if m.mode is not None or m.kind == "deflection_difference"]
    pairs = [(i, j) for i in own for j in own if i < j and states[i] == states[j]]
    i, j = pairs[int(rng.integers(len(pairs)))]
    a, b = rows[i], rows[j]
    rows[i], rows[j] = replace(a, value=b.value, sigma=b.sigma), replace(b, value=a.value, sigma=a.sigma)
    return replace(campaign, measurements=tuple(rows)), (i, j)


def carrying(payload: str, kind: str) -> Callable[[Campaign], Campaign]:
    """Let a payload be on in all rows of a kind."""

    def loaded(campaign: Campaign) -> Campaign:
        rows = (replace(m, load=Load((payload,))) if m.kind == kind else m for m in campaign)
        return replace(campaign, measurements=tuple(rows))

    return loaded


def faults(name: str) -> dict[str, Fault]:
    """Return what may be wrong with a shipped campaign."""
    arm, _ = case(name)
    both = {
        "none": Fault(),
        "one row 6 sigma off": Fault(spoil=row_off, cause=("value", "")),
        **{f"base {x}": Fault(soft(float(x)), cause=("soft base", "")) for x in (5, 10, 20)},
        "two values swapped": Fault(spoil=swapped, cause=("exchange", "")),
        "link 2 a tenth heavier": Fault(heavy_link, cause=("mass", arm.joints[1].link[0].name)),
    }
    if name == "six":
        return both | {"tool on, unsaid": Fault(rows=carrying("tool", "frequency"), cause=("on", "tool"))}
    return both | {
        "glass on, unsaid": Fault(rows=carrying("glass", "deflection"), cause=("on", "glass")),
        "fingers 30 % heavier": Fault(heavier, cause=("mass", "fingers")),
        "deflections x 0.93": Fault(spoil=gauge, cause=("scale", "deflection")),
        "one deflection x 1.2": Fault(spoil=misread, cause=("value", "deflection")),
        "springs harden": Fault(hardening, cause=("spring", "bending")),
    }


@cache
def case(name: str) -> tuple[Arm, Campaign]:
    """Return a shipped arm and its campaign; the one of six axes may carry a tool of half a kilogramme."""
    arm, campaign = (DATA / file for file in FILES[name])
    found = read_arm(arm).arm
    if name == "six":
        point = next(point for point in found.points if point.name == "tip")
        tool = Body("tool", 0.5, np.asarray(point.position), 5e-4 * np.eye(3))
        found = replace(found, payloads=(Payload(point.joint, tool),))
    return found, read_campaign(campaign)


def measured(name: str, fault: Fault, seed: int, draw: int) -> tuple[Campaign, tuple[int, ...]]:
    """Return a campaign in which something is wrong, and the rows that were spoilt.

    A truth whose modes change names is drawn again.
    """
    (arm, said), rng = case(name), np.random.default_rng([seed, draw])
    rows = fault.rows(said)
    exact = np.full(len(rows), np.nan)
    while not np.isfinite(exact).all():
        drawn = {path: float(arm.get(path)) * np.exp(SPREAD * rng.standard_normal()) for path in stiffness_paths(arm)}
        true = fault.arm(arm.replace(drawn))
        exact = np.asarray(PREDICT(true, bind(true, rows)))
    values = exact + np.array([m.sigma for m in said]) * rng.standard_normal(len(exact))
    blank = [i for i, m in enumerate(said) if m.kind == "frequency" and m.mode is None]
    for posture in said.postures:  # frequencies without a label ascend
        own = [i for i in blank if said.measurements[i].posture == posture]
        values[own] = np.sort(values[own])
    told = (replace(m, value=float(v)) for m, v in zip(said, values, strict=True))
    return fault.spoil(replace(said, measurements=tuple(told)), rng)


def work(name: str, words: str, draw: int, seed: int, explaining: bool) -> dict[str, Any]:
    """Say of one campaign whether it is in doubt, at which place of what fits the true cause comes, and how many fit.

    Place 0 is none; where nothing is in doubt nothing is sought.
    """
    arm, fault = case(name)[0], faults(name)[words]
    campaign, rows = measured(name, fault, seed, draw)
    fit = fit_campaign(arm, campaign, trusted=("all",), starts=4)
    found = explain(fit) if explaining and fit.in_doubt else None
    fitting = [item.changes for item in found.fitting] if found else []
    named = [len(changes) == 1 and meant(changes[0], fault, rows) for changes in fitting]
    return {"noticed": fit.in_doubt, "place": named.index(True) + 1 if True in named else 0, "fit": len(fitting)}


def once(name: str, words: str, draw: int, seed: int) -> dict[str, bool]:
    """Say what rings of one campaign, fitted from one start."""
    from ident.identify.assumptions import assumptions
    from ident.identify.exchangeable import exchangeable, moves_of
    from ident.identify.mode_matching import FAR
    from ident.identify.problem import pose
    from ident.inference.fit import Fit
    from ident.inference.information import information, rare
    from ident.inference.optima import distinct, normal_prior_sd
    from ident.inference.scrutiny import exchanges
    from ident.inference.search import ended, solve

    arm, fault = case(name)[0], faults(name)[words]
    campaign, rows = measured(name, fault, seed, draw)
    problem = pose(arm, campaign).problem
    known = problem.parameters
    reached = [ended(problem, solve(problem, np.asarray(known.theta(known.column("start")))))]
    end = reached[0][0]
    told = information(problem.scaled(np.asarray(end.jacobian)), normal_prior_sd(problem), known.names, known.nuisance)
    fit = Fit(problem, distinct(problem, reached), 0, end.predicted, end.jacobian, told, end.choice)
    by_sigma = bool(rare(2 * norm.sf(np.abs(fit.residuals))).any())
    chi_squared, labels = fit.improbable, not bool(fit.choice.settled)
    asked = bool(assumptions(fit, pose(arm, campaign)).asked_for)
    off = np.abs(np.nan_to_num(fit.row_tests.z))
    swaps = ()
    if (labels or chi_squared or fit.outliers.any()) and fit.degrees_of_freedom > 0:
        renamed = set(np.flatnonzero(np.asarray(fit.choice.cost) >= FAR).tolist())
        pairs = list(exchangeable(campaign, [*np.argsort(-off)[:20].tolist(), *renamed]))
        suspected = [pair for pair in pairs if set(pair) <= renamed]
        swaps = exchanges(fit, pairs, suspected, moves_of(campaign)) if words == "two values swapped" else ()
    return {
        "rows": bool(fit.outliers.any()),
        "rows by sigma": by_sigma,
        "any": bool(fit.outliers.any() or chi_squared or labels or asked),
        "any by sigma": bool(by_sigma or chi_squared or labels or asked),
        "named first": swaps[0].rows == rows if swaps else len(rows) == 1 and int(off.argmax()) == rows[0],
        "first by sigma": len(rows) == 1 and int(np.abs(fit.residuals).argmax()) == rows[0],
    }


def meant(change: Any, fault: Fault, rows: tuple[int, ...]) -> bool:
    """Tell whether a change is what is wrong."""
    kind, of = fault.cause
    return change.kind == kind and of in ("", change.of) and (not rows or set(change.rows) == set(rows))


def by_rows(name: str, draws: int, seed: int) -> bool:
    """Print how often single wrong rows are noticed by linear algebra, and tell whether it is as it should be."""
    from ident.identify.problem import pose
    from ident.inference.information import row_tests
    from ident.inference.search import evaluate

    problem, rng = pose(*case(name)).problem, np.random.default_rng(seed)
    here = evaluate(problem)
    theta = np.asarray(problem.parameters.theta(problem.parameters.column("start")))
    _, slope = (np.asarray(x) for x in problem.weigh(np.asarray(here.predicted), np.asarray(here.jacobian), theta))
    count, known = len(problem.kinds), np.isfinite(np.diag(slope[len(problem.kinds) :]))
    left = row_tests(problem, np.zeros(len(slope)), slope).left

    def noticed(wrong: int) -> np.ndarray:
        errors = rng.standard_normal(len(slope)) * np.append(np.ones(count), known)
        errors[:count] += OFF * (np.arange(count) == wrong)
        step, *_ = np.linalg.lstsq(slope, -errors, rcond=None)
        return np.asarray(row_tests(problem, errors + slope @ step, slope).outliers)

    alarms = sum(bool(noticed(-1).any()) for _ in range(draws))
    limit = row_tests(problem, np.zeros(len(slope)), slope).limit
    said = norm.cdf(OFF * np.sqrt(left) - limit)
    found = np.array([np.mean([noticed(i)[i] for _ in range(draws)]) for i in range(count)])
    outside = [i for i in range(count) if not _in_band(found[i], said[i], draws, count)]
    most = int(binom.ppf(BAND, draws, 0.0027))
    print(
        f"{name}: {count} rows, limit {limit:.2f}; right campaigns with an alarm {alarms} of {draws} (at most {most})"
    )
    print(f"  a row {OFF:g} sigma off is noticed: mean {found.mean():.3f}, as leverages say {said.mean():.3f}")
    print(f"  least {found.min():.3f} (said {said.min():.3f}); rows outside their {BAND:.1%} band, all rows: {outside}")
    return alarms <= most and not outside and bool(abs(found.mean() - said.mean()) < 0.02)


def by_kind(name: str, draws: int, seed: int) -> None:
    """Print how often rows and chi-squared ring by linear algebra, of campaigns of the arm file's stiffnesses."""
    from ident.identify.problem import pose
    from ident.inference.information import IMPROBABLE, rare, row_tests
    from ident.inference.search import evaluate

    (arm, said), problem = case(name), pose(*case(name)).problem
    here, sigma = evaluate(problem), np.asarray(problem.sigma)
    exact, theta = np.asarray(here.predicted), np.asarray(problem.parameters.theta(problem.parameters.column("start")))
    _, slope = (np.asarray(x) for x in problem.weigh(exact, np.asarray(here.jacobian), theta))
    freedom = len(exact) - np.linalg.matrix_rank(slope[: len(exact)])
    print(
        f"{name}, by linear algebra at the arm file's stiffnesses, of {draws}: rows by z, rows by sigma, chi-squared,"
    )
    print(
        "  any by z, any by sigma; the wrong row, or one of two, has the largest z, residual / sigma, of those noticed"
    )
    for words, fault in faults(name).items():
        rng, found = np.random.default_rng(seed), []
        true = fault.arm(arm)
        values = np.asarray(PREDICT(true, bind(true, fault.rows(said))))
        for _ in range(draws):
            drawn = values + sigma * rng.standard_normal(len(values))
            told = (replace(m, value=float(v)) for m, v in zip(said, drawn, strict=True))
            campaign, rows = fault.spoil(replace(said, measurements=tuple(told)), rng)
            errors = np.append((exact - np.array([m.value for m in campaign])) / sigma, np.zeros(len(theta)))
            step, *_ = np.linalg.lstsq(slope, -errors, rcond=None)
            left = errors + slope @ step
            tests, by_sigma = row_tests(problem, left, slope), left[: len(exact)]
            by_z, by_s = bool(tests.outliers.any()), bool(rare(2 * norm.sf(np.abs(by_sigma))).any())
            large = bool(chi2.sf((by_sigma**2).sum(), freedom) < IMPROBABLE)
            firsts = [int(np.argmax(np.abs(np.nan_to_num(x)))) in rows for x in (tests.z, by_sigma)]
            found.append(
                [by_z, by_s, large, by_z or large, by_s or large, *(first and (by_z or large) for first in firsts)]
            )
        print(f"  {words:24s}" + " ".join(f"{count:6d}" for count in np.sum(found, 0)), flush=True)


def _in_band(found: float, said: float, draws: int, count: int) -> bool:
    """Tell whether a rate is possible; further limits of Holm's are lower, so a little more may be noticed."""
    tail = (1 - BAND) / 2 / count
    return bool(binom.ppf(tail, draws, said) <= round(found * draws) <= binom.ppf(1 - tail, draws, said + 0.005))


def main() -> None:
    """Print, by fault, how many campaigns were in doubt, and where the true cause came."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arm", choices=FILES, default="lcd")
    parser.add_argument("--draws", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="")
    parser.add_argument("--noticed", action="store_true", help="do not search for explanations")
    parser.add_argument("--once", action="store_true", help="one search a campaign, no explanations")
    parser.add_argument("--rows", action="store_true", help="single wrong rows, by linear algebra")
    parser.add_argument("--resume", type=Path, metavar="FILE", help="JSON lines to go on with, or to begin")
    parser.add_argument("--processes", type=int, default=1)
    asked = parser.parse_args()
    print(f"{machine()}, seed {asked.seed}, commit {commit()}")
    if asked.rows:
        by_kind(asked.arm, asked.draws, asked.seed)
        sys.exit(not by_rows(asked.arm, asked.draws, asked.seed))
    if asked.once:
        names = [words for words in faults(asked.arm) if asked.only in words]
        wanted = [(asked.arm, words, i, asked.seed) for i in range(asked.draws) for words in names]
        done = resumable.run(once, wanted, {"seed": asked.seed}, asked.resume, asked.processes)
        for words in names:
            each = [done[key] for key in wanted if key[1] == words]
            rates = ", ".join(f"{what} {sum(found[what] for found in each)}" for what in each[0])
            noticed = [found for found in each if found["any"]]
            first = sum(found["named first"] for found in noticed)
            print(f"{words}, {len(each)} campaigns: {rates}; of those noticed named first {first} of {len(noticed)}")
        return
    names = [words for words in faults(asked.arm) if asked.only in words]
    wanted = [(asked.arm, words, i, asked.seed, not asked.noticed) for i in range(asked.draws) for words in names]
    done = resumable.run(work, wanted, {"seed": asked.seed}, asked.resume, asked.processes)
    for words in names:
        each = [done[key] for key in wanted if key[1] == words]
        doubtful = [found for found in each if found["noticed"]]
        places = [found["place"] for found in doubtful]
        print(
            f"{words}: in doubt {len(doubtful)} of {len(each)}; true cause fits {sum(p > 0 for p in places)}, first"
            f" {places.count(1)}, second {places.count(2)}; explanations that fit, median"
            f" {np.median([found['fit'] for found in doubtful] or [0]):.0f}"
        )


if __name__ == "__main__":
    main()
