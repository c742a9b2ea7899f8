"""Check of a single block: tracing, comparison with NumPy, and direct feedthrough."""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from types import MethodType
from weakref import WeakKeyDictionary

import casadi as ca
import numpy as np

from trussflow.blocks.errors import BlockError, SimulationError, TrussflowError
from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Event, History, Mode, Signals
from trussflow.blocks.framework.layout import Entry, Layout
from trussflow.blocks.framework.port import properties_of
from trussflow.blocks.support.types import Array
from trussflow.blocks.tracing.call_checks import (
    brief,
    checked,
    equation,
    refusal,
    tracing_errors,
)
from trussflow.blocks.tracing.kernels import (
    column_of,
    expressions,
    shapes_of,
    symbol,
    tracing,
)
from trussflow.blocks.tracing.program import Program
from trussflow.blocks.tracing.traced_block import TracedBlock

ROUND_OFF_TOLERANCE = 1e-9
"""Largest relative difference between two orders of the same operations, ill-conditioned blocks included."""

RANDOM_POINTS = 4
"""Count of random points; they all miss one branch on the sign of one number with probability 1/8."""

SPECIAL_VALUES = (0.0, 1.0e3, np.nan, np.inf)
"""Values of one element of each array, with random sign, at the special points [any].

At one more special point, all elements are equal. At special points, a difference counts only where NumPy
returns a finite number: CasADi may return one where NumPy returns NaN.
"""

SPECIAL_TOLERANCE = 1e-6
"""Largest relative difference at special points, where large numbers cancel more digits."""

NEARBY_FACTOR = 1.0 + 1e-9
"""Factor from a special point to a nearby one; a difference counts only if NumPy's results agree at both."""


@dataclass(frozen=True, slots=True)
class Isolated:
    """Result of checking a single block.

    Attributes
    ----------
    feedthrough : dict
        Inputs with direct feedthrough to each output.
    traced : TracedBlock or None
        The traced equations; None for a Python block.
    """

    feedthrough: dict[str, frozenset[str]]
    traced: TracedBlock | None = None


UNSHARED_ATTRIBUTES = ("name", "parent", "parameters", "extra_ports")
"""Attributes that may differ between blocks with the same equations; the traced copy has none of them."""

SharedResults = dict[bytes | None, Isolated | None]
"""Result shared by all blocks with the same `equations_key`; None if it cannot be shared."""


def kinds(block: Block) -> list[str]:
    """Return the names of the equations that a `block` has."""
    found = [
        "output",
        *(["derivative" if block.continuous else "update"] if block.states() else []),
    ]
    return [*found, "indicators", "on_event"] if block.declared(Event) else found


def argument_shapes(block: Block) -> tuple[dict[str, tuple[int, ...]], ...]:
    """Return the shapes of the states, modes and traced histories, inputs, and events of a `block`."""
    x, fired = (
        {n: block.state_shape(n) for n in names}
        for names in (
            [*block.states(), *block.declared(Mode), *block.declared(History)],
            block.declared(Event),
        )
    )
    return x, {p.name: p.whole_shape or () for p in block.inputs()}, fired


_results: WeakKeyDictionary[Block, tuple[list[tuple[object, ...]], Isolated]] = (
    WeakKeyDictionary()
)
"""Results by block, with the properties of its ports at that time.

A block is frozen and may be in several plans, but connections may change the properties of its ports.
"""


def isolate(block: Block, shared: SharedResults | None = None) -> Isolated:
    """Trace a single block, compare it with NumPy at random points, and find its feedthrough.

    Parameters
    ----------
    block : Block
        The block.
    shared : dict, optional
        Results of other blocks, used for blocks with the same equations.

    Raises
    ------
    TracingError
        If the equations cannot be traced, or disagree with plain NumPy.
    """
    ports = properties_of(block.ports.values())
    if block not in _results or _results[block][0] != ports:
        found = _isolated(block) if shared is None else _shared_result(block, shared)
        _results[block] = ports, found
    return _results[block][1]


def _shared_result(block: Block, shared: SharedResults) -> Isolated:
    """Return the result of a block with the same equations, from `shared` if it is there."""
    key = equations_key(block)
    if key is not None and key not in shared:
        # If the check fails, checking the block itself shows whether it or the copy is at fault.
        shared[key] = None
        with suppress(TrussflowError):
            shared[key] = _isolated(block, _anonymous_copy(block))
    return shared.get(key) or _isolated(block)


