"""Balance the drives' rotors: masses and their places, how certain they are, and the remaining vibration.

An imbalance is a complex number U = m_e e exp(i psi) [kg m]: psi counts about the joint's axis at joint angle 0, as in
`arm.parts.Drive`. A body of mass m at radius r and angle chi adds m r exp(i chi), so U + w = 0 balances a rotor for
either sense of rotation: the body sits opposite the imbalance, at psi + 180 degrees. If trial masses show that a body
acts as f times the stated one (a turned mark, a wrong scale, a model that responds differently), U + f w = 0. The
vibration is linear in each U (see `vibrate.simulate`, "Superposition"), so the remaining vibration follows from the
responses to unit imbalances at the rotor's height and at the height of the correction; their difference is the effect
of the couple.

References:
    ISO 21940-11:2016, Mechanical vibration, Rotor balancing, Part 11: rotors with rigid behaviour (balance grades).
    Goodman, "A least-squares method for computing balance corrections", J. Eng. Ind. 86(3), 1964.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Complex, Float
from scipy.stats import chi2

from ident.arm.arm import Arm
from ident.arm.multibody import possible_orders
from ident.arm.parts import Drive
from ident.studies.cause.trials import CONTRADICTED, NEAR, Tried
from ident.studies.scenario import Basis
from ident.vibrate.binomial import HALF_WIDTH
from ident.vibrate.fast import FastMethod, numbers_of, refuse_collapse, vibrations
from ident.vibrate.simulate import fast_method

RATE = 200.0
"""Sampling rate [Hz]: between two samples of an 8 Hz vibration, at most 0.8 % of its peak is missed."""
UNIT, LIGHTEST = 1e-3, 1e-9
"""Eccentricity [m] of a unit imbalance; stand-in mass [kg] where a rotor has none, with negligible effect."""
WORTH = 0.05
"""Least share of the vibration's peak at which an imbalance is corrected; assumed."""
GRADES = (0.4, 1.0, 2.5, 6.3, 16.0, 40.0, 100.0, 250.0, 630.0, 1600.0, 4000.0)
"""Balance quality grades G [mm/s] of ISO 21940-11."""


def complex_least_squares(
    matrix: Complex[np.ndarray, "R P"],
    values: Complex[np.ndarray, "R K"],
    covariance: Float[np.ndarray, "2*R 2*R"] | None = None,
) -> tuple[Complex[np.ndarray, "P K"], Float[np.ndarray, "K"]]:
    """Solve matrix x = values, each complex, by generalised least squares; the algebra of influence coefficients.

    Coefficients: from trial masses (R, P) and the changes at a sensor. Corrections: from coefficients (sensors, P) and
    the negative vibration.

    Args:
        matrix: (R, P)
        values: (R, K), K problems.
        covariance: of the values' real, then imaginary parts, the same for all problems; None for equal variances.

    Returns:
        x (P, K), and chi-squared (K,) of the residuals.

    References:
        Goodman (1964), see above.
    """
    both = np.block([[matrix.real, -matrix.imag], [matrix.imag, matrix.real]])
    right = np.concatenate([values.real, values.imag])
    white = np.linalg.inv(np.linalg.cholesky(np.eye(len(right)) if covariance is None else covariance))
    found = np.linalg.lstsq(white @ both, white @ right, rcond=None)[0]
    left = white @ (right - both @ found)
    return found[: matrix.shape[1]] + 1j * found[matrix.shape[1] :], np.asarray((left**2).sum(0))


# -------- Trial masses


@dataclass(frozen=True)
class Calibration:
    """Effect of a stated mass on a drive: f w, or f times the conjugate of w if angles count in the other sense.

    Attributes:
        draws: (D,) of f.
        mirrored: whether angles were counted in the other sense.
        odd: trial masses that do not act as stated, or not like the others.
        state: empty if the effect is known; `one trial` that does not act as stated, or several that a wrong mark and a
            wrong sense explain equally; `contradicting` ones.
        trials: number of trials behind the factor; 0 where it is 1 as stated.
    """

    draws: Complex[np.ndarray, "D"]
    mirrored: bool = False
    odd: tuple[Tried, ...] = ()
    state: str = ""
    trials: int = 0

    @property
    def factor(self) -> complex:
        """The mean of its draws."""
        return complex(self.draws.mean())

    def acts(self, mass: complex) -> Complex[np.ndarray, "D"]:
        """Return draws of the effect of a stated imbalance [kg m]."""
        return self.draws * (np.conj(mass) if self.mirrored else mass)

    def against(self, imbalance: Complex[np.ndarray, "*D"], factor: Complex[np.ndarray, "*D"]) -> np.ndarray:
        """Return the stated correction against an imbalance [kg m]."""
        wanted = -imbalance / factor
        return np.asarray(np.conj(wanted) if self.mirrored else wanted)


