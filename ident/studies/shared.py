"""Shared by several studies: options that pose a problem, and the arm with its source."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from ident.errors import InputError, Problem, refusal, require
from ident.inference.priors import Prior
from ident.studies import reading
from ident.studies.options import Options, option, repeated
from ident.text import one_line
from ident.units import STIFFNESS_UNITS, USUAL

if TYPE_CHECKING:
    import pandas

    from ident.arm.arm import Arm
    from ident.description.file import ArmFile
    from ident.identify.unknowns import Unknowns
    from ident.identify.values import Values
    from ident.measure import Campaign, Log


FARTHEST = 3600.0
"""Largest joint angle [deg], ten turns, as in a log."""


class UnitOptions(Options):
    """The unit in which stiffnesses are shown."""

    units: str = option(
        USUAL,
        f"unit of stiffness in reports, figures and pages: {', '.join(STIFFNESS_UNITS)}; result files are in SI",
        choices=tuple(STIFFNESS_UNITS),
        read=reading.stiffness_unit,
        text=USUAL,
    )


class SamplesOptions(UnitOptions):
    """The columns of files of samples."""

    columns: dict[str, str] = repeated(
        {},
        "what columns are that a file of samples does not name, as actual_q_0=joint1:rad,t=time:ms; may be repeated",
        read=reading.columns,
    )


class BaseOptions(UnitOptions):
    """The base of an arm."""

    soft_base: float | None = option(
        None,
        "let the base rock and turn about a point this far [m] below bushing 1: an undriven joint, by default ten "
        "times as stiff as joint 1",
        above=0.0,
    )


class ProblemOptions(BaseOptions):
    """The unknowns of an arm, and their priors."""

    fix: tuple[str, ...] = repeated(
        (),
        "parameter to keep at the arm file's value, as joint1.k_bend, or *.k_bend for all of them; may be repeated",
        read=reading.each_of,
    )
    tie: tuple[tuple[str, ...], ...] = repeated(
        (), "parameters fitted as one, as joint2.k_tors=joint3.k_tors; may be repeated", read=reading.ties
    )
    free: dict[str, float] = repeated(
        {},
        "further unknown with the width of its prior, as link2.mass:0.1 (10 %) or "
        "joint2.offset.x:0.01 (m); without a width it has no prior",
        read=reading.widths,
    )
    uncertain: dict[str, str] = repeated(
        {},
        "number that is not exactly known, with its standard deviation, as link2.mass:5%, joint2.offset.x:2mm or, of "
        "all loads together, load:1%; commas between several",
        read=reading.uncertain,
    )
    no_uncertain: bool = option(False, "take the numbers of the arm file as exact, whatever uncertainty it gives them")
    prior_sd: float = option(1.0, "width of the prior: standard deviation of ln(stiffness)", above=0.0, high=100.0)
    no_prior: bool = option(False, "no prior on stiffness and damping")
    prior: dict[str, Prior] = repeated(
        {},
        "prior of one parameter in SI, as joint1.k_tors=catalogue:K1:K2:K3 (of its harmonic drive), "
        "=log-uniform:LOW:HIGH or =log-normal:MEDIAN:SD; may be repeated",
        read=reading.priors,
    )
    discrepancy: dict[str, float] = repeated(
        {},
        "kind of measurement with a common model error, with the width of ln(factor), as deflection:0.1 (10 %); may be "
        "repeated",
        read=reading.widths,
    )
    trust_values: tuple[str, ...] = repeated(
        (),
        "row whose value is right though it looks implausible, as 7, its number in the file, or all; may be repeated",
        read=reading.names,
    )
    seed: int = option(0, "seed of all that is drawn at random", low=0, high=1e18)

    refuses: ClassVar[tuple[str, ...]] = ("uncertain",)

    def unknowns_of(self, arm: "ArmFile") -> "Unknowns":
        """Return the unknowns of an arm in the form of identification, with the uncertain numbers of its file.

        Raises:
            InputError: the file has uncertain numbers, and this study does not support them.
        """
        unknowns = self.unknowns.named(arm.arm)
        taken = {*unknowns.fixed, *unknowns.free, *(path for group in unknowns.tied for path in group)}
        own = {path: width for path, width in arm.uncertain.items() if path not in taken}
        if self.no_uncertain or not own:
            return unknowns
        got, remedy = f"uncertain numbers, {next(iter(own))} first", "take them as exact (`no_uncertain`)"
        require("uncertain" not in self.refuses, one_line(arm.path), got, "none in this study", remedy)
        return replace(unknowns, uncertain={**own, **unknowns.uncertain})

    @property
    def unknowns(self) -> "Unknowns":
        """The unknowns in the form of identification, without the uncertain numbers of the arm's file."""
        from ident.identify.unknowns import Unknowns

        width = math.inf if self.no_prior else self.prior_sd
        prior = {name: Prior.parse(form) if isinstance(form, str) else form for name, form in self.prior.items()}
        return Unknowns(self.fix, self.tie, self.free, width, prior, self.discrepancy, self.uncertain)


