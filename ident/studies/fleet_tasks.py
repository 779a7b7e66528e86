"""The robots of a fleet as tasks: each reads its files and writes one, whole or not at all.

What a task writes depends on its inputs, its options and the program alone, and its file is named by a hash of these:
whoever does it, and how often, the file is the same.
"""

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from ident.codec import CodecError, decode, encode
from ident.errors import IdentError
from ident.files import replace_file
from ident.text import one_line
from ident.units import USUAL

if TYPE_CHECKING:
    from ident.arm.arm import Arm
    from ident.identify.fleet import Robot, SourceFile
    from ident.identify.fleet_batch import Given
    from ident.inference.population_chains import Draws, Under
    from ident.studies.fleet import FleetOptions

KILLS = 3
"""Workers that a robot may have killed before it is given up."""
KILLED = f"its computation was killed {KILLS} times; look at the memory, or fit it alone"
"""Why such a robot has no fit."""


class Task:
    """What is done at once, and kept in a file of its own."""

    folder: Path

    @property
    def file(self) -> Path:
        """Where the result goes, named by all that it depends on."""
        raise NotImplementedError

    def results(self) -> tuple[Any, ...]:
        """Return what is asked for, or which input is wrong."""
        raise NotImplementedError

    def read(self) -> tuple[Any, ...] | None:
        """Return what was written; None where nothing was, or the file is damaged."""
        try:
            results = decode(json.loads(self.file.read_text("utf-8")))
        except (OSError, ValueError, RecursionError, CodecError):
            return None
        return results if isinstance(results, tuple) else None

    def do(self) -> str:
        """Do what is asked for, and write it.

        Returns:
            What nobody has expected, such as an error of a library; of it nothing is kept, since it may not come again.

        Raises:
            InputError: the folder can't be written.
        """
        file = self.file  # before the inputs are read: had one changed since, the name would not be of the new one
        try:
            text = json.dumps(encode(self.results()))
        except Exception as error:
            got = one_line(f"{type(error).__name__}: {error}")[:300]
            return f"an error in the program or a library ({got}); fit it alone to see more, and report it"
        replace_file(file, lambda out: out.write(text.encode("utf-8")), make_folders=True)
        return ""


T = TypeVar("T", bound=Task)


@dataclass(frozen=True)
class One(Task):
    """A robot to be fitted by itself.

    Attributes:
        name: the robot's.
        campaign: its measurements, a CSV file.
        arm: its description, a TOML file.
        options: of its fit.
        folder: where its result goes.
    """

    name: str
    campaign: Path
    arm: Path
    options: "FleetOptions"
    folder: Path

    @property
    def key(self) -> str:
        """A hash of inputs and options, of the program's sources and libraries, and of the machine."""
        from ident.programs import environment  # it imports jax

        options = {**self.options.of_each.recorded(), "units": USUAL}
        paths = [str(self.campaign), str(self.arm)]
        parts = [self.name, paths, digest(self.campaign), digest(self.arm), encode(options), environment()]
        return hashed(parts)

    @property
    def file(self) -> Path:
        """Where the result goes."""
        return self.folder / f"{self.key}.robot"

    @property
    def sources(self) -> "tuple[SourceFile, SourceFile]":
        """Campaign and arm as they are now."""
        from ident.identify.fleet import SourceFile

        return SourceFile(str(self.campaign), digest(self.campaign)), SourceFile(str(self.arm), digest(self.arm))

    def results(self) -> "tuple[Robot, ...]":
        """Fit the robot, or say which input is wrong."""
        from ident.identify.fleet import robot_of
        from ident.studies.fit import fit

        sources = self.sources
        try:
            return (robot_of(fit(self.arm, self.campaign, self.options).fit, self.name, *sources),)
        except IdentError as error:
            return (self.failed(str(error)),)

    def failed(self, error: str) -> "Robot":
        """Return the robot as one without a fit."""
        from ident.identify.fleet import Robot

        campaign, arm = self.sources
        return Robot(name=self.name, campaign=campaign, arm=arm, error=error)


@dataclass(frozen=True)
class Batch(Task):
    """Robots that are fitted together where they were measured in the same way.

    Attributes:
        members: the robots.
        size: robots that the program is for.
        folder: where the result goes.
    """

    members: tuple[One, ...]
    size: int
    folder: Path

    @property
    def file(self) -> Path:
        """Where the result goes."""
        return self.folder / f"{hashed([member.key for member in self.members])}.robots"

    def results(self) -> "tuple[Robot, ...]":
        """Fit those together of which nothing speaks against it, and each of the others by itself."""
        from ident.identify.fleet_batch import robots_together

        options = self.members[0].options
        arms: dict[str, Arm] = {}
        given = [each for member in self.members if (each := _given(member, arms)) is not None]
        trusted = tuple(map(str, options.trust_values))
        found = robots_together(given, options.unknowns, self.size, seed=options.seed, trusted=trusted)
        return tuple(found[member.name] if member.name in found else member.results()[0] for member in self.members)


@dataclass(frozen=True)
class Again(Task):
    """A robot to be drawn under a population.

    Attributes:
        one: the robot.
        under: the population.
    """

    one: One
    under: "Under"

    @property
    def folder(self) -> Path:  # type: ignore[override]
        """Where the result goes."""
        return self.one.folder

    @property
    def file(self) -> Path:
        """Where the result goes."""
        return self.folder / f"{hashed([self.one.key, encode(self.under)])}.draws"

    def results(self) -> "tuple[Draws | None]":
        """Draw the robot; None where that is not possible."""
        from ident.identify.fleet_draws import draws_under
        from ident.measure import read_campaign
        from ident.studies.shared import as_file

        options = self.one.options
        arm = as_file(self.one.arm, options.soft_base).arm
        seed = int(hashed([self.one.name, options.seed])[:8], 16)
        return (draws_under(arm, read_campaign(self.one.campaign), options.unknowns, self.under, seed),)


def _given(member: One, arms: "dict[str, Arm]") -> "Given | None":
    """Read a robot's files; None where something is wrong with them. An arm that many have is read once."""
    from ident.identify.fleet_batch import Given
    from ident.measure import read_campaign
    from ident.studies.shared import as_file

    campaign_file, arm_file = member.sources
    try:
        if arm_file.sha256 not in arms:
            described = as_file(member.arm, member.options.soft_base)
            member.options.unknowns_of(described)  # refuses uncertain numbers
            arms[arm_file.sha256] = described.arm
        campaign = read_campaign(member.campaign)
        return Given(member.name, campaign, arms[arm_file.sha256], campaign_file, arm_file)
    except IdentError:
        return None


def hashed(parts: list[Any]) -> str:
    """Return a hash of plain data, as a name for a file."""
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:32]


def digest(path: Path) -> str:
    """Return a hash of a file's bytes; empty where it can't be read."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return ""