def calibrated(tried: Sequence[Tried], count: int) -> Calibration:
    """Return how stated masses act on a drive, from all trial masses on it.

    For trial masses at the same or opposite angles, a wrong mark and a wrong sense fit equally well.

    Args:
        tried: trial masses on that drive; uninformative ones do not count.
        count: draws D.
    """
    tried = [each for each in tried if each.told]
    if not tried or any(each.right for each in tried):
        return Calibration(np.ones(count, complex), odd=tuple(each for each in tried if not each.right))
    if len(tried) == 1:
        return Calibration(tried[0].draws, odd=tuple(tried), state="one trial", trials=1)
    stated = np.array([each.stated for each in tried])
    effect = np.array([each.factor for each in tried]) * stated
    drawn = np.stack([each.draws for each in tried]) * stated[:, None]
    covariance = np.cov(np.concatenate([drawn.real, drawn.imag]), bias=True)
    covariance += np.diag(np.tile((NEAR / 2 * np.abs(effect)) ** 2, 2))
    accepted = list[Calibration]()
    for mirrored in (False, True):
        column = (np.conj(stated) if mirrored else stated)[:, None]
        _, left = complex_least_squares(column, effect[:, None], covariance)
        if chi2.sf(left[0], 2 * len(tried) - 2) > CONTRADICTED:
            draws = complex_least_squares(column, drawn, covariance)[0][0]
            accepted.append(Calibration(draws, mirrored, trials=len(tried)))
    if not accepted:
        return Calibration(np.ones(count, complex), odd=tuple(tried), state="contradicting")
    return accepted[0] if len(accepted) == 1 else replace(accepted[0], odd=tuple(tried), state="one trial")


# -------- Corrections


@dataclass(frozen=True)
class Pulley:
    """Where a correction can be mounted on a drive's pulley.

    Attributes:
        radius: [m] of the bodies' mass centres from the axis.
        height: [m] of their mass centres above the bushing.
        most: [kg] at one place.
        rotor: [kg] mass of the rotor, for its balance grade.
        holes: number of holes around the pulley; 0 if a body may sit at any angle.
        first: [rad] angle of hole 1, counted like phases.
        assumed: source of the rotor's mass; empty if it was given.
    """

    radius: float
    height: float
    most: float
    rotor: float
    holes: int = 0
    first: float = 0.0
    assumed: str = ""

    def split(self, wanted: complex) -> "tuple[Body, ...]":
        """Return the bodies that realise an imbalance [kg m]: one, or two in the neighbouring holes."""
        mass, angle = abs(wanted) / self.radius, float(np.angle(wanted)) % (2 * np.pi)
        if not self.holes:
            return (Body(mass, angle),)
        pitch = 2 * np.pi / self.holes
        before, past = divmod((angle - self.first) % (2 * np.pi), pitch)
        shares = (np.sin(pitch - past) / np.sin(pitch), np.sin(past) / np.sin(pitch))
        holes = [int(before) % self.holes, (int(before) + 1) % self.holes]
        return tuple(
            Body(mass * float(share), (self.first + k * pitch) % (2 * np.pi), k + 1)
            for k, share in zip(holes, shares, strict=True)
            if share > 1e-6
        )


@dataclass(frozen=True)
class Body:
    """A body to mount.

    Attributes:
        mass: [kg]
        angle: [rad] from 0 to 2 pi.
        hole: its number, from 1; 0 without holes.
    """

    mass: float
    angle: float
    hole: int = 0


