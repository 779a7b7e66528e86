"""Short texts that figures and reports share."""

import math
import re
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from ident.arm.fields import SPEED, STIFFNESS, field_of
from ident.identify.unknowns import SETUP, is_of_loop
from ident.measure import DRIVE_STATES, Measurement
from ident.measure.kinds import DIFFERENCES
from ident.measure.kinds import KINDS as MEASURED
from ident.measure.load import format_direction
from ident.report.report import Section, Table, cut, kept, written
from ident.text import by_key
from ident.units import QUANTITIES, stiffness_unit

if TYPE_CHECKING:
    from ident.inference.fit import Fit
    from ident.inference.information import Direction, Information, TradeOff
    from ident.inference.parameters import Parameter

# -------- Units
# Display units of numbers. The units of the arm's numbers: `ident.arm.fields`.

READ_UNITS = {"Hz": (1.0, "Hz"), "m": (1e3, "mm"), "rad": (1e3, "mrad")}
"""Display units of measured values: number per SI unit, and unit; ratios are displayed in percent."""
TRACE_UNITS = {"displacement": (1e3, "mm"), "velocity": (1e3, "mm/s"), "acceleration": (1.0, "m/s^2")}
"""Display unit of each kind of trace: number per SI unit, and unit."""
TURN = ".turn."
"""Part of the path of a measurement frame's rotation."""
MM = 1e3
"""mm in a metre."""


def trace_unit(kind: str) -> tuple[float, str]:
    """Return numbers per unit, and display unit, of a kind of trace; a kind that is none is its own unit."""
    return TRACE_UNITS.get(kind, (1.0, kind))


def arc_seconds(amplitude: float) -> float:
    """Return an amplitude of a transmission error [rad] as in catalogues: peak to peak [arc seconds]."""
    return 2 * math.degrees(amplitude) * 3600


def in_read_unit(kind: str, value: float) -> tuple[float, str]:
    """Return a measured or predicted SI value in the display unit of its kind, and the unit."""
    if kind == "shape":
        return value, ""
    factor, unit = READ_UNITS.get(QUANTITIES[MEASURED[kind]].si, (100.0, "%"))
    return value * factor, unit


def unit_of(path: str) -> str:
    """Return the SI unit of a parameter; `-` for factors, and for parameters of a model that is no arm."""
    field = field_of(path)
    if path.startswith(SETUP):
        return "rad" if TURN in path else "m"
    if is_of_loop(path):
        return QUANTITIES[MEASURED[path.rpartition(":")[2]]].si
    return field.unit if field else "%" if path == SPEED else "-"


def is_stiffness(path: str) -> bool:
    """Tell whether a path names a bushing stiffness."""
    field = field_of(path)
    return field is not None and field.name in STIFFNESS


def is_length(path: str) -> bool:
    """Whether a path names a length, which is displayed in mm."""
    field = field_of(path)
    own = (path.startswith(SETUP) or is_of_loop(path)) and unit_of(path) == "m"
    return own or (field is not None and field.read_unit == "mm")


def read_unit(path: str) -> tuple[float, str]:
    """Return the size of a parameter's display unit in SI, and the unit.

    For a stiffness it is the chosen unit, see `ident.units.stiffness_in`.
    """
    field = field_of(path)
    if is_stiffness(path):
        return stiffness_unit()
    if path.startswith(SETUP):
        return (1e-3, "mrad") if TURN in path else (1e-3, "mm")
    if is_of_loop(path):
        return (1e-3, "m" + unit_of(path))
    return (field.read_size, field.read_unit) if field else (1.0, unit_of(path))


def in_shown_unit(path: str, value: float) -> tuple[float, str]:
    """Return a value and its unit: for a stiffness in the chosen unit, else in SI, as given."""
    if not is_stiffness(path):
        return value, unit_of(path)
    size, unit = stiffness_unit()
    return value / size, unit


def shared_unit(paths: Iterable[str]) -> str:
    """Return the common display unit of paths, as ` [N m/rad]`; empty if they have several."""
    units = {in_shown_unit(path, 1.0)[1] for path in paths}
    return f" [{units.pop()}]" if len(units) == 1 else ""


def value_in_words(path: str, value: float) -> str:
    """Write a value with its unit, as `3.598e+05 N m/rad`."""
    number, name = in_shown_unit(path, value)
    return f"{number:.4g} {name}".removesuffix(" -")


# -------- Words

LARGEST = 1e6
"""Factor above which no number is printed."""
MOST_ROWS = 3
"""Rows, or numbers, named in a warning at most."""
NOTABLE = 0.15
"""Weight below which a short name of a parameter combination leaves a parameter out."""


