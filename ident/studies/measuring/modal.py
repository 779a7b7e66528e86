"""From the files of a hammer or ambient test to a campaign: modes with their covariance, labels."""

import os
from collections.abc import Mapping
from dataclasses import field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ident.errors import refusal, require
from ident.studies import reading
from ident.studies.door import DEFAULT, study
from ident.studies.options import option, repeated
from ident.studies.result import Result
from ident.studies.shared import ProblemOptions, SamplesOptions, as_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ident.arm.arm import Arm
    from ident.description.file import ArmFile
    from ident.measure import Campaign
    from ident.measure.channels import ChannelTable
    from ident.measure.recordings.recording import SourceFile
    from ident.measure.reproducibility import Reproducibility
    from ident.modal.ambient import AmbientTest
    from ident.modal.finished import FinishedTest
    from ident.modal.frf import ModalTest, Processing
    from ident.studies.measuring.modal_campaign import IdentifiedModes, NamedModes

FINISHED = ("undamped", "pole", "damped")
"""Kinds of frequencies in a file of finished modes."""


class ModalOptions(ProblemOptions, SamplesOptions):
    """Options of `ident.modal_test`: from records to frequency responses, and the knowledge before the data.

    The unknowns and their priors bound how far a computed shape may be wrong; measured modes are named by these shapes.
    """

    estimator: str = option("h1", "h1 (noise of the responses), h2 (of the force) or hv", choices=("h1", "h2", "hv"))
    window_end: float = option(
        0.001, "share to which an exponential window fades each record, 1 for none", above=0.0, high=1.0
    )
    rest: float = option(1.0, "time [s] between two hits of one record: closer ones are one double hit", above=0.0)
    band: tuple[float, float] | None = option(
        None,
        "frequencies LOW:HIGH [Hz]; default: what the hammer excites, to 20 dB below its most; from 1 Hz without force",
        read=reading.band,
    )

    amplitude: float | None = option(
        None,
        "amplitude at work [mm] of the response that a mode moves most, at which free decays after taps give the mode;"
        " default: the middle of the decay",
        above=0.0,
    )
    modes: dict[str, tuple[float, ...]] = repeated(
        {},
        "frequencies [Hz] of the modes to take at a posture, by its number, as 2=4.45,5.01; may be repeated",
        read=reading.frequencies,
    )
    no_modes: bool = option(False, "frequency responses only")
    sigma: dict[str, float] = repeated(
        {},
        "standard deviation of finished modes whose file has none, as a share: frequency=0.002; damping_ratio; and"
        " shape, of its largest motion",
        read=reading.numbers,
    )
    frequency_is: str | None = option(
        None, "what the frequencies of finished modes are, where their file does not say it", choices=FINISHED
    )
    reproducibility: dict[str, float] = repeated(
        {},
        "how far a value differs when the test is set up from the start, as a share: 0.002 of each frequency, or"
        " frequency=0.002, damping_ratio=0.05; 0 for none; default: these, which are assumed, and what repeated tests"
        " of one posture show",
        read=reading.shares,
    )
    common_share: float = option(
        0.5,
        "share of that variance which all frequencies of a test have in common, and all damping ratios; assumed",
        low=0.0,
        high=1.0,
    )
    shapes: bool = option(False, "write the measured shapes into the campaign, as data of a fit")

    @property
    def processing(self) -> "Processing":
        """The options in the form of `ident.modal`."""
        from ident.modal.frf import Processing

        return Processing(self.estimator, self.window_end, self.rest, self.band)

    @property
    def known_reproducibility(self) -> "Reproducibility":
        """Prior reproducibility of tests, before any is seen."""
        from ident.measure.reproducibility import Reproducibility

        return Reproducibility.of(self.reproducibility, self.common_share)


