"""Groups: a diagram that runs while it is enabled, or once at each edge of a trigger.

Each block with states or events in the group gets an input for the signal, and equations of its own: the
methods of a `GroupEquations` object, which call the equations of the block's class. Blocks after the exposed
outputs hold them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from trussflow.blocks.errors import DiagramError
from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import KINDS, Event, Mode, Signals, State
from trussflow.blocks.framework.diagram import Diagram, leaves
from trussflow.blocks.framework.equations import Equations
from trussflow.blocks.framework.port import INFERRED, Inferable, Input, Output, Port
from trussflow.blocks.support.types import Array, Vector
from trussflow.blocks.support.validation import one_of, shown

GROUP_EQUATIONS = (
    "initial_state",
    "output",
    "derivative",
    "update",
    "indicators",
    "on_event",
)
"""Equations of a block that those of a `GroupEquations` replace."""

ENABLE_THRESHOLD = 0.5
"""Threshold of enable signals and trigger edges [-]; comparisons and logic give 0 and 1."""


def enabled(group: Diagram, *, states: str = "held", outputs: str = "held") -> Diagram:
    """Let a diagram run only while a signal is above 0.5: it gets an input ``enable``.

    While it is not enabled, its continuous and sampled states are constant, its events do not happen, and its
    exposed outputs are constant. Edges of the signal are located, with every solver. An indicator that
    crosses zero meanwhile triggers its event when the group is enabled; a time event that was due happens
    then.

    Parameters
    ----------
    group : Diagram
        The diagram with its connections and exposed ports; it is changed.
    states : str
        ``"held"``: states continue from their last values; ``"reset"``: at each enabling, they start from
        their initial values (those of the blocks, not those of `initial=`).
    outputs : str
        ``"held"``: exposed outputs keep their last values while not enabled, zero before the first time;
        ``"reset"``: they are zero.

    Returns
    -------
    Diagram
        The same diagram.

    Raises
    ------
    DiagramError
        If it is no diagram that can be enabled.

    Notes
    -----
    Sampled blocks read the signal at their own instants. Sources continue with time.

    Examples
    --------
    >>> from trussflow.blocks import Constant, Diagram, Integrator, Step, enabled, simulate
    >>> timer, plant = Diagram("timer"), Diagram("plant")
    >>> one, count = timer.add(one=Constant(1.0), count=Integrator())
    >>> _ = one >> count
    >>> timer.expose(time=count.y)
    >>> switch, timer = plant.add(switch=Step(0.2), timer=enabled(timer))
    >>> _ = switch >> timer.enable
    >>> float(simulate(plant, 1.0, step=0.1)["timer.count.y"][-1].round(9))
    0.8
    """
    one_of(
        "way to treat the states of a group", states, ("held", "reset"), DiagramError
    )
    one_of(
        "way to treat the outputs of a group", outputs, ("held", "reset"), DiagramError
    )
    for block in _members(group, "enable"):
        if block.declared(State):
            kind = EnabledStates if block.sample_time is None else EnabledUpdates
            kind(block, resets=states == "reset").install()
    return _expose_group(group, "enable", lambda: GroupOutput(outputs))


def triggered(group: Diagram, *, edge: str = "rising") -> Diagram:
    """Let a diagram compute once at each edge of a signal, where it passes 0.5: it gets an input ``trigger``.

    The trigger is the clock of all sampled blocks in it, and replaces their own sample times. Exposed outputs
    have the values that are computed at an edge, from the inputs just before; zero before the first edge. An
    edge counts as one sample: equations with a sample time use that of their block.

    Parameters
    ----------
    group : Diagram
        The diagram of sampled blocks and blocks without states, with its connections and exposed ports; it is
        changed.
    edge : str
        ``"rising"``, ``"falling"`` or ``"both"``.

    Returns
    -------
    Diagram
        The same diagram.

    Raises
    ------
    DiagramError
        If it is no diagram that can be triggered, such as one with continuous states.
    """
    one_of("edge", edge, ("rising", "falling", "both"), DiagramError)
    members = _members(group, "trigger")
    for block in members:
        if block.continuous or block.has_events:
            raise DiagramError(
                f"cannot trigger '{block.path}' ({type(block).__name__}): it has "
                f"{'continuous states' if block.continuous else 'events'}, and between edges no time passes"
            )
    for block in members:
        if block.states():
            TriggeredUpdates(block, edge).install()
        elif block.sample_time is not None:
            TriggeredOutputs(block, edge).install()
        block.__dict__.update(sample_time=None, sample_offset=0.0)
    return _expose_group(group, "trigger", lambda: GroupLatch(edge))


class Gate(Block):
    """Base of blocks that follow the enable signal of a group."""

    group_enable = Input(meaning="the group runs while it is above 0.5")
    group_runs = Mode(meaning="whether the group runs")
    group_starts, group_stops = Event("rising"), Event("falling")

    def initial_state(self, u: Signals, p: Signals) -> Values:
        """Return whether the group runs from the start on."""
        return {"group_runs": np.where(u.group_enable > ENABLE_THRESHOLD, 1.0, 0.0)}

    def indicators(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the excess of the input over the threshold."""
        return dict.fromkeys(
            ("group_starts", "group_stops"), u.group_enable - ENABLE_THRESHOLD
        )

    def on_event(
        self, t: Array, x: Signals, u: Signals, p: Signals, fired: Signals
    ) -> Values:
        """Return whether the group runs after an edge of the input."""
        runs = np.where(
            fired.group_starts, 1.0, np.where(fired.group_stops, 0.0, x.group_runs)
        )
        return {"group_runs": runs}


