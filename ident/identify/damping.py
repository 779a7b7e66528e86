"""Damping given stiffness: the law that measured damping ratios follow, its parameters, and the unexplained scatter.

The second stage of a fit. Frequencies and statics determine the stiffnesses, damping ratios the damping: a cut
posterior, in which no misfit of a ratio moves a stiffness. A lightly damped, mass-normalised mode v with the angular
frequency w has

    zeta = sum_b (tau_b / 2w + eta_b / 2w^2) v' K_b v + alpha / 2w,

with the damping times tau, loss factors eta and stiffness matrices K_b of the bushings, and damping alpha M. It is
linear in numbers that are never negative. The measured ratio of mode m at posture p is

    ln(zeta measured) = ln(zeta) + b_m + b_mp + e,    var b_m = rho s^2,    var b_mp = (1 - rho) s^2,

with e by the row's sigma. So s is the scatter that the law does not explain: the prediction error of the ratio of a
mode without measurement.

References:
    Plummer, "Cuts in Bayesian graphical models", Stat. Comput. 25, 2015. Liu, Bayarri, Berger, "Modularization in
    Bayesian analysis", Bayesian Anal. 4, 2009. Lawson, Hanson, "Solving Least Squares Problems", 1974, chapter 23.
    Schwarz, "Estimating the dimension of a model", Ann. Stat. 6, 1978; a difference of 6 is strong evidence (Kass,
    Raftery, "Bayes factors", J. Am. Stat. Assoc. 90, 1995).
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ident.arm.arm import LOSS_OF, Arm
from ident.arm.fields import ALPHA, DAMPING, LOSS
from ident.arm.mechanics import static_equilibrium, unflatten
from ident.arm.modes import damped_eigenvalues, linearize, modes_about
from ident.arm.parts import Joint, MassDamping
from ident.arm.rotations import matvec
from ident.identify.conditions import Conditions, bind
from ident.identify.mode_matching import most_probable
from ident.identify.padding import padded
from ident.identify.predict import ArmModel, chains, picked
from ident.identify.unknowns import Unknowns, damping_parameters, is_damping
from ident.inference.problem import Data
from ident.measure import Campaign, Measurement
from ident.programs import in_batches, jit

Groups = tuple[tuple[str, ...], ...]
"""Numbers of a law, each with the paths that share it."""
Place = tuple[int, int]
"""Indices of a share in `OF_MODE` and of a scatter in `SCATTERS`."""

RATIO = "damping_ratio"
TOLD_APART = 6.0
"""Difference of BIC from which a law counts as better."""
SCATTERS = np.concatenate([[0.0], np.geomspace(0.003, 3.0, 61)])
"""Trial values of the scatter s of ln(ratio): from below any measurement accuracy to a factor of 20."""
START_SCATTER = 0.1
OF_MODE = np.array([0.0, 0.5, 1.0])
"""Share rho of its variance that is common to a mode at all postures."""
PRIOR = np.where(SCATTERS > 0, 0.5 / (len(SCATTERS) - 1), 0.5)
"""Prior weight of each scatter: half for none, half uniform in its logarithm; assumed."""
STEPS, SETTLED = 40, 1e-10
"""Most steps of least squares; change of cost, relative to 1 + cost, at which they end."""
LEAST = 1e-9
"""Least predicted damping ratio, so that it has a logarithm."""
PARTNER_SD, ANY_SD = 0.01, 1e6
"""Relative sd of a mode's frequency in matching a ratio to its mode: at least with a measured frequency, assumed; and
without one."""
EXACTLY = 2
"""Iterations from the ratios of lightly damped modes to those of the poles."""
COUPLED = 3.0
"""Largest factor between the ratio of a pole and that of the lightly damped mode; beyond it they do not correspond."""
MARKED, SUSPECTS = 0.01, 3
"""Probability of a marked row in a correct campaign; number of worst rows to predict from the others."""
CHUNK = 256
"""Draws of an arm whose modes are computed at once."""
DRAWS = 2000
"""Draws for an interval."""

# -------- Modes


@jit
def _quotients(arm: Arm, conditions: Conditions, data: Data) -> tuple[Array, ...]:
    """Return each row's mode, its angular frequency [rad/s], and v' K v of the bushings and servos [1/s^2]."""
    chain, values = chains(arm, conditions), conditions.named
    at = static_equilibrium(chain)
    modes = modes_about(chain, at)
    chosen = most_probable(values, modes, data, 0.0)
    shapes = jnp.moveaxis(modes.shape, 1, -1)
    by_joint, motors = unflatten(shapes[: at.W.shape[0]]), chain.motors
    energy = [(by_joint * matvec(K[..., None], by_joint)).sum(0) for K in (chain.bend, chain.tors)]
    energy += [motors.stiffness[..., None] * shapes[-len(motors.joint) :] ** 2] if motors else []
    own = [jnp.moveaxis(x, -1, 0)[:, :, values.states] for x in energy]
    omega = picked(2 * jnp.pi * modes.frequency[:, values.states], chosen)
    return chosen, omega, *((x * chosen[:, None]).sum(0) for x in own)


@jit
def _poles(arm: Arm, conditions: Conditions, chosen: Float[Array, "m R"]) -> Float[Array, "R"]:
    """Return the ratios of the poles, exact for damping of any size and distribution."""
    chain = chains(arm, conditions)
    s = damped_eigenvalues(linearize(chain, static_equilibrium(chain)))[: len(chosen), conditions.named.states]
    return picked(-s.real / jnp.abs(s), chosen)


class ModesOfRows(NamedTuple):
    """The modes of some damping rows of an arm.

    Attributes:
        arm, conditions: in one of few sizes.
        quotients: of the rows of these, see `_quotients`.
        places: (D,) index of each row among those of the conditions.
    """

    arm: Arm
    conditions: Conditions
    quotients: tuple[Array, ...]
    places: Int[np.ndarray, "D"]

    @classmethod
    def of(
        cls, model: ArmModel, parameters: Mapping[str, Any], rows: Iterable[Measurement], others: Iterable[Measurement]
    ) -> "ModesOfRows":
        """Return the modes of an arm with these numbers; a frequency of the same label and state helps the matching."""
        known = {mode_of(m): m for m in others if m.kind == "frequency"}
        blank: dict[str, Any] = {"kind": "frequency", "of": None, "group": "", "unit": "", "resolution": 0.0}
        twins = []
        for m in rows:
            value, sd = (partner.value, partner.sigma) if (partner := known.get(mode_of(m))) else (1.0, ANY_SD)
            twins.append(replace(m, value=value, sigma=max(sd, PARTNER_SD * value), **blank))
        conditions, own, places = padded(bind(model.arm, Campaign(measurements=tuple(twins))))
        data = Data(*np.array([(twins[i].value, twins[i].sigma) for i in own]).T)
        arm, conditions = replace(model, conditions=conditions, frames=None).applied(parameters)
        return cls(arm, conditions, _quotients(arm, conditions, data), places)

    def columns(self) -> tuple[Float[np.ndarray, "D *draws"], dict[str, Float[np.ndarray, "D *draws"]]]:
        """Return the frequency [Hz] of each mode, and its ratio per unit of each damping number."""
        omega, *energy = map(np.asarray, self.quotients[1:])
        omega, energy = omega[self.places], [x[:, self.places] for x in energy]
        columns = {ALPHA: 1 / (2 * omega)}
        for fields, power in ((DAMPING, 1), (LOSS, 2)):
            for number, each in zip(fields, energy, strict=False):
                named = zip(self.arm.joints, each, strict=True)
                columns |= {f"{joint.name}.{number}": own / (2 * omega**power) for joint, own in named}
        for each in energy[2:]:
            columns |= {f"{s.name}.tau": own / (2 * omega) for s, own in zip(self.arm.servos, each, strict=True)}
        return omega / (2 * np.pi), columns

    def poles(self, damping: Mapping[str, float]) -> Float[np.ndarray, "D"]:
        """Return the ratios of the poles with these damping numbers."""
        return np.asarray(_poles(damped(self.arm, damping), self.conditions, self.quotients[0]))[self.places]


def mode_of(m: Measurement) -> tuple[object, ...]:
    """Return the key of a row's mode: state and label."""
    return m.posture, m.load, m.drives, m.mode


