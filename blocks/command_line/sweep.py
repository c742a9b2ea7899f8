"""``trussflow sweep``: a sweep of a script, on this machine or on a cluster."""

from __future__ import annotations

import argparse
import contextlib
import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cloudpickle

from trussflow.blocks.errors import DiagramError, SimulationError
from trussflow.blocks.framework.command_arguments import (
    FAILED,
    Outcome,
    ended,
    parser_of,
    thing_of,
)
from trussflow.blocks.results.dataset import save
from trussflow.blocks.support.validation import shown
from trussflow.blocks.sweeps.sweep import EXECUTORS


def parser(prog: str) -> argparse.ArgumentParser:
    """Return the argument parser of the command `prog`."""
    found = parser_of(
        prog,
        "Run a sweep: functools.partial(sweep, ...) in a script, or a function that passes its keyword\n"
        "arguments to sweep. Called again with the same --path, it resumes the sweep.",
        "loop.py:campaign --path kept                                    # on all cores of this machine",
        "loop.py:campaign --path kept --scheduler tcp://192.168.0.1:8786 # on the workers of a Dask cluster",
        "loop.py:campaign --samples 20 --executor serial --output few.nc # a short trial",
    )
    found.add_argument("campaign", help="file.py:name or module:name")
    found.add_argument("--path", type=Path, help="folder of the finished samples")
    found.add_argument("--samples", type=int, help="number of samples of distributions")
    found.add_argument("--executor", choices=EXECUTORS, help="default: processes")
    found.add_argument(
        "--workers", type=int, help="number of parallel samples; default: one per core"
    )
    found.add_argument(
        "--scheduler", metavar="ADDRESS", help="scheduler of a Dask cluster"
    )
    found.add_argument("--output", type=Path, help="netCDF file of all samples")
    return found


def run(options: argparse.Namespace) -> Outcome:
    """Run the sweep of the `options`."""
    campaign = thing_of(options.campaign)
    if not callable(campaign):
        raise DiagramError(
            f"'{options.campaign}' is {shown(campaign)}; write functools.partial(sweep, ...)"
        )
    file = options.campaign.partition(":")[0]
    if file.endswith(".py"):  # workers on other machines do not have the script
        cloudpickle.register_pickle_by_value(sys.modules[Path(file).stem])
    names = ("path", "samples", "executor", "workers")
    given = {
        name: getattr(options, name)
        for name in names
        if getattr(options, name) is not None
    }
    with _cluster(options.scheduler) as more:
        swept = campaign(**(more | given))
    if options.output is not None:
        save(swept, options.output)
    columns = [name for name, kept in swept.data_vars.items() if kept.ndim == 1]
    told = swept[columns].to_dataframe()
    ended_as = told.groupby(["status", "message"]).size()
    complete = told[told["status"] == "complete"].drop(columns=["status", "message"])
    figures = complete.describe([0.05, 0.5, 0.95]).T if complete.size else complete
    rows = [
        {"status": s, "message": m, "samples": int(n)} for (s, m), n in ended_as.items()
    ]
    text = "\n\n".join(
        [ended_as.to_string(), *([figures.to_string()] if complete.size else [])]
    )
    code = FAILED if complete.empty and len(told) else 0
    return Outcome({"ended": rows, "figures": figures.to_dict("index")}, text, code)


@contextlib.contextmanager
def _cluster(address: str | None) -> Iterator[dict[str, Any]]:
    """Yield the executor arguments of a sweep on the cluster with the scheduler at `address`."""
    if address is None:
        yield {}
        return
    try:
        distributed: Any = importlib.import_module("distributed")
    except ImportError:
        raise SimulationError(
            "--scheduler needs Dask: pip install 'trussflow[cluster]'"
        ) from None
    try:
        client = distributed.Client(address, timeout=10.0)
    except (OSError, ValueError) as error:
        raise SimulationError(
            f"there is no scheduler at '{address}': {error}"
        ) from None
    with client:
        workers = sum(client.nthreads().values())
        yield {"executor": client.get_executor(), "workers": max(1, workers)}


def main(words: list[str], prog: str) -> int:
    """Run the command `prog` with these `words`; return the exit code."""
    return ended(run, parser(prog).parse_args(words))
