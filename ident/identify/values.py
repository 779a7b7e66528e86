"""Numbers that an arm takes over from a fit or from a posterior."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm
from ident.arm.base import BASE
from ident.arm.fields import EXPECTED, field_of
from ident.errors import InputError, Problem
from ident.identify.fit import CampaignFit
from ident.identify.predict import ArmModel
from ident.inference.problem import InverseProblem

if TYPE_CHECKING:
    from ident.inference.sample import Sample

BEST_ONLY = "draws about the best optimum only; the others are left out"
VANISHING, FARTHEST = 1e6, 1e12
"""Factors by which a fitted number may be less, and more, than the arm file's: what data leave open may become large,
but with a millionth of its stiffness no arm stands."""
OTHER_ARM = "fitted to another arm file, or to this one before it was changed"


@dataclass(frozen=True)
class Values:
    """Numbers of an arm, as a fit or a posterior has them.

    Attributes:
        path: the file that they are from; empty for a result of this process.
        sha256: hash of its bytes.
        values: by path in the arm, () or (draws,) [SI]; tied numbers each by its own path.
        left_out: names in the result that are no numbers of the arm.
        remark: what else a reader must know; mostly empty.
    """

    path: str
    sha256: str
    values: Mapping[str, Float[np.ndarray, "*draws"]]
    left_out: tuple[str, ...] = ()
    remark: str = ""

    @classmethod
    def of_fit(cls, fit: CampaignFit, arm: Arm) -> "Values":
        """Return the fitted numbers of an arm, with what speaks against the fit.

        Raises:
            InputError: the fit has no number of this arm.
        """
        items = fit.problem.parameters.items
        best = {item.paths: np.asarray(value) for item, value in zip(items, fit.best.values, strict=True)}
        return cls.of_arm(best, arm, remark=doubtful(fit.doubts), scaled=scaled_by(fit.problem))

    @classmethod
    def of_arm(
        cls,
        by_paths: Mapping[tuple[str, ...], Any],
        arm: Arm,
        path: str = "",
        sha256: str = "",
        remark: str = "",
        scaled: Sequence[str] = (),
    ) -> "Values":
        """Return those of some numbers that an arm has; each may stand for several paths, where tied.

        The inertia of bodies in `scaled` goes with their mass.

        Raises:
            InputError: there are none, some are not finite, or the arm has not the base that was fitted.
        """
        own = set(arm.paths())
        values = {name: np.asarray(value) for names, value in by_paths.items() for name in names if name in own}
        for body in scaled:
            values |= _inertia(arm, body, values)
        left_out = tuple(name for names in by_paths for name in names if name not in own)
        if not values:
            got = f"only {', '.join(left_out[:3])}" if left_out else "no variable"
            raise InputError(Problem(path, got, f"numbers of {arm.name}", "give the result of a fit of this arm"))
        if based := [name for name in left_out if name.startswith(f"{BASE}.")]:
            remedy = "give `soft_base` as it was given there"
            raise InputError(Problem(path, based[0], f"{arm.name} on such a base", remedy))
        if problems := [problem for name, value in values.items() for problem in _impossible(path, name, value, arm)]:
            raise InputError(problems)
        return cls(path, sha256, values, left_out, remark)

    @property
    def medians(self) -> dict[str, float]:
        """The median of each number's draws, or the number itself."""
        return {path: float(np.median(values)) for path, values in self.values.items()}

    def remarked(self, remark: str) -> "Values":
        """Return the same with a further remark."""
        return replace(self, remark="; ".join(filter(None, (self.remark, remark))))

    def outside(self, draws: "Values") -> tuple[str, ...]:
        """Return the numbers that lie outside all draws of another."""
        both = [path for path in self.values if path in draws.values]
        return tuple(p for p in both if not draws.values[p].min() <= self.medians[p] <= draws.values[p].max())

    def shuffled(self, seed: int) -> "Values":
        """Return the same draws in random order, so that any part of them is as good as any other."""
        order = np.random.default_rng(seed).permutation(len(next(iter(self.values.values()))))
        return replace(self, values={path: values[order] for path, values in self.values.items()})

    def without(self, paths: Mapping[str, Any]) -> dict[str, np.ndarray]:
        """Return the values of all numbers but those at some paths."""
        return {path: values for path, values in self.values.items() if path not in paths}


def _impossible(path: str, name: str, value: np.ndarray, arm: Arm) -> Iterator[Problem]:
    """Yield why numbers can't be this number of an arm: the worst of them, by the sign, or by its size."""
    field, own, remedy = field_of(name), float(arm.get(name)), "run the fit or sample again"
    if not value.size:
        yield Problem(path, "no draw", "draws", remedy, name)
    elif field and not (allowed := field.allows(value)).all():
        got = "a value that is not finite" if not np.isfinite(value).all() else f"{value[~allowed].flat[0]:g}"
        yield Problem(path, got, EXPECTED[field.sign], remedy, name)
    elif field and field.has_factor(own):
        middle = float(np.median(value))
        if not 1 / VANISHING <= abs(middle / own) <= FARTHEST:
            expected = f"a value of the order of {own:.4g}, as the arm file has it"
            yield Problem(path, f"{middle:.4g} {field.unit}", expected, remedy, name)