class GroupOutput(Gate):
    """Output of an enabled group: its signal while the group runs, else a held value or zero.

    Parameters
    ----------
    otherwise : str
        ``"held"`` or ``"reset"``: the output while the group does not run.
    """

    u = Input(INFERRED, unit=INFERRED, frame=INFERRED)
    y = Output(INFERRED, unit=INFERRED, frame=INFERRED)
    kept = Mode(0.0, INFERRED, meaning="the last value")

    def __init__(self, otherwise: str) -> None:
        self.keeps = float(otherwise == "held")
        super().__init__()

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the signal, or the held value."""
        return {"y": np.where(x.group_runs > ENABLE_THRESHOLD, u.u, x.kept)}

    def on_event(
        self, t: Array, x: Signals, u: Signals, p: Signals, fired: Signals
    ) -> Values:
        """Hold the signal when the group stops."""
        kept = np.where(fired.group_stops, self.keeps * u.u, x.kept)
        return super().on_event(t, x, u, p, fired) | {"kept": kept}


class Trigger(Block):
    """Base of blocks that act at the edges of a trigger."""

    group_trigger = Input(meaning="the group computes where it passes 0.5")
    group_rises, group_falls = Event("rising"), Event("falling")

    def indicators(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the excess of the input over the threshold."""
        return dict.fromkeys(
            ("group_rises", "group_falls"), u.group_trigger - ENABLE_THRESHOLD
        )


def edge_of(kind: str, fired: Signals) -> Array:
    """Return whether the events that `fired` include an edge of this `kind`."""
    edges = {"rising": fired.group_rises, "falling": fired.group_falls}
    return edges.get(kind, np.logical_or(*edges.values()))


