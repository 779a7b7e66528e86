"""What a fit of an arm takes for granted: rigid base and links, given masses, a servo that holds."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import jax
import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm
from ident.arm.hinges import CutArm, cut
from ident.identify.conditions import Conditions, bind
from ident.identify.predict import ArmModel, Held
from ident.identify.slopes import Slopes, slopes, slopes_once
from ident.identify.uncertain import scaled_inertia
from ident.inference.fit import Fit
from ident.inference.score import ScoreTest, asked_for, score_tests
from ident.measure import Campaign, Measurement
from ident.measure.kinds import SHAPES

ASSUMED = "assumed"
DUMAS = f"{ASSUMED}; links are usually taken as much stiffer (Dumas et al., Robot. Comput. Integr. Manuf. 27, 2011)"


@dataclass(frozen=True)
class Kind:
    """A kind of thing that a fit takes for granted.

    Attributes:
        plausible: an amount that an engineer would not be surprised at, as a share.
        of: what it is a share of.
        positive: whether it can't be negative.
        origin: where that amount comes from.
    """

    plausible: float
    of: str
    positive: bool
    origin: str


KINDS = {
    "base rocks": Kind(0.2, "joint 1's bending compliance", True, ASSUMED),
    "base turns": Kind(0.2, "joint 1's torsional compliance", True, ASSUMED),
    "link bends": Kind(0.1, "its joint's bending compliance", True, DUMAS),
    "link twists": Kind(0.1, "its joint's bending compliance", True, DUMAS),
    "mass": Kind(0.1, "the link's mass, inertia with it", False, ASSUMED),
    "mass centre": Kind(0.02, "the link's length", False, ASSUMED),
    "servo gives": Kind(0.05, "its joint's torsional compliance", True, ASSUMED),
}
"""All that is looked at. No published ratio of a base's stiffness to a first joint's was found: a base is taken to be
five times as stiff as joint 1 at least, the softest with which rates were studied (tests/benchmarks/README.md)."""


@dataclass(frozen=True)
class Assumption:
    """One thing that a fit takes for granted.

    Attributes:
        kind: one of `KINDS`.
        joint: name of the joint whose link or servo it is; empty for the base.
        test: what the plausible amount would move, and whether the data ask for it.
    """

    kind: str
    joint: str
    test: ScoreTest


@dataclass(frozen=True)
class Assumptions:
    """All that a fit takes for granted.

    Attributes:
        items: each with its test.
        height: [m] below bushing 1 at which a base is thought to give.
    """

    items: tuple[Assumption, ...]
    height: float

    @property
    def asked_for(self) -> tuple[Assumption, ...]:
        """What the data ask for, most of all first."""
        return tuple(self.items[place] for place in asked_for([item.test for item in self.items]))


def assumptions(fit: Fit, arm: Arm, campaign: Campaign) -> Assumptions:
    """Say of all that a fit takes for granted how far it might move the answer, and whether the data ask for it.

    Damping ratios are left out: they say next to nothing of a stiffness. So are shapes, and rows with a servo on, where
    the arm has servos. An arm that has an undriven joint at its foot or within a link takes nothing for granted there.
    What a discrepancy factor scales is scaled here as well.

    Args:
        fit: of the campaign.
        arm: as its file has it.
        campaign: what was fitted.
    """
    fitted, pieces, found = _found(fit, arm, campaign)
    names, changes = zip(*_each(fitted, pieces, found), strict=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        factor = np.where(found.predicted != 0, fit.predicted / found.predicted, 1.0)
    kinds = [KINDS[kind] for kind, _ in names]
    tests = score_tests(
        fit,
        np.array(changes) * factor,
        np.array([kind.plausible for kind in kinds]),
        [kind.positive for kind in kinds],
        np.array([_left_out(arm, m) for m in campaign]),
    )
    items = tuple(Assumption(kind, joint, test) for (kind, joint), test in zip(names, tests, strict=True))
    return Assumptions(items, pieces.height)


def _found(fit: Fit, arm: Arm, campaign: Campaign) -> tuple[Arm, CutArm, Slopes]:
    """Return the arm with the fitted numbers, whole and in pieces, and how the campaign's predictions change."""
    own, model = set(arm.paths()), fit.problem.model
    scaled, frames = (model.scaled, model.frames) if isinstance(model, ArmModel) else ((), None)
    fitted = scaled_inertia(arm, fit.parameters, scaled).replace(
        {path: value for path, value in fit.parameters.items() if path in own}
    )
    pieces, free = cut(fitted), replace(fitted, servos=())
    # all readings in the base frame, and lagging behind, as they were fitted
    _, _, conditions = ArmModel(free, bind(free, campaign), frames=frames).at(fit.parameters)
    return fitted, pieces, _slopes(fit.choice.held, free, pieces, jax.device_get(conditions))


def _left_out(arm: Arm, m: Measurement) -> bool:
    return m.kind in ("damping_ratio", *SHAPES) or (bool(arm.servos) and m.drives == "servo")


def _slopes(held: Held | None, fitted: Arm, pieces: CutArm, conditions: Conditions) -> Slopes:
    """Return how the campaign's predictions change; part by part where it is large."""
    model = ArmModel(fitted, conditions)
    parts = model.in_parts()
    if parts is None:
        padded, _, places = conditions.padded()
        each = [jax.device_get(slopes_once(fitted, pieces, padded, _places(fitted, held)))]
    else:
        places, split = parts.places, parts.split(held)
        chosen = [_places(fitted, own) for own in split]
        calls = zip(parts.models, chosen, strict=True)
        each = [jax.device_get(slopes(fitted, pieces, part.conditions, own)) for part, own in calls]
    joined = [np.concatenate(columns, -1)[..., places] for columns in zip(*each, strict=True)]
    return Slopes(*joined)  # type: ignore[arg-type]  # fetched from jax


def _places(arm: Arm, held: Held | None) -> Float[np.ndarray, "m R"] | None:
    """Return the modes that labels were taken for, without those of motors that servos hold: the last where none is."""
    return None if held is None else np.asarray(held.place)[: 3 * len(arm.joints)]


def _each(arm: Arm, pieces: CutArm, found: Slopes) -> "list[tuple[tuple[str, str], Float[np.ndarray, 'D']]]":
    """Return what is assumed, by kind and joint, with the change of the predictions by each share."""
    names = dict(zip(pieces.own, (joint.name for joint in arm.joints), strict=True))
    each: list[tuple[tuple[str, str], np.ndarray]] = []
    for hinge, bending, torsion in zip(pieces.hinges, found.bending, found.torsion, strict=True):
        beside = pieces.arm.joints[hinge.beside]
        across, about = float(beside.k_bend), float(beside.k_bend if hinge.link else beside.k_tors)
        kinds = ("link bends", "link twists") if hinge.link else ("base rocks", "base turns")
        name = names[hinge.beside] if hinge.link else ""
        each += [((kinds[0], name), bending / across), ((kinds[1], name), torsion / about)]
    rows = zip(arm.joints, found.mass, found.centre, found.servo, strict=True)
    for joint, mass, centre, servo in rows:
        each += [(("mass", joint.name), mass), (("mass centre", joint.name), centre)] if joint.link else []
        each += [(("servo gives", joint.name), servo)] if joint.driven else []
    return sorted(each, key=lambda pair: list(KINDS).index(pair[0][0]))


def of_kind(items: Sequence[Assumption], kind: str) -> tuple[Assumption, ...]:
    """Return those of one kind."""
    return tuple(item for item in items if item.kind == kind)
