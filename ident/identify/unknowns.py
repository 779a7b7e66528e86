"""The unknowns of an arm: joint stiffnesses and any other freed numbers, with their priors."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ident.arm.arm import Arm, stiffness_paths
from ident.arm.chain import Loads
from ident.arm.fields import ALPHA, DAMPING, LOSS, field_of
from ident.arm.parts import Body
from ident.errors import placed, refusal, require
from ident.inference.parameters import Parameter, Parameters
from ident.inference.priors import Prior
from ident.text import did_you_mean, quoted
from ident.units import width

V = TypeVar("V")

WEAK_PRIOR = 1.0
"""Default standard deviation of ln(stiffness) about the arm file's value: a factor of 7 each way covers 95 %."""
BASE_WIDER = 1.5
"""Width of a compliant base's prior, as a multiple of the others'; assumed. About ten times joint 1's stiffness, 95 %
then lie within 0.5 and 190 times it: from softer than the joint to invisible in any campaign."""
NARROWEST, WIDEST = 1e-6, 100.0
"""Allowed widths of priors, usually of ln(value): below a millionth the number is fixed, 43 decades are no prior."""
ELSEWHERE = 1000.0
"""Factor from the arm's value beyond which a prior probably has another unit, such as N m per arc minute (3438)."""
LENGTH_SCALE = 0.1
"""Unit [m] of theta for a coordinate without a prior, so that all unknowns are of order one."""


def parameter(
    arm: Arm, *paths: str, start: float | None = None, prior_sd: float = math.inf, prior: Prior | None = None
) -> Parameter:
    """Make one number of the arm, or several tied ones, an unknown.

    Args:
        arm: its value is the default of start and centre.
        paths: as in `Arm.get`; several are fitted as one number.
        start: of the fit.
        prior_sd: of ln(value) for positive quantities (`ident.arm.fields`), else of the value itself in its SI unit.
        prior: replaces the prior about the arm's value with width `prior_sd`, for a positive quantity.

    Raises:
        InputError: no such number, a positive quantity with a value <= 0, or a log prior for one of either sign.
    """
    value = next(float(arm.get(path)) for path in paths)
    positive = all((field := field_of(path)) and field.logarithmic for path in paths)
    flat, centre, start = 0.0, value, value if start is None else start
    if prior is not None:
        got = f"a prior on ln({paths[0]}), which may be negative"
        require(positive, "", got, "a number that is fitted as its logarithm", "free it (`free`) with a width")
        centre, prior_sd = math.sqrt(prior.low * prior.high), prior.sd
        flat = math.log(prior.high / prior.low) / 2
    if positive and not (start > 0 and centre > 0):
        remedy = f"give {paths[0]} a positive value in the arm file, or keep it (`fix`)"
        raise refusal("", f"{min(start, centre):g}", "a value > 0", remedy, paths[0])
    least = NARROWEST if positive else 0.0
    if not (least <= prior_sd <= WIDEST and prior_sd > 0) and prior_sd != math.inf:  # as good as fixed, or as none
        expected = f"a width from {least:g} to {WIDEST:g}" if positive else f"a width > 0, at most {WIDEST:g} in SI"
        remedy = "keep it (`fix`), or drop its prior" if prior_sd > 0 else "correct it"
        raise refusal("", f"a prior width of {prior_sd:g}", expected, remedy, paths[0])
    off = max(prior.low / start, start / prior.high) if prior is not None else 1.0
    if prior is not None and off > ELSEWHERE:  # wrong unit
        got = f"a prior from {prior.low:.4g} to {prior.high:.4g}, a factor of {off:.2g} from the arm's {start:.4g}"
        remedy = "check its unit, which is SI, or correct the arm file"
        raise refusal("", got, f"a factor of {ELSEWHERE:g} at most", remedy, paths[0])
    scale = 1.0 if positive else (prior_sd if math.isfinite(prior_sd) else LENGTH_SCALE)
    return Parameter(paths, positive, start, centre, prior_sd / scale, scale, flat)


