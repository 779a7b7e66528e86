"""Numbers that an arm adopts from a fit or from a posterior."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from ident.arm.arm import BASE, Arm, loss_paths
from ident.arm.fields import ALPHA, COMPONENTS, EXPECTED, STIFFNESS, field_of, fields_in
from ident.arm.parts import Joint
from ident.errors import Problem, refusal, refuse, require
from ident.text import one_line

if TYPE_CHECKING:
    from ident.identify.fit import CampaignFit
    from ident.identify.sample import CampaignSample
    from ident.inference.problem import InverseProblem

BEST_ONLY = "draws about the best optimum only; the others are left out"
VANISHING, FARTHEST = 1e6, 1e12
"""Largest factors of a fitted number below, and above, the arm file's: an undetermined stiffness may become large, but
with a millionth of its stiffness no arm is stable."""
OTHER_LAW = "damping is the arm file's: the law that was measured has no place there"
OTHER_ARM = "fitted to another arm file, or to this one before it was changed"
SAME_NUMBER = 1e-6
"""Difference, relative to the largest component, attributed to rounding in a file."""
NO_NUMBER = 1e-9
"""Difference of two numbers [SI] treated as equal."""
MOST_DIFFERENCES = 3
"""Most differences between two arms named in a message."""


@dataclass(frozen=True)
class Values:
    """Numbers of an arm from a fit or a posterior.

    Attributes:
        path: their file; empty for a result of this process.
        sha256: hash of its bytes.
        values: by path in the arm, () or (draws,) [SI]; tied numbers each by its own path.
        left_out: names in the result that are not numbers of the arm.
        remark: for the reader; mostly empty.
    """

    path: str
    sha256: str
    values: Mapping[str, Float[np.ndarray, "*draws"]]
    left_out: tuple[str, ...] = ()
    remark: str = ""

    @classmethod
    def of_fit(cls, fit: "CampaignFit", arm: Arm) -> "Values":
        """Return the fitted numbers of an arm, with the objections to the fit.

        Raises:
            InputError: the fit has no number of this arm.
        """
        items = fit.problem.parameters.items
        best = {item.paths: np.asarray(value) for item, value in zip(items, fit.best.values, strict=True)}
        carried = fit.damping.carried if fit.damping else {}
        best |= {paths: np.asarray(value) for paths, value in carried.items()}
        remark = remark_on(fit.doubts, bool(carried) or not fit.damping)
        return cls.of_arm(best, arm, remark=remark, scaled=scaled_by(fit.problem))

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
        """Return the numbers that exist in an arm; each may have several tied paths.

        The inertia of bodies in `scaled` scales with their mass.

        Raises:
            InputError: there are none, some are not finite, or the arm does not have the fitted base.
        """
        own = {*arm.paths(), *loss_paths(arm), ALPHA}
        values = {name: np.asarray(value) for names, value in by_paths.items() for name in names if name in own}
        for body in scaled:
            values |= _inertia(arm, body, values)
        left_out = tuple(name for names in by_paths for name in names if name not in own)
        got = f"only {', '.join(left_out[:3])}" if left_out else "no variable"
        require(values, path, got, f"numbers of {arm.name}", "give the result of a fit of this arm")
        if based := [name for name in left_out if name.startswith(f"{BASE}.")]:
            raise refusal(path, based[0], f"{arm.name} on such a base", "give `soft_base` as it was given there")
        refuse(problem for name, value in values.items() for problem in _impossible(path, name, value, arm))
        return cls(path, sha256, values, left_out, remark)

    @property
    def medians(self) -> dict[str, float]:
        """The median of each number's draws, or the number itself."""
        return {path: float(np.median(values)) for path, values in self.values.items()}

    def remarked(self, remark: str) -> "Values":
        """Return the same with a further remark."""
        return replace(self, remark="; ".join(filter(None, (self.remark, remark))))

    def outside(self, draws: "Values") -> tuple[str, ...]:
        """Return the names of numbers that lie outside all draws of another."""
        both = [path for path in self.values if path in draws.values]
        return tuple(p for p in both if not draws.values[p].min() <= self.medians[p] <= draws.values[p].max())

    def shuffled(self, seed: int) -> "Values":
        """Return the same draws in random order, so that any part of them is as good as any other."""
        order = np.random.default_rng(seed).permutation(len(next(iter(self.values.values()))))
        return replace(self, values={path: values[order] for path, values in self.values.items()})

    def without(self, paths: Mapping[str, Any]) -> dict[str, np.ndarray]:
        """Return the values of all numbers but those at some paths."""
        return {path: values for path, values in self.values.items() if path not in paths}