def degrees(posture: Iterable[float]) -> str:
    """Write joint angles [rad] as `(30, -60, 30) deg`."""
    return f"({', '.join(f'{math.degrees(angle) + 0.0:.4g}' for angle in posture)}) deg"


def vector_in_words(vector: np.ndarray) -> str:
    """Write a direction, as `-0.03, 0.00, 1.00`."""
    return ", ".join(f"{x + 0.0:.2f}" for x in vector.round(2))


def scatter(sd: float) -> str:
    """Write the standard deviation of a logarithm: `2.1 %` or, if large, `factor 1.9`."""
    return percent(sd) if sd < 0.3 else f"factor {as_factor(sd)}"


def as_factor(log: float, digits: int = 2) -> str:
    """Write a logarithm as its factor; above `LARGEST` only as `over` that."""
    return f"{math.exp(log):.{digits}g}" if log < math.log(LARGEST) else f"over {LARGEST:g}"


def three_digits(number: float) -> str:
    """Write a number with three digits, including zeros: `17.0`, `184`."""
    return f"{number:#.3g}".removesuffix(".")


def rounded(number: float, digits: int = 2) -> str:
    """Write a number with a given number of digits, without a power of ten: `0.71`, `120`."""
    return f"{float(f'{number:.{digits}g}'):.10g}"


def beside(number: float, limit: float) -> str:
    """Write a number with two digits, or with as many as show its side of a limit: `0.71`, `0.4987`."""
    written = (rounded(number, digits) for digits in range(2, 9))
    return next((text for text in written if np.sign(float(text) - limit) == np.sign(number - limit)), f"{number:.10g}")


def percent(share: float, sign: str = "") -> str:
    """Write a share with two digits, without a power of ten: `8.6 %`, `112 %`."""
    return f"{100 * share:{sign}.0f} %" if abs(share) > 0.994 else f"{100 * share:{sign}.2g} %"


def span(low: float, high: float) -> str:
    """Write an interval, as `6.900e5 to 7.441e5`."""
    return f"{written(low, '#.4g')} to {written(high, '#.4g')}"


def main_factors(direction: "Direction", spread: Float[np.ndarray, "P"]) -> list[int]:
    """Return the parameters that take part in a combination, by falling exponent.

    A parameter with a small exponent may matter too, if it is poorly known.

    Args:
        direction: the combination.
        spread: (P,) standard deviation of each theta.
    """
    size = np.abs(direction.weights)
    added = size * np.minimum(spread, math.log(LARGEST)) > 0.3 * direction.sd  # 30 % of the product's own spread
    matters = added if direction.seen else size > NOTABLE
    first, *others = np.argsort(-size).tolist()
    return [first, *(i for i in others if matters[i])]


def direction_name(direction: "Direction", names: Sequence[str], spread: Float[np.ndarray, "P"]) -> str:
    """Name a combination by its main parameters: a product, or a ratio if they trade off against each other."""
    order = main_factors(direction, spread)
    first, *others = (i for i in order[:2] if abs(direction.weights[i]) > NOTABLE)
    signs = [" / " if direction.weights[i] * direction.weights[first] < 0 else " · " for i in others]
    more = " …" if len(order) > 1 + len(others) else ""
    return cut(names[first], 24) + "".join(s + cut(names[i], 24) for s, i in zip(signs, others, strict=True)) + more


def short(m: Measurement) -> str:
    """Describe a measurement in a few words, with its value."""
    value, unit = in_read_unit(m.kind, m.value)
    what = f"{_what(m)}: " if _what(m) else ""
    loads = (f", {m.load}" if m.load else "") + _held(m)
    against = f" - {m.reference_load}" if m.kind in DIFFERENCES else ""
    defined = f" ({m.of})" if m.of else ""
    return f"{what}{value:.4g} {unit}{defined}{loads}{against} at {degrees(m.posture)}"


def describe(m: Measurement) -> str:
    """Describe a measurement in a few words, without its value."""
    what = f"{m.of or ''} {_what(m)} {m.kind.replace('_', ' ')}"
    loads = f", {m.load}" if m.load else ""
    against = f" - {m.reference_load}" if m.kind in DIFFERENCES and m.reference_load else ""
    ramp = f", {m.ramp}" if m.ramp else ""
    comma = "," * bool(loads or against or ramp or _held(m))
    return f"{what}{loads}{against}{ramp}{_held(m)}{comma} at {degrees(m.posture)}".replace("  ", " ").strip()


