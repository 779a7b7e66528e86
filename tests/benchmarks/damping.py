"""Rates of the law of damping: named rightly, its intervals, single rows that are wrong; truths by five laws.

`python tests/benchmarks/damping.py [--draws 40] [--seed 0] [--stages N] [--of pole] [--only ARM]`

Three arms (the paper's, a SCARA, six axes), measured at postures of their own: ratios of the exact poles of an arm that
loses by damping times, a constant, one loss factor by kind, at random mode by mode (0.5 to 3 %), or less at higher
frequencies; each read with a standard error of 5 %. The stiffnesses are the true ones: no ratio moves them.

`--stages 5 [--of pole]`: fits to frequencies, static deflections and such ratios, against fits without the ratios:
equal verdicts and numbers of starts, and the largest difference of a value or an end of an interval, in standard
errors. Frequencies of poles are those of the damped arm, which also is the arm of both fits. No arm has ratios at
random: it then has their mean in all modes.
"""

import argparse
import math
import sys
import time
from collections import Counter
from dataclasses import replace

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np
from shell import ROOT

sys.path.insert(0, str(ROOT / "tests" / "support"))
from one_program import shown

import ident
from ident.arm.fields import ALPHA, LOSS
from ident.identify.damping import RATIO, ModesOfRows, damped, damping_of
from ident.identify.fit import fit_campaign
from ident.identify.modal_analysis import modal_analysis
from ident.identify.predict import ArmModel
from ident.identify.unknowns import Unknowns
from ident.measure import Campaign, Load, Measurement
from ident.measure.load import AXES
from ident.studies.stiffness.fit_report import fit_sections

LAWS = ("viscous", "constant", "by kind", "random", "falling")
NOISE, HERTZ, MODES = 0.05, 0.002, 4
SHARES = {"viscous": {"tau"}, "constant": {"loss"}, "by kind": {"loss"}, "falling": {"alpha"}}


def arms():
    """Yield each arm with postures that are measured, and others that are not [deg]."""
    lcd = ident.read_arm(ROOT / "data" / "lcd_arm" / "arm.toml").arm
    yield "paper", lcd, [(a, -2 * a, a) for a in (0, 30, 60, 80)], [(a, -2 * a, a) for a in (15, 40, 70)]
    scara = ident.read_arm(ROOT / "ident" / "description" / "templates" / "scara.toml").arm
    yield (
        "scara",
        scara,
        [(0,) * len(scara.driven), *[(0, a, *(0,) * (len(scara.driven) - 2)) for a in (40, 80, 120)]],
        [(0, a, *(0,) * (len(scara.driven) - 2)) for a in (20, 60, 100)],
    )
    six = ident.read_arm(ROOT / "data" / "six_axis" / "arm.xml").arm
    measured = [(0, -60, 90, 0, 30, 0), (0, -30, 60, 0, 60, 0), (0, -90, 120, 0, 0, 0), (0, -45, 45, 0, 45, 0)]
    yield "six", six, measured, [(0, -50, 80, 0, 40, 0), (0, -75, 100, 0, 15, 0)]


def rows_at(arm, postures):
    """Return a row for each of the lowest modes at each posture."""
    rows = []
    for posture in np.radians(np.array(postures, float)).tolist():
        analysis = modal_analysis(arm, tuple(posture), modes=MODES)
        for label in dict.fromkeys(map(str, analysis.labels)):
            rows.append(Measurement(kind=RATIO, posture=tuple(posture), value=0.01, sigma=1e-3, mode=label))
    return rows


def truth(law, arm, rng):
    """Return damping numbers by a law; for ratios at random, none."""
    names, zeta = [joint.name for joint in arm.joints], math.exp(rng.uniform(math.log(0.003), math.log(0.03)))
    if law == "viscous":
        tau = zeta / (math.pi * 8.0)
        share = rng.uniform(0.3, 3.0)
        return {f"{n}.tau_bend": tau for n in names} | {f"{n}.tau_tors": tau * share for n in names}
    if law in ("constant", "by kind"):
        share = 1.0 if law == "constant" else rng.uniform(0.3, 3.0)
        return {f"{n}.loss_bend": 2 * zeta for n in names} | {f"{n}.loss_tors": 2 * zeta * share for n in names}
    return {ALPHA: 2 * zeta * 2 * math.pi * 8.0}


def true_ratios(law, arm, rows, rng):
    """Return the true ratio of each row."""
    if law == "random":
        by_mode = {mode: rng.uniform(0.005, 0.03) for mode in dict.fromkeys(m.mode for m in rows)}
        return np.array([by_mode[m.mode] for m in rows])
    numbers = truth(law, arm, rng)
    return ModesOfRows.of(ArmModel(arm, None), {}, rows, ()).poles(numbers)


def found(arm, rows):
    """Return the damping of an arm whose stiffnesses are known."""
    return damping_of(arm, ArmModel(arm, None), Campaign(measurements=tuple(rows)), np.zeros(0), {}, Unknowns())