def _inertia(arm: Arm, body: str, values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return a body's inertia in proportion to its mass, by path; nothing where there is no mass of it."""
    mass = values.get(f"{body}.mass")
    if mass is None:
        return {}
    own = {path: float(arm.get(path)) for path in arm.paths() if path.startswith(f"{body}.inertia.")}
    return {path: value * mass / float(arm.get(f"{body}.mass")) for path, value in own.items() if value}


def scaled_by(problem: InverseProblem) -> tuple[str, ...]:
    """Return the bodies whose inertia goes with their mass in a problem."""
    model = problem.model
    return model.scaled if isinstance(model, ArmModel) else ()


def doubtful(doubts: Sequence[str]) -> str:
    """Say that a fit is in doubt; nothing if it is not."""
    reasons = "; ".join(doubt.removesuffix(" (see below)") for doubt in doubts)
    return f"the fit is in doubt: {reasons}" if reasons else ""


@dataclass(frozen=True)
class Draws:
    """All draws of a posterior about its best optimum, burn-in left out.

    Attributes:
        by_paths: (n,) [SI] of each unknown, by the paths of the numbers that it stands for; chain after chain.
        path: the file that they are from; empty for a result of this process.
        sha256: hash of its bytes.
        remark: what else a reader must know; mostly empty.
        arm_sha256: hash of the file of the arm that was fitted; empty where it is not known.
        scaled: bodies whose inertia goes with their mass.
    """

    by_paths: Mapping[tuple[str, ...], Float[np.ndarray, "n"]]
    path: str = ""
    sha256: str = ""
    remark: str = ""
    arm_sha256: str = ""
    scaled: tuple[str, ...] = ()

    @classmethod
    def of_sample(cls, sample: "Sample") -> "Draws":
        """Return the draws of a posterior that was sampled in this process."""
        from ident.inference.posterior_summary import chains

        by_chain, items = chains(sample), sample.posterior.parameters.items
        best = by_chain.optimum == by_chain.optimum.min()
        by_paths = {item.paths: own[best].ravel() for item, own in zip(items, by_chain.values, strict=True)}
        scaled = scaled_by(sample.posterior.problem)
        return cls(by_paths, remark="" if best.all() else BEST_ONLY, scaled=scaled)

    def of(self, sha256: str) -> "Draws":
        """Return the same for an arm whose file has this hash, with a remark where another one was fitted."""
        if not (sha256 and self.arm_sha256 and sha256 != self.arm_sha256):
            return self
        return replace(self, remark="; ".join(filter(None, (self.remark, OTHER_ARM))))

    @property
    def total(self) -> int:
        """How many there are."""
        return min((len(values) for values in self.by_paths.values()), default=0)

    def some(self, arm: Arm, count: int, seed: int | None = None) -> Values:
        """Return draws of an arm's numbers.

        Args:
            arm: whose numbers are looked for.
            count: draws, at most; all if there are fewer.
            seed: of a choice at random, none drawn twice; without one the draws are spread evenly over the chains.

        Raises:
            InputError: there is no number of this arm.
        """
        return self._at(_choice(self.total, min(count, self.total), seed), arm)

    def two_groups(self, arm: Arm, count: int, fresh: int, seed: int = 0) -> tuple[Values, Values | None]:
        """Return draws that are spread evenly over the chains, and others, chosen at random of those that are left.

        What was fitted to the first can be tested with the others.

        Args:
            arm: whose numbers are looked for.
            count: draws of the first group, at most; all if there are fewer.
            fresh: draws of the second, at most; all that are left if these are fewer, None if there are none.
            seed: of the choice.

        Raises:
            InputError: there is no number of this arm.
        """
        first = _choice(self.total, min(count, self.total), None)
        left = np.setdiff1d(np.arange(self.total), first)
        second = left[_choice(len(left), min(fresh, len(left)), seed)]
        return self._at(first, arm), self._at(second, arm) if len(second) else None

    def _at(self, chosen: np.ndarray, arm: Arm) -> Values:
        drawn = {paths: values[chosen] for paths, values in self.by_paths.items()}
        return Values.of_arm(drawn, arm, self.path, self.sha256, self.remark, self.scaled)


def _choice(total: int, count: int, seed: int | None) -> np.ndarray:
    if seed is not None:
        return np.sort(np.random.default_rng(seed).choice(total, count, replace=False))
    return np.floor((np.arange(count) + 0.5) * total / max(count, 1)).astype(int)
