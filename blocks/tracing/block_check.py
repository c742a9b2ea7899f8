"""One block by itself: traced, checked against NumPy, and its feedthrough read off."""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np

from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.framework.errors import BlockError, SimulationError
from trussflow.blocks.framework.external import External
from trussflow.blocks.framework.types import Array
from trussflow.blocks.tracing.calling import checked, refusal, running_errors, tracing_errors
from trussflow.blocks.tracing.program import lower
from trussflow.blocks.tracing.template import Template
from trussflow.blocks.tracing.tracing import Trace, dependencies, shape_of, symbol, to_expression, tracing

RELATIVE_TOLERANCE = 1e-9
"""Round-off between two orders of the same operations, with room for ill-conditioned blocks."""

POINTS = 4
"""Random points compared; a branch on the sign of one number escapes all with odds of 1 in 8."""


@dataclass(frozen=True, slots=True)
class Isolated:
    """What tracing a block by itself tells.

    Attributes
    ----------
    feedthrough : dict
        For each output, the inputs it depends on within the same instant.
    template : Template or None
        The traced equations; None for a Python block.
    """

    feedthrough: dict[str, frozenset[str]]
    template: Template | None = None


def equations(block: Block, t: Array, x: Signals, u: Signals, p: Signals) -> dict[str, Values]:
    """Evaluate all equations of a `block`, of `t`, `x`, `u` and `p`, and check what they return.

    Raises
    ------
    BlockError
        If a name is missing or unknown, or an array has the wrong shape.
    """
    results = {"output": checked(block, "output", block.output(t, x, u, p))}
    kind = "derivative" if block.continuous else "update"
    if block.states():
        results[kind] = checked(block, kind, getattr(block, kind)(t, x, u, p))
    return results


_known: WeakKeyDictionary[Block, Isolated] = WeakKeyDictionary()
"""Blocks are frozen, and one is often part of many plans."""


def isolate(block: Block) -> Isolated:
    """Trace a block by itself, compare with NumPy at random points, find its feedthrough.

    Raises
    ------
    TracingError
        If the equations cannot be traced, or disagree with plain NumPy.
    """
    if block not in _known:
        traced = _isolated(block) if block.traced else Isolated(_declared_feedthrough(block))
        _known[block] = traced
    return _known[block]


def _isolated(block: Block) -> Isolated:
    owner = f"block '{block.path}'"
    shapes = {p.name: p.whole_shape or () for p in block.inputs()}
    u = Signals(owner, {n: symbol(n, s) for n, s in shapes.items()})
    x = Signals(owner, {n: symbol(n, block.state_shape(n)) for n in block.states()})
    p = Signals(owner, {n: symbol(n, v.shape) for n, v in block.parameters.items()})
    t = symbol("t", ())
    with tracing_errors(block), tracing() as trace:
        traced = equations(block, t, x, u, p)
    _compare(block, (t, x, u, p), traced, trace)
    hashes = {name: {e.element_hash() for e in _elements(value)} for name, value in u.items()}
    used = dependencies([to_expression(v) for v in traced["output"].values()], trace)
    feedthrough = {
        name: frozenset(i for i, h in hashes.items() if h & symbols)
        for name, symbols in zip(traced["output"], used, strict=True)
    }
    leaves = (t, *x.values(), *u.values(), *p.values())
    return Isolated(feedthrough, Template(leaves, tuple(trace.calls), traced))


def check_kind(block: Block) -> None:
    """Refuse blocks that nothing would ever run.

    Raises
    ------
    BlockError
        If a sample time is missing.
    """
    fault = ""
    if block.traced and block.hides:
        fault = "its open() would never be called: only Python blocks (traced = False) have one"
    elif block.sample_time is None and not block.traced and not block.continuous:
        fault = "a Python block needs a sample time; add it with block.sampled(every=...)"
    elif block.sample_time is None and block.states() and not block.continuous:
        fault = (
            "discrete states need a sample time; add it with block.sampled(every=...), or write "
            "derivative() if they are continuous"
        )
    elif block.has_events and (block.traced or not block.continuous):
        fault = (
            "its hooks for events would never be called: only Python blocks (traced = False) with "
            "derivative() have events"
        )
    if fault and not isinstance(block, External):
        raise BlockError(f"cannot run block '{block.path}' ({type(block).__name__}): {fault}")


def _declared_feedthrough(block: Block) -> dict[str, frozenset[str]]:
    """Return what a Python block says about its feedthrough, checked."""
    declared = block.feedthrough()
    inputs, outputs = ({p.name for p in ports} for ports in (block.inputs(), block.outputs()))
    if set(declared) != outputs or set().union(*declared.values()) - inputs:
        raise BlockError(
            f"feedthrough() of block '{block.path}' returned {declared}; it must give, for each of "
            f"its outputs ({', '.join(outputs) or 'none'}), some of its inputs "
            f"({', '.join(inputs) or 'none'})"
        )
    return {name: frozenset(used) for name, used in declared.items()}


def _elements(value: Array) -> list[Array]:
    expression = to_expression(value)
    return [expression[i] for i in range(expression.numel())]


def _compare(
    block: Block, symbols: tuple[Array, Signals, Signals, Signals], traced: dict[str, Values], trace: Trace
) -> None:
    """Refuse a block whose traced equations give other numbers than NumPy does."""
    t, x, u, p = symbols
    leaves = [t, *x.values(), *u.values(), *p.values()]
    outputs = [v for values in traced.values() for v in values.values()]
    names = [n for values in traced.values() for n in values]
    if not outputs:
        return
    column = ca.vertcat(*map(to_expression, outputs))
    program = lower("check", [to_expression(v) for v in leaves], column, trace)
    generator = np.random.default_rng(0)
    for _ in range(POINTS):
        point = [generator.uniform(0.1, 1.0, shape_of(v)) for v in leaves]
        point = [v * generator.choice([-1.0, 1.0], v.shape) for v in point[: -len(p) or None]]
        point += [np.asarray(v) for v in block.parameters.values()]
        numbers = iter(point)
        now = next(numbers)
        states, given = (Signals(g.owner, {n: next(numbers) for n in g}) for g in (x, u))
        try:
            with np.errstate(all="ignore"), running_errors(block, "equations", float(now)):
                plain = equations(block, now, states, given, Signals(p.owner, block.parameters))
        except SimulationError as error:
            if isinstance(error.__cause__, np.linalg.LinAlgError):
                continue  # a random matrix that has no solution proves nothing
            raise refusal(block, f"in NumPy, with random numbers: {error.__cause__!r}") from error
        expected = [np.ravel(v) for values in plain.values() for v in values.values()]
        values = program.evaluate([np.ravel(v) for v in point])
        found = np.split(values, np.cumsum([len(a) for a in expected])[:-1])
        for name, a, b in zip(names, expected, found, strict=True):
            scale = max(1.0, np.abs(a[np.isfinite(a)]).max(initial=0.0))
            if not np.allclose(b, a, rtol=0, atol=RELATIVE_TOLERANCE * scale, equal_nan=True):
                worst = int(np.nanargmax(np.where(np.isnan(b), np.inf, np.abs(b - a))))
                raise refusal(
                    block,
                    f"traced and NumPy values of '{name}' differ: element {worst} is "
                    f"{b[worst]:.6g} traced, {a[worst]:.6g} in NumPy",
                )