@dataclass(frozen=True)
class Rotor:
    """A drive's imbalance and its correction.

    Attributes:
        drive: the drive.
        pulley: where a correction can be mounted.
        found: [kg m] the imbalance.
        draws: (D,) of the imbalance.
        told: whether the runs determine it.
        sd: of its size, relative.
        repeats: [rad] standard deviation of its phase between phase groups, beyond their errors; NaN with one group.
        calibration: effect of a stated mass.
        speed: [Hz] largest rotation frequency of the pulley.
        makes: [m] peak of the vibration from this imbalance alone.
        share: of the whole vibration's peak.
    """

    drive: Drive
    pulley: Pulley
    found: complex
    draws: Complex[np.ndarray, "D"]
    told: bool
    sd: float
    repeats: float
    calibration: Calibration
    speed: float
    makes: float = 0.0
    share: float = 0.0

    @cached_property
    def wanted(self) -> complex:
        """Imbalance [kg m] to mount."""
        return complex(self.calibration.against(np.asarray(self.found), np.asarray(self.calibration.factor)))

    @cached_property
    def wanted_sd(self) -> tuple[float, float]:
        """Relative standard deviation of its size, and standard deviation of its angle [rad]."""
        off = self.calibration.against(self.draws, self.calibration.draws) / self.wanted
        return float(off.real.std()), float(off.imag.std())

    @cached_property
    def masses_sd(self) -> Float[np.ndarray, "B"]:
        """Standard deviation of each body's mass [kg]: over the draws, in the same places."""
        ways = np.exp(1j * np.array([body.angle for body in self.bodies]))
        wanted = self.calibration.against(self.draws, self.calibration.draws) / self.pulley.radius
        places, asked = np.stack([ways.real, ways.imag]), np.stack([wanted.real, wanted.imag])
        return np.asarray(np.linalg.lstsq(places, asked, rcond=None)[0].std(1))

    @property
    def bodies(self) -> tuple[Body, ...]:
        """The bodies to mount, also if none is mounted."""
        return self.pulley.split(self.wanted)

    @property
    def most(self) -> float:
        """Share of the whole vibration's peak from this imbalance; its upper limit if not determined."""
        return self.share * (1.0 if self.told else 1 + HALF_WIDTH * self.sd)

    @property
    def state(self) -> str:
        """What to do: `balance`, or why nothing is done."""
        if self.most < WORTH:
            return "not worth it"
        if not self.told:
            return "cannot be told"
        if self.calibration.state == "contradicting":
            return "trials contradict"
        return "balance" if max(body.mass for body in self.bodies) <= self.pulley.most else "does not fit"

    @property
    def balanced(self) -> bool:
        """Whether a correction is mounted."""
        return self.state == "balance"

    @property
    def couple(self) -> float:
        """Couple that the correction leaves [kg m^2]: its imbalance times its height above the rotor."""
        return abs(self.wanted) * (self.pulley.height - float(self.drive.height)) if self.balanced else 0.0

    @property
    def left(self) -> Complex[np.ndarray, "D"]:
        """Draws of the remaining imbalance [kg m]."""
        return self.draws + self.calibration.acts(self.wanted) if self.balanced else self.draws

    def quality(self, imbalance: float) -> float:
        """Return eccentricity times angular speed of an imbalance [kg m], in mm/s, as in balance grades."""
        return 1e3 * imbalance / self.pulley.rotor * 2 * np.pi * self.speed


def grade(quality: float) -> float:
    """Return the finest grade [mm/s] of ISO 21940-11 for an eccentricity times speed; infinite for none."""
    return next((each for each in GRADES if quality <= each * (1 + 1e-9)), np.inf)


def repeatability(phase: Sequence[float], sd: Sequence[float]) -> tuple[float, float]:
    """Return mean turn against the first phase group, and standard deviation between groups beyond their errors [rad].

    Random-effects model, by the method of moments.

    References:
        DerSimonian, Laird, "Meta-analysis in clinical trials", Controlled Clinical Trials 7(3), 1986.
    """
    turned, weights = np.angle(np.exp(1j * (np.asarray(phase) - phase[0]))), 1 / np.asarray(sd) ** 2
    mean = float(weights @ turned / weights.sum())
    if len(turned) < 2:
        return mean, np.nan
    excess = float(weights @ (turned - mean) ** 2) - (len(turned) - 1)
    return mean, float(np.sqrt(max(0.0, excess / (weights.sum() - (weights**2).sum() / weights.sum()))))


def tried_in(record: Mapping[str, Any], count: int) -> Tried:
    """Return a trial mass from a result of `ident source`, with the first of its draws.

    Raises:
        ValueError, TypeError, KeyError: the record is malformed.
    """
    (a, b), (c, d) = record["stated"], record["factor"]
    drawn = np.asarray(record["draws"], float)[:, :count]
    if drawn.ndim != 2 or len(drawn) != 2 or not np.isfinite(drawn).all():
        raise ValueError("draws of no trial mass")
    return Tried(record["run"], record["drive"], complex(a, b), complex(c, d), drawn[0] + 1j * drawn[1])