class ArmOptions(BaseOptions):
    """The load of an arm, and its changed numbers."""

    load: str = option("", "load case, as 'glass' or '5 kg @ tip'")
    set: dict[str, float] = repeated(
        {}, "number to change, in SI, as link2.mass=30 (inertia stays as it is); may be repeated", read=reading.numbers
    )
    force: bool = option(
        False, "take over values that were identified on another arm, and keep no earlier result of the same name"
    )

    def problems(self) -> list[Problem]:
        """Return numbers of an impossible sign."""
        from ident.arm.fields import EXPECTED, LARGEST, field_of

        fields = {path: field_of(path) for path in self.set}
        bad = [
            Problem("set", f"{path}={self.set[path]:g}", EXPECTED[each.sign], "correct it")
            for path, each in fields.items()
            if each and not each.allows(self.set[path])
        ] + [
            Problem("set", f"{path}={value:g}", f"magnitudes up to {LARGEST:g}", "check its unit, which is SI")
            for path, value in self.set.items()
            if not abs(value) <= LARGEST
        ]
        return [*super().problems(), *bad]


class RunsOptions(ArmOptions, SamplesOptions):
    """Options of a study of a table of runs: the table has the load of the arm."""

    refuses: ClassVar[tuple[str, ...]] = ("load",)
    instead: ClassVar[str] = "give it in the column load of the table of runs"


def is_angle(value: Any) -> bool:
    """Whether a value is an angle [deg] that a joint may have."""
    return isinstance(value, Real) and abs(float(value)) <= FARTHEST


def check_posture(posture: Sequence[float], arm: "Arm") -> None:
    """Refuse an invalid posture [deg] of an arm."""
    if len(posture) != len(arm.driven) or not all(map(is_angle, posture)):
        expected = f"{len(arm.driven)} angles within {FARTHEST:g} deg, one for each driven joint"
        raise refusal("posture", f"{tuple(posture)}", expected, "give one angle for each joint")


def as_file(arm: "Arm | ArmFile | str | Path", soft_base: float | None = None) -> "ArmFile":
    """Return an arm with its source; an arm made in Python has no file.

    Args:
        arm: the arm, or its file.
        soft_base: puts it on a compliant base, see `ident.arm.arm.on_soft_base`.

    Raises:
        InputError: it is no arm, its file is wrong, or it already stands on a compliant base.
    """
    from ident.arm.arm import Arm, check_size, on_soft_base
    from ident.description.file import ArmFile, read_arm

    if isinstance(arm, str | Path):
        arm = read_arm(arm)
    if isinstance(arm, Arm):
        check_size(len(arm.joints), "arm")
        arm = ArmFile(arm, "", "", {})
    if not isinstance(arm, ArmFile):
        raise refusal("arm", f"a {type(arm).__name__}", "an arm, or its file", "see ident.read_arm")
    if soft_base is None:
        return arm
    based = on_soft_base(arm.arm, soft_base)
    new = {path: "assumed" for path in based.paths() if path not in arm.origins} if arm.origins else {}
    return replace(arm, arm=based, origins={**arm.origins, **new})


def with_numbers(arm: "Arm", taken_over: "Values | None", changed: Mapping[str, float]) -> "Arm":
    """Return an arm with other numbers, which must be as valid as those of a file.

    Args:
        arm: the arm.
        taken_over: fitted values, or draws whose medians it takes; None for none.
        changed: further set numbers [SI] by path (`set`).

    Raises:
        InputError: impossible numbers, with their file or option.
    """
    from ident.arm.arm import check_arm

    sources = [("set", changed)]
    if taken_over is not None:
        sources = [(one_line(taken_over.path) or "fit", taken_over.medians), *sources]
    for where, numbers in sources:
        arm = arm.replace(numbers)
        try:
            if numbers:
                check_arm(arm)
        except InputError as error:
            parts = [(".".join(filter(None, (each.where, each.column))), each) for each in error.problems]
            raise InputError(Problem(where, f"{part}: {p.got}", p.expected, p.remedy) for part, p in parts) from None
    return arm


def as_log(path: "Log | str | Path", arm: "Arm", columns: Mapping[str, str]) -> "Log":
    """Return a path of an arm's driven joints, read from its file if need be; `columns` is as in `ident.read_log`."""
    from ident.measure import Log, read_log

    return path if isinstance(path, Log) else read_log(path, [joint.name for joint in arm.driven], columns)


def as_campaign(campaign: "Campaign | pandas.DataFrame | str | Path") -> "Campaign":
    """Return a campaign, read from its file, or from a frame with the columns of a file, if need be."""
    from ident.measure import Campaign, read_campaign
    from ident.measure.reading import parse_campaign

    if isinstance(campaign, str | Path):
        return read_campaign(campaign)
    if hasattr(campaign, "to_csv"):
        return replace(parse_campaign(campaign.to_csv(index=False).encode("utf-8"), "campaign"), path="")
    if not isinstance(campaign, Campaign):
        raise refusal("campaign", f"a {type(campaign).__name__}", "a campaign, or its file", "see ident.read_campaign")
    return campaign
