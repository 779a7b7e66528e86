"""Report which joint stiffness changed between two campaigns, by how much, and how certain that is."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, cast

from ident.errors import refusal, require
from ident.files import SourceFile
from ident.studies import reading
from ident.studies.door import DEFAULT, study
from ident.studies.options import repeated
from ident.studies.result import Result
from ident.studies.shared import ProblemOptions, UnitOptions, as_campaign, as_file
from ident.text import one_line, quoted, study_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ident.identify.compare import Comparison, Posterior
    from ident.identify.fit import CampaignFit
    from ident.studies.saved import Saved


class CompareOptions(UnitOptions):
    """Options of `ident.compare`."""

    same: tuple[str, ...] = repeated(
        (), "stiffness that is known not to have changed, as joint1.k_bend; may be repeated", read=reading.names
    )


Compared: TypeAlias = "Result | Saved | str | Path"
"""What can be compared: a result, its file, a campaign file, or a folder of results."""
ENDS = (".fit.json", ".sample.nc", ".diagnose.json")
"""File endings that are compared in two folders: for each campaign the first ending that both folders have."""


class CompareResult(Result):
    """Stiffness changes between two campaigns, or between the campaigns of two folders.

    The table has a row for each stiffness: both values [SI], their ratio with its 95 % interval, the probability of so
    large a change by chance, and whether it counts as changed. The figures show the ratios.

    Attributes:
        comparisons: for each pair of campaigns the joint fit and the changes.
        unpaired: files that only one of two folders has.
        files: files of the compared results, pair by pair.
        options: the options of the call.
    """

    comparisons: "tuple[Comparison, ...]"
    unpaired: tuple[str, ...] = ()
    files: tuple[tuple[SourceFile, SourceFile], ...] = ((SourceFile(), SourceFile()),)
    options: CompareOptions = field(default_factory=CompareOptions)

    shown = ("comparisons", "unpaired")

    @property
    def comparison(self) -> "Comparison":
        """The first pair, usually the only one."""
        return self.comparisons[0]

    @property
    def name(self) -> str:
        """Names of both campaigns, or of both folders."""
        if len(self.files) == 1 and not self.unpaired:
            return f"{'-'.join(dict.fromkeys(self.comparison.names))}.compare"
        first, second = (Path(file.path).absolute().parent.name for file in self.files[0])
        return f"{first}-{second}.compare"

    @property
    def changed(self) -> Mapping[str, bool]:
        """Whether each stiffness of the first pair has changed."""
        change = self.comparison.change
        return dict(zip(change.names, map(bool, change.changed), strict=True))

    def _figures(self) -> "dict[str, Figure]":
        """Return a figure for each pair: the ratio after / before of each stiffness, with its 95 % interval."""
        from ident.studies.stiffness.compare_figure import compare_figure

        one = len(self.comparisons) == 1
        return {"" if one else each.name: compare_figure(each) for each in self.comparisons}

    def _inputs(self) -> Mapping[str, Any]:
        one, pairs = len(self.files) == 1, enumerate(self.files, 1)
        return {f"{word}{'' if one else i}": file for i, pair in pairs for word, file in zip(WORDS, pair, strict=True)}

    @classmethod
    def arguments(cls, inputs: Mapping[str, Path], summary: Mapping[str, Any]) -> dict[str, Any]:
        """Return the files of all pairs as the two arguments of `compare`."""
        files = list(inputs.values())
        return dict(zip(WORDS, (files[::2], files[1::2]) if len(files) > 2 else files, strict=True))


WORDS = ("first", "second")


@study
def compare(
    first: "Compared | Sequence[Compared]", second: "Compared | Sequence[Compared]", options: CompareOptions = DEFAULT
) -> CompareResult:
    """Report which joint stiffness changed between two campaigns, by how much, and how certain that is.

    Both campaigns are fitted again in one joint fit, with the changes free: shared uncertainty, such as the prior or an
    uncertain mass, counts once. Draws of another program come without measurements: both are then taken as independent.
    Each result of a folder is compared with the result of the same name in the other folder.

    Args:
        first: the earlier result of `fit`, `sample` or `diagnose`, its file, a posterior as netCDF, a campaign (CSV,
            with arm.toml in its folder), which is fitted, or a folder; or several of them.
        second: the later one, or as many.
        options: among others, what is known not to have changed.

    Raises:
        InputError: results of other studies, folders without results of the same name, no stiffness in both fits, or
            an unknown name.
    """
    pairs, unpaired = _pairs(first, second)
    found = [tuple(_known(each, word) for each, word in zip(pair, WORDS, strict=True)) for pair in pairs]
    files = tuple((one, other) for (_, one), (_, other) in found)
    comparisons = tuple(_compared(one, other, options.same) for (one, _), (other, _) in found)
    return CompareResult(comparisons, unpaired, files, options)


def _compared(one: "CampaignFit | Posterior", other: "CampaignFit | Posterior", same: tuple[str, ...]) -> "Comparison":
    from ident.identify.compare import Posterior, compare_fits, compare_posteriors

    if isinstance(one, Posterior) or isinstance(other, Posterior):
        return compare_posteriors(one, other, same)
    return compare_fits(one, other, same)


def _pairs(
    first: "Compared | Sequence[Compared]", second: "Compared | Sequence[Compared]"
) -> "tuple[list[tuple[Compared, Compared]], tuple[str, ...]]":
    """Return the pairs to compare, and the files that only one of two folders has."""
    if isinstance(first, list | tuple) and isinstance(second, list | tuple):
        if not len(first) == len(second) > 0:
            raise refusal("second", f"{len(second)} results", f"{len(first)} of them", "give pairs")
        return list(zip(first, second, strict=True)), ()
    folders = [Path(each) for each in (first, second) if isinstance(each, str | Path) and os.path.isdir(each)]
    if not folders:
        return [(cast("Compared", first), cast("Compared", second))], ()
    where = one_line(str(folders[0]))
    require(len(folders) != 1, where, "a folder", "two files or two folders", "give what belongs to it")
    ours, theirs = map(_results_in, folders)
    pairs: list[tuple[Any, Any]] = []
    for campaign in sorted(ours.keys() & theirs.keys()):
        if end := next((end for end in ENDS if end in ours[campaign] and end in theirs[campaign]), ""):
            pairs.append((ours[campaign][end], theirs[campaign][end]))
    paired = {Path(path) for pair in pairs for path in pair}
    named = {path.name.removesuffix(end) for path in paired for end in ENDS}
    got, where = "no result of one name in both", " and ".join(one_line(str(folder)) for folder in folders)
    require(pairs, where, got, f"files {' or '.join(ENDS)}", "fit both campaigns under one name")
    alone = [path for side in (ours, theirs) for c, files in side.items() if c not in named for path in files.values()]
    return pairs, tuple(map(str, alone))


def _results_in(folder: Path) -> dict[str, dict[str, Path]]:
    """Return the results of a folder that can be compared, by campaign name and file ending."""
    found: dict[str, dict[str, Path]] = {}
    for path in sorted(folder.iterdir()):
        for end in ENDS:
            if path.name.endswith(end):
                found.setdefault(path.name.removesuffix(end), {})[end] = path
    return found


def _known(result: "Compared", name: str) -> "tuple[CampaignFit | Posterior, SourceFile]":
    """Return the fit or the posterior draws of a result, and its file."""
    import hashlib

    from ident.studies.saved import Saved, load

    file = SourceFile()
    if isinstance(result, str | Path):
        path = Path(result)
        known = _fitted(path) if path.suffix == ".csv" else _foreign(path)
        result = load(path) if known is None else result
        file = SourceFile(str(path), hashlib.sha256(path.read_bytes()).hexdigest())
        if known is not None:
            return known, file
    if isinstance(result, Result | Saved) and (fitted := result.fitted) is not None:
        return fitted, replace(file, notes=result.notes if isinstance(result, Saved) else ())
    got = quoted(study_of(result.form)) if isinstance(result, Result) else type(result).__name__
    raise refusal(file.path or name, f"a result of {got}", "one of fit, sample or diagnose", "give that")


def _fitted(campaign: Path) -> "CampaignFit":
    """Fit a campaign with the arm file in its folder, as `ident fit` does."""
    from ident.identify.fit import fit_campaign

    arm = as_file(campaign.parent / "arm.toml")
    return fit_campaign(arm.arm, as_campaign(campaign), ProblemOptions().unknowns_of(arm))


def _foreign(path: Path) -> "Posterior | None":
    """Return the draws from a file of another program; None for a file of ident, or without a file."""
    from ident.identify.compare import Posterior
    from ident.report.document import is_of_ident
    from ident.studies.result_values import read_posterior

    if path.suffix != ".nc" or not os.path.isfile(path) or is_of_ident(path):
        return None
    draws = read_posterior(path).by_paths
    values = {name: own for (name, *tied), own in draws.items() if name.endswith(STIFFNESSES) and not tied}
    where = one_line(str(path))
    if bad := [name for name, own in values.items() if len(own) <= len(values) or not (own > 0).all()]:
        raise refusal(where, "other values", f"positive numbers, more than {len(values)} draws", "correct it", bad[0])
    return Posterior(path.name.removesuffix(".nc"), values)


STIFFNESSES = (".k_bend", ".k_tors")
"""Endings of the names of compared parameters."""
