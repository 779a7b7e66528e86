"""The report of profiles of a fit, and its table."""

from collections.abc import Iterator, Sequence
from typing import Any

from ident.identify.fit import CampaignFit
from ident.inference.optima import LINEAR, Ending
from ident.inference.profile import Interval, Profile, threshold
from ident.report.report import Finding, Report, Section, Table, Verdict, by_head, cut, without_empty_columns, written
from ident.report.words import (
    counted,
    in_shown_unit,
    percent,
    priors_in_words,
    sentence,
    shared_unit,
    unit_of,
    with_tied,
)
from ident.studies.stiffness.warnings import drive_states

SIDES = ("below", "above")


def profile_sections(fit: CampaignFit, profiles: Sequence[Profile]) -> Report:
    """Return the report of profiles."""
    verdict = _verdict(fit, profiles)
    following = {"CONFIRMED": "ident validate", "NOT USABLE": "ident fit"}.get(verdict.word)
    if following is None:
        following = "ident plan" if any(_open_sides(profile) for profile in profiles) else "ident sample"
    return Report(
        f"Profile likelihood of {cut(fit.arm.name, 40)} on {cut(fit.campaign.name, 30)}: "
        f"{counted(len(fit.campaign), 'measurement')}, {counted(len(fit.problem.parameters.items), 'unknown')}",
        verdict,
        (_intervals_table(profiles),),
        tuple(_findings(fit, profiles)),
        next=f"{following} {{campaign}}",
        details=tuple(_details(fit, profiles)),
    )


def _verdict(fit: CampaignFit, profiles: Sequence[Profile]) -> Verdict:
    """Judge the linear intervals by the profiles: CONFIRMED, PARTLY, NOT CONFIRMED; NOT USABLE like its fit."""
    if fit.doubts:
        doubts = " ".join(map(sentence, fit.doubts))
        return Verdict("NOT USABLE", f"{doubts} The curves show the shape of chi-squared; use no interval.", "bad")
    if fall := max(profile.beaten for profile in profiles):
        return Verdict("NOT USABLE", f"The fit is not the best optimum: chi-squared falls {fall:.3g} below it.", "bad")
    count = len(profiles)
    agreeing = sum(each.linear and not _open_sides(each) and not each.rivals for each in profiles)
    limit = f"agree{'s' * (count == 1)} with the linear approximation within {percent(LINEAR)}"
    if agreeing == count:
        worst = max(abs(half - 1) for profile in profiles for half in profile.halves)
        which = f"All {count} intervals" if count > 1 else "The interval"
        return Verdict("CONFIRMED", f"{which} {limit} (largest difference {percent(worst)}).", "good")
    reason = f"{agreeing} of {counted(count, 'interval')} {limit}; take the others from the profile."
    return Verdict(f"PARTLY {agreeing} OF {count}" if agreeing else "NOT CONFIRMED", reason, "caution")


def _open_sides(profile: Profile) -> list[int]:
    return [side for side in (0, 1) if profile.widest.endings[side] is Ending.OPEN]


def _intervals_table(profiles: Sequence[Profile]) -> Table:
    shared, rows = shared_unit(profile.name for profile in profiles), []
    for profile in profiles:
        value, unit = in_shown_unit(profile.name, float(profile.values([profile.optimum])[0]))
        fitted = written(value, "#.5g") + f" {unit}".removesuffix(" -") * (not shared)
        ends = (interval_text(profile, interval) for interval in (profile.widest, profile.linear_interval))
        pairs = zip(profile.halves, profile.widest.endings, strict=True)
        halves = ("open" if ending is Ending.OPEN else f"{half:.2f}" if half else "closed" for half, ending in pairs)
        rows.append((with_tied(profile.item), fitted, *ends, ", ".join(halves), "" if profile.linear else "*"))
    level = level_in_words(profiles[0].widest.level)
    note = f"*: not within {percent(LINEAR)} of 1." * (not all(profile.linear for profile in profiles))
    heads = f"Unknown{shared}", "fitted", f"{level} by profile", "linear", "profile / linear", ""
    return without_empty_columns(by_head(heads, rows, note=note))


