"""Methods of results. Importing this module registers them, and imports xarray."""

from dataclasses import dataclass

import xarray as xr
from matplotlib.figure import Figure

from trussflow.blocks.results.conversions import plot


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