@dataclass(frozen=True)
class Unknowns:
    """The unknown numbers of an arm, and their priors.

    The stiffnesses of all driven joints' bushings are unknown, and those of a compliant base (`Arm.base`).

    Attributes:
        fixed: paths to keep at the arm's value.
        tied: groups of paths fitted as one number each.
        free: further paths with the width of their priors (see `parameter`; `math.inf` for none).
        prior_sd: width of the log-normal priors of stiffness and damping about the arm's values; `math.inf` for none.
            A base has one `BASE_WIDER` times as wide.
        priors: priors of single parameters by path, in place of that one.
        discrepancy: by kind of measurement, the standard deviation of ln(factor) of the model's discrepancy.
        uncertain: standard deviation of each uncertain number, by path or `load`, as `5%` or `2mm`.
    """

    fixed: tuple[str, ...] = ()
    tied: tuple[tuple[str, ...], ...] = ()
    free: Mapping[str, float] = field(default_factory=dict)
    prior_sd: float = WEAK_PRIOR
    priors: Mapping[str, Prior] = field(default_factory=dict)
    discrepancy: Mapping[str, float] = field(default_factory=dict)
    uncertain: Mapping[str, str] = field(default_factory=dict)

    @property
    def with_prior(self) -> "Unknowns":
        """The same with a prior on stiffness, as one kind of data alone may not determine all directions."""
        return replace(self, prior_sd=min(self.prior_sd, WEAK_PRIOR))

    def named(self, arm: Arm) -> "Unknowns":
        """Return the same with patterns such as `*.k_bend` replaced by the names of an arm's numbers.

        An explicit name takes precedence over a pattern.

        Raises:
            InputError: a pattern that matches no number.
        """
        paths = arm.paths()
        return replace(
            self,
            fixed=_named(self.fixed, paths, "fix"),
            tied=tuple(_named(group, paths, "tie") for group in self.tied),
            free=_spread(self.free, paths, "free"),
            priors=_spread(self.priors, paths, "prior"),
            uncertain=_spread(self.uncertain, paths, "uncertain"),
        )


def _is_pattern(path: str) -> bool:
    return "*" in path or "?" in path


def _named(given: Sequence[str], paths: Sequence[str], option: str) -> tuple[str, ...]:
    """Return names, each pattern replaced by its matches that are not also given by name."""
    found: list[str] = []
    for name in given:
        found += [path for path in _fitting(name, paths, option) if path not in found and path not in given]
        found += [] if _is_pattern(name) else [name]
    return tuple(found)


def _spread(given: Mapping[str, V], paths: Sequence[str], option: str) -> dict[str, V]:
    """Return entries by name, each pattern replaced by the names that match it."""
    spread = {path: value for pattern, value in given.items() for path in _fitting(pattern, paths, option)}
    return spread | {name: value for name, value in given.items() if not _is_pattern(name)}


def _fitting(pattern: str, paths: Sequence[str], option: str) -> list[str]:
    if not _is_pattern(pattern):
        return []
    if not (fitting := [path for path in paths if fnmatchcase(path, pattern)]):
        remedy = did_you_mean(pattern, paths, "see `ident show ARM --names`")
        raise refusal(option, f"the pattern {quoted(pattern)}", "one that fits a number of the arm", remedy)
    return fitting


