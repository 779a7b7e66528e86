"""A joint from its own log: stiffness, damping, friction, backlash and delay from the twist between motor and link.

The twist is linear in the unknowns, one equation per sample (all quantities at the joint):

    link - motor = zero - tau / k + (c / k^2) tau' - (b / 2) sign(tau) - d v + e_s sin q + e_c cos q

with the torque tau that the spring carries, motor speed v, the delay d of the link's channel behind the motor's, the
backlash b, and the eccentricity e of the link's encoder. A motor's torque T, less that of its inertia J, still includes
friction: tau = T - J a - F_c sign(v) - F_v v. So F_v / k and d share a column: the twist alone cannot separate them,
and a link shifted by d - F_v / k, at its own speed v - tau' / k, seems to have the damping c + F_v. If the torque in
the joint was measured, or no other joint moved, the motor's torque determines friction by itself.

References:
    T. Söderström, P. Stoica, "Instrumental Variable Methods for System Identification", Springer 1983. H. R. Künsch,
    "The jackknife and the bootstrap for general stationary observations", Annals of Statistics 17 (1989), 1217-1241.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import ceil, inf, isfinite, nan, pi, sqrt
from math import log as log_of

import numpy as np
from jaxtyping import Bool, Float
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d, minimum_filter1d
from scipy.stats import f as fisher
from scipy.stats import t as student

from ident.errors import refusal, require
from ident.measure.joint_log import JointLog

BLOCKS = 12
"""Jackknife blocks of the logs: fewer widen the intervals, with more one error spans several blocks."""
STILL = 0.05
"""Share of speed or torque below which a joint stands, with any friction up to Coulomb's, or is within its backlash."""
PASSES = 4
"""Passes with the link's channel shifted by the estimated delay; 3 ms converge to within 1 us in two."""
REVERSED = 0.03
"""Least share of the time with the rarer sign of the torque for a visible backlash."""
APART = 6
"""Filter widths between two samples with independent noise."""
PARALLEL = 1e9
"""Condition number of the scaled normal equations above which a log cannot separate its columns."""
CONTRADICTS = 0.01
"""Probability of a difference between logs below which they contradict each other."""
LEFT_OUT = {"delay": ("speed",), "friction": ("sign",), "encoder error": ("sine", "cosine")}
"""Columns of each effect."""
NOT_TOLD = 0.5
"""Half-width of a 95 % interval, as a share of the value, beyond which the value is not determined."""
FEWEST = 100
"""Least number of samples with a moving joint."""
QUANTITIES = ("stiffness", "damping", "coulomb", "viscous", "backlash", "delay")
Columns = Mapping[str, Float[np.ndarray, " T"]]


@dataclass(frozen=True)
class TwistSetting:
    """Conditions of a joint test.

    Attributes:
        inertia: [kg m^2] of the motor, referred to the joint (rotor times ratio squared); None for unknown.
        alone: whether no other joint moved.
        locked: whether the link was clamped.
        centred: whether the link's encoder is free of eccentricity.
        upto: [Hz] bandwidth of the analysis: both sides of the equation have the same low-pass filter (-3 dB).
    """

    inertia: float | None = None
    alone: bool = False
    locked: bool = False
    centred: bool = False
    upto: float = 20.0


