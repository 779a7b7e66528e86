"""Short texts that figures and reports share."""

import math
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from ident.arm.fields import field_of
from ident.inference.information import Direction
from ident.inference.parameters import Parameter
from ident.measure import Measurement
from ident.present.text.units import in_read_unit, unit_of
from ident.text import one_line

LARGEST = 1e6
"""Factor above which it is only said to be above."""
NOTABLE = 0.15
"""Weight below which a parameter is left out when a direction is put into words."""


def paragraphs(sections: Iterable[Iterable[str]]) -> str:
    """Return a report: lines as paragraphs, with a blank line between; empty ones are left out."""
    return "\n\n".join("\n".join(lines) for lines in map(list, sections) if lines) + "\n"


def degrees(posture: Iterable[float]) -> str:
    """Write joint angles [rad] as `(30, -60, 30) deg`."""
    return f"({', '.join(f'{math.degrees(angle) + 0.0:.4g}' for angle in posture)}) deg"


def scatter(sd: float) -> str:
    """Write the standard deviation of a logarithm: `2.1 %` or, where it is large, `factor 1.9`."""
    return f"{100 * sd:.2g} %" if sd < 0.3 else f"factor {as_factor(sd)}"


def as_factor(log: float, digits: int = 2) -> str:
    """Write a logarithm as the factor it is; what nothing bounds is more than any that means something."""
    return f"{math.exp(log):.{digits}g}" if log < math.log(LARGEST) else f"over {LARGEST:g}"


def span(low: float, high: float) -> str:
    """Write an interval, as `3.1 to 4.2`."""
    return f"{low:.4g} to {high:.4g}"


def cut(text: str, length: int) -> str:
    """Return a text on one line, shortened in its middle if it is long."""
    text = one_line(text)
    half = (length - 1) // 2
    return text if len(text) <= length else f"{text[: length - half - 1]}…{text[-half:]}"


def direction_name(direction: Direction, names: Sequence[str]) -> str:
    """Name a direction by its main parameters: a product, or a ratio where they are traded against each other."""
    order = [i for i in np.argsort(-np.abs(direction.weights)) if abs(direction.weights[i]) > NOTABLE]
    first, *others = order[:2]
    signs = [" / " if direction.weights[i] * direction.weights[first] < 0 else " · " for i in others]
    more = " …" if len(order) > 2 else ""
    return cut(names[first], 24) + "".join(s + cut(names[i], 24) for s, i in zip(signs, others, strict=True)) + more


def short(m: Measurement) -> str:
    """Say in a few words what was measured, with its value."""
    value, unit = in_read_unit(m.kind, m.value)
    what = m.mode or m.point or ""
    loads = f", {m.load}" if m.load else ""
    against = f" - {m.reference_load}" if m.kind == "deflection_difference" else ""
    return f"{f'{what}:' if what else ''} {value:.4g} {unit}{loads}{against} at {degrees(m.posture)}".strip()


def describe(m: Measurement) -> str:
    """Say in a few words what was measured, without its value."""
    what = m.mode or m.point or ""
    loads = f" {m.load}" if m.load else ""
    against = f" - {m.reference_load}" if m.kind == "deflection_difference" and m.reference_load else ""
    return f"{m.kind.replace('_', ' ')} {what}{loads}{against} at {degrees(m.posture)}".replace("  ", " ")


def known_from(prior_share: float, sd: float) -> str:
    """Say in what shares data and prior tell a parameter whose standard deviation is sd."""
    if not math.isfinite(sd):
        return "nothing: where the search stopped"
    prior_share = abs(round(prior_share, 2))
    return f"data {1 - prior_share:4.0%}, prior {prior_share:4.0%}"


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
        return f"flat in the logarithm from {low:.4g} to {high:.4g} {unit_of(item.name)}, flanks {100 * sd:.2g} % wide"
    own = unit_of(item.name) == "-" or not math.isclose(centre, float(item.start))
    about = f"{centre:.4g} {unit_of(item.name)}".removesuffix(" -") if own else "the arm file's value"
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