def stiffness_parameters(arm: Arm, unknowns: Unknowns | None = None) -> Parameters:
    """Return the parameters: bushing stiffnesses of all driven joints and of the base, and further unknowns.

    Args:
        arm: the arm.
        unknowns: further unknowns and priors.

    Raises:
        InputError: a path that the arm does not have, a path named twice, or nothing left to fit.
    """
    unknowns = (unknowns or Unknowns()).named(arm)
    prior_sd = unknowns.prior_sd
    sought = {joint.name: prior_sd for joint in arm.driven}
    sought |= {arm.base.name: BASE_WIDER * prior_sd} if arm.base else {}
    widths = {path: sought[name] for path in stiffness_paths(arm) if (name := path.split(".")[0]) in sought}
    widths |= unknowns.free
    fixed, groups = tuple(unknowns.fixed), [tuple(group) for group in unknowns.tied]
    taken = [*fixed, *(path for group in groups for path in group)]
    given = {"fix": fixed, "tie": taken[len(fixed) :], "free": unknowns.free, "uncertain": unknowns.uncertain}
    for option, paths in given.items():
        with placed(option):
            for path in {*paths} - {LOAD}:
                arm.get(path)
    for path in taken:
        if taken.count(path) > 1:
            raise refusal("fix" if path in fixed else "tie", f"{path} twice", "each parameter once", "name it once")
    for path in set(unknowns.free).intersection(fixed):
        raise refusal("free", f"{path} fixed and freed", "one of the two", "drop it from `fix` or from `free`")
    for group in groups:
        units = {path: field.unit for path in group if (field := field_of(path))}
        if len(set(units.values())) > 1:
            got = ", ".join(f"{path} [{unit}]" for path, unit in units.items())
            raise refusal("tie", f"a tie of {got}", "numbers of one unit", "tie only what can be equal")
    if unknowns.uncertain and unknowns.discrepancy:
        raise refusal("uncertain", "uncertain numbers beside a discrepancy", "one of both", "drop it, or `discrepancy`")
    for path in {*widths, *taken}.intersection(unknowns.uncertain):
        remedy = "drop it from `uncertain`, or from `free`, `fix` and `tie`"
        raise refusal("uncertain", f"{path} uncertain and an unknown, fixed or tied", "one of them", remedy)
    group_of = {path: group for group in groups for path in group}
    unknown = dict.fromkeys(group_of.get(path, (path,)) for path in widths if path not in fixed)
    for group in groups:
        require(group in unknown, "tie", "=".join(group), "at least one unknown among them", "free one of them too")
    require(unknown, "fix", "no unknown", "at least one", "fix fewer parameters")
    for path in unknowns.priors:
        if not any(path in group for group in unknown):
            known = [path for group in unknown for path in group]
            remedy = did_you_mean(path, known, "free it, or drop its prior")
            raise refusal("prior", f"a prior for {path}, which is not fitted", "an unknown", remedy)
    return Parameters(tuple(_tied(arm, group, widths, unknowns) for group in unknown))


def _tied(arm: Arm, group: tuple[str, ...], widths: Mapping[str, float], unknowns: Unknowns) -> Parameter:
    """Return the unknown of a group of tied paths, with the first width and the first prior given for any of them."""
    width = next((widths[path] for path in group if path in widths), unknowns.prior_sd)
    prior = next((unknowns.priors[path] for path in group if path in unknowns.priors), None)
    return parameter(arm, *group, prior_sd=width, prior=prior)


def is_damping(path: str) -> bool:
    """Whether a path is a damping number: a time or a loss factor, of a bushing or a servo, or alpha."""
    return path.rpartition(".")[2] in (*DAMPING, *LOSS, "tau") or path == ALPHA


def without_damping(unknowns: Unknowns) -> Unknowns:
    """Return the unknowns without damping, for campaigns with damping ratios: these determine the damping."""
    return replace(
        unknowns,
        fixed=tuple(path for path in unknowns.fixed if not is_damping(path)),
        tied=tuple(group for group in unknowns.tied if not all(map(is_damping, group))),
        free={path: width for path, width in unknowns.free.items() if not is_damping(path)},
        priors={path: prior for path, prior in unknowns.priors.items() if not is_damping(path)},
    )


def damping_parameters(arm: Arm, unknowns: Unknowns) -> tuple[Parameter, ...]:
    """Return the damping numbers that are freed, tied or have a prior by name, each with its own prior.

    Raises:
        InputError: a number that the arm does not have, or an invalid prior.
    """
    ties = [group for group in unknowns.tied if all(map(is_damping, group))]
    group_of = {path: group for group in ties for path in group}
    named = [path for path in (*unknowns.free, *unknowns.priors, *group_of) if is_damping(path)]
    groups = dict.fromkeys(group_of.get(path, (path,)) for path in named)
    return tuple(_tied(arm, group, unknowns.free, unknowns) for group in groups)


# -------- Readings
# Unknowns of the readings (frames, hysteresis widths), recognised by their names.

SETUP = "setup:"
"""Prefix of the names of a measurement frame's numbers; the frame's name and `.x` to `.z` or `.turn.x` to `.turn.z`
follow."""
LOOP = "loop:"
"""Prefix of the names of hysteresis widths; a number from 1 and the kind of its rows follow."""


def is_of_loop(name: str) -> bool:
    """Whether a parameter is the width of a hysteresis loop."""
    return name.startswith(LOOP)


def is_of_readings(name: str) -> bool:
    """Whether a parameter belongs to the readings: position of a frame, or width of a hysteresis loop."""
    return name.startswith((SETUP, LOOP))


