"""`ident fleet` as a process of which parts are killed: a worker, or the process itself."""

import os
import random
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import psutil
from results import TIME


def files(folder: Path) -> dict[Path, str]:
    """Return the contents of all files by name, but for the time that a result was made and its folder."""
    paths = [path for path in folder.rglob("*") if path.is_file() and not path.name.startswith(".ident-")]
    paths = [path for path in paths if "/.attempts-" not in path.as_posix()]  # of a command that was killed
    return {
        path.relative_to(folder): TIME.sub("", path.read_text("latin-1")).replace(str(folder), "OUT") for path in paths
    }


class Run:
    """`ident fleet` as a process."""

    def __init__(self, robots: Path, out: Path, *words: str):
        self.kept = out / f"{robots.name}.fleet.robots"
        self.log = out.with_suffix(".log")
        line = [sys.executable, "-m", "ident", "fleet", str(robots), "--starts=4", "--no-figure", "--out", str(out)]
        with self.log.open("ab") as log:
            self.process = subprocess.Popen([*line, *words], stdout=log, stderr=log, env=dict(os.environ))

    @property
    def done(self) -> int:
        """Robots that are fitted, and those that are drawn: each has a file."""
        return len(list(self.kept.glob("*.robot"))) + len(list(self.kept.glob("*.draws")))

    @property
    def workers(self) -> list[psutil.Process]:
        """Its workers, the oldest first: each is a Python process of its own."""
        with suppress(psutil.NoSuchProcess):
            children = psutil.Process(self.process.pid).children()
            return sorted(
                (each for each in children if "spawn_main" in " ".join(each.cmdline())), key=psutil.Process.create_time
            )
        return []

    def wait_for(self, ready: Callable[[], bool]) -> None:
        """Wait until something holds, or the process has ended."""
        while self.process.poll() is None and not ready():
            time.sleep(0.02)

    def kill_worker(self) -> bool:
        """Kill -9 the oldest worker that there is; False where there is none."""
        for worker in self.workers[:1]:
            worker.kill()
            return True
        return False

    def kill(self) -> None:
        """Kill -9 the process and its workers, which would end by themselves a little later."""
        for each in (*self.workers, psutil.Process(self.process.pid)):
            with suppress(psutil.NoSuchProcess):
                each.kill()
        self.process.wait()

    def end(self) -> int:
        """Wait for the end, and return the exit status."""
        return self.process.wait()


@dataclass
class Kills:
    """What became of a fleet in which something was killed over and over.

    Attributes:
        killed: kills that hit a run under way.
        exits: exit status of each run that was not killed itself.
    """

    killed: int = 0
    exits: list[int] = field(default_factory=list)


class Disturbed:
    """A fleet that two workers compute while parts of it are killed.

    Args:
        robots: the fleet.
        out: where the results go.
        moments: draws when something is killed.
    """

    def __init__(self, robots: Path, out: Path, moments: random.Random):
        self.robots, self.out, self.moments = robots, out, moments

    def kill_workers(self, times: int) -> Kills:
        """Kill a worker at each of so many moments of one run; wait for its end."""
        run, result = self._run(), Kills()
        for _ in range(times):
            if self._moment(run):
                result.killed += run.kill_worker()
        result.exits.append(run.end())
        return result

    def kill_clients(self, times: int) -> Kills:
        """Kill the process at a moment of each of so many runs."""
        result = Kills()
        for _ in range(times):
            run = self._run()
            if self._moment(run):
                run.kill()
                result.killed += 1
            else:
                result.exits.append(run.end())
        return result

    def leave_alone(self) -> int:
        """Return the exit status of a run that is left alone."""
        return self._run().end()

    def _run(self) -> Run:
        return Run(self.robots, self.out, "--workers=2")

    def _moment(self, run: Run) -> bool:
        """Wait until none, one or two files more are there, and somewhat longer; False where the run has ended."""
        run.wait_for(lambda: len(run.workers) == 2)
        count = run.done + self.moments.randrange(3)
        run.wait_for(lambda: run.done >= count)
        time.sleep(self.moments.uniform(0.0, 1.0))
        return run.process.poll() is None