@dataclass(frozen=True)
class Robot:
    """Identity of the robot with which stiffnesses were identified: they do not apply to another robot.

    Points, payloads, drives, belts, stroke, workspace, limits and the name do not belong to the identity.

    Attributes:
        name: of the arm; empty if a file does not name the arm of its values.
        joints: their names, from the base outwards.
        driven: the names of those with a pin.
        numbers: by path [SI], whole vectors and tensors: axes, offsets and stiffnesses of the joints, masses, mass
            centres and inertias of the links, curved springs.
        sha256: hash of the arm's file; empty where it has none.
    """

    name: str = ""
    joints: tuple[str, ...] = ()
    driven: tuple[str, ...] = ()
    numbers: Mapping[str, Any] = field(default_factory=dict)
    sha256: str = ""

    @classmethod
    def of(cls, arm: Arm, sha256: str = "") -> "Robot":
        """Return the identity of an arm."""
        parts: list[Any] = [part for joint in arm.joints for part in (joint, *joint.shaft, *joint.link)]
        numbers: dict[str, Any] = {f"{joint.name}.axis": np.asarray(joint.axis).tolist() for joint in arm.joints}
        for part in (*parts, *arm.springs):
            names = [number.name for number in fields_in(part)]
            own = [name for name in names if name in ("offset", *STIFFNESS)] if isinstance(part, Joint) else names
            numbers |= {f"{part.name}.{name}": np.asarray(getattr(part, name)).tolist() for name in own}
        joints, driven = (tuple(joint.name for joint in some) for some in (arm.joints, arm.driven))
        return cls(arm.name, joints, driven, numbers, sha256)

    @classmethod
    def read(cls, document: Any, sha256: str) -> "Robot":
        """Read the arm's identity from a result file; files of earlier versions have none.

        Raises:
            ValueError, TypeError, KeyError: the document has another format.
        """
        if document is None:
            return cls(sha256=sha256)
        arrays = {str(path): np.asarray(value, float) for path, value in dict(document["numbers"]).items()}
        if not all(each.shape in ((), (3,), (3, 3)) and np.isfinite(each).all() for each in arrays.values()):
            raise ValueError("numbers of no robot")
        numbers = {path: each.tolist() for path, each in arrays.items()}
        joints, driven = (tuple(map(str, document[name])) for name in ("joints", "driven"))
        return cls(str(document["name"]), joints, driven, numbers, sha256)

    @property
    def document(self) -> dict[str, Any]:
        """The robot in the format of result files."""
        return {name: value for name, value in asdict(self).items() if name != "sha256"}

    def at(self, path: str) -> float | None:
        """Return the number [SI] at a path as `link2.com.x`; None where it has none."""
        quantity, _, component = path.rpartition(".")
        value = self.numbers.get(path, self.numbers.get(quantity))
        if value is None or isinstance(value, float):
            return value
        return float(np.asarray(value)[COMPONENTS[component]]) if component in COMPONENTS else None

    def differences(self, other: "Robot", but: Collection[str] = ()) -> dict[str, str]:
        """Return the quantities in which another robot differs, each in words: `link2.mass (3 kg there, 5 kg here)`.

        Args:
            other: the robot here.
            but: numbers by path that may differ, such as `link2.com.x`.
        """
        found = {}
        for word, one, two in (("joints", self.joints, other.joints), ("driven joints", self.driven, other.driven)):
            if one != two:
                found[word] = f"{word} ({', '.join(one)} there, {', '.join(two)} here)"
                break
        for path in dict.fromkeys((*self.numbers, *other.numbers)):
            there, here = self.numbers.get(path), other.numbers.get(path)
            if there is None or here is None:
                found[path] = f"{path} (only {'here' if there is None else 'there'})"
            elif self._differs(path, there, here, other, but):
                unit = getattr(field_of(path), "unit", "-")
                texts = [f"{_written(value)} {unit}".removesuffix(" -") for value in (there, here)]
                found[path] = f"{path} ({texts[0]} there, {texts[1]} here)" if texts[0] != texts[1] else path
        return found

    def _differs(self, path: str, there: Any, here: Any, other: "Robot", but: Collection[str]) -> bool:
        """Whether a quantity differs in a component that must be equal."""
        one, two = np.asarray(there, float), np.asarray(here, float)
        if one.shape != two.shape:
            return True
        mass = f"{path.removesuffix('.inertia')}.mass"
        if mass in but and mass in self.numbers and other.numbers.get(mass):  # a shape's inertia scales with the mass
            scaled = two * (self.numbers[mass] / other.numbers[mass])
            two = scaled if np.allclose(scaled, one, SAME_NUMBER, NO_NUMBER) else two
        places = {f"{path}.{end}": place for end, place in COMPONENTS.items() if len(place) == one.ndim}
        size = max(float(np.abs(one).max()), float(np.abs(two).max()))
        differs = np.asarray(np.abs(one - two) > SAME_NUMBER * size + NO_NUMBER)
        for free in but:
            if free in (path, *places):
                differs[places.get(free, ...)] = False
        return bool(differs.any())