def gives(joint: Joint, field: str) -> bool:
    """Whether a joint's bushing is compliant in the direction of a damping number, and so dissipates there."""
    return getattr(joint, f"k_{field.partition('_')[2]}") is not None


def damped(arm: Arm, damping: Mapping[str, float]) -> Arm:
    """Return an arm with exactly this damping: of bushings, of servos, and in proportion to mass."""

    def joint(each: Any) -> Any:
        fields = [field for field in (*DAMPING, *LOSS) if gives(each, field)]
        values = [jnp.asarray(damping.get(f"{each.name}.{field}", 0.0)) for field in fields]
        return eqx.tree_at(lambda j: [getattr(j, field) for field in fields], each, values, is_leaf=lambda x: x is None)

    servos = {f"{servo.name}.tau" for servo in arm.servos}.intersection(damping)
    more = MassDamping(alpha=jnp.asarray(damping.get(ALPHA, 0.0)))
    arm = eqx.tree_at(lambda a: (a.joints, a.damping), arm, (tuple(map(joint, arm.joints)), more))
    return arm.replace({path: damping[path] for path in servos}) if servos else arm


@dataclass(frozen=True)
class Poles:
    """Damping used in the fit of the stiffnesses, for frequencies and shapes of damped modes.

    Attributes:
        numbers: damping by path; none for the arm file's.
        apart: (D,) [SI] difference of each row between laws that the data cannot separate; it adds to its sigma.
    """

    numbers: Mapping[str, float] = field(default_factory=dict)
    apart: tuple[float, ...] = ()

    def on(self, arm: Arm) -> Arm:
        """Return the arm with this damping."""
        return damped(arm, self.numbers) if self.numbers else arm


