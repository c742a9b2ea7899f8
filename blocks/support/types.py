"""Array types of the framework."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
"""A float array, usually of one dimension."""

Array = Any
"""A NumPy array of numbers, or a traced array."""
