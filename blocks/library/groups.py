"""Groups: a diagram that runs while it is enabled, or once at each edge of a trigger.

Nothing but blocks and wires: what has states in the diagram gets one input more, and equations that heed it,
by a class made of its own class; what is exposed is held by a block of its own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np

from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import KINDS, Event, Mode, Signals, State
from trussflow.blocks.framework.diagram import Diagram, leaves
from trussflow.blocks.framework.equations import Equations
from trussflow.blocks.framework.errors import DiagramError
from trussflow.blocks.framework.port import INFERRED, Inferable, Input, Output, Port
from trussflow.blocks.framework.types import Array, Vector
from trussflow.blocks.framework.validation import one_of, shown

Maker = Callable[[type[Block]], type[Block]]
"""Makes a class that heeds what a group does of the class of a block."""

ENABLE_THRESHOLD = 0.5
"""Threshold of enable signals and trigger edges [-]; comparisons and logic give 0 and 1."""


def enabled(group: Diagram, *, states: str = "held", outputs: str = "held") -> Diagram:
    """Let a diagram run only while a signal is above 0.5: it gets an input ``enable``.

    While it is not enabled, continuous and sampled states in it stand still, events do not happen, and what
    it exposes does not move. Edges of the signal are located, with every solver. An indicator that has
    crossed zero meanwhile is an event when the group is enabled; a time event that was due happens then.

    Parameters
    ----------
    group : Diagram
        The diagram, wired inside and exposed; it is changed, and wired to the outside as before.
    states : str
        ``"held"``: states go on from where they stopped; ``"reset"``: at each enabling, from their initial
        values (those of the blocks, not those of `initial=`).
    outputs : str
        ``"held"``: what is exposed keeps its last values while not enabled, zero before the first time;
        ``"reset"``: it is zero.

    Returns
    -------
    Diagram
        The same.

    Raises
    ------
    DiagramError
        If it is no diagram that can be enabled.

    Notes
    -----
    Sampled blocks look at the signal at their own instants. Sources go on with time.

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
    one_of("way to treat the states of a group", states, ("held", "reset"), DiagramError)
    one_of("way to treat the outputs of a group", outputs, ("held", "reset"), DiagramError)

    def kind(block: Block) -> Maker | None:
        if states == "reset" and type(block).initial is not Block.initial:
            raise DiagramError(
                f"cannot reset '{block.path}' ({type(block).__name__}) at each enabling: it computes its "
                'initial states in initial(), once for each run; use states="held"'
            )
        return None if not block.declared(State) else _enabled if block.sample_time is None else _sampled

    return _made(group, "enable", kind, partial(GroupOutput, outputs), group_resets=states == "reset")


def triggered(group: Diagram, *, edge: str = "rising") -> Diagram:
    """Let a diagram compute once at each edge of a signal, where it passes 0.5: it gets an input ``trigger``.

    The trigger is the clock of all sampled blocks in it, in the place of their own sample times. What it
    exposes is what it computes at an edge, from the inputs just before; zero before the first one. An edge
    counts as one sample: equations with a sample time in them use that of their block.

    Parameters
    ----------
    group : Diagram
        The diagram, of sampled blocks and blocks without memory, wired inside and exposed; it is changed.
    edge : str
        ``"rising"``, ``"falling"`` or ``"both"``.

    Returns
    -------
    Diagram
        The same.

    Raises
    ------
    DiagramError
        If it is no diagram that can be triggered, such as one with continuous states.
    """
    one_of("edge", edge, ("rising", "falling", "both"), DiagramError)

    def kind(block: Block) -> Maker | None:
        if block.continuous or block.has_events:
            raise DiagramError(
                f"cannot trigger '{block.path}' ({type(block).__name__}): it has "
                f"{'continuous states' if block.continuous else 'events'}, and between edges no time passes"
            )
        if block.states():
            return _triggered
        return None if block.sample_time is None else _clockless

    made = _made(group, "trigger", kind, partial(GroupLatch, edge), group_edge=edge)
    for block in leaves(made):
        block.__dict__.update(group_sample_time=block.sample_time, sample_time=None, sample_offset=0.0)
    return made


