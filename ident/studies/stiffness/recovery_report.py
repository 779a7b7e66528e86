"""The report of a recovery of known truths, and its table."""

from typing import TYPE_CHECKING, Any

from ident.report.report import Finding, Report, Verdict, by_head, cut
from ident.report.words import counted, percent, size_in_words, some
from ident.vibrate.binomial import HALF_WIDTH, BinomialEstimate

if TYPE_CHECKING:
    from ident.identify.recovery import Recovery

ENOUGH = 0.8
"""Share of robots below which a fault or a change is often missed: the usual power of a test."""


def recovery_sections(recovery: "Recovery") -> Report:
    """Return the report: RECOVERED if intervals hold the truth as often as they say, and false alarms are rare."""
    from scipy.stats import binom

    from ident.identify.recovery import CHANGE, CHANGED, RIGHT

    fit, rates, (alarms, draws), rows, faults = recovery.fit, recovery.rates, recovery.noticed[RIGHT], [], []
    for item, row in zip(fit.problem.parameters.items, rates, strict=True):
        sizes = (row["bias"], "+"), (HALF_WIDTH * row["standard_error"], "")
        bias = " ± ".join(percent(x, s) if item.positive else size_in_words(item, x, s) for x, s in sizes)
        held, of = row["held"], row["intervals"]
        band = "{:.0f} to {:.0f}".format(*binom.interval(0.95, of, row["level"])) if of else "-"
        rows.append((item.name, bias, f"{held} of {of}", band, row["power"]))
    for name, (count, of) in recovery.noticed.items():
        band = "{:.0f} to {:.0f} %".format(*(100 * end for end in BinomialEstimate(count, of).interval)) if of else "-"
        linear = f"; by the linear problem {recovery.expected:.1f}" if name == CHANGED else ""
        faults.append((name, f"{count} of {of}{linear}", band))
    shares = [100 * row["held"] / row["intervals"] for row in rates if row["intervals"]]
    good = bool(shares) and not recovery.missed
    held = f"holds the truth of {min(shares):.0f} to {max(shares):.0f} %" if shares else "is not reported"
    right = f"Of {draws} robots, each 95 % interval {held}; {counted(alarms, 'false alarm')}."
    wrong = f"Outside the binomial band: {some(recovery.missed)}. " * bool(recovery.missed)
    weak = [f"a change of {row['unknown']}" for row in rates if row["power"] is not None and row["power"] < ENOUGH]
    weak += [name for name, (count, of) in [*recovery.noticed.items()][2:] if count < ENOUGH * of]
    following = "ident profile" if recovery.missed else "ident plan" if weak else "ident sample"
    heads = "Unknown", "bias, 95 %", "intervals with the truth", "expected", f"{100 * CHANGE:g} % more is noticed|.0%"
    arm, campaign = cut(fit.arm.name, 30), cut(fit.campaign.name, 30)
    return Report(
        f"Recovery of {draws} robots drawn from the {recovery.truths} of {arm} by {campaign}",
        Verdict("RECOVERED" if good else "NOT RECOVERED", wrong + right, "good" if good else "bad"),
        (by_head(heads, rows), by_head(("What is wrong", "noticed", "95 % band of the rate"), faults)),
        (Finding(f"Often unnoticed: {some(weak)}", "see `ident plan`"),) if weak else (),
        next=f"{following} {{campaign}}",
    )


def recovery_rows(recovery: "Recovery") -> list[dict[str, Any]]:
    """Return a row for each unknown, see `Recovery.rates`."""
    return [dict(row) for row in recovery.rates]
