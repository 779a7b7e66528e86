"""Short texts that figures and reports share."""

import math
import textwrap
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm
from ident.arm.fields import field_of
from ident.arm.oddities import oddities
from ident.inference.information import Direction, Information
from ident.inference.parameters import Parameter
from ident.measure import DRIVE_STATES, Campaign, Measurement
from ident.measure.kinds import DIFFERENCES
from ident.measure.load import format_direction
from ident.present.text.units import in_read_unit, in_shown_unit, unit_of, value_in_words
from ident.text import one_line

WIDTH = 100
"""Columns of a terminal that every report fits."""
KEPT = "\u00a0"
"""Stands for a space at which no line is broken, until lines are."""
LARGEST = 1e6
"""Factor above which it is only said to be above."""
MOST_ROWS = 3
"""Rows, or numbers, that a warning names, at most."""
NOTABLE = 0.15
"""Weight below which a parameter is left out when a direction is put into a few words."""
MATTERS = 0.3
"""Spread that a factor adds to a product, as a share of the product's own, from which it is shown."""


def paragraphs(sections: Iterable[Iterable[str]]) -> str:
    """Return a report: lines as paragraphs, with a blank line between; empty ones are left out, long ones folded."""
    return "\n\n".join("\n".join(map(folded, lines)) for lines in map(list, sections) if lines) + "\n"


def folded(line: str) -> str:
    """Break a line where it would leave a terminal, but not within what is `kept`, and indent what goes on."""
    if len(line) <= WIDTH:
        return line.replace(KEPT, " ")
    indent = " " * (len(line) - len(line.lstrip()))
    words = line[len(indent) :]
    return textwrap.fill(
        words,
        WIDTH,
        initial_indent=indent,
        subsequent_indent=f"{indent}    ",
        break_long_words=False,
        break_on_hyphens=False,
        replace_whitespace=False,
    ).replace(KEPT, " ")


def kept(text: str) -> str:
    """Return words between which `folded` breaks no line."""
    return text.replace(" ", KEPT)


def degrees(posture: Iterable[float]) -> str:
    """Write joint angles [rad] as `(30, -60, 30) deg`."""
    return f"({', '.join(f'{math.degrees(angle) + 0.0:.4g}' for angle in posture)}) deg"


def scatter(sd: float) -> str:
    """Write the standard deviation of a logarithm: `2.1 %` or, where it is large, `factor 1.9`."""
    return percent(sd) if sd < 0.3 else f"factor {as_factor(sd)}"


def as_factor(log: float, digits: int = 2) -> str:
    """Write a logarithm as the factor it is; what nothing bounds is more than any that means something."""
    return f"{math.exp(log):.{digits}g}" if log < math.log(LARGEST) else f"over {LARGEST:g}"


def three_digits(number: float) -> str:
    """Write a number with three digits, zeros among them: `17.0`, `184`."""
    return f"{number:#.3g}".removesuffix(".")


def rounded(number: float, digits: int = 2) -> str:
    """Write a number with so many digits, and no power of ten: `0.71`, `120`."""
    return f"{float(f'{number:.{digits}g}'):.10g}"


def beside(number: float, limit: float) -> str:
    """Write a number with two digits, or with as many as tell on which side of a limit it lies: `0.71`, `0.4987`."""
    written = (rounded(number, digits) for digits in range(2, 9))
    return next((text for text in written if np.sign(float(text) - limit) == np.sign(number - limit)), f"{number:.10g}")


def percent(share: float, sign: str = "") -> str:
    """Write a share with two digits, and no power of ten where it is large: `8.6 %`, `112 %`."""
    return f"{100 * share:{sign}.0f} %" if abs(share) > 0.994 else f"{100 * share:{sign}.2g} %"


def span(low: float, high: float) -> str:
    """Write an interval, as `3.1 to 4.2`."""
    return f"{low:.4g} to {high:.4g}"


def cut(text: str, length: int) -> str:
    """Return a text on one line, shortened in its middle if it is long."""
    text = one_line(text)
    half = (length - 1) // 2
    return text if len(text) <= length else f"{text[: length - half - 1]}…{text[-half:]}"