@dataclass(frozen=True)
class JointNumber:
    """A number of a joint with its 95 % interval.

    Attributes:
        value: [SI] NaN if the log has no information on it.
        low: [SI] lower end.
        high: [SI] upper end.
    """

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class JointTwist:
    """Numbers of a joint from its logs.

    Attributes:
        name: of the joint.
        setting: conditions of the test.
        numbers: by quantity: `stiffness` [N m/rad], `damping` [N m s/rad], `coulomb` [N m], `viscous` [N m s/rad],
            `backlash` [rad], `delay` [s] of the link's channel.
        compliance: [rad/(N m)] one over the stiffness.
        parted: whether viscous friction is separated from delay and damping; otherwise the delay is too small by
            viscous / stiffness, and the damping too large by viscous.
        alone: result of each of several logs by itself.
        without: stiffness by a model without delay, friction or encoder error, by that word.
        loose: whether any backlash counts as compliance: the torque reverses, but is not known well enough to determine
            backlash.
        torque: (T,) [N m] of the spring, corrected for known friction, at each sample used.
        twist: (T,) [rad] of the spring: without zero, delay, friction and the encoder's error.
        residual: (T,) [rad] of the fit.
    """

    name: str
    setting: TwistSetting
    numbers: Mapping[str, JointNumber]
    compliance: JointNumber
    parted: bool
    loose: bool
    torque: Float[np.ndarray, " T"]
    twist: Float[np.ndarray, " T"]
    residual: Float[np.ndarray, " T"]
    alone: "tuple[JointTwist, ...]" = ()
    without: Mapping[str, JointNumber] = field(default_factory=dict)

    @property
    def disagree(self) -> bool:
        """Whether the logs contradict each other: by chance their compliances differ so in 1 of 100 cases."""
        each = [twist.compliance for twist in self.alone]
        if not each or not all(isfinite(one.value) for one in each):
            return False
        errors = np.array([one.high - one.low for one in each]) / 2 / student.ppf(0.975, BLOCKS - 1)
        weights, values = errors**-2.0, np.array([one.value for one in each])
        spread = float((weights * (values - weights @ values / weights.sum()) ** 2).sum())
        return float(fisher.sf(spread / (len(each) - 1), len(each) - 1, BLOCKS - 1)) < CONTRADICTS

    def told(self, quantity: str) -> bool:
        """Whether the logs determine a quantity: its interval is narrow enough, and they agree on the stiffness.

        If the stiffness is below 0, a sign or a column is wrong, and nothing is determined.
        """
        if self.compliance.high < 0:
            return False
        number = self.numbers[quantity]
        off = max(number.high - number.value, number.value - number.low)
        size = abs(number.value) if quantity == "delay" else number.value  # a delay below 0 is the motor's
        return off <= NOT_TOLD * size and not (quantity == "stiffness" and self.disagree)


NOTHING = JointNumber(nan, nan, nan)
"""A number without information in the log."""


def joint_twist(name: str, logs: Sequence[JointLog], setting: TwistSetting) -> JointTwist:
    """Estimate stiffness, damping, friction, backlash and delay of a joint from its logs.

    Args:
        name: of the joint, in all logs.
        logs: of the same joint; each has its own zero.
        setting: conditions of the test.

    Raises:
        InputError: a log is sampled too slowly, or its joint moves in too few samples.
    """
    terms = _twist_terms(setting, "load" in logs[0].columns[name])
    without = {
        word: _solved(name, logs, setting, dropped).numbers["stiffness"]
        for word, dropped in LEFT_OUT.items()
        if dropped[0] in terms and not setting.locked
    }
    alone = tuple(_solved(name, (log,), setting) for log in logs) if len(logs) > 1 else ()
    return replace(_solved(name, logs, setting), alone=alone, without=without)


