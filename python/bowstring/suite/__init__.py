"""Suite: public data sets, each with one robot, one mapping and one protocol of evaluation.

Constant curvature and the rod predict the same rows by the same metric, beside published figures.
"""

from bowstring.suite.protocol import Protocol, SuiteSet, built_in_sets, read_set
from bowstring.suite.running import ModelResult, SetResult, run_set
from bowstring.suite.summary import Suite, run_suite

__all__ = [
    "ModelResult",
    "Protocol",
    "SetResult",
    "Suite",
    "SuiteSet",
    "built_in_sets",
    "read_set",
    "run_set",
    "run_suite",
]
