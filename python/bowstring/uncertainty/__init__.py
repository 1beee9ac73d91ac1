"""Uncertainty: distributions of a robot's numbers, samples, Sobol' indices and summaries."""

from bowstring.uncertainty.distributions import (
    CorrelatedNormal,
    LogNormal,
    Normal,
    Triangular,
    TruncatedNormal,
    Uniform,
)
from bowstring.uncertainty.indices import (
    IntervalEstimate,
    MorrisEffects,
    SobolIndices,
    morris_effects,
    sobol_indices,
)
from bowstring.uncertainty.joint import Distributions, read_distributions
from bowstring.uncertainty.sampling import MorrisDesign, SaltelliDesign, SobolSample, evaluate
from bowstring.uncertainty.summary import Summary, spread_text, summarise

__all__ = [
    "CorrelatedNormal",
    "Distributions",
    "IntervalEstimate",
    "LogNormal",
    "MorrisDesign",
    "MorrisEffects",
    "Normal",
    "SaltelliDesign",
    "SobolIndices",
    "SobolSample",
    "Summary",
    "Triangular",
    "TruncatedNormal",
    "Uniform",
    "evaluate",
    "morris_effects",
    "read_distributions",
    "sobol_indices",
    "spread_text",
    "summarise",
]
