"""How far the values of a modal test differ from those of another one that was set up from the start."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ident.errors import require
from ident.measure.covariance import COMMON
from ident.text import did_you_mean, quoted

REPRODUCIBILITY = {"frequency": 0.002, "damping_ratio": 0.05}
"""Standard deviation, as a share of the value, between tests of one posture that were set up from the start; assumed:
sensors are mounted again, the posture is reached again, temperature and amplitude differ."""
ASSUMED_FREEDOM = 4
"""Degrees of freedom that the assumption counts where repeated tests show how far they differ."""


@dataclass(frozen=True)
class Reproducibility:
    """How far the values of a test differ from those of another one that was set up from the start.

    Attributes:
        share: by kind, the standard deviation as a share of the value.
        common: share of its variance that all values of a kind in one test have in common.
        freedom: by kind, the degrees of freedom of repeated tests that it was estimated from; none where it was said or
            assumed.
        said: kinds whose share was given by the user.
    """

    share: Mapping[str, float] = field(default_factory=lambda: REPRODUCIBILITY)
    common: float = COMMON
    freedom: Mapping[str, int] = field(default_factory=dict)
    said: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for kind, share in self.share.items():
            where, expected = "reproducibility", f"one of {', '.join(REPRODUCIBILITY)}"
            remedy = did_you_mean(kind, REPRODUCIBILITY, "name one of them")
            require(kind in REPRODUCIBILITY, where, quoted(kind), expected, remedy)
            expected, remedy = "a share from 0, below 1", "as frequency=0.002 for 0.2 %"
            require(0 <= share < 1, where, f"{kind}={share:g}", expected, remedy)
        remedy = "0.5 for half of the variance"
        require(0 <= self.common <= 1, "common", f"{self.common:g}", "a share from 0 to 1", remedy)

    @classmethod
    def of(cls, said: Mapping[str, float], common: float = COMMON) -> "Reproducibility":
        """Return what a user has said, and what is assumed of the other kinds."""
        return cls({**REPRODUCIBILITY, **said}, common, said=tuple(said))

    def after(self, kind: str, squares: float, freedom: int) -> "Reproducibility":
        """Return what repeated tests show of a kind, with the assumption as `ASSUMED_FREEDOM` degrees of freedom.

        Args:
            kind: of the values.
            squares: sum of squares of relative differences from their means, less what repeatability explains.
            freedom: its degrees of freedom; the share stays as it is without any, or where it was said.
        """
        if not freedom or kind in self.said:
            return self
        variance = (ASSUMED_FREEDOM * self.share[kind] ** 2 + max(squares, 0.0)) / (ASSUMED_FREEDOM + freedom)
        share, counts = {**self.share, kind: variance**0.5}, {**self.freedom, kind: freedom}
        return Reproducibility(share, self.common, counts, self.said)

    def covariance(self, values: Sequence[tuple[str, float]]) -> list[list[float]]:
        """Return the covariance of the values of one test.

        With s the share and v the values of a kind, s^2 (c v v' + (1 - c) diag(v)^2), c being the common share.

        Args:
            values: kind and number of each.
        """
        rows = [(kind, self.share.get(kind, 0.0) * value) for kind, value in values]
        alike = [[self.common if kind == other else 0.0 for other, _ in rows] for kind, _ in rows]
        return [
            [sd * other * (1.0 if i == j else alike[i][j]) for j, (_, other) in enumerate(rows)]
            for i, (_, sd) in enumerate(rows)
        ]
