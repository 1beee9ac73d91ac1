"""Large array computations in blocks: stored as they come, resumed, on one machine or a cluster.

A `Job` says what to compute, `run` computes its blocks into a folder, and the `Store` of that
folder reads them or writes them as one labelled data set.
"""

from bowstring.jobs.job import Coordinate, Job, Variable
from bowstring.jobs.running import RunInterrupted, run
from bowstring.jobs.store import Store, Unfinished
from bowstring.jobs.tasks import threads

__all__ = [
    "Coordinate",
    "Job",
    "RunInterrupted",
    "Store",
    "Unfinished",
    "Variable",
    "run",
    "threads",
]
