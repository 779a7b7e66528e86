"""Priors of a number before the data: log-normal, log-uniform, or from a maker's catalogue."""

import math
from dataclasses import dataclass

from ident.errors import placed, refusal, require
from ident.text import quoted

SHOULDER = 0.01
"""Width in ln(value) of the edges of a log-uniform prior: smooth enough for a fit, narrow enough for an edge."""
CATALOGUE_TOLERANCE = 0.1
"""Width in ln(value) beyond a catalogue's K1 and K3; assumed, as the makers' catalogues give no figure."""
FORMS = "log-normal:MEDIAN:SD, log-uniform:LOW:HIGH or catalogue:K1:K2:K3"


@dataclass(frozen=True)
class Prior:
    """Flat in ln(value) from low to high, and normal beyond them.

    Attributes:
        low: [SI] lower end of the flat part; equal to high for a log-normal prior.
        high: [SI] upper end of it.
        sd: [-] standard deviation in ln(value) of the normal flanks.
    """

    low: float
    high: float
    sd: float

    def __post_init__(self) -> None:
        if not (0 < self.low <= self.high < math.inf and 0 < self.sd < math.inf):
            got = f"a prior from {self.low:g} to {self.high:g} of width {self.sd:g}"
            raise refusal("", got, "0 < low <= high, width > 0, all finite", f"give {FORMS}")

    def __str__(self) -> str:
        form = "log-uniform" if self.sd == SHOULDER else "catalogue"
        return f"log-normal:{self.low}:{self.sd}" if self.low == self.high else f"{form}:{self.low}:{self.high}"

    @classmethod
    def log_normal(cls, median: float, sd: float) -> "Prior":
        """Return the prior with this median and this standard deviation of ln(value)."""
        return cls(median, median, sd)

    @classmethod
    def log_uniform(cls, low: float, high: float) -> "Prior":
        """Return the prior that is flat in ln(value), with edges one percent wide.

        Raises:
            InputError: the range is empty.
        """
        require(low != high, "", f"log-uniform from {low:g} to {high:g}", "low < high", "give two ends")
        return cls(low, high, SHOULDER)

    @classmethod
    def catalogue(cls, *stiffnesses: float) -> "Prior":
        """Return the prior of a harmonic drive whose catalogue states K1, K2, K3 [N m/rad].

        The drive stiffens with load from K1 to K3; as the acting value is unknown, all between are equally likely.
        """
        return cls(min(stiffnesses), max(stiffnesses), CATALOGUE_TOLERANCE)

    @classmethod
    def parse(cls, text: str) -> "Prior":
        """Read a prior in the command line's format, see `FORMS`.

        Raises:
            InputError: another format, or impossible numbers.
        """
        form, *words = text.split(":")
        make, count = {
            "log-normal": (cls.log_normal, (2,)),
            "log-uniform": (cls.log_uniform, (2,)),
            "catalogue": (cls.catalogue, (2, 3)),
        }.get(form, (None, ()))
        try:
            numbers = [float(word) for word in words]
        except ValueError:
            numbers = []
        if make is None or len(numbers) not in count:
            raise refusal("prior", quoted(text), FORMS, "correct it")
        with placed(f"prior {quoted(text)}"):
            return make(*numbers)
