"""The printed report of profiles: intervals beside those of the linear approximation, and why each side ends."""

from collections.abc import Iterator, Sequence

from ident.identify.fit import CampaignFit
from ident.inference.profile import FLAT, Interval, Profile, threshold
from ident.inference.profile_path import Ending
from ident.present.text.units import in_shown_unit
from ident.present.text.words import drive_states, paragraphs, priors_in_words

SIDES = ("below", "above")


def profile_report(fit: CampaignFit, profiles: Sequence[Profile]) -> str:
    """Return the report of profiles: both kinds of interval, the nested ones, and remarks on what is not regular."""
    sections = [
        _profile_heading(fit, profiles),
        _profile_table(fit, profiles),
        _nested(profiles),
        _profile_remarks(profiles),
    ]
    return paragraphs(sections)


def _profile_heading(fit: CampaignFit, profiles: Sequence[Profile]) -> Iterator[str]:
    level = profiles[0].widest.level
    count = len(fit.problem.parameters.items)
    yield f"Profiles of the fit of {fit.arm.name} to {fit.campaign.name}"
    yield f"  {len(fit.campaign)} measurements, {count} unknowns, least cost {fit.best.cost:.4g}"
    yield f"  Each parameter is moved and all others are fitted again. {level_in_words(level)}: delta"
    yield f"  chi-squared is {threshold(level):.3g}, with one degree of freedom. Data and priors count, as in the fit."
    for prior in priors_in_words(fit.problem.parameters.items):
        yield f"  prior: {prior}"
    yield from drive_states(fit.arm, fit.campaign)
    for doubt in fit.doubts:
        yield f"  WARNING: {doubt.replace('see below', 'see ident fit')}"
    if fit.doubts:
        yield "  So the profiles show the shape of the cost; no interval below is to be quoted."


def _profile_table(fit: CampaignFit, profiles: Sequence[Profile]) -> Iterator[str]:
    level = level_in_words(profiles[0].widest.level)
    yield (f"{'Parameters':18s} {'fitted':>10s}  {f'{level}, linear':22s} {f'{level}, profile':22s} profile/linear")
    for profile in profiles:
        value, _ = in_shown_unit(profile.name, float(profile.values([profile.optimum])[0]))
        mark = "" if profile.linear else " <--"
        yield (
            f"  {profile.name:16s} {value:10.5g}  {interval_text(profile, profile.linear_interval):22s}"
            f" {interval_text(profile, profile.widest):22s} {_halves(profile)}{mark}"
        )
        for other in profile.item.paths[1:]:
            yield f"    = {other}"
    units = {in_shown_unit(profile.name, 1.0)[1]: profile.name for profile in profiles}
    each = ", ".join(f"{in_shown_unit(profile.name, 1.0)[1]} of {profile.name}" for profile in profiles)
    yield f"  in {next(iter(units)) if len(units) == 1 else each}"
    yield "  profile/linear: halves of the interval below and above the fitted value; <-- more than 20 % off"
    if any(0.0 in profile.halves for profile in profiles):
        yield "  only: closed by the profile only, the linear interval is open"


def _halves(profile: Profile) -> str:
    return " ".join(_half(half, ending) for half, ending in zip(profile.halves, profile.widest.endings, strict=True))


def _half(half: float, ending: Ending) -> str:
    if ending is Ending.OPEN:
        return "  open"
    return f"{half:6.2f}" if half else "  only"


def _nested(profiles: Sequence[Profile]) -> Iterator[str]:
    levels = [interval.level for interval in profiles[0].intervals]
    if len(levels) > 1:
        yield "At all levels     " + "".join(f"{level_in_words(level):24s}" for level in levels).rstrip()
        for profile in profiles:
            cells = "".join(f"{interval_text(profile, interval):24s}" for interval in profile.intervals)
            yield f"  {profile.name:16s}{cells}".rstrip()


def _profile_remarks(profiles: Sequence[Profile]) -> Iterator[str]:
    lines = [line for profile in profiles for line in remarks(profile)]
    if lines:
        yield "Remarks"
        yield from (f"  {line}" for line in lines)


def remarks(profile: Profile) -> Iterator[str]:
    """Say in words what is not regular about a profile: open sides, bounds, other optima, doubts on the search."""
    for side in (0, 1):
        yield from _side(profile, side)
    if profile.beaten:
        yield (
            f"{profile.name}: WARNING, on the way the cost fell {profile.beaten:.3g} below the fit's, which is not the"
            " best optimum; fit again with more starts (--starts)"
        )
    inside = profile.converged_inside
    if not inside.all():
        lost = f"{(~inside).sum()} of {len(inside)} points"
        yield f"{profile.name}: the search did not converge at {lost}; the profile may lie lower there"
    if profile.rivals:
        places = ", ".join(f"{value:.4g}" for value in profile.values(profile.rivals))
        yield f"{profile.name}: another optimum fits about as well outside this interval, at {places}"


def _side(profile: Profile, side: int) -> Iterator[str]:
    ending, theta = profile.widest.endings[side], (profile.widest.low, profile.widest.high)[side]
    need = threshold(profile.widest.level)
    if ending is Ending.MODEL:
        (value,) = profile.values([theta])
        yield f"{profile.name}: bounded {SIDES[side]} by the model, which has no answer beyond {value:.4g}"
    elif ending is Ending.OPEN:
        last = (0, -1)[side]
        (value,) = profile.values(profile.theta[[last]])
        delta = profile.delta_chi_squared[last]
        reason = "flat: nothing tells it" if profile.flat[side] else "too little tells it"
        reached = "stays zero" if delta < FLAT else f"reaches {delta:.2g} of {need:.3g}"
        there = f"as far as {value:.3g} delta chi-squared {reached}"
        yield f"{profile.name}: open {SIDES[side]}, {reason} on this side ({there})"


def interval_text(profile: Profile, interval: Interval) -> str:
    """Write an interval: two numbers, one where a side is open, or `open`."""
    ends = profile.values([interval.low, interval.high])
    low, high = (f"{in_shown_unit(profile.name, float(value))[0]:.4g}" for value in ends)
    below, above = (ending is Ending.OPEN for ending in interval.endings)
    if below or above:
        return "open" if below and above else f"below {high}" if below else f"above {low}"
    return f"{low} to {high}"


def level_in_words(level: float) -> str:
    """Write a level as `95 %`."""
    return f"{100 * level:.4g} %"