# -------- Ratios


class Ratios(NamedTuple):
    """Measured ratios, prepared for the fit of a law.

    Attributes:
        log: (D,) ln(ratio), corrected for the errors of the frequencies.
        covariance: (D, D) of its errors, given those of the frequencies.
        mode: (D,) mode number of each: a label is one mode at all postures.
        place: (D,) number of the mode at its posture.
    """

    log: Float[np.ndarray, "D"]
    covariance: Float[np.ndarray, "D D"]
    mode: Int[np.ndarray, "D"]
    place: Int[np.ndarray, "D"]

    def some(self, rows: Any) -> "Ratios":
        """Return some of them."""
        return Ratios(self.log[rows], self.covariance[rows][:, rows], self.mode[rows], self.place[rows])

    def shared(self, other: "Ratios", at: Place) -> Float[np.ndarray, "D E"]:
        """Return the covariance of the modes' deviations from the law."""
        same = (np.equal.outer(getattr(self, of), getattr(other, of)) for of in ("place", "mode"))
        return SCATTERS[at[1]] ** 2 * ((1 - OF_MODE[at[0]]) * next(same) + OF_MODE[at[0]] * next(same))


def ratios_of(campaign: Campaign, off: Float[np.ndarray, "n"]) -> Ratios:
    """Return the damping ratios of a campaign, given the residuals of its other rows.

    The errors of rows in a group are correlated. Those of its frequencies are known from the fit of the stiffnesses,
    and shift the expected ratio by C21 C11^-1 r1, with the covariance C22 - C21 C11^-1 C12.

    Args:
        campaign: with all rows.
        off: (n,) measured less predicted, in sigma, of the rows that are not ratios.
    """
    ours, own = np.array([m.kind == RATIO for m in campaign]), [*campaign.of_kind(RATIO)]
    R, z, shift = np.eye(len(ours)), np.zeros(len(ours)), np.zeros(len(ours))
    z[~ours] = off
    for places, matrix in campaign.correlated:
        two, one = (np.array([i for i in places if ours[i] == mine], int) for mine in (True, False))
        R[np.ix_(places, places)] = matrix
        gain = np.linalg.lstsq(R[np.ix_(one, one)], R[np.ix_(one, two)])[0].T
        shift[two] = gain @ z[one]
        R[np.ix_(two, two)] -= gain @ R[np.ix_(one, two)]
    value, sigma = np.array([(m.value, m.spread) for m in own]).T
    relative = sigma / value
    log = np.log(value * np.maximum(1 - shift[ours] * relative, LEAST))
    return Ratios(log, R[ours][:, ours] * np.outer(relative, relative), *_numbers(own))


def _numbers(rows: Sequence[Measurement]) -> tuple[Int[np.ndarray, "D"], ...]:
    """Return the mode number of each row, and the number of the mode at its posture."""
    each: tuple[list[Any], ...] = [m.mode for m in rows], [*map(mode_of, rows)]
    return tuple(np.array([*map(keys.index, keys)], int) for keys in each)


# -------- Laws