def place_read(m: Measurement) -> str:
    """Describe the reading of a ramp and its place in a few words, for any load."""
    along = f" {format_direction(m.direction)}" if m.direction else ""
    setup, repeat = (f", {word}" if word else "" for word in (m.setup, m.repeat))
    return f"{m.kind.replace('_', ' ')} {_what(m)}{along}{_held(m)} at {degrees(m.posture)}{setup}{repeat}"


def _what(m: Measurement) -> str:
    if m.direction is None or m.reference_direction is None:
        return m.mode or m.point or m.joint or ""
    place, reference = format_direction(m.direction), format_direction(m.reference_direction)
    return f"{m.point} {place} / {m.reference_point} {reference} of {m.mode}"


def _held(m: Measurement) -> str:
    """Say what held the motors, unless it was a brake."""
    return "" if m.drives == DRIVE_STATES[0] else f", {m.drives} on"


def row_in_file(m: Measurement, name: str) -> str:
    """Name the row of a measurement with its line in the file: `row 7 (line 7 of table1.csv)`."""
    file = re.split(r"[/\\]", m.where.rpartition(":")[0])[-1]
    return f"row {name} (line {name} of {cut(file, 30)})" if file.endswith(".csv") else f"row {name}"


def counted(count: int, noun: str) -> str:
    """Write a number with its noun: `1 start`, `16 starts`."""
    return f"{count} {noun}{'s' * (count != 1)}"


def kinds_in_words(kinds: Sequence[str]) -> str:
    """Name kinds of measurement in the plural: `frequencies and deflections`."""
    return joined([re.sub("y$", "ie", kind.replace("_", " ")) + "s" for kind in kinds])


def joined(words: Sequence[str]) -> str:
    """Return words as a list: a, b and c."""
    return " and ".join([*([", ".join(words[:-1])] if words[1:] else []), *words[-1:]])


def sentence(words: str) -> str:
    """Write words as a sentence, with a capital and a full stop."""
    return f"{words[:1].upper()}{words[1:]}{'.' * (words[-1:] not in '.?!')}"


def lowered(words: str) -> str:
    """Begin words with a small letter, to stand within a sentence."""
    return f"{words[:1].lower()}{words[1:]}"


def some(names: Sequence[str], most: int = MOST_ROWS) -> str:
    """Name the first few: `a, b, c and 2 more`."""
    more = len(names) - most
    return ", ".join(names[:most]) + (f" and {more} more" if more > 0 else "")


def shares(known: "Information", i: int) -> tuple[float | None, float | None, float | None]:
    """Return shares of the information on a parameter: from the data alone, its own prior, data with other priors."""
    if not math.isfinite(known.sd[i]):
        return None, None, None
    data, prior = (abs(round(float(share[i]), 2)) for share in (known.data_share, known.prior_share))
    return data, prior, abs(1 - data - prior)


def in_percent(share: float) -> str:
    """Write a relative difference, `-3.7 %`; if large, the factor of the value, `35 times`."""
    if not -0.95 < share < 9.995:
        return f"{1 + share:.2g} times"
    return percent(share, "+")


def priors_in_words(items: Sequence["Parameter"]) -> Iterator[str]:
    """Yield the priors, one line for all parameters that share a form."""
    forms = by_key((_prior(item), item.name) for item in items)
    for form, names in forms.items():
        yield f"Prior: {form}." if len(forms) == 1 else f"Prior: {form}: {', '.join(names)}."


def _prior(item: "Parameter") -> str:
    sd, flat, centre = float(item.prior_sd), float(item.flat), float(item.centre)
    if not math.isfinite(sd):
        return "none"
    if not item.positive:
        size = f"{sd * float(item.scale):.3g} {unit_of(item.name)}"
        return f"normal about the arm file's value, standard deviation {size}"
    if flat:
        low, high = centre * math.exp(-flat), centre * math.exp(flat)
        (low, unit), (high, _) = (in_shown_unit(item.name, end) for end in (low, high))
        return f"flat in the logarithm from {low:.4g} to {high:.4g} {unit}, flanks {100 * sd:.2g} % wide"
    own = unit_of(item.name) == "-" or not math.isclose(centre, float(item.start))
    about = value_in_words(item.name, centre) if own else "the arm file's value"
    return f"log-normal about {about}, 95 % within a factor of {as_factor(1.96 * sd, 3)}"


def size_in_words(item: "Parameter", theta: float, sign: str = "") -> str:
    """Write a change of theta of a signed number in its display unit: `6.4 mm`."""
    size, unit = read_unit(item.name)
    return f"{theta * float(item.scale) / size:{sign}.2g} {unit}"