def main_factors(direction: Direction, spread: Float[np.ndarray, "P"]) -> list[int]:
    """Return which parameters take part in a direction, by falling exponent.

    An exponent may be small and its factor matter all the same, where that parameter is hardly known.

    Args:
        direction: the combination.
        spread: (P,) standard deviation of each theta.
    """
    size = np.abs(direction.weights)
    if direction.seen:
        matters = size * np.minimum(spread, math.log(LARGEST)) > MATTERS * direction.sd
    else:
        matters = size > NOTABLE
    first, *others = np.argsort(-size).tolist()
    return [first, *(i for i in others if matters[i])]


def direction_name(direction: Direction, names: Sequence[str], spread: Float[np.ndarray, "P"]) -> str:
    """Name a direction by its main parameters: a product, or a ratio where they are traded against each other."""
    order = main_factors(direction, spread)
    first, *others = (i for i in order[:2] if abs(direction.weights[i]) > NOTABLE)
    signs = [" / " if direction.weights[i] * direction.weights[first] < 0 else " · " for i in others]
    more = " …" if len(order) > 1 + len(others) else ""
    return cut(names[first], 24) + "".join(s + cut(names[i], 24) for s, i in zip(signs, others, strict=True)) + more


def short(m: Measurement) -> str:
    """Say in a few words what was measured, with its value."""
    value, unit = in_read_unit(m.kind, m.value)
    what = _what(m)
    loads = f", {m.load}" if m.load else ""
    against = f" - {m.reference_load}" if m.kind in DIFFERENCES else ""
    defined = f" ({m.of})" if m.of else ""
    loads += _held(m)
    return f"{f'{what}:' if what else ''} {value:.4g} {unit}{defined}{loads}{against} at {degrees(m.posture)}".strip()


def describe(m: Measurement) -> str:
    """Say in a few words what was measured, without its value."""
    what = _what(m)
    loads = f" {m.load}" if m.load else ""
    held = _held(m)
    against = f" - {m.reference_load}" if m.kind in DIFFERENCES and m.reference_load else ""
    against += f", {m.ramp}" if m.ramp else ""
    return f"{m.of or ''} {m.kind.replace('_', ' ')} {what}{loads}{against}{held} at {degrees(m.posture)}".replace(
        "  ", " "
    ).strip()


def place_read(m: Measurement) -> str:
    """Say in a few words what a ramp read, and where: whatever the load was."""
    along = f" {format_direction(m.direction)}" if m.direction else ""
    setup, repeat = (f", {word}" if word else "" for word in (m.setup, m.repeat))
    return f"{m.kind.replace('_', ' ')} {_what(m)}{along}{_held(m)} at {degrees(m.posture)}{setup}{repeat}"


def _what(m: Measurement) -> str:
    if m.direction is None or m.reference_direction is None:
        return m.mode or m.point or m.joint or ""
    place, reference = format_direction(m.direction), format_direction(m.reference_direction)
    return f"{m.point} {place} / {m.reference_point} {reference} of {m.mode}"


def _held(m: Measurement) -> str:
    """Say what held the motors, where it was no brake."""
    return "" if m.drives == DRIVE_STATES[0] else f", {m.drives} on"


def odd_numbers(arm: Arm) -> Iterator[str]:
    """Warn of numbers of an arm that look wrong, as a wrong arm file is the commonest cause of a wrong stiffness."""
    odd = oddities(arm)
    yield from (f"  WARNING: the arm file looks odd: {each}" for each in odd[:MOST_ROWS])
    if odd:
        more = f"{len(odd) - MOST_ROWS} more; " if len(odd) > MOST_ROWS else ""
        yield f"    ({more}`ident show` draws the arm and names them all)"


def correlated_errors(campaign: Campaign) -> Iterator[str]:
    """Say of how many rows the errors are correlated, if of any."""
    sizes = [len(places) for places, _ in campaign.correlated]
    if sizes:
        groups = "1 group" if len(sizes) == 1 else f"{len(sizes)} groups"
        yield f"  the errors of {sum(sizes)} measurements are correlated, in {groups}"


