"""A real Dask scheduler and real workers, each a process on the loopback that can be killed alone."""

import os
import random
import signal
import socket
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

HOST = "127.0.0.1"


class Cluster:
    """A scheduler at one address, which may be killed and started again, and workers.

    Each process is its own: workers have no nanny, so that what is killed is what computes, and nothing starts it anew.
    """

    def __init__(self, folder: Path, environment: dict[str, str] | None = None):
        self.folder, self.environment = folder, {**os.environ, **(environment or {})}
        folder.mkdir(parents=True, exist_ok=True)
        with socket.socket() as found:
            found.bind((HOST, 0))
            self.port = found.getsockname()[1]
        self.address = f"tcp://{HOST}:{self.port}"
        self.scheduler: subprocess.Popen[bytes] | None = None
        self.workers: deque[subprocess.Popen[bytes]] = deque()

    def __enter__(self) -> "Cluster":
        self.start_scheduler()
        return self

    def __exit__(self, *error: object) -> None:
        for process in (*self.workers, *([self.scheduler] if self.scheduler else [])):
            kill(process)

    def start_scheduler(self) -> None:
        """Start it, and wait until it listens."""
        where = ["--host", HOST, "--port", str(self.port), "--no-dashboard", "--no-show"]
        self.scheduler = self._process("scheduler", *where)
        while True:
            with suppress(OSError), socket.create_connection((HOST, self.port), 1):
                return
            time.sleep(0.05)

    def start_worker(self) -> None:
        """Start one more; it works when it is there, and ends when there is no scheduler for a second."""
        where = ["--host", HOST, "--no-dashboard", "--no-nanny", "--nthreads", "1", "--memory-limit", "0"]
        more = ["--death-timeout", "10", "--local-directory", str(self.folder)]
        self.workers.append(self._process("worker", self.address, *where, *more))

    def kill_scheduler(self) -> None:
        """Kill -9."""
        assert self.scheduler is not None
        kill(self.scheduler)

    def kill_worker(self) -> None:
        """Kill -9 the worker that was started first."""
        kill(self.workers.popleft())

    def kill_workers(self) -> None:
        """Kill -9 all."""
        while self.workers:
            self.kill_worker()

    def _process(self, kind: str, *words: str) -> "subprocess.Popen[bytes]":
        line = [sys.executable, "-m", "dask", kind, *words]
        with (self.folder / f"{kind}.log").open("ab") as log:
            return subprocess.Popen(line, stdout=log, stderr=log, cwd=self.folder, env=self.environment)


def kill(process: "subprocess.Popen[bytes]") -> None:
    """Kill -9, and wait for the end."""
    process.send_signal(signal.SIGKILL)
    process.wait()


class Run:
    """`ident fleet` as a process, on a cluster or on none."""

    def __init__(self, robots: Path, out: Path, *words: str, environment: dict[str, str] | None = None):
        self.kept = out / f"{robots.name}.fleet.robots"
        self.log = out.with_suffix(".log")
        self.before = self.attempts
        line = [sys.executable, "-m", "ident", "fleet", str(robots), "--starts=4", "--no-figure", "--out", str(out)]
        with self.log.open("ab") as log:
            self.process = subprocess.Popen(
                [*line, *words], stdout=log, stderr=log, env={**os.environ, **(environment or {})}
            )

    @property
    def attempts(self) -> set[Path]:
        """Where workers note what they attempt, a folder for each client that has reached them."""
        return set(self.kept.glob(".attempts-*"))

    @property
    def done(self) -> int:
        """Robots that are fitted, and those that are drawn: each has a file."""
        return len(list(self.kept.glob("*.robot"))) + len(list(self.kept.glob("*.draws")))

    def wait_for(self, ready: Callable[[], bool]) -> None:
        """Wait until something holds, or the process has ended."""
        while self.process.poll() is None and not ready():
            time.sleep(0.02)

    def end(self) -> int:
        """Wait for the end, and return the exit status."""
        return self.process.wait()


@dataclass
class Kills:
    """What became of a fleet in which something was killed over and over.

    Attributes:
        killed: kills that hit a run under way.
        exits: exit status of each run that was not killed itself.
        said_after: longest time [s] from the death of a scheduler to the client's end.
    """

    killed: int = 0
    exits: list[int] = field(default_factory=list)
    said_after: float = 0.0


class Disturbed:
    """A fleet that is computed on a cluster of two workers while parts of it are killed.

    Args:
        cluster: its scheduler is running, its workers are started here.
        robots: the fleet.
        out: where the results go.
        moments: draws when something is killed.
    """

    def __init__(self, cluster: Cluster, robots: Path, out: Path, moments: random.Random):
        self.cluster, self.robots, self.out, self.moments = cluster, robots, out, moments
        self._start_workers()

    def kill_workers(self, times: int) -> Kills:
        """Kill a worker at each of so many moments of one run, and start another; wait for its end."""
        run, result = self._run(), Kills()
        for _ in range(times):
            if self._moment(run):
                self.cluster.kill_worker()
                self.cluster.start_worker()
                result.killed += 1
        result.exits.append(run.end())
        return result

    def kill_schedulers(self, times: int) -> Kills:
        """Kill the scheduler at a moment of each of so many runs, and its workers with it."""
        result = Kills()
        for _ in range(times):
            run = self._run()
            if self._moment(run, reached=True):
                self.cluster.kill_scheduler()
                result.killed += 1
            before = time.monotonic()
            result.exits.append(run.end())
            result.said_after = max(result.said_after, time.monotonic() - before)
            self.cluster.kill_scheduler()
            self.cluster.kill_workers()
            self.cluster.start_scheduler()
            self._start_workers()
        return result

    def kill_clients(self, times: int) -> Kills:
        """Kill the client at a moment of each of so many runs."""
        result = Kills()
        for _ in range(times):
            run = self._run()
            if self._moment(run):
                kill(run.process)
                result.killed += 1
            else:
                result.exits.append(run.end())
        return result

    def leave_alone(self) -> int:
        """Return the exit status of a run that is left alone."""
        return self._run().end()

    def _start_workers(self) -> None:
        self.cluster.start_worker()
        self.cluster.start_worker()

    def _run(self) -> Run:
        return Run(self.robots, self.out, "--dask", self.cluster.address)

    def _moment(self, run: Run, *, reached: bool = False) -> bool:
        """Wait until none, one or two files more are there, and somewhat longer; False where the run has ended.

        Args:
            run: the client.
            reached: wait for its first robot at work before; until then an address without a scheduler is a wrong one.
        """
        run.wait_for(lambda: not reached or bool(run.attempts - run.before))
        count = run.done + self.moments.randrange(3)
        run.wait_for(lambda: run.done >= count)
        time.sleep(self.moments.uniform(0.0, 1.0))
        return run.process.poll() is None