def with_tied(item: "Parameter") -> str:
    """Name a parameter with its tied ones: the other one, or their number."""
    name, others = item.name, item.paths[1:]
    return f"{name} ({len(others) + 1} tied)" if others[1:] else f"{name} (and {others[0]})" if others else name


def parameter_in_words(item: "Parameter") -> str:
    """Name a parameter in physical words: `torsion of joint2`; by its own name, if it is not one of an arm's."""
    part, _, rest = item.name.partition(".")
    if part == "discrepancy":
        return f"model factor of every {rest.replace('_', ' ')}"
    field = field_of(item.name)
    name = f"{field.short} of {part}" if field and not field.rank else item.name
    return f"{name} (and what is tied to it)" if len(item.paths) > 1 else name


def balance(weights: Sequence[float], items: Sequence["Parameter"], least: float = NOTABLE) -> str:
    """Name the parameters that trade off in a combination: `torsion of joint2 against torsion of joint3`.

    Parameters of a weight below `least`, relative to the largest, are left out.
    """
    lead = max(weights, key=abs)
    order = [i for i in np.argsort(-np.abs(weights)) if abs(weights[i] / lead) > least]
    along = " and ".join(parameter_in_words(items[i]) for i in order if weights[i] * lead > 0)
    against = " and ".join(parameter_in_words(items[i]) for i in order if weights[i] * lead < 0)
    if against:
        return f"{along} against {against}"
    return f"{along} together" if len(order) > 1 else along


# -------- Directions
# Parameter combinations in words: how well each is known, and unnoticed changes.


def what_is_fixed(fit: "Fit") -> Section:
    """Return the combinations that the data determine, best known first, with their widths; none for a fit in doubt."""
    known, items = fit.information, fit.problem.parameters.items
    rows = []
    for direction in fit.combinations:
        hidden = bool(fit.doubts) or np.isnan(direction.sd)
        weak = ", weakly" if (direction.weak or direction.open) and not hidden else ""
        width = "not reported" if hidden else f"{scatter(direction.sd)}{weak}"
        rows.append((product(direction, items, known.sd), width))
    title = f"Determined by the data: {known.fixed} of {len(known.directions)} combinations"
    return Section(title, (Table("", ("combination", "std. error"), tuple(rows)),) if rows else ())


def what_is_open(known: "Information", items: tuple["Parameter", ...]) -> Section | None:
    """Return the changes along each undetermined combination that the data do not notice; maybe nothing."""
    trades = known.trade_offs()
    if not trades:
        return None
    filler = "the prior alone fills them" if np.isfinite(known.sd).all() else "they stay where the search stopped"
    title = f"Not determined by the data: {len(trades)} of {len(known.directions)} combinations; {filler}"
    return Section(title, tuple(f"{in_words(trade, items)} would not show in the data" for trade in trades))


def product(direction: "Direction", items: tuple["Parameter", ...], spread: Float[np.ndarray, "P"]) -> str:
    """Write a combination as a product of powers of parameters; a signed one enters as its exponential.

    Args:
        direction: the combination.
        items: the parameters.
        spread: (P,) standard deviation of each theta: a factor is shown if its exponent times this matters.
    """
    units = [f"{float(item.scale):g} {unit_of(item.name)}" for item in items]
    factors = [item.name if item.positive else f"exp({item.name} / {x})" for item, x in zip(items, units, strict=True)]
    first, *others = main_factors(direction, spread)
    if not others:
        return factors[first]
    powers = []
    for i in (first, *others):
        weight = direction.weights[i]
        powers.append(f"{factors[i]}^{weight:.2f}" if abs(weight) > 0.095 else f"{factors[i]}^{weight:.1g}")
    return f" {kept('* ')}".join(powers)


def in_words(trade: "TradeOff", items: tuple["Parameter", ...]) -> str:
    """Write the changes that go unnoticed when one parameter rises by 10 %, or by a tenth of its scale."""
    step = math.log(1.1)
    moved = [
        _change(item, change * step)
        for item, change in zip(items, trade.change, strict=True)
        if item.name != trade.name and abs(change) > 0.05
    ]
    lead = next(_change(item, step) for item in items if item.name == trade.name)
    along = f" together with {' and '.join(moved)}" if moved else ""
    return f"{lead}{along}"


def _change(item: "Parameter", theta: float) -> str:
    if item.positive:
        return f"{item.name} by {percent(math.expm1(theta), '+')}"
    return f"{item.name} by {size_in_words(item, theta, '+')}"