def rotor_of(
    basis: Basis,
    drive: Drive,
    pulley: Pulley,
    middle: Mapping[str, float],
    row: Mapping[str, Any],
    phases: Mapping[str, Sequence[Sequence[float]]],
    tried: Sequence[Tried],
) -> Rotor:
    """Return a drive's rotor with its imbalance, at its mean phase over the phase groups.

    Args:
        basis: the motion, and draws of the identified numbers.
        drive: the drive.
        pulley: where a correction can be mounted.
        middle: identified numbers, by path [SI].
        row: its imbalance, a row of that result's table.
        phases: of each drive's imbalance, with standard deviation, in each phase group [rad].
        tried: masses added for runs, on any drive.
    """
    paths = [f"{drive.name}.{name}" for name in ("eccentric_mass", "eccentricity", "phase")]
    count = len(next(iter(basis.draws.values())))
    mass, size, phase = (basis.draws.get(path, np.full(count, float(basis.arm.get(path)))) for path in paths)
    told = bool(row["told"])
    turn, between = repeatability(*phases[drive.name]) if told else (0.0, np.nan)
    scatter = np.nan_to_num(between) * np.random.default_rng(0).standard_normal(len(phase))
    one, far, way = (middle.get(path, float(basis.arm.get(path))) for path in paths)
    joint = [joint.name for joint in basis.arm.driven].index(drive.joint)
    rate = np.asarray(basis.motion(np.linspace(0.0, basis.motion.arrival, 2000))[1])[joint]
    return Rotor(
        drive,
        pulley,
        one * far * np.exp(1j * (way + turn)),
        mass * size * np.exp(1j * (phase + turn + scatter)),
        told,
        float(row["sd"] or np.nan) / max(float(row["amplitude"]), 1e-300),
        between,
        calibrated([each for each in tried if each.drive == drive.name], len(phase)),
        float(np.abs(rate).max() * abs(float(drive.ratio)) / (2 * np.pi)),
    )


# Remaining vibration


@dataclass(frozen=True)
class Balance:
    """Rotors, their corrections, and the vibration before and after.

    Attributes:
        basis: arm, motion and draws.
        rotors: of all drives.
        tried: masses added for runs.
        time: (T,) [s]
        before: (3, T) [m] vibration of the end point.
        after: (3, T) [m] with the corrections.
        peaks: (2, K) [m] peak before and after, by draws.
        of_imbalance: (2, K) [m] the same for the vibration from imbalance.
        errors: [m] peak of the vibration from transmission errors.
        own: [m] peak of the vibration from the motion itself.
    """

    basis: Basis
    rotors: tuple[Rotor, ...]
    tried: tuple[Tried, ...]
    time: Float[np.ndarray, "T"]
    before: Float[np.ndarray, "3 T"]
    after: Float[np.ndarray, "3 T"]
    peaks: Float[np.ndarray, "2 K"]
    of_imbalance: Float[np.ndarray, "2 K"]
    errors: float
    own: float

    @property
    def balanced(self) -> tuple[Rotor, ...]:
        """The rotors with a correction."""
        return tuple(each for each in self.rotors if each.balanced)

    @property
    def left(self) -> Float[np.ndarray, "3"]:
        """Remaining share of the peak: median, and 95 % interval."""
        return np.quantile(self.peaks[1] / self.peaks[0], (0.5, 0.025, 0.975))

    @property
    def gains(self) -> bool:
        """Whether the corrections do not raise the peak, by the upper end of that interval."""
        return bool(self.left[2] <= 1)

    @property
    def imbalance_left(self) -> Float[np.ndarray, "3"]:
        """The same for the vibration from imbalance."""
        return np.quantile(self.of_imbalance[1] / self.of_imbalance[0], (0.5, 0.025, 0.975))


ARMS = 16
"""Simulated draws of the arm: the remaining vibration depends on the imbalance's error, hardly on the stiffness's."""


@dataclass(frozen=True)
class _Responses:
    """Excitation of some arms (A), and their responses to a unit imbalance.

    Attributes:
        motion: (3, T, A) [m] response to the motion itself.
        errors: (3, T, A) [m] response to transmission errors.
        units: (H, R, 3, T, 2, A) [m] response to an imbalance of 1 kg m on each rotor, at 0 and 90 degrees, at its own
            height and at that of its correction.
    """

    motion: np.ndarray
    errors: np.ndarray
    units: np.ndarray

    def imbalance(self, height: int, rotor: int, size: Complex[np.ndarray, "A"]) -> np.ndarray:
        """Return the response to an imbalance [kg m], (3, T, A) [m]."""
        cosine, sine = np.moveaxis(self.units[height, rotor], 2, 0)
        return np.asarray(cosine * size.real + sine * size.imag)

    def sums(self, rotors: Sequence[Rotor], found: np.ndarray, added: np.ndarray) -> list[np.ndarray]:
        """Return the vibration before and after, then its part from imbalance before and after, (3, T, A) each [m].

        Args:
            rotors: all of them.
            found: (R, A) [kg m] their imbalances.
            added: (R, A) [kg m] effect of the corrections.
        """
        before = sum((self.imbalance(0, k, z) for k, z in enumerate(found)), np.zeros(self.motion.shape))
        mounted = [self.imbalance(-1, k, z) for k, z in enumerate(added) if rotors[k].balanced]
        after = sum(mounted, before)
        rest = self.motion + self.errors
        return [rest + before, rest + after, before, after]