class ModalResult(Result):
    """Frequency responses, or spectra of an ambient test, and modes.

    The figures show each posture's responses, and the poles from which its modes were chosen; the table has a row
    for each mode: posture [deg], frequency [Hz], damping ratio, their standard deviations, label.

    Attributes:
        arm: the arm as in its file, with the points that the channel table adds.
        tests: the tests, by posture and load.
        identified: modes of each test; empty if not requested.
        finished: files of finished modes.
        named: their modes.
        campaign: the named modes, with the correlation of their errors; None if not requested.
        files: recordings, by name, and the channel table.
        options: the options of the call.
        reproducibility: part of the campaign's sigmas beyond the scatter within a test; None without a campaign.
    """

    arm: "ArmFile"
    tests: "tuple[ModalTest | AmbientTest, ...]"
    identified: "tuple[IdentifiedModes, ...]" = ()
    finished: "tuple[FinishedTest, ...]" = ()
    named: "tuple[NamedModes, ...]" = ()
    campaign: "Campaign | None" = None
    files: "Mapping[str, SourceFile]" = field(default_factory=dict)
    options: ModalOptions = field(default_factory=ModalOptions)
    reproducibility: "Reproducibility | None" = None

    shown = ("tests", "identified", "finished", "named", "campaign", "reproducibility")
    made_from = ("arm", "files")
    summarised = ("hits", "rejected")

    @property
    def name(self) -> str:
        """Name of the folder of the recordings, and of the study."""
        return f"{Path(self.files['channels'].path).absolute().parent.name}.modal"

    @property
    def hits(self) -> int:
        """Number of accepted hits."""
        return sum(test.hits for test in self.hammer_tests)

    @property
    def hammer_tests(self) -> "tuple[ModalTest, ...]":
        """Tests with measured force."""
        from ident.modal.frf import ModalTest

        return tuple(test for test in self.tests if isinstance(test, ModalTest))

    @property
    def rejected(self) -> tuple[str, ...]:
        """Rejected hits, with the reason."""
        return tuple(
            f"{each.file}, hit {each.number}: {each.reason}" for test in self.hammer_tests for each in test.rejected
        )

    @property
    def doubtful(self) -> bool:
        """Whether driving points, reciprocal responses or hits contradict each other, or a record is too short."""
        return any(each.modes.doubtful for each in self.identified) or not all(test.good for test in self.hammer_tests)

    @property
    def short(self) -> bool:
        """Whether a search for the most probable modes has not converged."""
        from ident.modal.modes import Modes

        return any(isinstance(each.modes, Modes) and not each.modes.converged for each in self.identified)

    def _figures(self) -> "dict[str, Figure]":
        """Return for each posture its responses, the choice of its modes (`modes`), and `shapes`."""
        from ident.studies.measuring.modal_figure import argand_figure, measured_figure, stabilisation_figure

        words = ["" if i == 1 else str(i) for i in range(1, len(self.tests) + 1)]
        found = self.identified or (None,) * len(self.tests)
        figures = {word: measured_figure(test, each) for word, test, each in zip(words, self.tests, found, strict=True)}
        return figures | {
            f"{kind}{word}": draw(test, each)
            for kind, draw in (("modes", stabilisation_figure), ("shapes", argand_figure))
            for word, test, each in zip(words, self.tests, self.identified, strict=False)
        }

    def _write(self, path: Path, head: Mapping[str, Any]) -> tuple[Path, ...]:
        from ident.report.document import write_netcdf
        from ident.studies.measuring.modal_files import modal_groups, write_campaign_file

        responses = self._beside(path, ".nc")
        write_netcdf(responses, modal_groups(self.tests, head))
        written = responses, *super()._write(path, head)
        tables = self._beside(path, ".csv"), self._beside(path, ".covariance.csv")
        if not self.campaign:
            return written
        write_campaign_file(self.campaign, head, tables[0], self.reproducibility)
        return *tables, *written

    @classmethod
    def arguments(cls, inputs: Mapping[str, Path], summary: Mapping[str, Any]) -> dict[str, Any]:
        """Return the folder of the recordings, the channel table and the arm."""
        first = next(path for name, path in inputs.items() if name not in ("arm", "channels"))
        return {"tests": first.parent, "channels": inputs["channels"], "arm": inputs["arm"]}