class Gate(Block):
    """Base of blocks that follow the enable signal of a group."""

    group_enable = Input(meaning="the group runs while it is above 0.5")
    group_runs = Mode(meaning="whether the group runs")
    group_starts, group_stops = Event("rising"), Event("falling")

    def initial_state(self, u: Signals, p: Signals) -> Values:
        """Run from the start on, if the input says so."""
        return {"group_runs": np.where(u.group_enable > ENABLE_THRESHOLD, 1.0, 0.0)}

    def indicators(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return how far the input is above the level."""
        return dict.fromkeys(("group_starts", "group_stops"), u.group_enable - ENABLE_THRESHOLD)

    def on_event(self, t: Array, x: Signals, u: Signals, p: Signals, fired: Signals) -> Values:
        """Start, or stop."""
        runs = np.where(fired.group_starts, 1.0, np.where(fired.group_stops, 0.0, x.group_runs))
        return {"group_runs": runs}


class GroupOutput(Gate):
    """Output of an enabled group, which passes while the group runs.

    Parameters
    ----------
    otherwise : str
        ``"held"`` or ``"reset"``: what it is while the group does not run.
    """

    u = Input(INFERRED, unit=INFERRED, frame=INFERRED)
    y = Output(INFERRED, unit=INFERRED, frame=INFERRED)
    kept = Mode(0.0, INFERRED, meaning="the last value")

    def __init__(self, otherwise: str) -> None:
        self.keeps = float(otherwise == "held")
        super().__init__()

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the signal, or what was kept of it."""
        return {"y": np.where(x.group_runs > ENABLE_THRESHOLD, u.u, x.kept)}

    def on_event(self, t: Array, x: Signals, u: Signals, p: Signals, fired: Signals) -> Values:
        """Keep the signal where the group stops."""
        kept = np.where(fired.group_stops, self.keeps * u.u, x.kept)
        return super().on_event(t, x, u, p, fired) | {"kept": kept}


class Trigger(Block):
    """Base of blocks that act at the edges of a trigger."""

    group_trigger = Input(meaning="the group computes where it passes 0.5")
    group_rises, group_falls = Event("rising"), Event("falling")

    group_edge: str

    def indicators(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return how far the input is above the level."""
        return dict.fromkeys(("group_rises", "group_falls"), u.group_trigger - ENABLE_THRESHOLD)

    def heeded(self, fired: Signals) -> Array:
        """Return whether what happens is an edge of the kind meant."""
        edges = {"rising": fired.group_rises, "falling": fired.group_falls}
        return edges.get(self.group_edge, np.logical_or(*edges.values()))


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
        self.group_edge = edge
        super().__init__()

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return what was kept."""
        return {"y": x.kept}

    def on_event(self, t: Array, x: Signals, u: Signals, p: Signals, fired: Signals) -> Values:
        """Keep the signal."""
        return {"kept": np.where(self.heeded(fired), u.u, x.kept)}


def _made(
    group: Diagram, name: str, kind: Callable[[Block], Maker | None], output: Callable[[], Block], **how: Any
) -> Diagram:
    """Let all that needs it in a `group` heed an input `name`, and put an `output` before what is exposed."""
    given: object = group
    if not isinstance(given, Diagram) or name in group.ports:
        why = f"it has a port '{name}' already" if isinstance(given, Diagram) else "it is no Diagram"
        raise DiagramError(f"cannot make a group of {shown(given)}: {why}")
    makers: dict[Block, Maker] = {}
    for block in leaves(group):
        if not block.traced:
            raise DiagramError(
                f"cannot put '{block.path}' ({type(block).__name__}) into a group: it is a Python block; "
                "let it heed the signal itself, as an input"
            )
        if isinstance(block, Gate | Trigger):
            raise DiagramError(f"cannot put '{block.path}' into a group: it is in one; join their conditions")
        if made := kind(block):
            makers[block] = made
    for block, made in makers.items():
        block.__dict__.update(how)
        base: Any = type(block)
        own = {n: d for n, d in block.__dict__.pop("_declared", {}).items() if n not in base._declared}
        _become(block, _class_of(made, base, *own.items()))
    for exposed, (inner, *_) in [*group.exposed.items()]:
        if not inner.is_input:
            held = group.add(f"{exposed}_of_group", output())
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


def _become(block: Block, made: type[Block]) -> None:
    """Let a `block` be of a class `made` of its own: it keeps its name, its values and its wires."""
    object.__setattr__(block, "__class__", made)
    for name in ("group_enable", "group_trigger"):
        if name in made._declared:
            own = (Inferable(value, fixed=True) for value in ((), None, None))
            block.ports[name] = Port(block, name, made._declared[name], *own)


# -- classes made of others -------------------------------------------------------------------


@cache
def _class_of(make: Maker, base: Any, *own: Any) -> type[Block]:
    """Return the class that `make` makes of a `base`, with what a block declares as its `own`."""

    def reduced(self: Block, _protocol: int) -> tuple[Any, ...]:
        return _blank, (make, base, *own), {**vars(self)}

    inner: Any = type(base.__name__, (base,), dict(own))

    def initial(self: Block, name: str, p: Signals) -> Vector:
        """Return the initial value of a state: a block that overrides this knows its own states only."""
        own_value: Vector = (inner if name in inner._declared else Block).initial(self, name, p)
        return own_value

    members = {"__module__": __name__, "__reduce_ex__": reduced, "initial": initial}
    return type(base.__name__, (make(inner),), members)


def _blank(make: Maker, base: Any, *own: Any) -> Block:
    """Return an empty block of such a class, to be filled by pickle or copy."""
    return object.__new__(_class_of(make, base, *own))


def _states(base: type[Block], name: str) -> bool:
    """Tell whether a class states the equation `name`."""
    return getattr(base, name) is not getattr(Equations, name)


def _initial(base: type[Block], block: Block, u: Signals, p: Signals) -> Values:
    """Return the states and modes from which a `block` starts anew."""
    declared = {n: d.initial for n, d in base._declared.items() if isinstance(d, State)}
    values: Values = {n: p[value] if isinstance(value, str) else value for n, value in declared.items()}
    return values | base.initial_state(block, u, p)


def _kinds(base: type[Block], kind: type[Any]) -> dict[str, Any]:
    return {n: d for n, d in base._declared.items() if isinstance(d, kind)}


def _enabled(base: type[Block]) -> type[Block]:
    """Return the class of continuous blocks, and of blocks with events, that stand still while disabled."""
    events = _kinds(base, Event)
    sides = {n: f"{n}_side_at_stop" for n, event in events.items() if event.kind != "time"}

    def derivative(self: Any, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        rates = base.derivative(self, t, x, u, p)
        return {n: np.where(x.group_runs > ENABLE_THRESHOLD, rate, 0.0) for n, rate in rates.items()}

    def initial_state(self: Any, u: Signals, p: Signals) -> Values:
        return base.initial_state(self, u, p) | Gate.initial_state(self, u, p)

    def indicators(self: Any, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        own = base.indicators(self, t, x, u, p)
        still = {n: x[sides[n]] if n in sides else np.inf for n in events}
        runs = {n: np.where(x.group_runs > ENABLE_THRESHOLD, own[n], still[n]) for n in events}
        return runs | Gate.indicators(self, t, x, u, p)

    def on_event(self: Any, t: Array, x: Signals, u: Signals, p: Signals, fired: Signals) -> Values:
        values = {n: x[n] for n in _kinds(base, State)}
        if events:
            happened = sum(np.sum(np.reshape(fired[n], (-1,))) for n in events) > 0
            after, now = base.on_event(self, t, x, u, p, fired), base.indicators(self, t, x, u, p)
            values |= {n: np.where(happened, value, x[n]) for n, value in after.items()}
            values |= {side: np.where(fired.group_stops, now[n], x[side]) for n, side in sides.items()}
        if self.group_resets:
            values |= {
                n: np.where(fired.group_starts, value, values[n])
                for n, value in _initial(base, self, u, p).items()
            }
        return values | Gate.on_event(self, t, x, u, p, fired)

    # Before the first time, on the side from which nothing happens.
    members: dict[str, Any] = {
        side: Mode(float(KINDS[events[n].kind]), events[n].shape) for n, side in sides.items()
    }
    members |= {"derivative": derivative} if _states(base, "derivative") else {}
    members |= {"initial_state": initial_state, "indicators": indicators, "on_event": on_event}
    return type(base.__name__, (Gate, base), members)


def _sampled(base: type[Block]) -> type[Block]:
    """Return the class of sampled blocks whose states stand still while disabled."""

    def start(self: Any, x: Signals, u: Signals, p: Signals) -> Signals:
        if not self.group_resets:
            return x
        anew = np.logical_and(u.group_enable > ENABLE_THRESHOLD, x.group_ran < ENABLE_THRESHOLD)
        first = _initial(base, self, u, p)
        return Signals(x.owner, {n: np.where(anew, first[n], v) if n in first else v for n, v in x.items()})

    def output(self: Any, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        return base.output(self, t, start(self, x, u, p), u, p)

    def update(self: Any, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        runs = u.group_enable > ENABLE_THRESHOLD
        following = base.update(self, t, start(self, x, u, p), u, p)
        values = {n: np.where(runs, value, x[n]) for n, value in following.items()}
        return values | {"group_ran": np.where(runs, 1.0, 0.0)}

    members = {"group_enable": Input(), "group_ran": State(), "output": output, "update": update}
    return type(base.__name__, (base,), members)


def _as_sampled(base: type[Block], block: Any) -> Block:
    """Return a `block` with its sample time, as its equations need it; it has none, having no clock."""
    made = object.__new__(base)
    made.__dict__.update({**vars(block), "sample_time": block.group_sample_time})
    return made


def _clockless(base: type[Block]) -> type[Block]:
    """Return the class of sampled blocks that have no clock of their own."""

    def output(self: Any, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        return base.output(_as_sampled(base, self), t, x, u, p)

    return type(base.__name__, (base,), {"output": output})


def _triggered(base: type[Block]) -> type[Block]:
    """Return the class of blocks whose states are modes, updated at edges of a trigger."""
    states = _kinds(base, State)

    def on_event(self: Any, t: Array, x: Signals, u: Signals, p: Signals, fired: Signals) -> Values:
        following, heeded = base.update(_as_sampled(base, self), t, x, u, p), self.heeded(fired)
        return {n: np.where(heeded, value, x[n]) for n, value in following.items()}

    members: dict[str, Any] = {
        n: Mode(s.initial, s.shape, unit=s.unit, meaning=s.meaning) for n, s in states.items()
    }
    members |= {"update": Equations.update, "on_event": on_event}
    return type(base.__name__, (Trigger, _clockless(base)), members)
