"""Who does the tasks of a fleet: this process, others (`fleet_pool`) or a cluster (`fleet_cluster`).

What was done before is skipped.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

from ident.studies.fleet_tasks import Again, Batch, One, T

if TYPE_CHECKING:
    from ident.identify.fleet import Robot
    from ident.inference.population_chains import Draws, Under
    from ident.studies.fleet import EngineOptions


class Engine:
    """Does tasks of one folder where the options say; a context, to whose end it stays connected with a cluster.

    Args:
        options: processes here, or a cluster.
    """

    def __init__(self, options: "EngineOptions"):
        self.options, self.open = options, ExitStack()
        self.cluster: Callable[[list[Any]], Iterator[tuple[Any, str]]] | None = None

    def __enter__(self) -> "Engine":
        """Do nothing yet: a cluster is asked for when there is something to do."""
        return self

    def __exit__(self, *error: object) -> None:
        """Take leave of the cluster."""
        self.open.close()

    def done(self, tasks: list[T]) -> Iterator[tuple[T, str]]:
        """Return each task when it is done, and why it is not; those that were done before come first."""
        pending = []
        for task in tasks:
            if task.read() is None:
                pending.append(task)
            else:
                yield task, ""
        if not pending:
            return
        if self.options.dask:
            yield from self._on_cluster(pending)
        elif self.options.workers > 1:
            from ident.studies.fleet_pool import in_processes

            yield from in_processes(pending, self.options.workers)
        else:
            yield from ((task, task.do()) for task in pending)

    def _on_cluster(self, pending: list[T]) -> Iterator[tuple[T, str]]:
        if self.cluster is None:
            from ident.studies.fleet_cluster import cluster

            self.cluster = self.open.enter_context(cluster(self.options.dask, pending[0].folder))
        return self.cluster(pending)


def outcomes(robots: Sequence[One], engine: Engine, size: int) -> Iterator["Robot"]:
    """Fit what is not fitted of the robots, as workers come free, and return all, those that were fitted first.

    Robots of a batch that could not be done as one are done each by itself: it tells which of them is to blame.

    Args:
        robots: sorted, so that the same robots make the same batches.
        engine: fits them.
        size: robots of a batch.
    """
    single = list(robots)
    if size > 1:
        parts = [tuple(single[start : start + size]) for start in range(0, len(single), size)]
        single = []
        for batch, _ in engine.done([Batch(part, size, part[0].folder) for part in parts]):
            if known := batch.read():
                yield from known
            else:
                single += batch.members
    for one, reason in engine.done(single):
        known = one.read()
        yield known[0] if known else one.failed(f"{one.campaign}: {reason or 'its result can not be read'}")


def drawn(robots: Sequence[One], under: "Under", engine: Engine) -> 'Iterator[tuple[One, "Draws | None"]]':
    """Draw robots under a population, as workers come free; None for one of which that is not possible."""
    for task, _ in engine.done([Again(one, under) for one in robots]):
        known = task.read()
        yield task.one, known[0] if known else None
