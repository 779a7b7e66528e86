"""The result of every study: frozen, with report, figures, table and files."""

import hashlib
import inspect
import json
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from functools import wraps
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, TypeVar, cast, dataclass_transform, get_args

from ident.errors import InputError, ModelError, refusal
from ident.report.report import WIDTH, Report, html_of, text_of
from ident.studies import STUDIES, module_of
from ident.studies.following import kept_in, next_command
from ident.studies.options import Options
from ident.text import NEWEST, one_line, study_of
from ident.units import USUAL, stiffness_in

if TYPE_CHECKING:
    import pandas
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ident.identify.fit import CampaignFit

BESIDE = "'s "
"""Between an input and a companion file that was read with it: `campaign's covariance`."""
SIDE_FILES = ("covariance", "setups", "bushings")
"""Possible companion files of an input: its attributes."""
TEXTS = ("arm", "campaign", "path", "channels")
"""First words of the inputs whose text a result stores."""
LONGEST_TEXT = 5_000_000
"""Largest stored text [bytes]; of a longer one only path and hash are stored."""

SHOWING = (*("sections", "_figures", "save_figures"), *("frequency_figure", "path_figure", "animation", "_write"))
"""Methods that show stiffnesses in display units."""
R = TypeVar("R")
"""Return type of such a method."""


Wrap = Callable[[Iterable[int]], Iterator[int]]
"""Passes numbers on, one for each step of the work."""


class Progress(Protocol):
    """Shows the progress of long work."""

    def __call__(self, description: str, total: int | None = None) -> Wrap:
        """Return a wrapper that shows a bar over an iterable of numbers, with a description."""
        ...


def _finite(value: Any) -> bool:
    """Whether all numbers of a value are finite; None is no number."""
    import numpy as np

    if isinstance(value, Mapping):
        return all(map(_finite, value.values()))
    if isinstance(value, tuple):
        return all(map(_finite, value))
    return value is None or bool(np.isfinite(np.asarray(value)).all())


def silent(description: str, total: int | None = None) -> Wrap:
    """Show nothing."""
    return iter


LONG = ("sample", "diagnose", "fleet")
"""Long studies: their result is not overwritten by one with other inputs."""


def other_inputs(result: "Result", folder: Path) -> str:
    """Say how the inputs of an existing result of a long study differ from these; empty if they don't.

    Inputs are compared by content; a file of ident itself contains its date, so it is also compared by path. Inputs
    that either result lacks are not compared, so that a fleet can grow.
    """
    there = folder / f"{result.name}{result.suffix}"
    if study_of(result.form) not in LONG or not os.path.exists(there):
        return ""
    old, new = _inputs_of(there), result.inputs
    common = [each for each in new if each in old]
    which = next((each for each in common or old if each not in new or not _same(old[each], new[each])), "")
    was, now = _origin(old.get(which)), _origin(new.get(which))
    return f"{which}: {was}{', since changed' * (was == now)}" if which else ""


def _with_what_lies_beside(inputs: Mapping[str, Any]) -> Mapping[str, Any]:
    pairs = [(name + BESIDE + word, getattr(each, word, None)) for name, each in inputs.items() for word in SIDE_FILES]
    pairs += [("runs" + BESIDE + word, file) for word, file in getattr(inputs.get("runs"), "files", {}).items()]
    return {**inputs, **{name: source for name, source in pairs if source is not None and source.path}}


def input_of(name: str) -> str:
    """Return the main input of a companion file: `campaign` for `campaign's covariance`."""
    if name.startswith("runs" + BESIDE):
        return "runs"
    return next((name.removesuffix(end) for end in (BESIDE + word for word in SIDE_FILES) if name.endswith(end)), name)


def _inputs_of(path: Path) -> Mapping[str, Any]:
    """Return the inputs of an existing result; empty if it can't be read."""
    from ident.report.document import EXPECTED, read_document, read_group, whole

    try:
        if path.suffix == ".json":
            inputs = read_document(path, EXPECTED).get("inputs")
        else:
            with whole(path, "other contents", EXPECTED, "give the file that ident wrote"):
                inputs = json.loads(read_group(path).attrs["inputs"])
    except InputError:
        return {}
    return inputs if isinstance(inputs, Mapping) else {}


def _same(old: Any, new: Any) -> bool:
    """Whether an input is the same: by content, or by path for a file that ident has written."""
    if new is None or not isinstance(old, Mapping):
        return new is None and not old
    of_ident = any(word in STUDIES for word in Path(new.path).name.split(".")[1:])
    return old.get("sha256") == new.sha256 or (of_ident and old.get("path") == new.path)