def stages(name, arm, rows, given):
    """Print how far fits with ratios are from those without."""
    states, tip = dict.fromkeys(m.posture for m in rows), arm.points[-1].name
    loads = (f"15 N -z @ {tip}", "-z"), (f"15 N y @ {tip}", "y")
    still = [
        Measurement(kind="deflection_difference", posture=q, value=1e-3, sigma=3e-5, point=tip, load=Load.parse(load),
                    direction=AXES[along]) for q in states for load, along in loads
    ]  # fmt: skip
    hertz = [replace(m, kind="frequency", value=5.0, of=given.of) for m in rows]
    alone = {}
    for law in LAWS:
        off, same, count = [], 0, 0
        began = time.perf_counter()
        for draw in range(given.stages):
            rng = np.random.default_rng((given.seed, LAWS.index(law), draw))
            held = rng.bit_generator.state
            numbers = {} if law == "random" else truth(law, arm, rng)
            rng.bit_generator.state = held
            ratios = true_ratios(law, arm, rows, rng)
            if law == "random":
                names = [f"{joint.name}.{field}" for joint in arm.joints for field in LOSS]
                numbers = dict.fromkeys(names, 2 * ratios.mean())
            true = damped(arm, numbers) if given.of else arm  # without what falls
            ratios = ratios * (1 + NOISE * rng.standard_normal(len(rows)))
            noise = np.random.default_rng((given.seed, draw)).standard_normal(len(hertz) + len(still))
            values = shown(true, Campaign(measurements=(*hertz, *still)))
            sigma = np.where(np.arange(len(noise)) < len(hertz), HERTZ * np.abs(values), 3e-5)
            others = [
                replace(m, value=float(v), sigma=float(s))
                for m, v, s in zip([*hertz, *still], values + sigma * noise, sigma, strict=True)
            ]
            more = [replace(m, value=float(v), sigma=float(NOISE * v)) for m, v in zip(rows, ratios, strict=True)]
            key = draw if true is arm else (law, draw)
            if key not in alone:
                alone[key] = fit_campaign(true, Campaign(measurements=tuple(others)), trusted=["all"])
            one = alone[key]
            both = fit_campaign(true, Campaign(measurements=(*others, *more)), trusted=["all"])
            sd, words = one.information.sd, [fit_sections(each).verdict for each in (one, both)]
            ends = np.log(both.interval() / one.interval())
            off.append(max(np.nanmax(np.abs(x) / s) for x, s in [(both.best.theta - one.best.theta, sd),
                                                                 (ends, sd[:, None])]))  # fmt: skip
            starts = [sum(optimum.starts for optimum in each.optima) + each.failed for each in (one, both)]
            equal = (words[0].word, one.doubts, starts[0]) == (words[1].word, both.doubts, starts[1])
            same, count = same + equal, count + 1
            if not equal:
                print(f"    {law} {draw}: {words[0].word} {starts[0]} / {words[1].word} {starts[1]} {both.doubts}")
        took = (time.perf_counter() - began) / count
        print(f"  {name} {law:9s} {given.of or 'undamped'}: verdict and starts alike in {same} of {count}, "
              f"largest difference {max(off):.2g} std. errors, {took:.0f} s", flush=True)  # fmt: skip


def main():
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--stages", type=int, default=0, help="campaigns for each arm and law that are fitted twice")
    parser.add_argument("--of", choices=("pole",), help="what their frequencies are of damped modes")
    parser.add_argument("--only", help="an arm")
    given = parser.parse_args()
    for name, arm, measured, others in arms():
        if given.only not in (None, name):
            continue
        if given.stages:
            stages(name, arm, rows_at(arm, measured), given)
            continue
        rows, beyond = rows_at(arm, measured), rows_at(arm, others)
        print(f"\n{name}: {len(rows)} ratios at {len(measured)} postures")
        for law in LAWS:
            named, inside, widths, errors, marked, right = Counter(), [], [], [], 0, 0
            began = time.perf_counter()
            for draw in range(given.draws):
                rng = np.random.default_rng((given.seed, LAWS.index(law), draw))
                known = true_ratios(law, arm, [*rows, *beyond], rng)
                value = known[: len(rows)] * (1 + NOISE * rng.standard_normal(len(rows)))
                own = [replace(m, value=float(v), sigma=float(NOISE * v)) for m, v in zip(rows, value, strict=True)]

                damping = found(arm, own)
                named["undecided" if damping.rivals else "+".join(sorted(damping.best.family))] += 1
                right += int(damping.marked.sum())
                if law == "random":  # each mode by its other rows
                    i = int(rng.integers(len(own)))
                    pairs = [(found(arm, [*own[:i], *own[i + 1 :]]), [own[i]], known[[i]])]
                else:
                    pairs = [(damping, beyond, known[len(rows) :])]
                for fitted, like, true in pairs:
                    low, high = np.quantile(
                        np.log(fitted.drawn(Campaign(measurements=tuple(like)), 1000, draw)), [0.025, 0.975], 1
                    )
                    mid = (low + high) / 2
                    inside += ((low <= np.log(true)) & (np.log(true) <= high)).tolist()
                    widths += ((high - low) / 2).tolist()
                    errors += (np.log(true) - mid).tolist()
                if law != "random":
                    i = int(rng.integers(len(own)))
                    wrong = [*own]
                    wrong[i] = replace(own[i], value=min(own[i].value * 3, 0.9), sigma=own[i].sigma * 3)
                    marked += bool(found(arm, wrong).marked[i])
            rms = float(np.sqrt(np.mean(np.square(errors))))
            ratio = float(np.median(widths)) / rms
            took = (time.perf_counter() - began) / given.draws
            print(
                f"  {law:9s} {dict(named)!s:50s} coverage {np.mean(inside):.3f} half width/rms {ratio:.2f} "
                f"marked: right {right / given.draws / len(rows):.4f} wrong {marked / given.draws:.2f} {took:.2f} s"
            )


if __name__ == "__main__":
    sys.exit(main())
