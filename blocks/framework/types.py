"""The array types that the framework passes around."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
"""A float array, usually of one dimension."""

Array = Any
"""A NumPy array of numbers, or the traced array that stands in for one."""
