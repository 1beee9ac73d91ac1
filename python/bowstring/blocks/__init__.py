"""Large array computations in blocks: stored as they come, resumed, on one machine or a cluster.

A `Job` says what to compute, `run` computes its blocks into a folder, and the `Store` of that
folder reads them or writes them as one labelled data set.
"""

from bowstring.blocks.job import Coordinate, Job, Variable
from bowstring.blocks.running import RunInterrupted, run
from bowstring.blocks.store import Store, Unfinished
from bowstring.blocks.tasks import threads

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
