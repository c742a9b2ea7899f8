"""The Python blocks of a plan in one run: their equation objects, and calls with flat vectors."""

from __future__ import annotations

import contextlib
from collections.abc import Collection, Iterable, Mapping
from math import prod
from typing import Any
from weakref import WeakSet

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.errors import SimulationError, TrussflowError
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.declarations import Event, Mode, Signals
from trussflow.blocks.framework.equations import EVENTS, Equations, Values
from trussflow.blocks.framework.layout import spans
from trussflow.blocks.framework.run_state import Running, SelfStepping
from trussflow.blocks.support.types import Array, Vector
from trussflow.blocks.support.validation import number_array
from trussflow.blocks.tracing.call_checks import checked, running_errors
from trussflow.blocks.tracing.plan import Plan

FLOAT = np.dtype(float)
"""Usual type of the results of equations."""

_opened: WeakSet[Running] = WeakSet()
"""Objects that are already open."""


def open_block(block: Block, p: Signals) -> Equations:
    """Return the equation object of a `block` with parameters `p` [as declared] for one run.

    Raises
    ------
    SimulationError
        If the code of the block raises, or returns something else.
    """
    with running_errors(block, "open", None):
        opened: object = block.open(p)
    where = (
        f"open() of block '{block.path}' ({type(block).__name__}) returned {opened!r}; "
    )
    if isinstance(opened, SelfStepping) != block.steps_itself:
        must = (
            "must be a"
            if block.steps_itself
            else "must set steps_itself = True to be a"
        )
        raise SimulationError(
            where
            + f"the block has steps_itself = {block.steps_itself}; it {must} SelfStepping"
        )
    if not isinstance(opened, Running) and opened is not block:
        raise SimulationError(where + "it must be a Running, or the block itself")
    if isinstance(opened, Running):
        if opened in _opened:
            raise SimulationError(
                where + "it was opened before; each run needs a new one"
            )
        if opened.states_own(*EVENTS) and not block.has_events:
            raise SimulationError(
                where
                + "it has events, so the block must declare them, as hit = Event()"
            )
        _opened.add(opened)
    return opened


class OpenBlocks:
    """Equation objects of the Python blocks for one run, keyed by block path.

    Parameters
    ----------
    blocks : iterable of (Block, Signals)
        The blocks and their parameters, which follow when those of the run are changed [as declared].

    Attributes
    ----------
    equations : dict of str to Equations
        Equation object of each Python block: the block itself, or its `Running` object.

    Raises
    ------
    SimulationError
        If a block cannot be opened; those that were opened are closed.
    """

    def __init__(self, blocks: Iterable[tuple[Block, Signals]] = ()) -> None:
        self.equations: dict[str, Equations] = {}
        self._blocks: dict[str, Block] = {}
        try:
            for block, p in blocks:
                opened = open_block(block, p)
                self._blocks[block.path] = block
                self.equations[block.path] = (
                    SampledStepping(opened, block)
                    if isinstance(opened, SelfStepping)
                    else opened
                )
        except BaseException:
            with contextlib.suppress(TrussflowError):
                # The first error is reported.
                self.close()
            raise

    def kept(self) -> dict[str, Running]:
        """Return the objects with an internal state, by path."""
        return {path: e for path, e in self.equations.items() if isinstance(e, Running)}

    @property
    def messages(self) -> dict[str, list[str]]:
        """Messages of this run, keyed by path."""
        return {
            path: list(running.messages)
            for path, running in self.kept().items()
            if running.messages
        }

    @property
    def unrestorable(self) -> list[str]:
        """Paths of the blocks that cannot save their state."""
        return [path for path, running in self.kept().items() if not running.restores]

    def call_each(
        self, method: str, values: Mapping[str, Any] | None = None
    ) -> dict[str, Any]:
        """Call a `method` of each `Running` object; return the results by path.

        The argument of a call is the block's entry in `values`, if there are any.
        """
        found = {}
        for path, running in self.kept().items():
            with running_errors(self._blocks[path], method, None):
                own = [] if values is None else [values[path]]
                found[path] = getattr(running, method)(*own)
        return found

    def save(self) -> dict[str, Any]:
        """Return the internal states of the blocks, by path.

        Raises
        ------
        SimulationError
            If a block cannot save its state.
        """
        if stuck := self.unrestorable:
            raise SimulationError(
                f"cannot save: block '{stuck[0]}' ({type(self._blocks[stuck[0]]).__name__}) has a "
                f"state that it cannot save; {self.kept()[stuck[0]].stuck}"
            )
        return self.call_each("save")

    def close(self) -> None:
        """Close the blocks, which release their resources.

        Raises
        ------
        SimulationError
            If the code of a block raises; the other blocks are closed in any case.
        """
        with contextlib.ExitStack() as stack:
            # Unwound in reverse order: each close() is called within its
            # own `running_errors`, and an error of one block does not
            # keep the others from being closed.
            for path, running in self.kept().items():
                stack.enter_context(running_errors(self._blocks[path], "close", None))
                stack.callback(running.close)
            self.equations = {}


