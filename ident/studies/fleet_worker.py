"""What runs on a worker of a fleet, in another process or on another machine; it imports nothing heavy by itself.

jax and equinox read some settings when they are imported, so that a worker is set up (`begin`) before that.
"""

import os
from contextlib import chdir
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any, NamedTuple
from uuid import uuid4

from ident.errors import IdentError

if TYPE_CHECKING:
    from ident.studies.fleet_tasks import Task

OF_JAX = ("jax_enable_x64", "jax_compilation_cache_dir", "jax_persistent_cache_min_compile_time_secs")
OF_SYSTEM = ("IDENT_PROGRAMS", "EQX_ON_ERROR", "TF_CPP_MIN_LOG_LEVEL")
"""What workers take over of jax's settings, and of the environment."""
ONE = Lock()
"""Held while a task is done: jax itself uses all cores, and folders and settings are the process's."""


class ClusterError(IdentError):
    """The cluster can't go on; the same command does, when the cluster is mended."""


class Place(NamedTuple):
    """Where and as what a worker works: the client's folder, its settings, and its program.

    Attributes:
        folder: which paths are relative to.
        settings: see `settings`.
        environment: see `ident.programs.environment`.
        run: name of the client's run.
    """

    folder: Path
    settings: dict[str, dict[str, Any]]
    environment: str
    run: str


def settings() -> dict[str, dict[str, Any]]:
    """Return what a worker shall take over from this process."""
    import jax

    environment = {name: os.environ.get(name) for name in OF_SYSTEM}
    return {"system": environment, "jax": {name: jax.config.values[name] for name in OF_JAX}}


def begin(settings: dict[str, dict[str, Any]]) -> None:
    """Set a worker up like the process that has these settings."""
    for name, value in settings["system"].items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value
    import jax

    for name, value in settings["jax"].items():
        jax.config.update(name, value)


def probe(place: Place, token: Path) -> dict[str, Any]:
    """Return what this worker is, and prove that it shares a folder with the client: by a file beside the token.

    Args:
        place: where it shall work.
        token: file that the client has written.
    """
    with ONE:
        begin(place.settings)
        from ident.programs import SOURCES, circumstances

        shared = ""
        try:
            with chdir(place.folder):
                mark = token.with_name(f"{token.name}-{uuid4().hex}")
                mark.write_bytes(token.read_bytes())
                shared = mark.name
        except OSError:
            pass
        return {"shared": shared, "ident": SOURCES, **circumstances()}


def attempt(task: "Task", place: Place) -> str:
    """Do a task, unless it has killed as many workers as it may; return why nothing was written, as `Task.do` does.

    While it lasts, a mark lies in the run's folder: one that was left there is of a worker that was killed.

    Raises:
        ClusterError: a worker of another program, or a folder that can't be written.
    """
    from ident.errors import InputError

    with ONE, chdir(place.folder):
        begin(place.settings)
        from ident.programs import environment
        from ident.studies.fleet_tasks import KILLED

        if environment() != place.environment:
            raise ClusterError("a worker that has joined later has other versions or another processor: end it")
        if task.read() is not None:
            return ""
        name = task.file.stem
        try:
            marks = marks_of(task.folder, place.run)
            marks.mkdir(parents=True, exist_ok=True)
            if given_up(task.folder, place.run, name):
                return KILLED
            mark = marks / f"{name}-{uuid4().hex}"
            mark.touch()
            reason = task.do()
            mark.unlink()
        except (OSError, InputError) as error:
            raise ClusterError(f"a worker can't write: {error}") from None
        return reason


def marks_of(folder: Path, run: str) -> Path:
    """Return the folder for the marks of a run."""
    return folder / f".attempts-{run}"


def given_up(folder: Path, run: str, name: str) -> bool:
    """Return whether a task of this name has killed as many workers as it may."""
    from ident.studies.fleet_tasks import KILLS

    return len(list(marks_of(folder, run).glob(f"{name}-*"))) >= KILLS
