"""What a robot description says, URDF or MJCF: an arm but for its bushings, and the arm with them."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from ident.arm.arm import GRAVITY, Arm
from ident.arm.checks import massless_joint
from ident.arm.parts import Body, Joint, Payload, Point
from ident.errors import InputError, Problem
from ident.text import did_you_mean

Pair = tuple[float, ...]
"""Two numbers, across the axis and about it; their number is checked when the file is read."""


def refusal(where: str, got: str, expected: str, remedy: str) -> InputError:
    """Return the error of one problem."""
    return InputError(Problem(where, got, expected, remedy))


@dataclass(frozen=True)
class Pin:
    """A joint without its bushing, and what turns with it; what its attributes mean, `Joint` says."""

    name: str
    axis: Float[np.ndarray, "3"]
    offset: Float[np.ndarray, "3"]
    link: tuple[Body, ...]
    limits: tuple[float, float]
    driven: bool = True


@dataclass(frozen=True)
class Robot:
    """A serial arm as its description has it.

    Attributes:
        name: what it is called.
        where: names the file in errors.
        pins: from the base outwards.
        frames: the joint that carries each frame that may be the end point, and its place [m] in that joint's frame.
        end: which of them is the end point, if no other is named.
        kind: what such a frame is called there: a link, a body or site.
        gravity: (3,) [m/s^2] in the base frame.
        remedy: how a link gets mass in that format.
    """

    name: str
    where: str
    pins: tuple[Pin, ...]
    frames: Mapping[str, tuple[str, Float[np.ndarray, "3"]]]
    end: str
    kind: str
    remedy: str
    gravity: Any = GRAVITY

    @property
    def joints(self) -> list[str]:
        """Names of the joints."""
        return [pin.name for pin in self.pins]

    def arm(
        self,
        bushings: Mapping[str, Mapping[str, Any]],
        tip: str | None = None,
        points: tuple[Point, ...] = (),
        payloads: tuple[Payload, ...] = (),
    ) -> Arm:
        """Return the arm.

        Args:
            bushings: what `Joint` takes of stiffness and damping, by joint.
            tip: the frame whose origin is the point `tip`, by default the end.
            points: further points.
            payloads: bodies that a load case may add.

        Raises:
            InputError: a joint that nothing beyond it loads, no such frame, or a name that occurs twice.
        """
        joints = [
            Joint(
                pin.name,
                axis=pin.axis,
                offset=pin.offset,
                link=pin.link,
                limits=pin.limits,
                driven=pin.driven,
                **bushings[pin.name],
            )
            for pin in self.pins
        ]
        if massless := massless_joint(joints):
            last, got, expected = massless
            remedy = f"give the {'last ' * (last == len(joints) - 1)}link {self.remedy}"
            raise refusal(f"{self.where}, joint {joints[last].name}", got, expected, remedy)
        try:
            return Arm(self.name, tuple(joints), (*points, self._tip(tip)), payloads, self.gravity)
        except InputError as error:
            raise InputError(Problem(self.where, p.got, p.expected, p.remedy) for p in error.problems) from None

    def _tip(self, tip: str | None) -> Point:
        tip = self.end if tip is None else tip
        if tip in self.frames:
            return Point("tip", *self.frames[tip])
        remedy = did_you_mean(tip, self.frames, f"one of {', '.join(self.frames)}")
        raise refusal(self.where, f"the tip {tip!r}", f"a moving {self.kind} of this robot", remedy)

    def bushings(
        self, stiffness: Mapping[str, Pair] | Pair, damping: Mapping[str, Pair] | Pair
    ) -> dict[str, dict[str, float]]:
        """Return what `Joint` takes by joint, of pairs for each joint or one for all.

        Raises:
            InputError: a joint lacks a value, there is no such joint, or a value is out of range.
        """
        problems: list[Problem] = []
        k = _by_joint(stiffness, self.joints, "stiffness", problems)
        tau = _by_joint(damping, self.joints, "damping", problems)
        if problems:
            raise InputError(problems)
        keys = ("k_bend", "k_tors", "tau_bend", "tau_tors")
        return {name: dict(zip(keys, (*k[name], *tau[name]), strict=True)) for name in self.joints}


def _by_joint(
    values: Mapping[str, Pair] | Pair, names: list[str], what: str, problems: list[Problem]
) -> Mapping[str, Pair]:
    """Return a pair for every joint; add what is missing, unknown or out of range to the problems."""
    given = values if isinstance(values, Mapping) else dict.fromkeys(names, values)
    for name in names:
        if name not in given:
            problems.append(Problem(f"joint {name}", f"no {what}", "a pair (bending, torsion)", f"add its {what}"))
    for name, pair in given.items():
        if name not in names:
            remedy = did_you_mean(name, names, "leave it out")
            problems.append(Problem(f"{what} of {name}", "no such joint", f"one of {', '.join(names)}", remedy))
        elif not _in_range(pair, what):
            least = "> 0 N m/rad" if what == "stiffness" else ">= 0 s"
            problems.append(Problem(f"joint {name}", f"{what} {pair}", f"two numbers {least}", "correct it"))
    return given


def _in_range(pair: Any, what: str) -> bool:
    try:
        numbers = np.asarray(pair, dtype=float)
    except (TypeError, ValueError):
        return False
    least = np.finfo(float).tiny if what == "stiffness" else 0.0
    return numbers.shape == (2,) and bool(np.all(np.isfinite(numbers) & (numbers >= least)))
