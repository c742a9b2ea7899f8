"""Groups: a diagram that runs while it is enabled.

Each block with states or events in the group gets an input for the signal, and equations of its own: the
methods of an `Enabled` object, which call the equations of the block's class. Blocks after the exposed
outputs hold them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from trussflow.blocks.errors import DiagramError
from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import (
    KINDS,
    Event,
    History,
    Mode,
    Signals,
    State,
)
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
"""Equations of a block that those of an `Enabled` object replace."""

ENABLE_THRESHOLD = 0.5
"""Threshold of enable signals [-]; comparisons and logic give 0 and 1."""


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
    for what, way in (("states", states), ("outputs", outputs)):
        kind = f"way to treat the {what} of a group"
        one_of(kind, way, ("held", "reset"), DiagramError)
    resets = states == "reset"
    members = _members(group)
    for block in members:
        if resets and type(block).initial is not Block.initial:
            raise DiagramError(
                f"cannot reset '{block.path}' ({type(block).__name__}): it computes its initial states; "
                "use states='held'"
            )
    for block in members:
        if [*block.declared(State), *block.declared(Event)]:
            make = EnabledStates if block.sample_time is None else EnabledUpdates
            make(block, resets=resets).install()
    for exposed, (inner, *_) in [*group.exposed.items()]:
        if not inner.is_input:
            # The exposed port keeps its name and gets another inner end, so that
            # connections to the group stay valid.
            held = group.add(f"{exposed}_of_group", GroupOutput(outputs))
            inner >> held.u
            group.exposed[exposed] = (held.y,)
            group.ports[exposed] = replace(held.y, block=group, name=exposed)
    _expose_enable(group)
    return group


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


def _members(group: Diagram) -> list[Block]:
    """Return the blocks of a diagram that becomes a group."""
    given: object = group
    if not isinstance(given, Diagram) or "enable" in group.ports:
        why = (
            "it has a port 'enable' already"
            if isinstance(given, Diagram)
            else "it is no Diagram"
        )
        raise DiagramError(f"cannot make a group of {shown(given)}: {why}")
    blocks = list(leaves(group))
    for block in blocks:
        if not block.traced or block.declared(History):
            what = "is a Python block" if not block.traced else "stores its input"
            raise DiagramError(
                f"cannot put '{block.path}' ({type(block).__name__}) into a group: it {what}; "
                "give it an input for the signal, and read it in its equations"
            )
        if "group_enable" in block.ports:
            raise DiagramError(
                f"cannot put '{block.path}' into a group: it is in one; join their conditions"
            )
    return blocks


def _expose_enable(diagram: Diagram) -> None:
    """Expose as ``enable`` all inputs in a `diagram` that decide when its group runs."""
    inputs = []
    for block in diagram.blocks.values():
        if isinstance(block, Diagram):
            _expose_enable(block)
        name = "enable" if isinstance(block, Diagram) else "group_enable"
        inputs += [block.ports[name]] if name in block.ports else []
    if inputs:
        diagram.expose(enable=tuple(inputs))


# -- equations of the blocks in a group -------------------------------------------------------


class Enabled(Equations):
    """Equations of a block in an enabled group; they call the equations of its class.

    Parameters
    ----------
    block : Block
        The block.
    resets : bool
        Whether states start from their initial values at each enabling.

    Attributes
    ----------
    kind : type
        Class of the block.
    states, events : dict
        States with modes, and events, of the class, by name.
    sides : dict of str to str
        Mode with the side of each indicator while the group does not run, by name of the event.
    """

    def __init__(self, block: Block, *, resets: bool) -> None:
        self.block: Any = block
        self.kind = type(block)
        self.states: dict[str, Any] = block.declared(State)
        self.events: dict[str, Any] = block.declared(Event)
        self.sides = {
            n: f"{n}_side_at_stop" for n, e in self.events.items() if e.kind != "time"
        }
        self.resets = resets

    def declarations(self) -> dict[str, Any]:
        """Return the declarations that the block gets in the group, by name."""
        raise NotImplementedError

    def install(self) -> None:
        """Give the block these equations and declarations."""
        # As attributes of the instance, the new equations precede those of the class.
        # Other instances of the class are unchanged.
        names = ["initial", *filter(self.states_own, GROUP_EQUATIONS)]
        if "derivative" in names and not self.block.continuous:
            names.remove("derivative")  # of a block that has events only
        values = self.block.__dict__
        declared = self.declarations()
        values.update({name: getattr(self, name) for name in names})
        values["_declared"] = {**self.block._declared, **declared}
        signal = declared["group_enable"]
        # Shape, unit and frame of the new input: a number without unit and frame.
        own = (Inferable(value, fixed=True, own=True) for value in ((), None, None))
        self.block.ports["group_enable"] = Port(
            self.block, "group_enable", signal, *own
        )

    def initial(self, name: str, p: Signals) -> Vector:
        """Return the initial value of the state `name`; the class of the block knows its own states only."""
        return (self.kind if name in self.states else Block).initial(
            self.block, name, p
        )

    def first(self, u: Signals, p: Signals) -> Values:
        """Return the states and modes from which the block starts at an enabling."""
        values: Values = {}
        for name, state in self.states.items():
            value = state.initial
            values[name] = p[value] if isinstance(value, str) else value
        return values | self.kind.initial_state(self.block, u, p)


class EnabledStates(Enabled):
    """Equations of a continuous block, or of a block with events, in an enabled group."""

    def declarations(self) -> dict[str, Any]:
        """Return the declarations of `Gate`, and modes."""
        declared = {**Gate._declared}
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
        # A constant indicator triggers nothing. The stored value, not zero, keeps the
        # side, so that a crossing in the meantime counts at the next enabling. A time
        # event at infinity is never due.
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
            # The block may assume that one of its events fired, but an edge of the
            # enable signal calls `on_event`, too.
            happened = sum(np.sum(np.reshape(fired[n], (-1,))) for n in self.events) > 0
            after = self.kind.on_event(self.block, t, x, u, p, fired)
            now = self.kind.indicators(self.block, t, x, u, p)
            values |= {n: np.where(happened, value, x[n]) for n, value in after.items()}
            values |= {
                side: np.where(fired.group_stops, now[n], x[side])
                for n, side in self.sides.items()
            }
        if self.resets:
            # Applied last: the reset overrides events of the block at the same instant.
            first = self.first(u, p)
            values |= {
                n: np.where(fired.group_starts, value, values[n])
                for n, value in first.items()
            }
        return values | Gate.on_event(self.block, t, x, u, p, fired)


class EnabledUpdates(Enabled):
    """Equations of a sampled block in an enabled group, whose states are constant while it does not run."""

    def declarations(self) -> dict[str, Any]:
        """Return the input for the signal, and states."""
        return {"group_enable": Input(), "group_ran": State()}

    def _start(self, x: Signals, u: Signals, p: Signals) -> Signals:
        """Return the states with which the block computes: the initial ones at an enabling that resets."""
        if not self.resets:
            return x
        # Sampled blocks read the signal at their instants, so that the edge is found by
        # comparison with the previous instant, not by an event.
        anew = np.logical_and(
            u.group_enable > ENABLE_THRESHOLD, x.group_ran < ENABLE_THRESHOLD
        )
        first = self.first(u, p)
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
        return values | {"group_ran": np.where(runs, 1.0, 0.0)}
