"""Gaussian process with zero mean, a Matérn kernel and several outputs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from bowstring.aliases import Floats

#: Rows predicted at once, which bounds the memory.
_BLOCK: Final = 2_000


def matern(distance: Floats) -> Floats:
    """Matérn kernel of order 3/2 of distances in units of the length scale.

    Parameters
    ----------
    distance : ndarray
        Distances, no unit.

    Returns
    -------
    ndarray
        Correlation, 1 at distance 0.
    """
    scaled = np.sqrt(3.0) * distance
    return np.asarray((1.0 + scaled) * np.exp(-scaled))


@dataclass(frozen=True, eq=False)
class GaussianProcess:
    """Posterior of a Gaussian process (theory Eq. 7.7), with one kernel for all outputs.

    Attributes
    ----------
    inputs : ndarray (n, d)
        Inputs in units of their length scales.
    outputs : ndarray (n, q)
        Outputs.
    noise : float
        Variance of the noise over that of the process.
    """

    inputs: Floats
    outputs: Floats
    noise: float

    @cached_property
    def _factor(self) -> Floats:
        from scipy.linalg import cholesky

        kernel = self._kernel(self.inputs)
        kernel[np.diag_indices_from(kernel)] += self.noise
        return np.asarray(cholesky(kernel, lower=True))

    @cached_property
    def _weights(self) -> Floats:
        from scipy.linalg import cho_solve

        return np.asarray(cho_solve((self._factor, True), self.outputs))

    def _kernel(self, inputs: Floats) -> Floats:
        from scipy.spatial.distance import cdist

        return matern(cdist(inputs, self.inputs))

    def mean(self, inputs: Floats) -> Floats:
        """Posterior mean, which tends to zero away from the inputs.

        Parameters
        ----------
        inputs : ndarray (m, d)
            Inputs in units of their length scales.

        Returns
        -------
        ndarray (m, q)
            Mean of the outputs.
        """
        blocks = range(0, len(inputs), _BLOCK)
        found = [self._kernel(inputs[i : i + _BLOCK]) @ self._weights for i in blocks]
        return np.concatenate(found) if found else np.zeros((0, self.outputs.shape[1]))

    def explained(self, inputs: Floats) -> Floats:
        """Share of the prior variance that the data remove: near 1 among them, 0 far away.

        Parameters
        ----------
        inputs : ndarray (m, d)
            Inputs in units of their length scales.

        Returns
        -------
        ndarray (m,)
            Share from 0 to 1.
        """
        from scipy.linalg import solve_triangular

        found = [np.zeros(0)]
        for i in range(0, len(inputs), _BLOCK):
            across = self._kernel(inputs[i : i + _BLOCK]).T
            found.append((solve_triangular(self._factor, across, lower=True) ** 2).sum(axis=0))
        return np.clip(np.concatenate(found), 0.0, 1.0)