def _written(value: Any) -> str:
    numbers = np.atleast_1d(np.asarray(value, float))
    if numbers.ndim == 2:
        numbers = numbers[np.triu_indices(3)] if np.triu(numbers, 1).any() else np.diag(numbers)
    texts = [f"{number + 0.0:.6g}" for number in numbers]
    return texts[0] if len(texts) == 1 else f"({', '.join(texts)})"


def of_this_robot(
    values: Values,
    robot: Robot,
    own: Robot,
    *,
    changed: Collection[str] = (),
    designed: Collection[str] = (),
    force: bool = False,
) -> Values:
    """Return values that an arm may adopt, with a remark if their robot differs.

    Args:
        values: of the result.
        robot: with which they were identified.
        own: the arm that adopts them.
        changed: further numbers set by the user, by path.
        designed: numbers changed by `ident design`, by path; they may differ.
        force: also accept the values of another robot.

    Raises:
        InputError: the values belong to another robot, or would undo a design change.
    """
    other_file = bool(own.sha256 and robot.sha256 and own.sha256 != robot.sha256)
    if not robot.joints:
        return values.remarked(OTHER_ARM) if other_file else values
    but = {*values.values, *changed}
    apart, insist = robot.differences(own, but), "or insist (`force`)"
    # all numbers of a redesigned body may differ: its inertia follows from mass and shape
    bodies = {part for part in (path.partition(".")[0] for path in designed) if f"{part}.mass" in own.numbers}
    beyond = robot.differences(own, {*but, *designed, *(p for p in own.numbers if p.partition(".")[0] in bodies)})
    undone = [path for path in designed if path in values.values and path not in changed]
    undone = [p for p in undone if not any(_same(own.at(p), other) for other in (robot.at(p), values.medians[p]))]
    got = remedy = ""
    if beyond:
        got = f"the values of another robot, {one_line(robot.name)}: {_few(list(beyond.values()))}"
        remedy = f"identify this arm, {insist}"
    elif undone:
        got = f"other values of what ident design has changed: {_few(undone)}"
        remedy = f"leave it out, set the designed values, too (`set`), {insist}"
    if got and not force:
        expected = f"those of {one_line(own.name)} as it is described now"
        raise refusal(one_line(values.path) or "result", got, expected, remedy)
    if apart and not beyond:
        values = values.remarked(f"identified before ident design changed {_few(list(apart))}")
    elif other_file and not got:
        values = values.remarked(OTHER_ARM)
    return values.remarked(got) if got else values


def _same(one: float | None, other: float | None) -> bool:
    if one is None or other is None:
        return one is other
    return abs(one - other) <= SAME_NUMBER * abs(one) + NO_NUMBER


def _few(texts: Sequence[str]) -> str:
    more = f"; {len(texts) - MOST_DIFFERENCES} more" if len(texts) > MOST_DIFFERENCES else ""
    return "; ".join(texts[:MOST_DIFFERENCES]) + more


def _impossible(path: str, name: str, value: np.ndarray, arm: Arm) -> Iterator[Problem]:
    """Yield why values are impossible for this number of an arm: the worst of them, by its sign or its size."""
    field, own, remedy = field_of(name), float(arm.get(name)), "run the fit or sample again"
    if not value.size:
        yield Problem(path, "no draw", "draws", remedy, name)
    elif field and not (allowed := field.allows(value)).all():
        got = "a value that is not finite" if not np.isfinite(value).all() else f"{value[~allowed].flat[0]:g}"
        yield Problem(path, got, EXPECTED[field.sign], remedy, name)
    elif field and field.has_factor(own):
        middle = float(np.median(value))
        if middle and not 1 / VANISHING <= abs(middle / own) <= FARTHEST:
            expected = f"a value of the order of {own:.4g}, as the arm file has it"
            yield Problem(path, f"{middle:.4g} {field.unit}", expected, remedy, name)


