"""``trussflow run``: a diagram, a block or an FMU simulated, without writing code."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trussflow.blocks.errors import DiagramError, NameLookupError
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.library.sources import Constant
from trussflow.blocks.results.conversions import plot, to_pandas
from trussflow.blocks.results.dataset import save
from trussflow.blocks.simulation.adaptive import METHODS
from trussflow.blocks.simulation.simulator import simulate
from trussflow.blocks.simulation.solver import FIXED_STEP
from trussflow.command_arguments import Outcome, block_of, main_of, parser_of, values_of
from trussflow.fmu.importing.block import Fmu

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


PICTURES = (".png", ".svg", ".pdf")


def parser(prog: str) -> argparse.ArgumentParser:
    """Return the argument parser of the command `prog`."""
    found = parser_of(
        prog,
        "Simulate a diagram, a block or an FMU, and print final, least and greatest values of its signals.",
        "loop.py:loop 10                                     # 10 s with steps of 1 ms",
        "loop.py:loop 10 --solver DOP853 --plot loop.png     # variable steps, and a picture",
        "loop.py:loop 10 --parameter pendulum.mass=2 --json  # another mass, output as JSON",
        "plant.fmu 5 --input u=1.5 --output plant.nc         # an FMU under a constant input",
    )
    found.add_argument(
        "item", help="file.py:name or module:name of a diagram or block, or an FMU"
    )
    found.add_argument("duration", type=float, help="time to simulate [s]")
    found.add_argument(
        "--step",
        type=float,
        help="step of fixed-step solvers and FMUs [s]; default: 0.001",
    )
    found.add_argument("--solver", choices=(*FIXED_STEP, *METHODS), default="rk4")
    found.add_argument(
        "--log", nargs="+", metavar="BLOCK.PORT", help="by default every output"
    )
    found.add_argument(
        "--log-step", type=float, help="time between logged instants [s]"
    )
    for option, what in (
        ("parameter", "value of a parameter"),
        ("input", "constant input of a block or FMU"),
    ):
        found.add_argument(
            f"--{option}",
            dest=f"{option}s",
            action="append",
            default=[],
            metavar="NAME=VALUE",
            help=f"{what}, arrays as [1, 2]; may be repeated",
        )
    found.add_argument("--output", type=Path, help="netCDF file to write")
    found.add_argument(
        "--plot",
        type=Path,
        help=f"picture of all logged signals: {', '.join(PICTURES)}",
    )
    return found


def picture(path: Path | None) -> Path | None:
    """Return the `path` of a picture to write; raise `DiagramError` unless it can be written."""
    if path and not (path.suffix.lower() in PICTURES and path.parent.is_dir()):
        raise DiagramError(
            f"cannot draw to '{path}': use {', '.join(PICTURES)} in an existing folder"
        )
    return path


def run(options: argparse.Namespace) -> Outcome:
    """Simulate the diagram, block or FMU of the `options`."""
    picture(options.plot)
    step = (
        1e-3 if options.step is None and options.solver in FIXED_STEP else options.step
    )
    item = options.item
    block = (
        Fmu(item, step=step or 1e-3)
        if item.lower().endswith(".fmu")
        else block_of(item)
    )
    result = simulate(
        driven(block, values_of("--input", options.inputs)),
        options.duration,
        step=step,
        solver=options.solver,
        log=options.log,
        log_step=options.log_step,
        parameters=values_of("--parameter", options.parameters),
    )
    if options.output is not None:
        save(result, options.output)
    if options.plot is not None:
        plot(result).savefig(options.plot)
    table = figures(result)
    rows = table.rename_axis("signal").reset_index().to_dict("records")
    return Outcome(rows, table.to_string(float_format="{:.5g}".format))


def driven(block: Block, inputs: dict[str, Any]) -> Diagram:
    """Return a diagram that can run: a `block` by itself has constant `inputs`, zero by default.

    Raises
    ------
    NameLookupError
        If there is no such input.
    """
    if isinstance(block, Diagram) and not block.inputs():
        return block
    whole = Diagram("run")
    whole.add(block=block)
    if unknown := sorted(set(inputs) - {port.name for port in block.inputs()}):
        names = ", ".join(port.name for port in block.inputs()) or "none"
        raise NameLookupError(f"there is no input '{unknown[0]}'; there is {names}")
    for port in block.inputs():
        if port.name in inputs:
            whole.add(**{f"input_{port.name}": Constant(inputs[port.name])}).y >> port
        else:
            whole.ground(port)
    return whole


def figures(result: xr.Dataset) -> pd.DataFrame:
    """Return unit, last, least and greatest value of each element of the signals of a `result`."""
    # slow to import
    import pandas as pd

    values = to_pandas(result)
    units = [
        signal.attrs.get("units", "")
        for signal in result.data_vars.values()
        for _ in range(signal[0].size)
    ]
    return pd.DataFrame(
        {
            "unit": pd.Series(units, values.columns),
            "end": values.iloc[-1],
            "least": values.min(skipna=False),
            "greatest": values.max(skipna=False),
        }
    )


main = main_of(run, parser)