def _text(name: str, source: Any) -> str | None:
    """Return the text of an input, if its result stores it: arms, campaigns and their companion files."""
    if source is None or not source.path or input_of(name).split()[0] not in TEXTS:
        return None
    try:
        data = Path(source.path).read_bytes()
        text = data.decode("utf-8")
    except (OSError, UnicodeDecodeError):
        return None
    same = len(data) <= LONGEST_TEXT and hashlib.sha256(data).hexdigest() == source.sha256
    return text if same and "<include" not in text else None  # MJCF in several files is found on disk


def _text_of_part(campaign: Any) -> str:
    """Return a campaign as text if it differs from its file; empty if it does not, or if text can't hold all of it."""
    from ident.measure import Campaign, read_campaign
    from ident.measure.reading import campaign_text

    if not isinstance(campaign, Campaign) or campaign.covariance or campaign.setups.each:
        return ""
    with suppress(InputError):
        if campaign.path and read_campaign(campaign.path) == campaign:
            return ""
    return campaign_text(campaign)


def _origin(source: Any) -> str:
    path = source.get("path") if isinstance(source, Mapping) else getattr(source, "path", None)
    return one_line(str(path)) if path else "none"


class Figures(dict[str, "Figure"]):
    """Figures by name, the main one by the name of its study; `figures[""]` is the main one, too."""

    def __missing__(self, name: str) -> "Figure":
        if name or not self:
            raise KeyError(name)
        return next(iter(self.values()))


def _in_its_unit(show: Callable[..., R]) -> Callable[..., R]:
    """Wrap a method of a result so that it shows stiffnesses in the unit of its options."""

    @wraps(show)
    def shown(self: "Result", *given: Any, **named: Any) -> R:
        with stiffness_in(getattr(vars(self)["options"], "units", USUAL)):
            return show(self, *given, **named)

    return shown


class Alias(property):
    """A property forwarded from the value of a study; its docstring is its line among the `Attributes` of the class."""

    def __set_name__(self, owner: type, name: str) -> None:
        (kind,) = get_args(owner.__annotations__[name])
        self.fget.__annotations__["return"] = getattr(kind, "__forward_arg__", kind)
        line = re.search(rf"^    {name}: (.*(?:\n {{8}}.*)*)", inspect.cleandoc(owner.__doc__ or ""), re.MULTILINE)
        words = " ".join(line[1].split()) if line else ""
        self.__doc__ = words[:1].upper() + words[1:]


def alias(path: str) -> Any:
    """Return a property that follows a path; a class declares its type, `time: ClassVar[float]`, for type checkers."""

    def get(result: Any) -> Any:
        return attrgetter(path)(result)

    return Alias(get)


class Reported:
    """Base class of everything with a report; it prints as the first screen."""

    def __str__(self) -> str:
        return self.report()

    def __repr__(self) -> str:
        return f"<ident {type(self).__name__} {getattr(self, 'name', '')}: print it for the report>"

    @property
    def notes(self) -> tuple[str, ...]:
        """Differences between the arm and its robot description."""
        return ()

    def sections(self) -> Report:
        """Return the report: verdict, tables, findings, details."""
        raise NotImplementedError

    def document(self) -> dict[str, Any]:
        """Return the same for programs."""
        raise NotImplementedError

    @property
    def verdict(self) -> str | None:
        """Word of the verdict in the report, as GOOD; None for a study that judges nothing."""
        verdict = self.sections().verdict
        return verdict.word if verdict else None

    def _repr_html_(self) -> str:
        """Return the first screen as HTML for a notebook."""
        return html_of(self.sections())

    def table(self) -> list[dict[str, Any]]:
        """Return the main numbers as rows; empty without a table."""
        return []

    def to_dataframe(self) -> "pandas.DataFrame":
        """Return the table as a pandas frame."""
        import pandas

        return pandas.DataFrame(self.table())

    def report(self, *, details: bool = False, width: int = WIDTH, colour: bool = False) -> str:
        """Return the text that the command prints, see `text_of`."""
        return text_of(self.sections(), details=details, width=width, colour=colour)


