"""Say which joint stiffness has changed between two campaigns, by how much, and how sure that is."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ident.errors import InputError, Problem
from ident.studies import reading
from ident.studies.options import Options, option
from ident.studies.result import Result, study_of
from ident.text import quoted

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ident.identify.compare import Comparison
    from ident.identify.fit import CampaignFit


@dataclass(frozen=True, kw_only=True)
class CompareOptions(Options):
    """Options of `ident.compare`."""

    same: tuple[str, ...] = option(
        (),
        "stiffness that is known not to have changed, as joint1.k_bend; may be repeated",
        repeated=True,
        read=reading.names,
    )


@dataclass(frozen=True)
class ComparedFile:
    """A result that was compared: its file, where there is one.

    Attributes:
        path: the file.
        sha256: hash of its bytes.
    """

    path: str = ""
    sha256: str = ""


@dataclass(frozen=True, repr=False, eq=False)
class CompareResult(Result):
    """Which stiffnesses have changed between two campaigns.

    Its table has a row for each: both values [SI], their ratio with its 95 % interval, the chance of so large a change
    where nothing has changed, and whether it counts as changed. Its figure shows the ratios.

    Attributes:
        comparison: both campaigns, fitted together, and the changes.
        files: of the results that were compared.
        options: what was asked for.
    """

    comparison: "Comparison"
    files: tuple[ComparedFile, ComparedFile] = (ComparedFile(), ComparedFile())
    options: CompareOptions = field(default_factory=CompareOptions)

    form = "ident-compare/1"
    subject = "comparison.name"
    shown = ("comparison",)
    summary = ("comparison.change.p_value", "comparison.change.statistic")

    @property
    def changed(self) -> Mapping[str, bool]:
        """Whether each stiffness has changed."""
        change = self.comparison.change
        return dict(zip(change.names, map(bool, change.changed), strict=True))

    def figures(self) -> "dict[str, Figure]":
        """Return one figure: the ratio of each stiffness after to before, with its 95 % interval."""
        from ident.present.figures.compare import compare_figure

        return {"": compare_figure(self.comparison)}

    def _inputs(self) -> Mapping[str, Any]:
        return dict(zip(("first", "second"), self.files, strict=True))


def compare(
    first: "Result | str | Path", second: "Result | str | Path", options: CompareOptions | None = None
) -> CompareResult:
    """Say which joint stiffness has changed between two campaigns, by how much, and how sure that is.

    Both campaigns are fitted again together, with the changes free: what they have in common, such as the prior and an
    uncertain mass, counts once.

    Args:
        first: the earlier result of `fit`, `sample` or `diagnose`, or its file.
        second: the later one.
        options: what is known not to have changed.

    Raises:
        InputError: other results, no stiffness that both have fitted, or a name that is none of them.
    """
    from ident.identify.compare import compare_fits

    options = CompareOptions.of(options)
    (one, its_file), (other, other_file) = (
        _fit_of(each, name) for each, name in ((first, "first"), (second, "second"))
    )
    return CompareResult(compare_fits(one, other, options.same), (its_file, other_file), options)


def _fit_of(result: "Result | str | Path", name: str) -> "tuple[CampaignFit, ComparedFile]":
    """Return the fit that a result holds, and its file."""
    import hashlib

    from ident.studies.diagnose import DiagnoseResult
    from ident.studies.fit import FitResult
    from ident.studies.load import load
    from ident.studies.sample import SampleResult

    file = ComparedFile()
    if isinstance(result, str | Path):
        path, result = Path(result), load(result)
        file = ComparedFile(str(path), hashlib.sha256(path.read_bytes()).hexdigest())
    if isinstance(result, FitResult):
        return result.fit, file
    if isinstance(result, SampleResult):
        return result.sample.fitted, file
    if isinstance(result, DiagnoseResult):
        return result.diagnosis.identification.sampled.fitted, file
    got = quoted(study_of(result.form)) if isinstance(result, Result) else type(result).__name__
    raise InputError(Problem(file.path or name, f"a result of {got}", "one of fit, sample or diagnose", "give that"))
