"""Families of linear models: over grids of parameters, and over the times of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from trussflow.blocks.errors import LinearAnalysisError
from trussflow.blocks.framework.block import Block
from trussflow.blocks.linear_analysis.linearize import Linearizer
from trussflow.blocks.linear_analysis.operating_point import (
    OperatingPoint,
    given_point,
    points_during,
)
from trussflow.blocks.linear_analysis.references import References
from trussflow.blocks.simulation.session import Session
from trussflow.blocks.simulation.solver import (
    SolverSettings,
    refuse_unknown,
    spelled_out,
)
from trussflow.blocks.support.validation import by_name, finite_array, shown

if TYPE_CHECKING:
    import xarray as xr


@spelled_out(SolverSettings)
def linearize_over(
    item: Block,
    inputs: References = None,
    outputs: References = None,
    *,
    parameters: Mapping[str, Sequence[Any]] | None = None,
    times: Sequence[float] | None = None,
    at: OperatingPoint | None = None,
    cut: References = (),
    **settings: Unpack[SolverSettings],
) -> xr.DataArray:
    """Return the linear models of a diagram over a grid of parameters, and at times of runs.

    Everything is traced once.

    Parameters
    ----------
    item : Block
        A diagram, or a single block.
    inputs, outputs, cut
        As for `linearize`.
    parameters : mapping, optional
        Values of the parameters on the grid, keyed by ``"block.parameter"`` [units as declared].
    times : sequence of float, optional
        Increasing times at which to linearize along a run from `at`, one run for each point of the grid
        [s]; by default at the start alone.
    at : OperatingPoint, optional
        Operating point, or start of the runs; by default the initial states.
    step, solver, backend, rtol, atol
        Of the `Solver` of runs [s, -, -, -, unit of the state].

    Returns
    -------
    xarray.DataArray
        A `LinearModel` in each element, with one axis for each parameter and one for time:
        ``family.sel(time=2.0).item()``.

    Raises
    ------
    LinearAnalysisError
        If a parameter has no values, or times do not increase from the start.

    Examples
    --------
    >>> from trussflow.blocks import Diagram, Gain, Integrator, linearize_over
    >>> loop = Diagram("loop")
    >>> gain, integral = loop.add(gain=Gain(-1.0), integral=Integrator())
    >>> _ = integral >> gain >> integral
    >>> family = linearize_over(loop, gain.u, integral.y, parameters={"gain.gain": [-1.0, -3.0]})
    >>> [float(model.poles()[0].real) for model in family.values]
    [-1.0, -3.0]
    """
    import xarray as xr

    refuse_unknown(settings, SolverSettings.__annotations__)
    begin = given_point(at)
    axes: dict[str, list[Any]] = {}
    for name, values in by_name("parameters", parameters).items():
        if isinstance(values, str) or not np.size(values) or not np.ndim(values):
            raise LinearAnalysisError(
                f"cannot linearize over '{name}' = {shown(values)}: give a sequence of values to try"
            )
        axes[name] = [*values]
    instants = (
        [begin.time]
        if times is None
        else finite_array("times to linearize at", times).ravel().tolist()
    )
    if (
        not instants
        # The first difference may be zero: the start itself is an instant like others.
        or not np.all(np.diff([begin.time, *instants])[1:] > 0)
        or instants[0] < begin.time
    ):
        raise LinearAnalysisError(
            f"cannot linearize at the times {shown(times)}: they must increase, from {begin.time:g} s on"
        )
    linearizer = Linearizer(item, inputs, outputs, cut=cut)
    session = None if times is None else Session(item, **settings)
    models = []
    for values in product(*axes.values()):
        point = replace(
            begin,
            parameters={**begin.parameters, **dict(zip(axes, values, strict=True))},
        )
        points = [point] if session is None else points_during(session, point, instants)
        models += [linearizer.at(one) for one in points]
    if times is not None:
        axes["time"] = instants
    # Coordinates of xarray hold numbers, so that an axis over arrays has none.
    coordinates = {n: v for n, v in axes.items() if all(np.ndim(one) == 0 for one in v)}
    family = np.empty(len(models), dtype=object)
    # One by one, as NumPy would convert the models to arrays of numbers.
    for k, model in enumerate(models):
        family[k] = model
    shape = [len(v) for v in axes.values()]
    array = xr.DataArray(family.reshape(shape), coordinates, [*axes])
    if times is not None:
        array["time"].attrs["units"] = "s"
    return array