# -------- Uncertain
# Uncertain numbers of an arm, and a common scale of its loads: nuisances with a Gaussian prior.

LOAD = "load"
"""Name of the common scale of all measured load cases: that of a load cell."""
NUISANCE_NARROWEST, NUISANCE_WIDEST = 1e-6, 1.0
"""Allowed relative widths: a number uncertain by more than its own size is not a nuisance."""


def scaled_bodies(arm: Arm, paths: Iterable[str]) -> tuple[str, ...]:
    """Return the bodies with uncertain mass: their inertia scales with it."""
    names = {part.name for part in arm.parts() if isinstance(part, Body)}
    return tuple(name for path in paths if path.endswith(".mass") and (name := path.removesuffix(".mass")) in names)


def scaled_inertia(arm: Arm, parameters: Mapping[str, Any], bodies: tuple[str, ...]) -> Arm:
    """Return an arm with the inertia of some bodies scaled in proportion to their new mass."""

    def body(node: Any) -> Any:
        if not isinstance(node, Body) or node.name not in bodies:
            return node
        factor = jnp.asarray(parameters[f"{node.name}.mass"]) / node.mass
        inertia = jnp.reshape(node.inertia, node.inertia.shape + (1,) * factor.ndim) * factor
        return eqx.tree_at(lambda b: b.inertia, node, inertia)

    return jax.tree.map(body, arm, is_leaf=lambda node: isinstance(node, Body)) if bodies else arm


def uncertain_parameter(arm: Arm, path: str, text: str) -> Parameter:
    """Return the nuisance of an uncertain number, its prior centred at the arm's value.

    Args:
        arm: with the value.
        path: of the number, or `load`.
        text: its standard deviation, as `5%` of the value or as `2mm`.

    Raises:
        InputError: no such number, a width in a wrong unit, or one that is not small.
    """
    value = 1.0 if path == LOAD else float(arm.get(path))
    field = None if path == LOAD else field_of(path)
    positive, said = path == LOAD or bool(field and field.logarithmic), f"{path}:{text}"
    unit = field.unit if field and field.unit != "-" else ""
    found = width(text, unit)
    if found is None:
        expected = f"a width > 0, as a share (5%){f' or in a unit such as {unit}' if unit else ''}"
        raise refusal("uncertain", said, expected, "correct it")
    if value == 0 and (found.share or positive):
        raise refusal("uncertain", f"{said} of a value of zero", "a value", "give it one")
    sd = found.size * abs(value) if found.share else found.size
    if positive and not NUISANCE_NARROWEST <= sd / abs(value) <= NUISANCE_WIDEST:
        expected = f"a width from {NUISANCE_NARROWEST:.0e} to {NUISANCE_WIDEST:g} of its value"
        raise refusal("uncertain", said, expected, "free it (`free`), or drop it")
    if positive and value > 0:
        return Parameter((path,), True, value, value, sd / value, nuisance=True)
    return Parameter((path,), False, value, value, 1.0, sd, nuisance=True)


def with_numbers(arm: Arm, loads: Loads, parameters: Mapping[str, Any], bodies: tuple[str, ...]) -> tuple[Arm, Loads]:
    """Return an arm and its load cases with these numbers, the inertia of some bodies scaled with their mass.

    Args:
        arm: the arm.
        loads: batch `(S, *ones)`.
        parameters: `()` or `(*batch)` each, by path, and `load`.
        bodies: whose inertia scales with their mass.
    """
    own = {path: x for path, x in parameters.items() if path != LOAD}
    loads = scaled_loads(loads, parameters[LOAD]) if LOAD in parameters else loads
    return scaled_inertia(arm, parameters, bodies).replace(own), loads


def scaled_loads(loads: Loads, scale: Any) -> Loads:
    """Return load cases with all masses, forces and moments scaled by one factor; payloads belong to the arm.

    Args:
        loads: batch `(S, *ones)`.
        scale: `()` or `(*batch)`.
    """
    moment = None if loads.moment is None else loads.moment * scale
    return Loads(loads.payload, loads.mass * scale, loads.force * scale, moment)


def is_loaded(loads: Loads) -> bool:
    """Whether any load case has a mass, a force or a moment in addition to payloads."""
    return any(np.any(part) for part in (loads.mass, loads.force, loads.moment) if part is not None)