def drive_states(arm: Arm, campaign: Campaign) -> Iterator[str]:
    """Warn in one line of rows whose motors a servo held, where the arm file describes none."""
    if arm.servos:
        return
    own = [m.where.rpartition(":")[2] or str(i) for i, m in enumerate(campaign, 1) if m.drives == "servo"]
    if not own:
        return
    if len(own) == len(campaign):
        yield "  WARNING: servo on in all rows: the model holds the motors, so that k_tors contains the servo"
        return
    rows = f"row{'s' * (len(own) > 1)} {', '.join(own[:MOST_ROWS])}"
    rows += f" and {len(own) - MOST_ROWS} more" if len(own) > MOST_ROWS else ""
    yield f"  WARNING: brake and servo mixed, fit them apart: servo on in {rows}"


def shares(known: Information, i: int) -> str:
    """Say in what shares a parameter is told by the data alone, by its own prior, and by data with other priors."""
    if not math.isfinite(known.sd[i]):
        return "nothing"
    data, prior = (abs(round(float(share[i]), 2)) for share in (known.data_share, known.prior_share))
    return f"{data:5.0%} {prior:5.0%} {abs(1 - data - prior):5.0%}"


def in_percent(share: float) -> str:
    """Write a relative difference, `-3.7 %`; where it is no small one, what the value is multiplied by, `35 times`."""
    if not -0.95 < share < 9.995:
        return f"{1 + share:.2g} times"
    return percent(share, "+")


def priors_in_words(items: Sequence[Parameter]) -> Iterator[str]:
    """Say which priors there are, one line for all parameters that share a form."""
    forms: dict[str, list[str]] = {}
    for item in items:
        forms.setdefault(_prior(item), []).append(item.name)
    for form, names in forms.items():
        yield form if len(forms) == 1 else f"{form}: {', '.join(names)}"


def _prior(item: Parameter) -> str:
    sd, flat, centre = float(item.prior_sd), float(item.flat), float(item.centre)
    if not math.isfinite(sd):
        return "none"
    if not item.positive:
        return f"normal about the arm file's value, sd {sd * float(item.scale):.3g} {unit_of(item.name)}"
    if flat:
        low, high = centre * math.exp(-flat), centre * math.exp(flat)
        (low, unit), (high, _) = (in_shown_unit(item.name, end) for end in (low, high))
        return f"flat in the logarithm from {low:.4g} to {high:.4g} {unit}, flanks {100 * sd:.2g} % wide"
    own = unit_of(item.name) == "-" or not math.isclose(centre, float(item.start))
    about = value_in_words(item.name, centre) if own else "the arm file's value"
    return f"log-normal about {about}, 95 % within a factor of {as_factor(1.96 * sd, 3)}"


def parameter_in_words(item: Parameter) -> str:
    """Name a parameter in physical words: `torsion of joint2`; as it is called, if it is none of an arm's."""
    part, _, rest = item.name.partition(".")
    if part == "discrepancy":
        return f"model factor of every {rest.replace('_', ' ')}"
    field = field_of(item.name)
    name = f"{field.short} of {part}" if field and not field.rank else item.name
    return f"{name} (and what is tied to it)" if len(item.paths) > 1 else name


def balance(weights: Sequence[float], items: Sequence[Parameter], least: float = NOTABLE) -> str:
    """Say which parameters a direction sets against each other: `torsion of joint2 against torsion of joint3`.

    Those of a weight below `least`, relative to the largest, are left out.
    """
    lead = max(weights, key=abs)
    order = [i for i in np.argsort(-np.abs(weights)) if abs(weights[i] / lead) > least]
    sides = [
        " and ".join(parameter_in_words(items[i]) for i in order if weights[i] * lead * sign > 0) for sign in (1, -1)
    ]
    if sides[1]:
        return " against ".join(sides)
    return f"{sides[0]} together" if len(order) > 1 else sides[0]