def equations_key(block: Block) -> bytes | None:
    """Return bytes that are equal for two blocks only if their equations are the same; None if unknown.

    Besides their arguments, equations can read the class, the attributes and the ports of their block.
    """
    # Not `block.__getstate__`, which a class may override to omit attributes.
    attributes = object.__getstate__(block)
    if not isinstance(attributes, dict):
        return None  # attributes in slots are not compared
    if not block.traced or any(isinstance(v, MethodType) for v in attributes.values()):
        return None  # methods of another object, which refers to the block
    read = {
        n: v
        for n, v in attributes.items()
        if n not in (*UNSHARED_ATTRIBUTES, "ports", "inferred_shape")
    }
    ports = properties_of(block.ports.values())
    shapes = shapes_of(block.parameters)
    everything = (type(block), read, ports, shapes, block.inferred_shape.get())
    try:
        # Equal bytes imply equal content. Unequal bytes of equal content only cost
        # another check.
        return pickle.dumps(everything)
    except Exception:  # noqa: BLE001 - any error, for example of a lambda
        return None


def _anonymous_copy(block: Block) -> Block:
    """Return a copy of a `block` without name and parameter values; equations that read them fail."""
    copy: Block = object.__new__(type(block))
    values = copy.__dict__
    values.update(
        (n, v) for n, v in vars(block).items() if n not in UNSHARED_ATTRIBUTES
    )
    values["ports"] = {n: replace(p, block=copy) for n, p in block.ports.items()}
    return copy


def _isolated(block: Block, copy: Block | None = None) -> Isolated:
    """Return the result of checking a `block`; if there is a `copy`, that is traced in its place."""
    if not block.traced:
        return Isolated(_declared_feedthrough(block))
    owner = f"block '{block.path}'"
    shapes = (*argument_shapes(block), shapes_of(block.parameters))
    x, u, fired, p = (
        Signals(owner, {n: symbol(n, s) for n, s in each.items()}) for each in shapes
    )
    t, values = symbol("t", ()), dict[str, Values]()
    with tracing_errors(block), tracing() as trace:
        for kind in kinds(block):
            made = equation(copy or block, kind, fired)(t, x, u, p)
            values[kind] = checked(block, kind, made)
    arguments = (t, *x.values(), *u.values(), *p.values(), *fired.values())
    results = Layout(
        [
            (kind, name, shape)
            for kind, made in values.items()
            for name, shape in shapes_of(made).items()
        ]
    )
    program = Program(
        "block",
        tuple(expressions(arguments)),
        tuple(trace),
        column_of(v for made in values.values() for v in made.values()),
        shares=False,
    )
    _compare(block, (x, u, fired), [*values], program.function, results)
    # Feedthrough is structural: an output depends on an input if the Jacobian has an
    # element that is not always zero. Inputs follow t and the states.
    rows = {
        name: {*program.function.jac_sparsity(0, 1 + len(x) + number).row()}
        for number, name in enumerate(u)
    }

    def read_by(e: Entry) -> frozenset[str]:
        return frozenset(n for n, r in rows.items() if r & {*range(e.start, e.stop)})

    for e in results.of("indicators"):
        if block.declared(Event)[e.name].kind == "time" and (inputs := read_by(e)):
            raise BlockError(
                f"the time of event '{e.name}' of block '{block.path}' depends on input "
                f"{', '.join(sorted(inputs))}, and may change between events: let on_event() keep it in a "
                "Mode, or declare an event of another kind, whose indicator is that time minus t"
            )
    feedthrough = {e.name: read_by(e) for e in results.of("output")}
    return Isolated(feedthrough, TracedBlock(program, results))


def _declared_feedthrough(block: Block) -> dict[str, frozenset[str]]:
    """Return the checked feedthrough that a Python block declares."""
    declared = block.feedthrough()
    inputs, outputs = (
        {p.name for p in ports} for ports in (block.inputs(), block.outputs())
    )
    if set(declared) != outputs or set().union(*declared.values()) - inputs:
        raise BlockError(
            f"feedthrough() of block '{block.path}' returned {declared}; it must give, for each of "
            f"its outputs ({', '.join(outputs) or 'none'}), some of its inputs "
            f"({', '.join(inputs) or 'none'})"
        )
    return {name: frozenset(used) for name, used in declared.items()}


