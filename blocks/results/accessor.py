"""Methods of results. Importing this module registers them, and imports xarray."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import xarray as xr

from trussflow.blocks.results.conversions import plot

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@xr.register_dataset_accessor("trussflow")  # type: ignore[no-untyped-call]
@dataclass
class ResultAccessor:
    """Methods of a result under the name ``result.trussflow``.

    Attributes
    ----------
    result : xarray.Dataset
        Result of `simulate`.
    """

    result: xr.Dataset

    def plot(self, *names: str) -> Figure:
        """Return the figure of the signals with these `names`, as the function `plot`."""
        return plot(self.result, *names)