def check_outputs(outputs: object, size: int, name: str) -> None:
    """Raise an error if `outputs` of the self-stepping block `name` are not `size` numbers [-].

    Raises
    ------
    SimulationError
        Naming the block.
    """
    if not isinstance(outputs, np.ndarray) or outputs.shape != (size,):
        raise SimulationError(
            f"outputs() of '{name}' returned {outputs!r}; it must return one vector of {size} numbers, all "
            "ports in order of declaration"
        )


class SampledStepping(Running):
    """A block that steps itself, as a sampled block.

    At each instant, the block first takes the step from the previous instant, with its inputs held.

    Parameters
    ----------
    inner : SelfStepping
        Self-stepping object.
    block : Block
        Its block.
    """

    def __init__(self, inner: SelfStepping, block: Block) -> None:
        self._inner = inner
        self._block = block
        self.stuck = inner.stuck
        self._outputs = _laid_out({p.name: p.whole_shape for p in block.outputs()})
        self._size = sum(port.size for port in block.outputs())
        self._needed = _needed(block, block.feedthrough())
        self._is_direct = bool(self._needed.any())
        self._time: float | None = None
        self._held = np.zeros(0)
        self._first = True

    @property
    def restores(self) -> bool:
        """Whether the block can be restored."""
        return self._inner.restores

    @property
    def messages(self) -> tuple[str, ...]:
        """Messages of this run."""
        return self._inner.messages

    def tuned(self) -> None:
        """Notify the block of changed parameters."""
        self._inner.tuned()

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the outputs at the start, for initial states; the block starts again if the inputs change."""
        inputs = [np.ravel(u[port.name]) for port in self._block.inputs()]
        found = self.reach(float(t), np.concatenate([np.zeros(0), *inputs]))
        return {
            name: found[place].reshape(shape) for name, place, shape in self._outputs
        }

    def reach(self, t: float, u: Vector) -> Vector:
        """Return the outputs at an instant.

        Parameters
        ----------
        t : float
            Time of the instant [s].
        u : Vector
            All inputs [units as declared]; only those with direct feedthrough are used.
        """
        if self._time is None or (self._first and t == self._time):
            # Starts again at the same time if an iteration of initial states changes the inputs.
            # Inputs without feedthrough are NaN: they may depend on these outputs.
            self._held = np.where(self._needed, u, np.nan)
            self._inner.start(t, self._held)
            self._time = t
            outputs = self._inner.outputs()
            check_outputs(outputs, self._size, self._block.path)
            return outputs
        if t != self._time:  # an instant may be evaluated more than once
            self._inner.advance(self._time, t)
        if self._is_direct:
            self._held = np.where(self._needed, u, self._held)
            self._inner.set(self._held)
        self._time = t
        return self._inner.outputs()

    def hold(self, u: Vector) -> None:
        """Keep all inputs `u` [units as declared] for the step that follows."""
        self._held = u
        self._first = False
        self._inner.set(u)

    def save(self) -> dict[str, Any]:
        """Return the time, the held inputs and the state of the block."""
        if self._first:  # no step was taken: it starts anew
            return {"time": None}
        return {"time": self._time, "held": self._held, "state": self._inner.save()}

    def restore(self, saved: dict[str, Any]) -> None:
        """Restore the result of `save`, perhaps in another run."""
        if saved["time"] is None:
            self._time = None
            self._first = True
            return
        self._held = np.array(saved["held"])
        if self._time is None:
            self._inner.start(saved["time"], self._held)
        self._time = saved["time"]
        self._first = False
        self._inner.restore(saved["state"])

    def close(self) -> None:
        """Release everything."""
        self._inner.close()


Arrays = list[tuple[str, slice, tuple[int, ...]]]
"""Names of arrays, their places in a flat vector, and their shapes."""


class BlockCall:
    """Calls the equations of a Python block with flat vectors: its states, inputs, parameters.

    Parameters
    ----------
    plan : Plan
        The plan that the block is in.
    block : Block
        The block.

    Attributes
    ----------
    block : Block
        The block.
    path : str
        Its path.
    states, outputs, parameters : slice
        Indices of its states in x (continuous block) or d (sampled block), of its outputs in
        d, and its parameters in p.
    size : int
        Number of its states [-].
    modes, events, fired : slice
        Indices of its modes and event flags in d, and of its indicators among all.
    needed : array of bool
        Inputs with direct feedthrough to any output.
    direct : bool
        Whether there are any.
    unknown : Vector
        Inputs that are not known, NaN [-].
    """

    def __init__(self, plan: Plan, block: Block) -> None:
        path = block.path
        self.block = block
        self.path = path
        self.states = (plan.x if block.continuous else plan.memory).span_of(path)
        self.outputs = plan.held.span_of(path)
        self.parameters = plan.p.span_of(path)
        self.modes = plan.modes.span_of(path)
        self.fired = plan.fired.span_of(path)
        first = plan.fired.span.start
        # The event flags are a part of d; indicators have the
        # same order, counted from 0.
        self.events = slice(self.fired.start - first, self.fired.stop - first)
        self.size = self.states.stop - self.states.start
        states = [*block.states()]
        stored = [*states, *block.declared(Mode)]
        self._stored = _laid_out({n: block.state_shape(n) for n in stored})
        self._inputs = _laid_out({p.name: p.whole_shape for p in block.inputs()})
        self._parameters = _laid_out({n: v.shape for n, v in block.parameters.items()})
        self._events = _laid_out(
            {n: block.state_shape(n) for n in block.declared(Event)}
        )
        self._results = {
            "output": _laid_out({p.name: p.whole_shape for p in block.outputs()}),
            "indicators": self._events,
            "on_event": self._stored,
        }
        self._states = self._stored[: len(states)]
        self.needed = _needed(block, plan.feedthrough[path])
        self.direct = bool(self.needed.any())
        self.unknown = np.full(self.needed.size, np.nan)
        self._owner = f"block '{path}'"
        self._nothing = Signals(self._owner, {})

    def own(self, x: Vector, d: Vector) -> Vector:
        """Return the block's own states, then its modes, of all `x` and `d` [as declared]; a copy."""
        own: Vector = (x if self.block.continuous else d)[self.states]
        if self.modes.start == self.modes.stop:
            return own.copy()
        return np.concatenate([own, d[self.modes]])

    def places(self, size: int) -> NDArray[np.int64]:
        """Return where states and modes of a continuous block are in (x, modes); x has that `size` [-]."""
        modes = np.r_[size + self.modes.start : size + self.modes.stop]
        return np.concatenate([np.r_[self.states], modes]).astype(np.int64)

    def happened(self, flags: NDArray[np.bool_]) -> Signals:
        """Return the `flags` [-] of the block's events by name."""
        return self._signals(self._events, flags)

    def _signals(self, arrays: Arrays, flat: NDArray[Any]) -> Signals:
        if not arrays:
            return self._nothing
        values = {name: flat[place].reshape(shape) for name, place, shape in arrays}
        return Signals(self._owner, values)

    def ask(
        self,
        equations: Equations,
        kind: str,
        t: float,
        s: Vector,
        u: Vector,
        p: Vector,
        *more: Signals,
    ) -> Any:
        """Return the result of an equation, unchecked.

        Parameters
        ----------
        equations : Equations
            Equation object of the block in this run.
        kind : str
            Name of the equation.
        t : float
            Time [s].
        s, u, p : Vector
            The block's own states and modes, inputs and parameters [units as declared].
        *more : Signals
            Further arguments of the equation.
        """
        try:
            return getattr(equations, kind)(
                np.float64(t), *self.signals(s, u, p), *more
            )
        except Exception:
            # only now, as a context takes as long as the call of a small function
            with running_errors(self.block, kind, t):
                raise

    def signals(
        self, s: Vector, u: Vector, p: Vector
    ) -> tuple[Signals, Signals, Signals]:
        """Return the block's own states and modes `s`, inputs `u`, parameters `p` [as declared] by name."""
        return (
            self._signals(self._stored, s),
            self._signals(self._inputs, u),
            self._signals(self._parameters, p),
        )

    def __call__(
        self,
        equations: Equations,
        kind: str,
        t: float,
        s: Vector,
        u: Vector,
        p: Vector,
        *more: Signals,
    ) -> Vector:
        """Return the result of an equation, checked, in one vector; arguments as for `ask`."""
        return self.flat(kind, self.ask(equations, kind, t, s, u, p, *more), s)

    def flat(self, kind: str, values: Any, s: Vector) -> Vector:
        """Return the `values` that an equation of that `kind` returned, checked, in one vector.

        States and modes that `on_event` did not return are those in `s` [as declared].
        """
        order = self._results.get(kind, self._states)
        flat = np.empty(order[-1][1].stop if order else 0)
        if isinstance(values, dict) and len(values) == len(order):
            # the usual case, without the time of the checks
            for name, place, shape in order:
                value = values.get(name)
                if not shape and type(value) in (float, np.float64):
                    flat[place] = value
                elif (
                    type(value) is np.ndarray
                    and value.dtype is FLOAT
                    and value.shape == shape
                ):
                    flat[place] = value.reshape(-1)
                else:
                    break
            else:
                return flat
        if isinstance(values, dict):
            where = f"what {kind}() of Python block '{self.path}' returned as"
            values = {
                name: number_array(f"{where} '{name}'", value)
                for name, value in values.items()
            }
        arrays = checked(self.block, kind, values)
        if kind == "on_event":
            # An event changes only some states and modes; the others keep their values.
            arrays = {
                name: arrays.get(name, s[place]) for name, place, _ in self._stored
            }
        for name, place, _ in order:
            flat[place] = np.ravel(arrays[name])
        return flat


def _needed(
    block: Block, feedthrough: Mapping[str, Collection[str]]
) -> NDArray[np.bool_]:
    """Return for each input element of a block whether it has direct feedthrough to any output."""
    names = frozenset[str]().union(*feedthrough.values())
    marks = [np.full(port.size, port.name in names) for port in block.inputs()]
    return np.concatenate([np.zeros(0, dtype=bool), *marks])


def _laid_out(shapes: Mapping[str, tuple[int, ...] | None]) -> Arrays:
    """Return the places of arrays of these `shapes` [-], by name, one after the other in a vector."""
    known = {name: shape or () for name, shape in shapes.items()}
    places = spans(map(prod, known.values()))
    return list(zip(known, places, known.values(), strict=True))
