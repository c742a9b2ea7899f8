"""Conversions of results: tables, python-control, and plots."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import TYPE_CHECKING, Any

from trussflow.blocks.errors import NameLookupError, SimulationError
from trussflow.blocks.framework.units import distinct
from trussflow.blocks.support.types import Vector
from trussflow.blocks.support.validation import shown

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from control import TimeResponseData
    from matplotlib.figure import Figure


def signals_of(result: Any, doing: str, names: Sequence[str] = ()) -> xr.Dataset:
    """Return the signals with these `names`, or all, of a `result`; messages name the action, `doing`."""
    if not hasattr(result, "to_netcdf"):
        raise SimulationError(
            f"cannot {doing} {shown(result)}: it is no result of a run"
        )
    for name in names:
        if name not in result.data_vars:
            there = ", ".join(map(str, result.data_vars)) or "none"
            raise NameLookupError(
                f"cannot {doing} {shown(name)}: the signals of the result are: {there}"
            )
    chosen: xr.Dataset = result[[*names]] if names else result
    return chosen


def labels_of(signal: xr.DataArray) -> list[tuple[str, ...]]:
    """Return the labels of each element of a `signal` over time; elements of axes without labels are numbered."""
    labels = (
        map(str, signal[d].values if d in signal.coords else range(signal.sizes[d]))
        for d in signal.dims[1:]
    )
    return [*product(*labels)]


def elements_of(signal: xr.DataArray) -> Vector:
    """Return a `signal` over time as rows of elements, one column per instant."""
    return signal.to_numpy().reshape(len(signal), -1).T


def to_pandas(result: xr.Dataset) -> pd.DataFrame:
    """Return a result as a table: a row for each time, a column for each element, such as ``plant.q[0]``.

    Elements with labels are named by them, such as ``plant.position[z]``.

    Parameters
    ----------
    result : xarray.Dataset
        Result of `simulate`.
    """
    import pandas as pd

    columns = {}
    for name, signal in signals_of(result, "tabulate").data_vars.items():
        for label, values in zip(labels_of(signal), elements_of(signal), strict=True):
            columns[f"{name}[{', '.join(label)}]" if label else name] = values
    return pd.DataFrame(columns, index=pd.Index(result["time"].values, name="time"))


def to_control(
    result: xr.Dataset, outputs: Sequence[str], inputs: Sequence[str] = ()
) -> TimeResponseData:
    """Return signals of a result as the `control.TimeResponseData` of python-control.

    Parameters
    ----------
    result : xarray.Dataset
        Result of `simulate`.
    outputs, inputs : sequence of str
        Names of the signals.

    Raises
    ------
    NameLookupError
        If there is no such signal.
    """
    from control import TimeResponseData

    given, driving = (
        to_pandas(signals_of(result, "convert", names)) if names else None
        for names in (outputs, inputs)
    )
    if given is None:
        raise SimulationError("cannot convert no signals: name the outputs")
    return TimeResponseData(
        result["time"].values,
        given.values.T,
        inputs=None if driving is None else driving.values.T,
        issiso=False,
        output_labels=[*given],
        input_labels=None if driving is None else [*driving],
    )


def plot(result: xr.Dataset, *names: str) -> Figure:
    """Plot signals of a result over time, with one subplot for each unit.

    A result has this function as a method: ``result.trussflow.plot(*names)``; ``result.plot`` is xarray's own.

    Parameters
    ----------
    result : xarray.Dataset
        Result of `simulate`.
    *names : str
        Names of the signals; by default all.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.

    Raises
    ------
    NameLookupError
        If there is no such signal.
    """
    import matplotlib.pyplot as plt  # slow to import

    from trussflow.blocks.support.figures import NotebookFigure

    groups: dict[str, list[str]] = {}
    for name, signal in signals_of(result, "plot", names).data_vars.items():
        groups.setdefault(signal.attrs.get("units", ""), []).append(str(name))
    figure, rows = plt.subplots(
        max(1, len(groups)),
        sharex=True,
        squeeze=False,
        layout="constrained",
        FigureClass=NotebookFigure,
    )
    for axes, (unit, group) in zip(rows[:, 0], groups.items(), strict=False):
        to_pandas(result[group]).plot(
            ax=axes, xlabel="time [s]", ylabel=f"[{distinct(unit)}]" if unit else ""
        )
    return figure
