"""Scatter between modal tests of one posture, each set up from scratch."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ident.errors import require
from ident.measure.covariance import COMMON
from ident.text import did_you_mean, quoted

REPRODUCIBILITY = {"frequency": 0.002, "damping_ratio": 0.05}
"""Relative standard deviation between tests of one posture, each set up from scratch: sensors remounted, posture
reached again, another temperature and amplitude; assumed."""
ASSUMED_FREEDOM = 4
"""Degrees of freedom of the assumed scatter when it is combined with that of repeated tests."""


@dataclass(frozen=True)
class Reproducibility:
    """Scatter between modal tests of one posture, each set up from scratch.

    Attributes:
        share: by kind, the relative standard deviation.
        common: share of the variance that all values of a kind in one test have in common.
        freedom: by kind, degrees of freedom of the repeated tests behind the share; none where it is given or assumed.
        said: kinds whose share the user gave.
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
        """Return the user's shares, and the assumed ones of the other kinds."""
        return cls({**REPRODUCIBILITY, **said}, common, said=tuple(said))

    def after(self, kind: str, squares: float, freedom: int) -> "Reproducibility":
        """Return the scatter updated by repeated tests; the assumed share counts `ASSUMED_FREEDOM` degrees of freedom.

        Args:
            kind: of the values.
            squares: sum of squared relative differences from their means, less the part that repeatability explains.
            freedom: its degrees of freedom; without any, or with a given share, the share does not change.
        """
        if not freedom or kind in self.said:
            return self
        variance = (ASSUMED_FREEDOM * self.share[kind] ** 2 + max(squares, 0.0)) / (ASSUMED_FREEDOM + freedom)
        share, counts = {**self.share, kind: variance**0.5}, {**self.freedom, kind: freedom}
        return Reproducibility(share, self.common, counts, self.said)

    def covariance(self, values: Sequence[tuple[str, float]]) -> list[list[float]]:
        """Return the covariance of the values of one test.

        For the values v of a kind: s^2 (c v v' + (1 - c) diag(v)^2), with the share s and the common share c.

        Args:
            values: kind and number of each.
        """
        rows = [(kind, self.share.get(kind, 0.0) * value) for kind, value in values]
        alike = [[self.common if kind == other else 0.0 for other, _ in rows] for kind, _ in rows]
        return [
            [sd * other * (1.0 if i == j else alike[i][j]) for j, (_, other) in enumerate(rows)]
            for i, (_, sd) in enumerate(rows)
        ]