@study
def modal_test(
    tests: str | Path,
    channels: "ChannelTable | str | Path | None" = None,
    arm: "ArmFile | None" = None,
    options: ModalOptions = DEFAULT,
) -> ModalResult:
    """Identify the modes of a hammer test, or of a test without force (taps, ambient), and name them by their shapes.

    Args:
        tests: folder of the recordings; files that the table does not name are ignored.
        channels: quantity of each channel; by default channels.csv in that folder.
        arm: the arm; by default arm.toml in that folder.
        options: windows, estimator and band [Hz], which modes to take, and the knowledge of the arm before the data.

    Raises:
        InputError: a file is damaged, the table is wrong, or they do not match; each error has a line.
    """
    from dataclasses import replace

    from ident.measure.channels import recordings_of
    from ident.measure.recordings.recording import SourceFile
    from ident.modal.ambient import measured_tests
    from ident.modal.finished import finished_tests
    from ident.studies.measuring.modal_campaign import (
        modal_campaign,
        observed_reproducibility,
        with_effect,
    )

    folder = Path(tests)
    reproducibility = options.known_reproducibility  # refused before any file is read
    table, arm, based = described(folder, channels, arm, options)
    recordings = recordings_of(folder, table, options.columns)
    measured = measured_tests(based, recordings, options.processing)
    files = {"channels": SourceFile(table.path, table.sha256)}
    finished = finished_tests(based, recordings, options.sigma, options.frequency_is)
    used = {name for test in measured for name in test.files} | {name for test in finished for name in test.files}
    files |= {
        name: SourceFile(each.path, each.sha256, each.remarks) for name, each in recordings.items() if name in used
    }
    identified, named = _identified(arm.arm, (measured, finished), options)
    result = ModalResult(arm, measured, identified, finished, named, None, files, options)
    if options.no_modes:
        return result
    every: tuple[ModalTest | AmbientTest | FinishedTest, ...] = (*measured, *finished)
    modes: tuple[IdentifiedModes | NamedModes, ...] = (*identified, *named)
    shown, name = observed_reproducibility(every, modes, reproducibility), f"{folder.absolute().name}.modal"
    campaign = modal_campaign(name, every, modes, shapes=options.shapes, reproducibility=shown)
    identified = tuple(with_effect(each, shown) for each in identified)
    return replace(result, identified=identified, campaign=campaign, reproducibility=shown)


def described(
    folder: Path, channels: "ChannelTable | str | Path | None", arm: "ArmFile | Path | None", options: ModalOptions
) -> "tuple[ChannelTable, ArmFile, ChannelTable]":
    """Return the channel table, the arm with its points, and the table with directions in the base frame.

    Raises:
        InputError: no such folder, or table or arm is wrong.
    """
    from dataclasses import replace

    from ident.description.file import ArmFile
    from ident.measure.channels import ARM, CHANNELS, ChannelTable, check_folder, read_channels
    from ident.studies.measuring.modal_campaign import in_base_frame, with_places

    check_folder(folder)
    table = channels if isinstance(channels, ChannelTable) else read_channels(channels or folder / CHANNELS)
    counting = any(row.counts for row in table.rows)
    require(counting, table.path, "no row of a response", "at least one", "fill in the column role", "role")
    file = arm if isinstance(arm, ArmFile) else as_file(arm or folder / ARM, options.soft_base)
    placed = with_places(file.arm, table)
    return table, replace(file, arm=placed), in_base_frame(placed, table)


def _identified(
    arm: "Arm", tests: "tuple[tuple[ModalTest | AmbientTest, ...], tuple[FinishedTest, ...]]", options: ModalOptions
) -> "tuple[tuple[IdentifiedModes, ...], tuple[NamedModes, ...]]":
    """Return the modes of each test, and those from files of finished modes, if requested."""
    from ident.identify.unknowns import stiffness_parameters
    from ident.studies.measuring.modal_campaign import identify_modes, name_modes

    if options.no_modes:
        require(options.amplitude is None, "amplitude", "it with `no_modes`", "nothing", "leave one of them out")
        return (), ()
    near = {int(number): frequencies for number, frequencies in options.modes.items()}
    parameters = stiffness_parameters(arm, options.unknowns)
    measured, finished = tests
    amplitude = None if options.amplitude is None else options.amplitude / 1e3
    how: dict[str, Any] = {"near": near, "seed": options.seed, "amplitude": amplitude}
    identified = identify_modes(arm, measured, parameters, **how) if measured or amplitude else ()
    return identified, name_modes(arm, finished, parameters, seed=options.seed)


modal = modal_test
"""The study under the name in its result files."""


def new_channels(
    tests: str | Path, channels: str | Path | None = None, arm: str | Path | None = None
) -> tuple[Path, int]:
    """Write a channel table to fill in for the recordings of a folder, and return its path and its number of rows.

    Args:
        tests: folder of the recordings.
        channels: path of the table; by default channels.csv in that folder.
        arm: its number of joints; by default that of arm.toml in that folder, else one.

    Raises:
        InputError: no recordings, or the table already exists.
    """
    from ident.measure.channels import ARM, CHANNELS, write_template

    folder = Path(tests)
    beside = folder / ARM
    source = arm or (beside if os.path.exists(beside) else None)
    joints = len(as_file(source).arm.driven) if source else 1
    path = Path(channels) if channels else folder / CHANNELS
    if os.path.isdir(path):
        raise refusal(str(path), "a folder", "a file to write", "name the table")
    return path, write_template(folder, path, joints)