@dataclass(frozen=True)
class Law:
    """One law of damping, fitted to the data.

    Attributes:
        groups: its numbers, each with the paths that share it.
        values: (k,) [s, -, or 1/s] of each.
        scatter: unexplained scatter s of ln(ratio).
        bic: Schwarz's criterion.
        weights: (3, G) posterior weight of each share in `OF_MODE` and scatter in `SCATTERS`.
    """

    groups: Groups
    values: Float[np.ndarray, "k"]
    scatter: float
    bic: float
    weights: Float[np.ndarray, "3 G"]

    @property
    def numbers(self) -> dict[str, float]:
        """The damping by path, ties spelled out, without zeros."""
        pairs = zip(self.groups, self.values.tolist(), strict=True)
        return {path: value for group, value in pairs for path in group if value > 0}

    @property
    def family(self) -> frozenset[str]:
        """Trend of the ratio with frequency: `tau` grows, `loss` is constant, `alpha` falls; several for a sum.

        The damping of servos does not matter here.
        """
        words = {path.rpartition(".")[2].partition("_")[0] for path in self.numbers if not path.endswith(".tau")}
        return frozenset(words)


def _candidates(arm: Arm, servos: bool) -> list[Groups]:
    """Return the candidate laws; if servos held the motors in some row, the servos have their own damping number."""
    times, losses = (
        tuple(tuple(f"{j.name}.{field}" for j in arm.joints if gives(j, field)) for field in fields)
        for fields in (DAMPING, LOSS)
    )
    joints = tuple(tuple(f"{j.name}.{field}" for field in LOSS if gives(j, field)) for j in arm.joints)
    time, loss, falling = sum(times, ()), sum(losses, ()), (ALPHA,)
    more = (tuple(f"{servo.name}.tau" for servo in arm.servos),) if servos else ()
    laws: tuple[Groups, ...] = ((time,), times, (loss,), losses, joints, (falling,), (loss, time, falling))
    return [tuple(filter(None, (*groups, *more))) for groups in laws]


class _Design(NamedTuple):
    """A law as a linear model: from its numbers to the ratios.

    Attributes:
        columns: (D, k) ratio per unit of each number.
        kept: (D,) ratio by the fixed damping numbers.
        centre, narrow: (k,) prior of ln(number), and the inverse of its width; zero for none.
    """

    columns: Float[np.ndarray, "D k"]
    kept: Float[np.ndarray, "D"]
    centre: Float[np.ndarray, "k"]
    narrow: Float[np.ndarray, "k"]

    def of(self, x: Float[np.ndarray, "k *draws"]) -> Float[np.ndarray, "D *draws"]:
        """Return the ratios."""
        return np.maximum(self.kept.reshape(-1, *(1,) * (x.ndim - 1)) + self.columns @ x, LEAST)

    def some(self, rows: Any) -> "_Design":
        """Return the model of some rows."""
        return self._replace(columns=self.columns[rows], kept=self.kept[rows])

    def slopes(self, x: Float[np.ndarray, "k"]) -> Float[np.ndarray, "D _"]:
        """Return the derivatives of ln(ratio) by ln(number) of those above zero."""
        return self.columns[:, x > 0] * x[x > 0] / self.of(x)[:, None]


class _Errors:
    """Errors of ln(ratio) for each share `OF_MODE`, along independent axes with variance 1 + s^2 size."""

    def __init__(self, ratios: Ratios):
        L = np.linalg.cholesky(ratios.covariance)
        inverse, one = np.linalg.inv(L), int(np.argmin(np.abs(SCATTERS - START_SCATTER)))
        shared = (ratios.shared(ratios, (i, one)) / SCATTERS[one] ** 2 for i in range(len(OF_MODE)))
        size, Q = np.linalg.eigh([inverse @ K @ inverse.T for K in shared])
        self.turn = np.swapaxes(Q, 1, 2) @ inverse
        self.variance = 1 + SCATTERS[:, None] ** 2 * np.maximum(size, 0.0)[:, None]
        self.volume = 2 * np.log(np.diag(L)).sum() + np.log(self.variance).sum(-1)

    def whitened(self, x: Float[np.ndarray, "D *n"], at: Place) -> Float[np.ndarray, "D *n"]:
        """Return independent numbers of variance 1."""
        return (self.turn[at[0]] @ x) / np.sqrt(self.variance[at]).reshape(-1, *(1,) * (x.ndim - 1))

    def log_likelihood(self, residuals: Float[np.ndarray, "D"]) -> Float[np.ndarray, "3 G"]:
        """Return ln(likelihood) at all shares and scatters, up to a constant."""
        squares = (self.turn @ residuals)[:, None] ** 2
        return -((squares / self.variance).sum(-1) + self.volume) / 2