def _inertia(arm: Arm, body: str, values: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return a body's inertia in proportion to its mass, by path; nothing without a mass."""
    mass = values.get(f"{body}.mass")
    if mass is None:
        return {}
    own = {path: float(arm.get(path)) for path in arm.paths() if path.startswith(f"{body}.inertia.")}
    return {path: value * mass / float(arm.get(f"{body}.mass")) for path, value in own.items() if value}


def scaled_by(problem: "InverseProblem") -> tuple[str, ...]:
    """Return the bodies whose inertia scales with their mass in a problem; none with discrepancies."""
    return tuple(getattr(problem.model, "scaled", ()))


def remark_on(doubts: Sequence[str], damping: bool = True) -> str:
    """Write that a fit has objections, or that an arm file cannot hold its damping law; empty otherwise."""
    doubt = f"the fit is in doubt: {'; '.join(doubts)}" if doubts else ""
    return "; ".join(filter(None, (doubt, "" if damping else OTHER_LAW)))


@dataclass(frozen=True)
class Draws:
    """All draws of a posterior about its best optimum, without burn-in.

    Attributes:
        by_paths: (n,) [SI] of each unknown, by the paths of its numbers; chain after chain.
        path: their file; empty for a result of this process.
        sha256: hash of its bytes.
        remark: for the reader; mostly empty.
        scaled: bodies whose inertia scales with their mass.
        robot: with which they were identified.
    """

    by_paths: Mapping[tuple[str, ...], Float[np.ndarray, "n"]]
    path: str = ""
    sha256: str = ""
    remark: str = ""
    scaled: tuple[str, ...] = ()
    robot: Robot = Robot()

    @classmethod
    def of_sample(cls, sampled: "CampaignSample", arm: Arm | None = None, sha256: str = "") -> "Draws":
        """Return the draws of a posterior sampled in this process, with an arm if robots are to be compared."""
        sample = sampled.sample
        by_chain, items = sample.by_chain(), sample.posterior.parameters.items
        best = by_chain.optimum == by_chain.optimum.min()
        by_paths = {item.paths: own[best].ravel() for item, own in zip(items, by_chain.values, strict=True)}
        by_paths |= {paths: own[best].ravel() for paths, own in sampled.damping.items()}
        scaled = scaled_by(sample.posterior.problem)
        robot = Robot() if arm is None else Robot.of(arm, sha256)
        return cls(by_paths, remark="" if best.all() else BEST_ONLY, scaled=scaled, robot=robot)

    def doubted(self, doubts: Sequence[str]) -> "Draws":
        """Return the same with a remark on the objections to their starting fit."""
        return replace(self, remark="; ".join(filter(None, (remark_on(doubts), self.remark))))

    @property
    def total(self) -> int:
        """Number of draws."""
        return min((len(values) for values in self.by_paths.values()), default=0)

    def some(self, arm: Arm, count: int, seed: int | None = None) -> Values:
        """Return draws of an arm's numbers.

        Args:
            arm: with these numbers.
            count: most draws; all if there are fewer.
            seed: of a random choice without replacement; without it the draws are spread evenly over the chains.

        Raises:
            InputError: there is no number of this arm.
        """
        return self._at(_choice(self.total, min(count, self.total), seed), arm)

    def two_groups(self, arm: Arm, count: int, fresh: int, seed: int = 0) -> tuple[Values, Values | None]:
        """Return draws spread evenly over the chains, and a random choice of the remaining ones.

        A design fitted to the first group can be tested with the second.

        Args:
            arm: with these numbers.
            count: most draws of the first group; all if there are fewer.
            fresh: most draws of the second; all remaining ones if these are fewer, None if there are none.
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


# -------- Identified
# Numbers of an arm from a fit or a posterior, for export to other files.


@dataclass(frozen=True)
class Identified:
    """Numbers of an arm by path, with their sources.

    Attributes:
        values: fitted value, or median of the draws [SI]; tied numbers each by its own path.
        intervals: 95 % interval of each [SI]; none for damping from measured ratios.
        supported: numbers whose interval the data support.
        doubts: objections to the fit.
        sources: a word, path and SHA-256 of each file.
    """

    values: Mapping[str, float]
    intervals: Mapping[str, tuple[float, float]]
    supported: frozenset[str]
    doubts: tuple[str, ...]
    sources: tuple[tuple[str, str, str], ...]