def _compare(
    block: Block,
    arguments: tuple[Signals, Signals, Signals],
    kinds: Sequence[str],
    function: ca.Function,
    results: Layout,
) -> None:
    """Raise `TracingError` if the traced `function` of a block returns other `results` than NumPy.

    Numbers replace the symbols in the `arguments`: states, inputs and events. The `kinds` are those of the
    equations.
    """
    if not results.size:
        return
    x, u, fired = arguments
    own = Signals(u.owner, block.parameters)
    equations = [
        (kind, equation(block, kind, fired), results.of(kind)) for kind in kinds
    ]

    def plain(point: Sequence[Array], check: bool = False) -> Array:
        """Return the results in NumPy, one after the other."""
        now, *arrays = point
        numbers = iter(arrays)
        for group in arguments:
            # `zip` takes a name first, so that it stops before the next number.
            group.update(zip([*group], numbers, strict=False))
        fired.update({n: v > 0 for n, v in fired.items()})
        columns = [np.zeros(0)]
        for kind, compute, entries in equations:
            values = compute(now, x, u, own)
            if check:
                checked(block, kind, values)
            columns += [np.ravel(values[e.name]) for e in entries]
        return np.concatenate(columns)

    shapes = (value.shape for group in arguments for value in group.values())
    chosen = points(((), *shapes))
    columns = [
        np.reshape(each, (len(chosen), -1)).T for each in zip(*chosen, strict=True)
    ]
    # CasADi evaluates a function at several points at once, one column per point.
    before_events = 1 + len(x) + len(u)
    found = function(
        *columns[:before_events],
        *(np.repeat(np.reshape(v, (-1, 1)), len(chosen), 1) for v in own.values()),
        *(np.where(v > 0, 1.0, 0.0) for v in columns[before_events:]),
    ).full()
    for number, (point, values) in enumerate(zip(chosen, found.T, strict=True)):
        special = number >= RANDOM_POINTS
        tolerance = SPECIAL_TOLERANCE if special else ROUND_OFF_TOLERANCE
        try:
            with np.errstate(all="ignore"):
                expected = plain(point, check=number == 0)
                wrong = _differing(values, expected, results, tolerance)
                if special:
                    # CasADi drops products with a structural zero, NumPy's 0 * NaN is NaN; later branches
                    # may then differ. So a difference counts only if NumPy's result is stable nearby.
                    lost = np.isnan(expected) & np.isfinite(values)
                    wrong &= np.isfinite(expected) & ~lost.any()
                    nearby = (
                        [v * NEARBY_FACTOR for v in point],
                        [np.where(v == 0.0, -v, v) for v in point],
                    )
                    for near in nearby if wrong.any() else ():
                        wrong &= ~_differing(plain(near), expected, results, tolerance)
        except (SimulationError, np.linalg.LinAlgError):
            continue  # the block rejects the values, or a random matrix is singular
        except TrussflowError:
            raise
        except Exception as error:
            if special:
                continue
            reason = f"in NumPy, with random numbers: {brief(error)}"
            raise refusal(block, reason, error) from error
        if wrong.any():
            worst = int(np.argmax(wrong))
            raise refusal(
                block,
                f"traced and NumPy values of {results.describe(worst)} differ: "
                f"{values[worst]:.6g} traced, {expected[worst]:.6g} in NumPy",
            )


@lru_cache
def points(
    shapes: tuple[tuple[int, ...], ...], number: int = RANDOM_POINTS
) -> list[list[Array]]:
    """Return read-only points: arrays of these `shapes` [-].

    The first `number` [-] points are random, the others are the special points. Blocks with equal shapes
    share them.
    """
    generator = np.random.default_rng(0)

    def ordinary() -> list[Array]:
        return [
            np.array(generator.uniform(0.1, 1.0, s) * generator.choice([-1.0, 1.0], s))
            for s in shapes
        ]

    found = [ordinary() for _ in range(number + len(SPECIAL_VALUES))]
    for point, value in zip(found[number:], SPECIAL_VALUES, strict=True):
        # Time stays ordinary: no run has an infinite time.
        for array in (a for a in point[1:] if a.size):
            place = generator.integers(array.size)
            array.flat[place] = value * generator.choice([-1.0, 1.0])
    found.append([np.full(s, 0.5) for s in shapes])
    for array in (a for point in found for a in point):
        array.flags.writeable = False
    return found


def _differing(
    found: Array, expected: Array, results: Layout, tolerance: float
) -> Array:
    """Return a mask of the elements of `results` that differ by more than the tolerance.

    Parameters
    ----------
    found, expected : Array
        The results, one after the other [any].
    results : Layout
        The places of the results.
    tolerance : float
        Relative to the largest element of the same result, but at least absolute [-].
    """
    same = (found == expected) | (np.isnan(found) & np.isnan(expected))
    if same.all():
        return ~same
    allowed = np.where(np.isfinite(expected), np.abs(expected), 0.0)
    for e in results:
        part = allowed[e.start : e.stop]
        # Relative to the whole result: an element may be a difference of large terms.
        part[:] = tolerance * part.max(initial=1.0)
    with np.errstate(invalid="ignore"):
        return ~(same | (np.abs(found - expected) <= allowed))
