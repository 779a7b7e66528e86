"""What several studies share: options that pose a problem, and the arm with where it comes from."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ident.errors import InputError, Problem
from ident.inference.priors import Prior
from ident.studies import reading
from ident.studies.options import Options, option

if TYPE_CHECKING:
    from ident.arm.arm import Arm
    from ident.description.file import ArmFile
    from ident.identify.unknowns import Unknowns
    from ident.measure import Campaign


@dataclass(frozen=True, kw_only=True)
class ProblemOptions(Options):
    """What is unknown of an arm, and what is known of it before the data."""

    fix: tuple[str, ...] = option(
        (),
        "parameter to keep at the arm file's value, as joint1.k_bend; may be repeated",
        repeated=True,
        read=reading.names,
    )
    tie: tuple[tuple[str, ...], ...] = option(
        (),
        "parameters fitted as one, as joint2.k_tors=joint3.k_tors; may be repeated",
        repeated=True,
        read=reading.ties,
    )
    free: dict[str, float] = option(
        {},
        "further unknown with the width of its prior, as link2.mass:0.1 (10 %) or "
        "joint2.offset.x:0.01 (m); without a width it has no prior",
        repeated=True,
        read=reading.widths,
    )
    prior_sd: float = option(1.0, "width of the prior: standard deviation of ln(stiffness)", above=0.0)
    no_prior: bool = option(False, "no prior on stiffness and damping")
    prior: dict[str, Prior] = option(
        {},
        "prior of one parameter in SI, as joint1.k_tors=catalogue:K1:K2:K3 (of its harmonic drive), "
        "=log-uniform:LOW:HIGH or =log-normal:MEDIAN:SD; may be repeated",
        repeated=True,
        read=reading.priors,
    )
    discrepancy: dict[str, float] = option(
        {},
        "kind of measurement that the model may get wrong by a common factor, with the width of ln(factor), "
        "as deflection:0.1 (10 %); may be repeated",
        repeated=True,
        read=reading.widths,
    )
    trust_values: tuple[str, ...] = option(
        (),
        "row whose value is right though it looks implausible, as 7, its number in the file, or all; may be repeated",
        repeated=True,
        read=reading.names,
    )
    seed: int = option(0, "seed of all that is drawn at random", low=0)

    @property
    def unknowns(self) -> "Unknowns":
        """What is unknown, as identification takes it."""
        from ident.identify.unknowns import Unknowns

        width = math.inf if self.no_prior else self.prior_sd
        prior = {name: Prior.parse(form) if isinstance(form, str) else form for name, form in self.prior.items()}
        return Unknowns(self.fix, self.tie, self.free, width, prior, self.discrepancy)


@dataclass(frozen=True, kw_only=True)
class ArmOptions(Options):
    """What an arm carries, and which of its numbers are changed."""

    load: str = option("", "load case, as 'glass' or '5 kg @ tip'")
    set: dict[str, float] = option(
        {},
        "number to change, in SI, as link2.mass=30 (inertia stays as it is); may be repeated",
        repeated=True,
        read=reading.numbers,
    )

    def problems(self) -> list[Problem]:
        """Return numbers of a sign that they can't have."""
        from ident.arm.fields import EXPECTED, field_of

        fields = {path: field_of(path) for path in self.set}
        return [
            Problem("set", f"{path}={self.set[path]:g}", EXPECTED[each.sign], "correct it")
            for path, each in fields.items()
            if each and not each.allows(self.set[path])
        ]


def as_file(arm: "Arm | ArmFile | str | Path") -> "ArmFile":
    """Return an arm with where it comes from; one that was made in Python comes from no file."""
    from ident.arm.arm import Arm
    from ident.description.file import ArmFile, read_arm

    if isinstance(arm, ArmFile):
        return arm
    if isinstance(arm, str | Path):
        return read_arm(arm)
    if not isinstance(arm, Arm):
        raise InputError(Problem("arm", f"a {type(arm).__name__}", "an arm, or its file", "see ident.read_arm"))
    return ArmFile(arm, "", "", {})


def as_campaign(campaign: "Campaign | str | Path") -> "Campaign":
    """Return a campaign, read from its file if need be."""
    from ident.measure import Campaign, read_campaign

    if isinstance(campaign, str | Path):
        return read_campaign(campaign)
    if not isinstance(campaign, Campaign):
        got, remedy = f"a {type(campaign).__name__}", "see ident.read_campaign"
        raise InputError(Problem("campaign", got, "a campaign, or its file", remedy))
    return campaign
