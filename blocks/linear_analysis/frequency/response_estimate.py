"""Estimated frequency response for python-control, with its standard deviation."""

from __future__ import annotations

from typing import Any

import control
import numpy as np
from numpy.typing import NDArray


class ResponseEstimate(control.FrequencyResponseData):  # type: ignore[misc] # it ships no types
    """An estimated frequency response: a ``control.FrequencyResponseData`` with standard errors.

    Operations of python-control (products, feedback) return a plain FrequencyResponseData.

    Parameters
    ----------
    estimates : array of complex, shape (n, p, m, frequencies)
        Responses from n realizations of the excitation; the estimate is their mean [any].
    omega : Vector
        Frequencies [rad/s].
    **names
        As for ``control.FrequencyResponseData``: inputs, outputs.

    Attributes
    ----------
    standard_error : array, shape (p, m, frequencies)
        Standard deviation of the complex estimate from the mean of infinitely many realizations; NaN for one
        realization [unit of output per unit of input].
    """

    def __init__(
        self,
        estimates: NDArray[np.complex128],
        omega: NDArray[np.float64],
        **names: Any,
    ) -> None:
        super().__init__(estimates.mean(axis=0), omega, smooth=omega.size > 3, **names)
        number = len(estimates)
        spread = np.sum(np.abs(estimates - estimates.mean(axis=0)) ** 2, axis=0)
        self.standard_error: NDArray[np.float64] = (
            np.sqrt(spread / (number - 1) / number)
            if number > 1
            else np.full(spread.shape, np.nan)
        )

    def __repr__(self) -> str:
        """Return the table, as the representation of python-control fails with several inputs."""
        return str(self)