class _Fitting(NamedTuple):
    """A law, its linear model and the rows to fit."""

    design: _Design
    ratios: Ratios
    errors: _Errors

    def least_squares(self, x: Float[np.ndarray, "k"], at: Place) -> Float[np.ndarray, "k"]:
        """Return the numbers >= 0 of least squares in ln(ratio), by Gauss-Newton from a point nearby."""
        off = self.residuals(x, at)
        for _ in range(STEPS):
            A = self.slopes(x, at)
            way = _nnls(A, off + A @ x) - x
            tried = (x + share * way for share in (1.0, 0.5, 0.25, 0.125))
            better = next((y for y in tried if (there := self.residuals(y, at)) @ there <= off @ off), None)
            if better is None:
                break
            before, x, off = off @ off, better, self.residuals(better, at)
            if before - off @ off <= SETTLED * (1 + before):
                break
        return x

    def residuals(self, x: Float[np.ndarray, "k"], at: Place) -> Float[np.ndarray, "_"]:
        """Return independent residuals of variance 1: measured less predicted, and those of the priors."""
        prior = np.log(np.maximum(x / self.design.centre, LEAST)) * self.design.narrow
        return np.concatenate([self.errors.whitened(self.ratios.log - np.log(self.design.of(x)), at), -prior])

    def slopes(self, x: Float[np.ndarray, "k"], at: Place) -> Float[np.ndarray, "_ k"]:
        """Return the derivatives of these residuals by the numbers, with the sign of the prediction."""
        design = self.design
        own = self.errors.whitened(design.columns / design.of(x)[:, None], at)
        return np.vstack([own, np.diag(design.narrow / np.maximum(x, LEAST * design.centre))])

    def law(self, groups: Groups) -> Law:
        """Fit the numbers, then share and scatter, in turn until these converge."""
        measured = np.exp(self.ratios.log)
        x = _nnls(self.design.columns / measured[:, None], np.maximum(1 - self.design.kept / measured, 0.0))
        x = np.where(self.design.narrow > 0, self.design.centre, x)
        at = len(OF_MODE) - 1, int(np.argmin(np.abs(SCATTERS - START_SCATTER)))
        for _ in range(STEPS):
            x = self.least_squares(x, at)
            likelihood = self.errors.log_likelihood(self.ratios.log - np.log(self.design.of(x)))
            before, at = at, _place(int(np.argmax(likelihood)))
            if at == before:
                break
        G = self.errors.turn @ self.design.slopes(x)
        seen = np.einsum("rik,rgi,ril->rgkl", G, 1 / self.errors.variance, G) + np.diag(self.design.narrow[x > 0] ** 2)
        posterior = likelihood - np.linalg.slogdet(seen)[1] / 2
        weights = np.exp(posterior - posterior.max()) * PRIOR
        bic = -2 * likelihood.max() + ((x > 0).sum() + 1) * math.log(len(measured))
        return Law(groups, x, float(SCATTERS[at[1]]), float(bic), weights / weights.sum())

    def numbers(
        self, x: Float[np.ndarray, "k"], at: Place, count: int, rng: np.random.Generator
    ) -> Float[np.ndarray, "k count"]:
        """Draw the numbers by least squares for data with new noise, from a point nearby.

        So they too are never negative (Bardsley, Fox, "An MCMC method for uncertainty quantification in nonnegativity
        constrained inverse problems", Inverse Probl. Sci. Eng. 20, 2012).
        """
        A = self.slopes(x, at)
        noise = rng.standard_normal((len(A), count))
        noise[len(self.ratios.log) :] *= self.design.narrow[:, None] > 0
        wanted = (self.residuals(x, at) + A @ x)[:, None] + noise
        numbers = np.linalg.pinv(A) @ wanted  # all at once if no number is negative
        for i in np.flatnonzero((numbers < 0).any(0)):
            numbers[:, i] = _nnls(A, wanted[:, i])
        return numbers

    def drawn(
        self, law: Law, like: tuple[_Design, Ratios], at: Place, count: int, rng: np.random.Generator
    ) -> Float[np.ndarray, "n count"]:
        """Draw ln(ratio) of some modes at a share and scatter.

        Args:
            law: its numbers are the starting point.
            like: its linear model for these modes, and the modes.
            at: share and scatter.
            count: number of draws.
            rng: source of randomness.
        """
        numbers = self.numbers(self.least_squares(law.values, at), at, count, rng)
        off = self.errors.whitened(self.ratios.log[:, None] - np.log(self.design.of(numbers)), at)
        gain = self.errors.whitened(self.ratios.shared(like[1], at), at)
        size, Q = np.linalg.eigh(like[1].shared(like[1], at) - gain.T @ gain)
        beside = Q @ (np.sqrt(np.maximum(size, 0.0))[:, None] * rng.standard_normal((len(size), count)))
        return np.log(like[0].of(numbers)) + gain.T @ off + beside