class GroupLatch(Trigger):
    """Output of a triggered group: the signal at the last edge.

    Parameters
    ----------
    edge : str
        ``"rising"``, ``"falling"`` or ``"both"``.
    """

    u = Input(INFERRED, unit=INFERRED, frame=INFERRED)
    y = Output(INFERRED, unit=INFERRED, frame=INFERRED)
    kept = Mode(0.0, INFERRED, meaning="the signal at the last edge")

    def __init__(self, edge: str) -> None:
        self.edge = edge
        super().__init__()

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the held value."""
        return {"y": x.kept}

    def on_event(
        self, t: Array, x: Signals, u: Signals, p: Signals, fired: Signals
    ) -> Values:
        """Hold the signal at an edge."""
        return {"kept": np.where(edge_of(self.edge, fired), u.u, x.kept)}


def _members(group: Diagram, name: str) -> list[Block]:
    """Return the blocks of a diagram that becomes a group with the input `name`."""
    given: object = group
    if not isinstance(given, Diagram) or name in group.ports:
        why = (
            f"it has a port '{name}' already"
            if isinstance(given, Diagram)
            else "it is no Diagram"
        )
        raise DiagramError(f"cannot make a group of {shown(given)}: {why}")
    blocks = list(leaves(group))
    for block in blocks:
        if not block.traced:
            raise DiagramError(
                f"cannot put '{block.path}' ({type(block).__name__}) into a group: it is a Python block; "
                "give it an input for the signal, and read it in its equations"
            )
        if not block.ports.keys().isdisjoint(("group_enable", "group_trigger")):
            raise DiagramError(
                f"cannot put '{block.path}' into a group: it is in one; join their conditions"
            )
    return blocks


def _expose_group(group: Diagram, name: str, holder: Callable[[], Block]) -> Diagram:
    """Put a block made by `holder` before each exposed output, and expose the input `name`."""
    for exposed, (inner, *_) in [*group.exposed.items()]:
        if not inner.is_input:
            held = group.add(f"{exposed}_of_group", holder())
            inner >> held.port("u")
            group.exposed[exposed] = (held.port("y"),)
            group.ports[exposed] = replace(held.port("y"), block=group, name=exposed)
    _expose(group, name)
    return group


def _expose(diagram: Diagram, name: str) -> None:
    """Expose as `name` all inputs in a `diagram` that decide when its group runs."""
    inputs = []
    for block in diagram.blocks.values():
        if isinstance(block, Diagram):
            _expose(block, name)
        own = name if isinstance(block, Diagram) else f"group_{name}"
        inputs += [block.ports[own]] if own in block.ports else []
    if inputs:
        diagram.expose(**{name: tuple(inputs)})


# -- equations of the blocks in a group -------------------------------------------------------


class GroupEquations(Equations):
    """Equations of a block in a group; they call the equations of its class.

    Parameters
    ----------
    block : Block
        The block.

    Attributes
    ----------
    kind : type
        Class of the block.
    states, events : dict
        States with modes, and events, of the class, by name.
    """

    def __init__(self, block: Block) -> None:
        self.block: Any = block
        self.kind = type(block)
        self.states: dict[str, Any] = block.declared(State)
        self.events: dict[str, Any] = block.declared(Event)

    def declarations(self) -> dict[str, Any]:
        """Return the declarations that the block gets in the group, by name."""
        return {}

    def install(self) -> None:
        """Give the block these equations and declarations."""
        names = ["initial", *filter(self.states_own, GROUP_EQUATIONS)]
        if "derivative" in names and not self.block.continuous:
            names.remove("derivative")  # of a block that has events only
        values = self.block.__dict__
        declared = self.declarations()
        values.update({name: getattr(self, name) for name in names})
        values["_declared"] = {**self.block._declared, **declared}
        for name, declaration in declared.items():
            if isinstance(declaration, Input):
                own = (Inferable(value, fixed=True) for value in ((), None, None))
                self.block.ports[name] = Port(self.block, name, declaration, *own)

    def initial(self, name: str, p: Signals) -> Vector:
        """Return the initial value of the state `name`; the class of the block knows its own states only."""
        return (self.kind if name in self.states else Block).initial(
            self.block, name, p
        )


class Enabled(GroupEquations):
    """Equations of a block in an enabled group.

    Parameters
    ----------
    block : Block
        The block.
    resets : bool
        Whether states start from their initial values at each enabling.

    Attributes
    ----------
    starts : dict
        Name of the state or mode that stores the initial value of each state. There are none if the class
        does not override `initial`: its initial values are then parameters or numbers.
    """

    def __init__(self, block: Block, *, resets: bool) -> None:
        super().__init__(block)
        self.resets = resets
        computed = resets and self.kind.initial is not Block.initial
        self.starts = {name: f"{name}_at_start" for name in self.states if computed}

    def initial(self, name: str, p: Signals) -> Vector:
        """Return the initial value of the state `name`, or of the state that stores it."""
        return super().initial(
            name.removesuffix("_at_start") if name in self.starts.values() else name, p
        )

    def first(self, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the states and modes from which the block starts at an enabling."""
        values: Values = {}
        for name, state in self.states.items():
            value = state.initial
            if name in self.starts:
                value = x[self.starts[name]]
            values[name] = p[value] if isinstance(value, str) else value
        return values | self.kind.initial_state(self.block, u, p)


