"""Compute a job's missing blocks, on this machine or on a Dask cluster."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from bowstring import interrupts
from bowstring.errors import InputError
from bowstring.jobs import tasks
from bowstring.jobs.job import Job
from bowstring.jobs.store import Store

if TYPE_CHECKING:
    from distributed import Client


class RunInterrupted(KeyboardInterrupt):
    """Ctrl-C during `run`; `store` holds the blocks that were finished."""

    def __init__(self, store: Store) -> None:
        super().__init__(store.kept)
        self.store = store

    def __reduce__(self) -> tuple[type[RunInterrupted], tuple[Store]]:
        return RunInterrupted, (self.store,)  # pickled in a pool of processes


def run(
    job: Job,
    folder: str | Path,
    client: str | Client | None = None,
    progress: Callable[[float], object] | None = None,
) -> Store:
    """Compute the blocks of a job that a folder does not have yet.

    Each block is written as it comes. A run that was stopped, or killed, goes on from there if it
    is started again. The results are the same to the last bit on one machine and on a cluster.

    Parameters
    ----------
    job : Job
        What to compute.
    folder : str or Path
        New or empty folder, or one with blocks of the same job.
    client : str or distributed.Client, optional
        Dask cluster that computes the blocks, or the address of its scheduler; needs the extra
        ``cluster``. Without it this process does.
    progress : callable, optional
        Called with the share, from 0 to 1, of the blocks of this run that are finished.

    Returns
    -------
    Store
        The folder with all blocks.

    Raises
    ------
    InputError
        Before the work if the folder or the cluster cannot be used or the drive has no room;
        during it if the drive is full or the cluster is gone. Finished blocks are kept; the error
        is `Unfinished` if there are some.
    NoSolutionError
        If a block fails; the message names it.
    RunInterrupted
        After Ctrl-C.
    """
    store = Store(folder, job)
    store.check_room()
    missing = store.missing
    if not missing:
        return store
    notify = progress or (lambda share: None)

    finished = 0

    def keep(number: int, content: bytes) -> None:
        nonlocal finished
        put(number, content)
        finished += 1
        notify(finished / len(missing))

    try:
        with contextlib.ExitStack() as stack:
            cluster = None if client is None else stack.enter_context(tasks.connected(client))
            put = stack.enter_context(store.writing())
            if cluster is None:
                _compute(job, missing, keep)
            else:
                tasks.compute(job, missing, cluster, keep)
    except tasks.Failure as failure:
        if failure.kind is InputError:
            raise store.stopped(str(failure)) from failure.__cause__
        raise failure.kind(f"{failure}; {store.kept}") from failure.__cause__
    except KeyboardInterrupt:
        interrupts.acknowledge()
        raise RunInterrupted(store) from None
    return store


def _compute(job: Job, numbers: Sequence[int], keep: Callable[[int, bytes], None]) -> None:
    """Compute blocks in this process."""
    for number in numbers:
        try:
            content = job.compute(number)
        except Exception as error:
            if interrupts.is_interrupt(error):
                raise KeyboardInterrupt from None
            raise tasks.failed(job, number, error) from error
        keep(number, content)
