"""How far a fitted arm may be trusted where it was not measured: parts of a campaign, predicted by the rest of it."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from math import degrees

import numpy as np

from ident.errors import InputError, Problem
from ident.identify.fit import CampaignFit
from ident.inference.held_out import HeldOut, held_out
from ident.inference.verdicts import rare
from ident.measure import Campaign

LEAVE = ("posture", "kind", "row", "fraction")
"""What may be left out at a time."""
FOLDS = 5
"""Parts of a campaign of which one is left out at a time, chosen at random, for `fraction`."""
LEVEL = 0.95
"""Share of measurements like these that a scope shall hold."""


@dataclass(frozen=True)
class Scope:
    """How well one kind of measurement is predicted where it was not measured.

    Attributes:
        kind: of measurement.
        folds: parts that were left out and have such a measurement.
        count: measurements of the kind in them.
        rms: [-] root mean square of what they are off, relative to the measured value.
        seen: [-] half of the interval that holds 95 % of them: t of so many folds, times rms.
        expected: [-] the same by the model's own standard deviations.
    """

    kind: str
    folds: int
    count: int
    rms: float
    seen: float
    expected: float

    @property
    def half(self) -> float:
        """Half of the interval that may be stated: the larger of both, so that luck with few parts does not count."""
        return max(self.seen, self.expected)


@dataclass(frozen=True)
class Validation:
    """A fit, and what it predicts of each part of its campaign when that is left out.

    Attributes:
        fit: to the whole campaign.
        leave: what was left out at a time.
        parts: what was left out, and its prediction.
    """

    fit: CampaignFit
    leave: str
    parts: tuple[HeldOut, ...]

    @property
    def told(self) -> tuple[HeldOut, ...]:
        """The parts that the others predict."""
        return tuple(part for part in self.parts if part.told)

    @property
    def missed(self) -> tuple[HeldOut, ...]:
        """The parts that lie too far from their prediction, for so many of them."""
        told = self.told
        far = rare([part.p_value for part in told])
        return tuple(part for part, too_far in zip(told, far, strict=True) if too_far)

    @property
    def z(self) -> np.ndarray:
        """(n,) how far each measurement that is predicted lies from its prediction, in standard deviations."""
        return np.concatenate([part.off / part.sd for part in self.told]) if self.told else np.empty(0)

    @property
    def covered(self) -> int:
        """Measurements in the 95 % interval of their prediction."""
        return int((np.abs(self.z) < _normal_half()).sum())

    @property
    def scopes(self) -> tuple[Scope, ...]:
        """How well each kind of measurement is predicted."""
        kinds = dict.fromkeys(m.kind for m in self.fit.campaign)
        return tuple(scope for kind in kinds if (scope := self._scope(kind)))

    def _scope(self, kind: str) -> Scope | None:
        from scipy.stats import t

        of_kind = np.array([m.kind == kind for m in self.fit.campaign])
        off, sd = [], []
        for part in self.told:
            own = of_kind[part.places] & (part.measured != 0)
            if own.any():
                off.append((part.off / np.where(own, part.measured, 1.0))[own])
                sd.append((part.sd / np.abs(np.where(own, part.measured, 1.0)))[own])
        if not off:
            return None
        rms = float(np.sqrt(np.mean([np.mean(each**2) for each in off])))
        expected = float(np.sqrt(np.mean([np.mean(each**2) for each in sd])))
        seen = float(t.ppf((1 + LEVEL) / 2, len(off))) * rms
        return Scope(kind, len(off), sum(map(len, off)), rms, seen, _normal_half() * expected)


def _normal_half() -> float:
    from scipy.special import ndtri

    return float(ndtri((1 + LEVEL) / 2))


def validate_fit(
    fit: CampaignFit,
    leave: str = "posture",
    seed: int = 0,
    progress: Callable[[Iterable[int]], Iterable[int]] = iter,
) -> Validation:
    """Leave out each part of a campaign in turn, fit the arm to the rest, and predict what was left out.

    Args:
        fit: to the whole campaign.
        leave: one of `LEAVE`; a part is left out whole.
        seed: of the parts that are chosen at random.
        progress: wraps the numbers of the parts, to show a bar.

    Raises:
        InputError: there are fewer than two parts.
    """
    parts = parts_of(fit.campaign, leave, seed)
    if len(parts) < 2:
        got, remedy = f"{leave}, of which the campaign has {len(parts)}", "leave out something else"
        raise InputError(Problem("leave", got, "two parts or more", remedy))
    return Validation(fit, leave, held_out(fit, parts, progress))


def parts_of(campaign: Campaign, leave: str, seed: int = 0) -> Mapping[str, list[int]]:
    """Return the places of the measurements in each part of a campaign, by the part's name."""
    parts: dict[str, list[int]] = {}
    for place, name in enumerate(_names(campaign, leave, seed)):
        parts.setdefault(name, []).append(place)
    return parts


def _names(campaign: Campaign, leave: str, seed: int) -> Iterator[str]:
    if leave == "fraction":
        folds = min(FOLDS, len(campaign))
        yield from (f"part {k + 1}" for k in np.random.default_rng(seed).permutation(np.arange(len(campaign)) % folds))
    for number, m in enumerate(campaign, 1):
        if leave == "posture":
            yield f"({', '.join(f'{degrees(angle) + 0.0:.4g}' for angle in m.posture)}) deg"
        elif leave == "kind":
            yield m.kind
        elif leave == "row":
            yield f"row {number}"