class EnabledStates(Enabled):
    """Equations of a continuous block, or of a block with events, in an enabled group."""

    def __init__(self, block: Block, *, resets: bool) -> None:
        super().__init__(block, resets=resets)
        self.sides = {
            n: f"{n}_side_at_stop"
            for n, event in self.events.items()
            if event.kind != "time"
        }

    def declarations(self) -> dict[str, Any]:
        """Return the declarations of `Gate`, and modes."""
        declared = {**Gate._declared}
        for name, start in self.starts.items():
            declared[start] = Mode(0.0, self.states[name].shape)
        for name, side in self.sides.items():
            event = self.events[name]
            # Before the first enabling, the indicator is on the side from which no event happens.
            declared[side] = Mode(float(KINDS[event.kind]), event.shape)
        return declared

    def derivative(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the derivatives of the states, which are zero while the group does not run."""
        rates = self.kind.derivative(self.block, t, x, u, p)
        return {
            n: np.where(x.group_runs > ENABLE_THRESHOLD, rate, 0.0)
            for n, rate in rates.items()
        }

    def initial_state(self, u: Signals, p: Signals) -> Values:
        """Return the initial states, and whether the group runs."""
        return self.kind.initial_state(self.block, u, p) | Gate.initial_state(
            self.block, u, p
        )

    def indicators(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the indicators, which are constant while the group does not run."""
        now = self.kind.indicators(self.block, t, x, u, p)
        still = {
            n: x[self.sides[n]] if n in self.sides else np.inf for n in self.events
        }
        values = {
            n: np.where(x.group_runs > ENABLE_THRESHOLD, now[n], still[n])
            for n in self.events
        }
        return values | Gate.indicators(self.block, t, x, u, p)

    def on_event(
        self, t: Array, x: Signals, u: Signals, p: Signals, fired: Signals
    ) -> Values:
        """Return the states after events of the block, and after the group starts or stops."""
        values: Values = {n: x[n] for n in self.states}
        if self.events:
            happened = sum(np.sum(np.reshape(fired[n], (-1,))) for n in self.events) > 0
            after = self.kind.on_event(self.block, t, x, u, p, fired)
            now = self.kind.indicators(self.block, t, x, u, p)
            values |= {n: np.where(happened, value, x[n]) for n, value in after.items()}
            values |= {
                side: np.where(fired.group_stops, now[n], x[side])
                for n, side in self.sides.items()
            }
        if self.resets:
            first = self.first(x, u, p)
            values |= {
                n: np.where(fired.group_starts, value, values[n])
                for n, value in first.items()
            }
        return values | Gate.on_event(self.block, t, x, u, p, fired)


class EnabledUpdates(Enabled):
    """Equations of a sampled block in an enabled group, whose states are constant while it does not run."""

    def declarations(self) -> dict[str, Any]:
        """Return the input for the signal, and states."""
        starts = {
            start: State(self.states[name].shape) for name, start in self.starts.items()
        }
        return {"group_enable": Input(), "group_ran": State(), **starts}

    def _start(self, x: Signals, u: Signals, p: Signals) -> Signals:
        """Return the states with which the block computes: the initial ones at an enabling that resets."""
        if not self.resets:
            return x
        anew = np.logical_and(
            u.group_enable > ENABLE_THRESHOLD, x.group_ran < ENABLE_THRESHOLD
        )
        first = self.first(x, u, p)
        return Signals(
            x.owner,
            {n: np.where(anew, first[n], v) if n in first else v for n, v in x.items()},
        )

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the outputs."""
        return self.kind.output(self.block, t, self._start(x, u, p), u, p)

    def update(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the next states, and whether the group ran."""
        runs = u.group_enable > ENABLE_THRESHOLD
        following = self.kind.update(self.block, t, self._start(x, u, p), u, p)
        values = {n: np.where(runs, value, x[n]) for n, value in following.items()}
        values |= {start: x[start] for start in self.starts.values()}
        return values | {"group_ran": np.where(runs, 1.0, 0.0)}


class TriggeredOutputs(GroupEquations):
    """Equations of a sampled block without states in a triggered group, where it has no clock.

    Parameters
    ----------
    block : Block
        The block.
    edge : str
        ``"rising"``, ``"falling"`` or ``"both"``.
    """

    def __init__(self, block: Block, edge: str) -> None:
        super().__init__(block)
        self.edge = edge
        self.sample_time = block.sample_time

    def sampled(self) -> Block:
        """Return the block with its sample time, which its equations may use: it has no clock itself."""
        made: Block = object.__new__(self.kind)
        made.__dict__.update({**vars(self.block), "sample_time": self.sample_time})
        return made

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the outputs."""
        return self.kind.output(self.sampled(), t, x, u, p)


class TriggeredUpdates(TriggeredOutputs):
    """Equations of a sampled block in a triggered group: its states are modes, updated at edges."""

    def declarations(self) -> dict[str, Any]:
        """Return the declarations of `Trigger`, and modes that replace the states."""
        modes = {
            name: Mode(
                state.initial, state.shape, unit=state.unit, meaning=state.meaning
            )
            for name, state in self.states.items()
        }
        return {**Trigger._declared, **modes}

    def indicators(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the indicators of the edges."""
        return Trigger.indicators(self.block, t, x, u, p)

    def on_event(
        self, t: Array, x: Signals, u: Signals, p: Signals, fired: Signals
    ) -> Values:
        """Return the states after an edge."""
        following = self.kind.update(self.sampled(), t, x, u, p)
        happened = edge_of(self.edge, fired)
        return {n: np.where(happened, value, x[n]) for n, value in following.items()}
