"""A page that simulates a diagram by itself: one HTML file with the compiled equations."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from trussflow.blocks.errors import DiagramError, SimulationError
from trussflow.blocks.framework.clock import exact, ticks
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Port
from trussflow.blocks.linear_analysis.references import Reference
from trussflow.blocks.live.choices import (
    Ends,
    charts,
    controls,
    usual_signals,
    usual_step,
)
from trussflow.blocks.live.loop import loop_of
from trussflow.blocks.results.channels import Chosen, chosen_channels
from trussflow.blocks.simulation.prepared import Prepared
from trussflow.blocks.simulation.solver import FIXED_STEP, Solver
from trussflow.blocks.simulation.step_size_warnings import warn_of_missed_jumps
from trussflow.blocks.support.files import written
from trussflow.blocks.support.packing import compressed, packed
from trussflow.blocks.support.texts import package_text, page_text, script_json
from trussflow.blocks.support.types import Vector
from trussflow.blocks.support.validation import as_path, positive, positive_if_given
from trussflow.blocks.tracing.codegen import c_sources, content
from trussflow.blocks.tracing.compiler import compile_web_module
from trussflow.blocks.tracing.initialization import initialization
from trussflow.blocks.tracing.plan import Plan
from trussflow.blocks.tracing.program import Program
from trussflow.blocks.tracing.quantities import derivative, outputs

if TYPE_CHECKING:
    from trussflow.blocks.live.server import LiveServer

MAX_ROWS = 4000
"""Largest number of logged steps of a run [-]."""

FUNCTIONS = ("tf_work_size", "tf_advance", "tf_evaluate")
"""Functions of the compiled equations that the page calls."""


@dataclass(frozen=True, slots=True)
class Panel:
    """View of a live page that follows its cursor, such as a scene in space.

    Attributes
    ----------
    script : str
        JavaScript that pushes an object with two functions to ``window.trussflowPanels``: ``mount(element, data)``
        fills an element of the page, and ``update(time, signals)`` shows an instant. The signals are arrays of
        numbers by name.
    signals : sequence of Port or str
        Signals that the page logs for it, as for the argument `log` of `simulate`.
    """

    script: str
    signals: Sequence[Port | str] = ()


def live_page(
    diagram: Diagram, path: str | Path | None, **settings: Any
) -> Path | None:
    """Write a page that simulates a diagram, or serve it if there is no path.

    Parameters
    ----------
    diagram : Diagram
        The diagram.
    path : str or pathlib.Path, optional
        File to write.
    **settings
        As for `contents`.

    Returns
    -------
    pathlib.Path or None
        Path of the page, if it was written.

    Raises
    ------
    DiagramError
        If a page is to be written and a block computes in Python, or the file cannot be written.
    SimulationError
        If an argument is invalid.
    LinearAnalysisError
        If the loop cannot be analysed.
    CompilationError
        If there is no compiler for WebAssembly.
    """
    if path is None:
        server_of(diagram, **settings).until_interrupted()
        return None
    cannot = f"cannot make a live page of '{diagram.name}'"
    file = as_path(DiagramError, cannot, path)
    data, _, programs = contents(diagram, **settings)
    module = compile_web_module(
        content(programs), partial(c_sources, programs), FUNCTIONS
    )
    return written(file, html(data, module), DiagramError, f"{cannot} in")


def server_of(diagram: Diagram, **settings: Any) -> LiveServer:
    """Return the server of a live page.

    Parameters
    ----------
    diagram : Diagram
        The diagram.
    **settings
        As for `contents`, without `at`.

    Raises
    ------
    SimulationError
        If an argument is invalid.
    """
    # slow to import
    from trussflow.blocks.live.server import LiveServer

    data, prepared, _ = contents(diagram, is_served=True, **settings)
    logged = range(0, data["steps"] + 1, data["every"])
    return LiveServer(prepared, html(data, None).encode(), logged, pace=data["pace"])


Contents = tuple[dict[str, Any], Prepared, list[Program]]
"""Data of a page for JavaScript, the prepared diagram, and its programs."""


def contents(
    diagram: Diagram,
    *,
    parameters: Mapping[str, Ends | None] | Sequence[str] | None = None,
    signals: Chosen | None = None,
    at: Reference | None = None,
    duration: float = 10.0,
    step: float | None = None,
    panels: Sequence[Panel] = (),
    pace: float | None = None,
    is_served: bool = False,
) -> Contents:
    """Return the contents of a page; a served one may have Python blocks.

    Parameters
    ----------
    diagram : Diagram
        The diagram.
    parameters, signals, at, duration, step, panels, pace
        As for `Diagram.live` [duration, step: s; pace: -].
    is_served : bool
        Whether this process computes the runs.

    Raises
    ------
    DiagramError
        If a block computes in Python.
    SimulationError
        If an argument is invalid.
    LinearAnalysisError
        If the loop cannot be analysed.
    """
    cannot = f"cannot make a live page of '{diagram.name}'"
    positive(duration=duration)
    positive_if_given(step=step, pace=pace)
    if is_served and at is not None:
        raise SimulationError(
            "a served page has no poles and Bode plot; leave out at=, or give a file to write"
        )
    if pace is not None and not is_served:
        raise SimulationError(
            f"{cannot} with pace=: only a served page has a pace; leave out the path"
        )
    plan = Plan(diagram, step or math.inf)
    plan.loops.refuse_idle_starts()
    if plan.python_blocks and not is_served:
        names = ", ".join(
            f"'{b.path}' ({type(b).__name__})" for b in plan.python_blocks
        )
        raise DiagramError(
            f"{cannot}: {names} computes in Python, which a browser cannot run; leave out the path: "
            "live() then serves a page whose runs are computed here"
        )
    p = plan.parameters(None)
    x, d = plan.initial(p, None)
    length = exact(duration)
    tick = usual_step(plan, length, x, d, p) if step is None else exact(step)
    shown = usual_signals(plan.system) if signals is None else signals
    charted = chosen_channels(plan.system, shown)
    followed = chosen_channels(
        plan.system, list(dict.fromkeys(s for panel in panels for s in panel.signals))
    )
    channels = chosen_channels(
        plan.system, {c.name: c.port for c in (*charted, *followed)}
    )
    loops = [] if at is None else [loop_of(diagram, at)]
    quantities = [
        derivative(),
        outputs([c.port for c in channels]),
        *([] if is_served else [initialization()]),
        *(outputs([loop.port], "wire") for loop in loops),
    ]
    prepared = Prepared(
        plan, quantities, Solver(step=float(tick), solver="rk4"), channels
    )
    programs = [*prepared.programs, *(loop.program for loop in loops)]
    steps = ticks(length, tick, "the duration")
    warn_of_missed_jumps(plan, tick, (Fraction(0), length), p)
    data = {
        "name": diagram.name,
        "steps": steps,
        "pace": pace,
        "panels": [panel.script for panel in panels],
        "every": -(-steps // MAX_ROWS),
        "programs": [program.name for program in programs],
        **_simulation(prepared, steps, p, x, d),
        "controls": controls(plan, p, parameters),
        "arrays": {f"{e.path}.{e.name}": [e.start, *e.shape] for e in plan.p},
        # Name, port or state, and places in a logged row.
        "channels": [
            (c.name, f"{c.port.block.path}.{c.port.name}", c.places.tolist())
            for c in channels
        ],
        "charts": charts(channels[: len(charted)]),
        "loop": loops[0].data if loops else None,
    }
    return data, prepared, programs


def _simulation(
    prepared: Prepared, steps: int, p: Vector, x: Vector, d: Vector
) -> dict[str, Any]:
    """Return the data of the step algorithm of `steps` [-]; `p`, `x`, `d` are initial values [as declared]."""
    plan, tick = prepared.plan, prepared.tick
    return {
        "tick": [tick.numerator, tick.denominator],
        "method": [*FIXED_STEP].index("rk4"),
        "sizes": [plan.p.size, plan.x.size, plan.d_size],
        # Packed, as JSON has no infinity.
        "numbers": packed(np.concatenate([p, x, d])),
        "modes": plan.modes.span.stop,
        "stored": plan.memory.span.stop,
        "width": sum(c.port.size for c in prepared.channels),
        "kinds": plan.kinds.tolist(),
        "sides": plan.sides.span.start,
        # The set of clocks that ticks at each step.
        "due": prepared.schedule.due(0, steps + 1).tobytes(),
        # Name, first and last index of the arrays in x and in d, for messages.
        "places": [
            [
                (f"{e.path}.{e.name}", e.start, e.stop)
                for layout in group
                for e in layout
            ]
            for group in ([plan.x], plan.layouts[1:-1])
        ],
    }


def html(data: dict[str, Any], module: bytes | None) -> str:
    """Return the text of a page.

    Parameters
    ----------
    data : dict
        Its data.
    module : bytes or None
        The WebAssembly module; without it, a server computes the runs.
    """
    text = partial(package_text, package="trussflow.blocks.live")
    engine = text("linear.js") + text("worker.js") if module else text("served.js")
    # As JSON, a step with sampled blocks would take ten bytes.
    due = data.pop("due")
    return page_text(
        "trussflow.blocks.live",
        data["name"],
        connect="" if module else "connect-src 'self'",
        data=script_json(data),
        module=compressed(due + (module or b"")),
        worker=engine + text("queue.js"),
    )


# Set here, as the framework does not import this package.
Diagram._live_page = live_page
