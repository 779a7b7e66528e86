"""Cross-validation of a fitted arm: parts of a campaign, predicted by the rest of it."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import degrees

import numpy as np
from jaxtyping import Float

from ident.errors import require
from ident.identify.fit import CampaignFit
from ident.inference.information import half_width, rare
from ident.inference.scrutiny import HeldOut, held_out
from ident.measure import Campaign
from ident.programs import Progress
from ident.text import no_such

LEAVE = ("posture", "kind", "row", "fraction")
"""Units of cross-validation: left out one at a time."""
FOLDS = 5
"""Random parts of a campaign for `fraction`, left out one at a time; usual for cross-validation."""
LEVEL = 0.95
"""Share of measurements like these that a scope should contain."""


@dataclass(frozen=True)
class Scope:
    """Prediction error of one kind of measurement in cross-validation.

    Attributes:
        kind: of measurement.
        folds: left-out parts with such a measurement.
        count: measurements of the kind in them.
        rms: [-] rms prediction error, relative to the measured value; [SI] if it is absolute.
        seen: [-] or [SI] half-width of the interval with 95 % of the errors: Student's t for the folds, times rms.
        expected: [-] or [SI] the same by the model's own standard deviations.
    """

    kind: str
    folds: int
    count: int
    rms: float
    seen: float
    expected: float

    @property
    def half(self) -> float:
        """Half-width to report: the larger of both, so that luck with few parts does not count."""
        return max(self.seen, self.expected)


@dataclass(frozen=True)
class Validation:
    """A fit, and the prediction of each part of its campaign from the rest.

    Attributes:
        fit: to the whole campaign.
        leave: unit of cross-validation.
        parts: each left-out part, with its prediction.
    """

    fit: CampaignFit
    leave: str
    parts: tuple[HeldOut, ...]

    @property
    def told(self) -> tuple[HeldOut, ...]:
        """The parts for which the others determine a prediction."""
        return tuple(part for part in self.parts if part.told)

    @property
    def missed(self) -> tuple[HeldOut, ...]:
        """The parts too far from their prediction, corrected for their number."""
        told = self.told
        far = rare([part.p_value for part in told])
        return tuple(part for part, too_far in zip(told, far, strict=True) if too_far)

    @property
    def z(self) -> np.ndarray:
        """(n,) distance of each measurement from its prediction, in standard deviations."""
        return np.concatenate([part.off / part.sd for part in self.told]) if self.told else np.empty(0)

    @property
    def covered(self) -> int:
        """Number of measurements in the 95 % interval of their prediction."""
        return int((np.abs(self.z) < half_width(LEVEL)).sum())

    @cached_property
    def ratios(self) -> Float[np.ndarray, "n 3"]:
        """Damping ratios as measured, as predicted from the other parts, and their distance, see `Damping.left_out`."""
        damping = self.fit.damping
        return damping.left_out(parts_of(damping.rows, self.leave).values()) if damping else np.zeros((0, 3))

    @property
    def scopes(self) -> tuple[Scope, ...]:
        """Prediction error of each kind of measurement."""
        kinds = dict.fromkeys(m.kind for m in self.fit.campaign)
        return tuple(scope for kind in kinds if (scope := self.scope(kind)))

    def scope(self, kind: str, *, relative: bool = True) -> Scope | None:
        """Return the prediction error of a kind of measurement, relative or in SI; None without a predicted part."""
        from scipy.stats import t

        of_kind = np.array([m.kind == kind for m in self.fit.campaign])
        off, sd = [], []
        for part in self.told:
            own = of_kind[part.places] & ((part.measured != 0) | (not relative))
            if own.any():
                size = np.abs(part.measured[own]) if relative else 1.0
                off.append(part.off[own] / size)
                sd.append(part.sd[own] / size)
        if not off:
            return None
        rms = float(np.sqrt(np.mean([np.mean(each**2) for each in off])))
        expected = float(np.sqrt(np.mean([np.mean(each**2) for each in sd])))
        seen = float(t.ppf((1 + LEVEL) / 2, len(off))) * rms
        return Scope(kind, len(off), sum(map(len, off)), rms, seen, half_width(LEVEL) * expected)


def validate_fit(fit: CampaignFit, leave: str = "posture", seed: int = 0, progress: Progress = iter) -> Validation:
    """Cross-validate: leave out each part of a campaign in turn, fit the arm to the rest, and predict the part.

    Args:
        fit: to the whole campaign.
        leave: `posture`, `kind`, `row` or `fraction`; a part is left out whole.
        seed: of randomly chosen parts.
        progress: wraps the numbers of the parts, to show a bar.

    Raises:
        InputError: there are fewer than two parts.
    """
    parts = parts_of(fit.campaign, leave, seed)
    got, remedy = f"{leave}, of which the campaign has {len(parts)}", "leave out something else"
    require(len(parts) >= 2, "leave", got, "two parts or more", remedy)
    return Validation(fit, leave, held_out(fit, parts, progress))


def parts_of(campaign: Campaign, leave: str, seed: int = 0) -> Mapping[str, list[int]]:
    """Return the indices of the measurements in each part of a campaign, by the part's name."""
    if leave not in LEAVE:
        raise no_such("leave", leave, LEAVE, "")
    count, parts = len(campaign), dict[str, list[int]]()
    fold = np.random.default_rng(seed).permutation(np.arange(count) % min(FOLDS, count))
    for place, m in enumerate(campaign):
        name = {
            "posture": f"({', '.join(f'{degrees(angle) + 0.0:.4g}' for angle in m.posture)}) deg",
            "kind": m.kind,
            "row": f"row {place + 1}",
            "fraction": f"part {fold[place] + 1}",
        }[leave]
        parts.setdefault(name, []).append(place)
    return parts