def balanced(basis: Basis, rotors: Sequence[Rotor], tried: Sequence[Tried], middle: Mapping[str, float]) -> Balance:
    """Predict the vibration that corrections leave over a motion.

    Args:
        basis: with draws of the arm's numbers, as many as each rotor has of its imbalance.
        rotors: of all drives, without the vibration from their imbalances.
        tried: masses added for runs.
        middle: the arm's identified numbers, by path [SI].

    Raises:
        InputError: see `simulate`.
        ModelError: the arm collapses.
    """
    arm, draws = basis.arm.replace(middle), basis.draws
    solve = replace(fast_method(arm, basis.motion, basis.loads, False, RATE, None), measured=True)
    own = {path: np.asarray(x) for path, x in numbers_of(arm).items()}
    nominal = _responses(arm, rotors, basis, solve, {path: x[None] for path, x in own.items()})
    found = np.array([[each.found] for each in rotors])
    added = np.array([[each.calibration.acts(each.wanted).mean()] for each in rotors])
    peak = np.abs(nominal.sums(rotors, found, added)[0]).max()
    sizes = [float(np.abs(nominal.imbalance(0, k, z)).max()) for k, z in enumerate(found)]
    rotors = tuple(replace(each, makes=x, share=x / peak) for each, x in zip(rotors, sizes, strict=True))
    before, after, *_ = (part[..., 0] for part in nominal.sums(rotors, found, added))
    count = len(next(iter(draws.values())))
    arms, peaks = min(ARMS, count), list[np.ndarray]()
    members = {path: draws[path][:arms] if path in draws else np.broadcast_to(x, arms) for path, x in own.items()}
    drawn = _responses(arm, rotors, basis, solve, members)
    for first in range(0, count - arms + 1, arms):
        found = np.stack([each.draws[first : first + arms] for each in rotors])
        added = np.stack([each.calibration.acts(each.wanted)[first : first + arms] for each in rotors])
        peaks.append(np.stack([np.abs(part).max((0, 1)) for part in drawn.sums(rotors, found, added)]))
    time, both = solve.samples.wanted, np.concatenate(peaks, 1)
    errors, motion = (float(np.abs(part).max()) for part in (nominal.errors, nominal.motion))
    return Balance(basis, rotors, tuple(tried), time, before, after, both[:2], both[2:], errors, motion)


def _responses(
    arm: Arm, rotors: Sequence[Rotor], basis: Basis, solve: FastMethod, members: Mapping[str, Float[np.ndarray, "A"]]
) -> _Responses:
    """Simulate arms: with all excitation, with none, and with a unit imbalance of each rotor alone at each height."""
    aside = any(each.pulley.height != float(each.drive.height) for each in rotors)
    still = dict.fromkeys((each.amplitude for each in possible_orders(arm)), 0.0)
    sets: list[dict[str, float]] = [{}, still]
    for rotor in rotors:
        name = rotor.drive.name
        for height in (float(rotor.drive.height), rotor.pulley.height)[: 1 + aside]:
            unit = still | {f"{name}.eccentricity": UNIT, f"{name}.height": height}
            sets += [unit | {f"{name}.phase": turn} for turn in (0.0, np.pi / 2)]
    every = np.asarray(vibrations(arm, members, solve, sets))
    refuse_collapse(basis.motion, every)
    whole, motion = every[..., 0, :], every[..., 1, :]
    units = (every[..., 2:, :] - motion[..., None, :]).reshape((*whole.shape[:2], len(rotors), -1, 2, whole.shape[2]))
    units = np.moveaxis(units, (3, 2), (0, 1))
    for k, rotor in enumerate(rotors):
        units[:, k] /= np.maximum(members[f"{rotor.drive.name}.eccentric_mass"], LIGHTEST) * UNIT
    found = _Responses(motion, np.zeros_like(motion), units)
    excited = whole - motion
    for k, rotor in enumerate(rotors):
        mass, size, phase = (members[f"{rotor.drive.name}.{x}"] for x in ("eccentric_mass", "eccentricity", "phase"))
        excited = excited - found.imbalance(0, k, mass * size * np.exp(1j * phase))
    return replace(found, errors=excited)