def _solved(name: str, logs: Sequence[JointLog], setting: TwistSetting, dropped: tuple[str, ...] = ()) -> JointTwist:
    measured, motor = (each in logs[0].columns[name] for each in ("load", "torque"))
    balanced = motor and (measured or setting.alone)
    known = measured or balanced or setting.locked
    shift, friction = 0.0, (0.0, 0.0)
    for step in range(PASSES):
        # The rows of all logs below each other, with a column for the zero of each. The shift of the link's channel and
        # the sign of the torque in the joint are those of the pass before.
        parts = [_rows(log, name, setting, shift, friction, known and step > 0) for log in logs]
        rows = {term: np.concatenate([part[term] for part in parts]) for term in parts[0]}
        number = np.repeat(np.arange(len(parts)), [len(part["twist"]) for part in parts])
        rows |= {f"zero {i}": (number == i).astype(float) for i in range(len(parts))}
        reverses = known and step > 0 and _reverses(rows["gap"])
        if known and step > 0 and not reverses:  # the few rows on the other side of the backlash leave
            keep = np.sign(rows["gap"]) == np.sign(rows["gap"].sum())
            rows = {term: column[keep] for term, column in rows.items()}
        zeros = [term for term in rows if term.startswith("zero")]
        terms = [term for term in _twist_terms(setting, measured) if term not in dropped]
        terms = [*zeros, *terms, *(["gap"] if reverses else [])]
        fit = _solve(rows["twist"], rows, terms)
        stiffness = -1 / fit["torque"]
        found = {"damping": fit["rate"] * stiffness**2} if "rate" in fit else {}
        if balanced:
            left = rows["motor"] - rows["torque"] if measured else rows["torque"]
            # the motor's torque is friction, and what else is in it
            rest = (["acceleration"] if setting.inertia is None else []) if measured else ["link", "sine", "cosine"]
            balance = _solve(left, rows, [*zeros, "sign", "speed", *rest])
            found |= {"coulomb": balance["sign"], "viscous": balance["speed"]}
        elif not measured:
            found["coulomb"] = fit.get("sign", nan * stiffness) * stiffness
        if setting.locked and not measured:
            found["viscous"] = fit["speed"] * stiffness
        if "speed" in fit and not setting.locked:
            lag = found["viscous"] / stiffness if balanced and not measured else 0.0
            found["delay"] = shift + lag - fit["speed"]
            shift = float(np.nan_to_num(found["delay"][0]))
        if not measured:  # viscous friction that the twist does not tell is left out of the torque's sign
            coulomb, viscous = (float(np.nan_to_num(found.get(word, [0.0])[0])) for word in ("coulomb", "viscous"))
            friction = coulomb, viscous
        if reverses:
            found["backlash"] = -2 * fit["gap"]
    spring = sum((fit[term][0] * rows[term] for term in ("torque", "rate", "gap") if term in fit), np.zeros(1))
    residual = rows["twist"] - sum((fit[term][0] * rows[term] for term in terms), np.zeros(1))
    compliance = _number(-fit["torque"])
    low, high = compliance.low, compliance.high  # its inverse: it is above 0, or may be
    ends = 1 / high if high > 0 else -inf, 1 / low if low > 0 else inf
    numbers = {"stiffness": JointNumber(1 / compliance.value, *ends)}
    numbers |= {word: _number(found[word]) if word in found else NOTHING for word in QUANTITIES[1:]}
    loose = not known and _reverses(rows["gap"])
    return JointTwist(name, setting, numbers, compliance, known, loose, rows["torque"], spring + residual, residual)


def _reverses(sign: Float[np.ndarray, " T"]) -> bool:
    """Whether a torque has either sign for long enough, whichever block is left out."""
    parts = np.array_split(sign, BLOCKS)
    either = np.array([[(part > 0).sum(), (part < 0).sum()] for part in parts])
    return bool(((either.sum(axis=0) - either.max(axis=0)) > REVERSED * len(sign)).all())


def _twist_terms(setting: TwistSetting, measured: bool) -> list[str]:
    """Return the columns of the twist; of a clamped link, speed and rate of the torque are the same."""
    motion = ["speed"] if setting.locked and not measured else ["rate"] if setting.locked else ["rate", "speed"]
    friction = [] if measured else ["sign", *(["acceleration"] if setting.inertia is None else [])]
    return ["torque", *motion, *friction, *([] if setting.centred or setting.locked else ["sine", "cosine"])]