def _findings(fit: CampaignFit, profiles: Sequence[Profile]) -> Iterator[Finding]:
    """Yield irregularities of the profiles, most important first."""
    for profile in sorted(profiles, key=lambda each: -each.beaten):
        if profile.beaten:
            text = f"{profile.name}: on the way chi-squared falls {profile.beaten:.3g} below the fit's"
            yield Finding(text, "fit again with more starts (--starts)")
    yield from drive_states(fit.arm, fit.campaign)
    for profile in profiles:
        if profile.rivals:
            places = ", ".join(_shown(profile, theta) for theta in profile.rivals)
            text = f"{profile.name}: another optimum fits about as well outside this interval, at {places}"
            text += f" {in_shown_unit(profile.name, 1.0)[1]}"
            yield Finding(text.removesuffix(" -"), "measure what tells them apart (`ident plan`)")
    for side, word in enumerate(("lower", "upper")):
        if names := [profile.name for profile in profiles if side in _open_sides(profile)]:
            yield Finding(f"the data give no {word} bound for {', '.join(names)}", "measure what `ident plan` proposes")
    for profile in profiles:
        for side, theta in enumerate((profile.widest.low, profile.widest.high)):
            if profile.widest.endings[side] is Ending.MODEL:
                end = _shown(profile, theta)
                yield Finding(f"{profile.name}: bounded {SIDES[side]} by the model, which has no answer beyond {end}")
    for profile in profiles:
        if lost := int((~profile.converged_inside).sum()):
            where = f"{lost} of {counted(len(profile.converged_inside), 'point')}"
            yield Finding(f"{profile.name}: the search did not converge at {where}; the profile may lie lower there")


# -------- Details


def _details(fit: CampaignFit, profiles: Sequence[Profile]) -> Iterator[Section]:
    level = profiles[0].widest.level
    method = (
        f"Each unknown is moved in steps and all others are fitted again at each step. {level_in_words(level)}: "
        f"chi-squared rises by {threshold(level):.3g} (one degree of freedom). Chi-squared counts data and priors, as "
        f"in the fit; its minimum is {fit.best.cost:.4g}. profile / linear: lower and upper half of the profile's "
        f"interval, each over the half of the linear interval; *: not within {percent(LINEAR)} of 1."
    )
    if any(0.0 in profile.halves for profile in profiles):
        method += " closed: the profile has an end there, the linear interval has none."
    yield Section("How to read it", (method, *priors_in_words(fit.problem.parameters.items)))
    levels = [interval.level for interval in profiles[0].intervals]
    if len(levels) > 1:
        rows = ((each.name, *(interval_text(each, interval) for interval in each.intervals)) for each in profiles)
        title = f"Intervals at all levels{shared_unit(each.name for each in profiles)}"
        yield Section(title, (by_head(("unknown", *map(level_in_words, levels)), rows),))
    sides = []
    for profile, side in ((each, side) for each in profiles for side in _open_sides(each)):
        end, rise = _shown(profile, profile.theta[-side]), float(profile.delta_chi_squared[-side])
        flat = " and stays flat" * bool(profile.flat[side])
        sides.append(f"{profile.name} {SIDES[side]}: chi-squared rises by {max(rise, 0.0):.2g} up to {end}{flat}.")
    if sides:
        yield Section("Sides without a bound", tuple(sides))


def interval_text(profile: Profile, interval: Interval) -> str:
    """Write an interval: two numbers, one where a side is open, or `open`."""
    return span_text(interval, *(_shown(profile, theta) for theta in (interval.low, interval.high)))


def span_text(interval: Interval, low: str, high: str) -> str:
    """Write an interval from the texts of its ends: `3.1 to 4.2`, `above 3.1`, or `open`."""
    below, above = (ending is Ending.OPEN for ending in interval.endings)
    if below or above:
        return "open" if below and above else f"below {high}" if below else f"above {low}"
    return f"{low} to {high}"


def _shown(profile: Profile, theta: float) -> str:
    """Write the value at a theta in display units."""
    (value,) = profile.values([theta])
    return written(in_shown_unit(profile.name, float(value))[0], "#.4g")


def level_in_words(level: float) -> str:
    """Write a level as `95 %`."""
    return f"{100 * level:.4g} %"


# -------- Rows


def profile_rows(profiles: Sequence[Profile]) -> list[dict[str, Any]]:
    """Return a row for each profile: fitted value, unit, ends [SI] of the linear interval and of the profile's.

    An open end is infinite, or zero for a positive number.
    """
    rows = []
    for each in profiles:
        linear, widest = each.linear_interval, each.widest
        values = each.values([each.optimum, linear.low, linear.high, widest.low, widest.high])
        names = ("value", "linear_low_95", "linear_high_95", "low_95", "high_95")
        own = dict(zip(names, map(float, values), strict=True))
        rows.append({"parameter": each.name, "unit": unit_of(each.name), **own})
    return rows