def _nnls(A: Float[np.ndarray, "n k"], b: Float[np.ndarray, "n"]) -> Float[np.ndarray, "k"]:
    from scipy.optimize import nnls  # takes 0.1 s to import, and fits without damping ratios do not need it

    return np.asarray(nnls(A, b)[0])


def _place(number: int) -> Place:
    """Return the indices of a weight from its flat index."""
    return divmod(number, len(SCATTERS))


# -------- Damping


@dataclass(frozen=True)
class Damping:
    """Damping given stiffness: the candidate laws, and their residuals.

    Attributes:
        rows: the damping rows.
        laws: best first; a sum of several only if it is better by `TOLD_APART` at least.
        ratios: (D,) the measured ones.
        columns: (D,) ratio of each row's mode per unit of each damping number.
        frequency: (D,) [Hz] of each row's mode on the fitted arm.
        marked: (D,) outliers under a law that fits the others; they do not count.
        arm: as in its file.
        model: the fitted arm.
        parameters: its fitted numbers.
        unknowns: of the fit.
    """

    rows: Campaign
    laws: tuple[Law, ...]
    ratios: Ratios
    columns: Mapping[str, Float[np.ndarray, "D"]]
    frequency: Float[np.ndarray, "D"]
    marked: Bool[np.ndarray, "D"]
    arm: Arm
    model: ArmModel
    parameters: Mapping[str, float]
    unknowns: Unknowns

    @property
    def best(self) -> Law:
        """The best law, which reports name."""
        return self.laws[0]

    @property
    def rivals(self) -> tuple[Law, ...]:
        """Laws of another kind that the data cannot separate from the best one."""
        near = (law for law in self.laws[1:] if law.bic - self.best.bic < TOLD_APART)
        return tuple(law for law in near if law.family != self.best.family and len(law.family) == 1)

    @property
    def predicted(self) -> Float[np.ndarray, "D"]:
        """The best law's ratios [-]."""
        return self._design(self.best.groups, self.columns).of(self.best.values)

    def left_out(self, parts: Iterable[Sequence[int]]) -> Float[np.ndarray, "n 3"]:
        """Return the ratios as measured, as predicted from the rows of other parts, and their distance.

        The law is the best one, with numbers fitted to the other parts without marked rows. The distance is in standard
        deviations.
        """
        design, found = self._design(self.best.groups, self.columns), [np.zeros((0, 3))]
        for part in parts:
            others = np.setdiff1d(np.flatnonzero(~self.marked), part)
            if len(others) < 2:
                continue
            _, mean, z = _by_others(self.best, design, self.ratios, part, others)
            found.append(np.array([np.exp(self.ratios.log[part]), np.exp(mean), z]).T)
        return np.concatenate(found)

    def numbers(self, law: Law) -> dict[str, float]:
        """Return all damping by path: a law's numbers, and the fixed ones."""
        return _kept(law.groups, self.arm, self.unknowns) | law.numbers

    @property
    def carried(self) -> dict[tuple[str, ...], float]:
        """The best law's numbers by their paths, and zero for all other damping; none if an arm file cannot hold it.

        That is the case for the loss factor of a nonlinear spring.
        """
        arm, best = self.arm, self.numbers(self.best)
        curved = {f"{spring.joint}.{LOSS_OF[spring.direction]}" for spring in arm.springs}
        if curved.intersection(best):
            return {}
        free = {path for group in self.best.groups for path in group}
        others = (path for path in arm.paths() if path in self.columns and path not in {*free, *best})
        numbers = zip(self.best.groups, self.best.values.tolist(), strict=True)
        return dict(numbers) | {(path,): 0.0 for path in others if float(arm.get(path))}

    def given(self, draws: Mapping[str, Float[np.ndarray, "n"]], seed: int = 0) -> dict[tuple[str, ...], np.ndarray]:
        """Draw the arm's damping numbers once for each draw of its stiffnesses.

        The unexplained scatter of a mode is a common factor of all of them, drawn again for each.

        Args:
            draws: numbers of the arm, by path.
            seed: of the draws.
        """
        if not self.carried:
            return {}
        rng, kept, law = np.random.default_rng(seed), np.flatnonzero(~self.marked), self.best
        count, data = len(next(iter(draws.values()))), self.ratios.some(kept)
        errors, drawn = _Errors(data), []

        def columns_of(some: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
            columns = ModesOfRows.of(self.model, some, self.rows, ()).columns()[1]
            return {path: np.broadcast_to(x, (len(x), CHUNK)) for path, x in columns.items()}

        columns = in_batches(columns_of, dict(draws), CHUNK)
        for i, at in enumerate(rng.choice(law.weights.size, count, p=law.weights.ravel()).tolist()):
            design = self._design(law.groups, {path: x[:, i] for path, x in columns.items()}).some(kept)
            place = _place(at)
            numbers = _Fitting(design, data, errors).numbers(law.values, place, 1, rng)[:, 0]
            drawn.append(numbers * np.exp(SCATTERS[place[1]] * rng.standard_normal()))
        by_group = dict(zip(law.groups, np.array(drawn).T, strict=True))
        return {group: by_group.get(group, np.full(count, x)) for group, x in self.carried.items()}

    def _design(self, groups: Groups, columns: Mapping[str, np.ndarray]) -> _Design:
        return _design(groups, columns, self.arm, self.unknowns)

    def drawn(self, like: Campaign, count: int = DRAWS, seed: int = 0) -> Float[np.ndarray, "n count"]:
        """Draw the ratios of some modes: a law by its probability, its numbers, and the modes' scatter.

        Args:
            like: damping rows that name modes and postures; their values do not count.
            count: number of draws.
            seed: of the draws.
        """
        rng, kept, drawn = np.random.default_rng(seed), np.flatnonzero(~self.marked), []
        mode, place = (x[len(self.rows) :] for x in _numbers([*self.rows, *like]))
        wanted = Ratios(np.zeros(len(mode)), np.eye(len(mode)), mode, place)
        modes = ModesOfRows.of(self.model, self.parameters, like, ())
        columns = _of_poles(modes, modes.columns()[1], self.best, (self.arm, self.unknowns))
        chance = np.exp([(min(law.bic for law in self.laws) - law.bic) / 2 for law in self.laws])
        data = self.ratios.some(kept)
        errors = _Errors(data)
        for law, n in zip(self.laws, rng.multinomial(count, chance / chance.sum()).tolist(), strict=True):
            own, there = (self._design(law.groups, each) for each in (self.columns, columns))
            fitting = _Fitting(own.some(kept), data, errors)
            often = rng.multinomial(n, law.weights.ravel()).reshape(law.weights.shape)
            for at in zip(*np.nonzero(often), strict=True):
                drawn.append(fitting.drawn(law, (there, wanted), (int(at[0]), int(at[1])), int(often[at]), rng))
        return np.exp(np.concatenate(drawn, 1))


def damping_of(
    arm: Arm,
    model: ArmModel,
    campaign: Campaign,
    predicted: Float[np.ndarray, "n"],
    parameters: Mapping[str, float],
    unknowns: Unknowns,
) -> Damping:
    """Find the law of damping of a fitted arm.

    Args:
        arm: as in its file.
        model: the fitted arm.
        campaign: all rows, damping ratios included.
        predicted: (n,) [SI] predictions of the fit for the others.
        parameters: fitted numbers of the arm.
        unknowns: damping numbers freed by name are fitted one by one, and all others are fixed; fixed ones stay fixed.
    """
    rows, rest = campaign.of_kind(RATIO), campaign.without(RATIO)
    off = [(m.value - x) / m.spread for m, x in zip(rest, predicted.tolist(), strict=True)]
    ratios, modes = ratios_of(campaign, np.nan_to_num(off)), ModesOfRows.of(model, parameters, rows, rest)
    hertz, columns = modes.columns()
    freed = damping_parameters(arm, unknowns)
    servos = any(m.drives == "servo" for m in rows)
    asked = [tuple(item.paths for item in freed)] if freed else _candidates(arm, servos)
    groups = [tuple(filter(None, (tuple(p for p in g if p not in unknowns.fixed) for g in each))) for each in asked]

    def laws(kept: Int[np.ndarray, "n"]) -> tuple[Law, ...]:
        """Fit all laws to some rows; of several laws with the same nonzero numbers the first counts."""
        data = ratios.some(kept)
        errors, found = _Errors(data), dict[frozenset[tuple[str, float]], Law]()
        for own in groups:
            if own and (len(own) == 1 or len(own) < len(kept) or freed):
                law = _Fitting(_design(own, columns, arm, unknowns).some(kept), data, errors).law(own)
                found.setdefault(frozenset((path, round(x, 12)) for path, x in law.numbers.items()), law)
        return tuple(sorted(found.values(), key=lambda law: law.bic + TOLD_APART * (len(law.family) > 1)))

    every = np.arange(len(rows))
    for _ in range(EXACTLY):
        best = laws(every)[0]
        columns = _of_poles(modes, columns, best, (arm, unknowns))
    best = laws(every)[0]
    marked = _marked(best, _design(best.groups, columns, arm, unknowns), ratios)
    return Damping(rows, laws(every[~marked]), ratios, columns, hertz, marked, arm, model, parameters, unknowns)


def _of_poles(
    modes: ModesOfRows, columns: Mapping[str, np.ndarray], law: Law, asked: tuple[Arm, Unknowns]
) -> dict[str, Float[np.ndarray, "D"]]:
    """Return the columns of lightly damped modes, scaled so that a law gives the ratios of corresponding poles."""
    change = modes.poles(_kept(law.groups, *asked) | law.numbers) / _design(law.groups, columns, *asked).of(law.values)
    change = np.where((change > 1 / COUPLED) & (change < COUPLED), change, 1.0)
    return {path: own * change for path, own in columns.items()}


def _kept(groups: Groups, arm: Arm, unknowns: Unknowns) -> dict[str, float]:
    """Return the arm's damping numbers that a law keeps: fixed ones, and if some are freed, all others."""
    free = {path for group in groups for path in group}
    kept = arm.paths() if damping_parameters(arm, unknowns) else unknowns.fixed
    return {path: float(arm.get(path)) for path in kept if is_damping(path) and path not in free}


def _design(groups: Groups, columns: Mapping[str, np.ndarray], arm: Arm, unknowns: Unknowns) -> _Design:
    """Return a law as a linear model; the kept numbers are the arm's."""
    freed = {item.paths: item for item in damping_parameters(arm, unknowns)}
    none = np.zeros(len(columns[ALPHA]))
    kept = sum((x * columns[path] for path, x in _kept(groups, arm, unknowns).items() if path in columns), none)
    each = np.array([sum((columns.get(path, none) for path in group), none) for group in groups]).T
    items = [freed.get(group) for group in groups]
    centre = np.array([1.0 if item is None else float(item.centre) for item in items])
    narrow = np.array([0.0 if item is None else 1 / float(np.hypot(item.prior_sd, item.flat)) for item in items])
    return _Design(each, kept, centre, narrow)


def _marked(law: Law, design: _Design, ratios: Ratios) -> Bool[np.ndarray, "D"]:
    """Return which rows are outliers: too far from their prediction by the others under the same law."""
    from scipy.special import stdtr  # likewise

    rows = np.arange(len(ratios.log))
    off = np.abs(ratios.log - np.log(design.of(law.values))) / np.sqrt(np.diag(ratios.covariance))
    marked = np.zeros(len(rows), bool)
    for row in np.argsort(-off)[:SUSPECTS].tolist() if len(rows) > 2 else ():
        others, _, z = _by_others(law, design, ratios, [row], np.setdiff1d(rows, row))
        freedom = max(len(rows) - 1 - int((others.values > 0).sum()), 1)
        marked[row] = 2 * stdtr(freedom, -abs(z[0])) < MARKED / len(rows)
    return marked


def _by_others(
    law: Law, design: _Design, ratios: Ratios, left: Sequence[int], rest: Int[np.ndarray, "r"]
) -> tuple[Law, Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """Return a law fitted to some rows, the predicted ln(ratio) of the rows left out, and their standardised residuals.

    The standard deviation is that of measurement and prediction together.
    """
    data, like = ratios.some(rest), ratios.some(left)
    fitting = _Fitting(design.some(rest), data, _Errors(data))
    others = fitting.law(law.groups)
    place = _place(int(np.argmax(others.weights)))
    drawn = fitting.drawn(others, (design.some(left), like), place, DRAWS, np.random.default_rng(0))
    mean = drawn.mean(1)
    return others, mean, (like.log - mean) / np.sqrt(drawn.var(1) + np.diag(like.covariance))