@dataclass_transform(eq_default=False, frozen_default=True, field_specifiers=(field,))
class Result(Reported):
    """Result of a study, with its inputs and options: a frozen dataclass, as each of its subclasses.

    `print(result)` prints what the command prints; `ident.load` reads a saved result again. Results are compared by
    identity: they hold too many numbers for equality to be meaningful.
    """

    form: ClassVar[str]
    """Format and version of its file: by default named by the study's module."""
    suffix: ClassVar[str] = ".json"
    """Ending of its file's name."""
    subject: ClassVar[str]
    """Path to the name of the studied object."""
    shown: ClassVar[tuple[str, ...]]
    """The fields behind its report, figure and table; by default the first one that is neither arm nor label."""
    drawn: ClassVar[tuple[str, ...] | None] = None
    """The fields behind its figure, if they differ; empty without a figure."""
    listed: ClassVar[tuple[str, ...] | None] = None
    """The fields behind its table, if they differ."""
    made_from: ClassVar[tuple[str, ...]]
    """Paths to its inputs, or to several by name; the name is the end of the path, or given by `path as name`."""
    summarised: ClassVar[tuple[str, ...]] = ()
    """Content of its file besides the table: names or paths of properties."""
    numbers: ClassVar[tuple[str, ...]] = ()
    """Its essential numbers, as paths; all must be finite, else there is no result."""

    def __post_init__(self) -> None:
        for path in self.numbers:
            if not _finite(attrgetter(path)(self)):
                raise ModelError(
                    f"no {study_of(self.form)}: its {path.rpartition('.')[2]} are beyond all numbers; "
                    "check the sizes of what was given: stiffnesses, masses, sigmas, and their units"
                )

    def __init_subclass__(cls, **more: Any) -> None:
        super().__init_subclass__(**more)
        if "form" not in cls.__dict__:
            cls.form = f"ident-{cls.__module__.rpartition('.')[2]}/{NEWEST}"
        for name in SHOWING:
            if name in cls.__dict__:
                setattr(cls, name, _in_its_unit(cls.__dict__[name]))
        dataclass(frozen=True, repr=False, eq=False)(cls)
        if not hasattr(cls, "shown"):
            cls.shown = (next(each.name for each in fields(cls) if each.name not in ("arm", "label")),)  # type: ignore[arg-type]

    @property
    def name(self) -> str:
        """Base name of its files: the studied object, and the study."""
        return re.sub(r"[/\\\0]", "_", f"{attrgetter(self.subject)(self)}.{study_of(self.form)}")

    @property
    def main_figure(self) -> str:
        """Name of the main figure: that of the study, or of its file."""
        return self.name.rpartition(".")[2]

    @classmethod
    def arguments(cls, inputs: Mapping[str, Path], summary: Mapping[str, Any]) -> dict[str, Any]:
        """Return the arguments of its study for a repetition, from its summary: files of its inputs by name."""
        return dict(inputs)

    @property
    def short(self) -> bool:
        """Whether a computation missed its own criterion: chains too short, no optimum."""
        return False

    @property
    def doubtful(self) -> bool:
        """Whether the data contradict each other, or the model."""
        return False

    @_in_its_unit
    def sections(self) -> "Report":
        """Return the report of the result: verdict, tables, findings, details."""
        report: Report = self._present("_report", "sections")
        return replace(report, next=next_command(report.next, self.inputs, vars(self)["options"], self.name))

    def figures(self, ax: "Axes | None" = None) -> Figures:
        """Return matplotlib figures by name; the main one has the study's name, and files without a further word.

        Args:
            ax: draw the main figure into these axes, if it has one panel.

        Raises:
            InputError: `ax` for a figure of several panels.
        """
        if ax is None:
            drawn = self._figures()
        else:
            from ident.report.style import drawn_into

            with drawn_into(ax):
                drawn = self._figures()
            drawn = {**drawn, next(iter(drawn)): cast("Figure", ax.figure)}
        return Figures({word or self.main_figure: figure for word, figure in drawn.items()})

    @_in_its_unit
    def _figures(self) -> "Mapping[str, Figure]":
        """Return the figures, the main one first and without a name."""
        return {} if self.drawn == () else {"": self._present("_figure", "figure")}

    def table(self) -> list[dict[str, Any]]:
        """Return the main numbers as rows, for `pandas.DataFrame`."""
        rows: list[dict[str, Any]] = self._present("_report", "rows")
        return rows

    @property
    def summary(self) -> Mapping[str, Any]:
        """Its main numbers besides the table, by name [SI]; those that its file has."""
        return {name.rpartition(".")[2]: attrgetter(name)(self) for name in self.summarised}

    def document(self) -> dict[str, Any]:
        """Return for programs its provenance, summary and table."""
        return self._document(self.head)

    def _document(self, head: Mapping[str, Any]) -> dict[str, Any]:
        from ident.report.document import plain

        notes = {"notes": list(self.notes)} if self.notes else {}
        return {**head, **notes, **plain({**self.sections().judged, "summary": self.summary, "table": self.table()})}

    def save(self, path: str | Path) -> tuple[Path, ...]:
        """Write the result's files, all of them or none, and return their paths; files of the same name are replaced.

        Args:
            path: the main file, ending as its format demands, or a folder, in which the files get the result's name.

        Raises:
            InputError: a file of another ending, or the folder or a file can't be written.
        """
        from ident.files import together

        path = Path(path)
        if path.suffix != self.suffix:
            if path.suffix in (".json", ".nc", ".csv", ".txt", ".toml", ".html", ".png") and not os.path.isdir(path):
                remedy = "name the file so, or a folder"
                raise refusal(str(path), f"the ending {path.suffix}", f"a file *{self.suffix}", remedy)
            path = path / f"{self.name}{self.suffix}"
        with together(), kept_in(path.parent):
            return self._write(path, self.head)

    def save_figures(self, folder: str | Path) -> tuple[Path, ...]:
        """Write the figures as PNG into a folder, all or none, under the result's name, and return their paths.

        Raises:
            InputError: the folder or a file can't be written.
        """
        from ident.files import together
        from ident.report.document import save

        written = []
        with together():
            for name, figure in self.figures().items():
                word = "" if name == self.main_figure else name
                written.append(Path(folder) / f"{self.name}{'.' * bool(word)}{word}.png")
                save(figure, written[-1])
        return tuple(written)

    def _present(self, part: str, what: str) -> Any:
        """Return a part of the result from a report or figure file: the report of a fit from `fit_sections`."""
        study = study_of(self.form)
        own = {"figure": self.drawn, "rows": self.listed}.get(what) or self.shown
        show = getattr(module_of(study, part), f"{study}_{what}")
        return show(*(attrgetter(name)(self) for name in own))

    def _beside(self, path: Path, suffix: str) -> Path:
        """Return the path of a further file: its name ends in the study's, so that it replaces no other file."""
        stem, study = path.name.removesuffix(self.suffix), study_of(self.form)
        return path.with_name(f"{stem}{suffix}" if study in stem.split(".") else f"{stem}.{study}{suffix}")

    @property
    def inputs(self) -> Mapping[str, Any]:
        """Inputs from files, each with `path` and `sha256`, by name; None for inputs that were not given."""
        return _with_what_lies_beside(self._inputs())

    @property
    def notes(self) -> tuple[str, ...]:
        """Differences between an arm and its URDF or MJCF: fixed joints, ignored limits, other names."""
        return tuple(dict.fromkeys(note for source in self._inputs().values() for note in getattr(source, "notes", ())))

    def standard_errors(self) -> list[dict[str, float]]:
        """Return the Monte Carlo standard errors [SI] of the sampled numbers of the table, by row, or none."""
        return []

    def _inputs(self) -> Mapping[str, Any]:
        inputs = dict[str, Any]()
        for each in self.made_from:
            path, _, name = each.partition(" as ")
            found = attrgetter(path)(self)
            inputs |= found if isinstance(found, Mapping) else {name or path.rpartition(".")[2]: found}
        return inputs

    @property
    def head(self) -> dict[str, Any]:
        """Head of its file: format, software, options, inputs and the robot, in JSON types."""
        from ident.report.document import provenance

        options: Options = vars(self)["options"]
        head = provenance(self.form, self.inputs, options.recorded())
        arm = getattr(self.inputs.get("arm"), "arm", None)
        if arm is not None:
            from ident.identify.values import Robot

            head["robot"] = Robot.of(arm).document
        return head

    @property
    def fitted(self) -> "CampaignFit | None":
        """The fit of the result, or the fit it started from; None for a study without one."""
        return None

    def _write(self, path: Path, head: Mapping[str, Any]) -> tuple[Path, ...]:
        """Write the files of a result, by default the one for `ident.load`."""
        from ident.report.document import write_json

        write_json(self._record(head), path)
        return (path,)

    def _record(self, head: Mapping[str, Any]) -> dict[str, Any]:
        """Return the complete record of the result in JSON types: numbers and texts, no class of the program."""
        from ident.report.document import plain, report_data

        texts = {name: text for name, source in self.inputs.items() if (text := _text(name, source)) is not None}
        document = self._document(head)
        campaign = self.inputs.get("campaign")
        if campaign is not None and (own := _text_of_part(campaign)):
            # a part of a file, or values without a file, are stored as a file of their own
            source = {"path": campaign.path or "campaign.csv", "sha256": hashlib.sha256(own.encode()).hexdigest()}
            document["inputs"] = {**document["inputs"], "campaign": source}
            texts["campaign"] = own
        return {
            **document,
            "name": self.name,
            "standard_errors": plain(self.standard_errors()),
            "fit": self.fitted and plain(self.fitted.state(), repr),
            "texts": texts,
            "report": report_data(self.sections()),
        }