def _rows(
    log: JointLog, name: str, setting: TwistSetting, shift: float, friction: tuple[float, float], known: bool
) -> Columns:
    """Return the columns of a log, filtered alike, at the samples at which the joint moves."""
    given, time, step = log.columns[name], log.time, log.interval
    sigma = sqrt(log_of(2)) / (2 * pi * setting.upto) / step
    got, expected = f"{1 / step:.4g} samples a second", f"at least {1 / step * 0.4 / sigma:.4g} for `upto`"
    require(sigma >= 0.4, log.path, got, expected, "log faster, or lower `upto`")
    if 8 * sigma > len(time):  # a filter that takes all of the log, and without an end of memory
        lowest = setting.upto * 8 * sigma / len(time)
        got, expected = f"{len(time)} samples for `upto` {setting.upto:g} Hz", f"at least {lowest:.4g} Hz"
        raise refusal(log.path, got, expected, "give a longer log, or raise `upto`")

    def smooth(values: Float[np.ndarray, " T"]) -> Float[np.ndarray, " T"]:
        return np.asarray(gaussian_filter1d(values, sigma))

    def rate(values: Float[np.ndarray, " T"]) -> Float[np.ndarray, " T"]:
        # not by a derivative of the filter's kernel, which lets offsets through
        return np.asarray(CubicSpline(time, values)(time, 1))

    motor = given["motor"]
    link = CubicSpline(time, given["link"])(time + shift) if "link" in given else np.zeros(len(time))
    speed, inertia = rate(smooth(motor)), setting.inertia or 0.0
    sign, acceleration = smooth(np.sign(speed)), rate(speed)
    rows = {"twist": smooth(link - motor), "speed": speed, "acceleration": acceleration, "sign": sign}
    rows |= {"sine": smooth(np.sin(link)), "cosine": smooth(np.cos(link)), "link": rate(rate(smooth(link)))}
    if "torque" in given:
        rows["torque"] = rows["motor"] = smooth(given["torque"]) - inertia * acceleration
    if "load" in given:
        rows["torque"] = smooth(given["load"])
    rows["rate"] = rate(rows["torque"])
    apart = ceil(APART * sigma)
    later, earlier = np.roll(rows["torque"], -apart), np.roll(rows["torque"], apart)
    rows |= {"with torque": earlier + later, "with rate": later - earlier}
    inside = rows["torque"] - friction[0] * sign - friction[1] * speed
    rows["gap"] = np.sign(inside)

    def exceeds(values: Float[np.ndarray, " T"], share: float) -> Bool[np.ndarray, " T"]:
        """Return where a size is nowhere small within the filter's reach; its maximum may be from a start."""
        size = minimum_filter1d(np.abs(values), 2 * ceil(2 * sigma) + 1)
        return np.asarray(size > share * np.quantile(np.abs(values), 0.95))

    moving, edge = exceeds(speed, STILL), ceil(4 * sigma + abs(shift) / step) + apart
    if known:  # where the torque passes 0 the joint is within its backlash; its own noise must not choose the rows
        large = exceeds(inside, STILL)
        moving &= np.roll(large, apart) & np.roll(large, -apart)
        moving &= np.roll(inside, apart) * np.roll(inside, -apart) > 0
    moving[:edge] = moving[len(time) - edge :] = False
    got, expected = f"{moving.sum()} samples in which {name} moves", f"at least {FEWEST}"
    require(moving.sum() >= FEWEST, log.path, got, expected, "give a longer log, in which it moves to and fro", name)
    return {term: column[moving] for term, column in rows.items()}


def _solve(left: Float[np.ndarray, " T"], rows: Columns, terms: Sequence[str]) -> dict[str, Float[np.ndarray, " R"]]:
    """Return the coefficient of each column: from all rows, then with each block of neighbouring rows left out.

    Errors of neighbouring rows are correlated, whatever their spectrum: leaving out blocks shows how far they move a
    value. Noise of the torque attenuates its column, so that least squares gives too stiff a joint: so the equations
    are multiplied by the torque a little earlier and later, with independent noise (instrumental variables).
    """
    table, tools = (np.stack([rows.get(f"{with_}{term}", rows[term]) for term in terms], 1) for with_ in ("", "with "))
    none = np.finfo(float).tiny  # a column of zeros stays zero, without information
    table_scale, tools_scale = (np.sqrt((each**2).mean(axis=0) + none) for each in (table, tools))
    blocks = np.array_split(np.arange(len(left)), BLOCKS)
    squares = np.stack([(tools[block] / tools_scale).T @ (table[block] / table_scale) for block in blocks])
    products = np.stack([(tools[block] / tools_scale).T @ left[block] for block in blocks])
    matrices = squares.sum(axis=0) - np.concatenate([0 * squares[:1], squares])
    sides = products.sum(axis=0) - np.concatenate([0 * products[:1], products])
    if not (np.linalg.cond(matrices) < PARALLEL).all():
        return dict.fromkeys(terms, np.full(BLOCKS + 1, nan))
    values = np.linalg.solve(matrices, sides[..., None])[..., 0] / table_scale
    return dict(zip(terms, values.T, strict=True))


def _number(values: Float[np.ndarray, " R"]) -> JointNumber:
    """Return a value with its jackknife interval over blocks."""
    value, parts = float(values[0]), values[1:]
    spread = sqrt((BLOCKS - 1) / BLOCKS * float(((parts - parts.mean()) ** 2).sum()))
    half = float(student.ppf(0.975, BLOCKS - 1)) * spread
    return JointNumber(value, value - half, value + half)
