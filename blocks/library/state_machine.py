"""A small state machine, for the modes of a mission."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from trussflow.blocks.errors import BlockError
from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Signals, State
from trussflow.blocks.framework.port import Input, Output
from trussflow.blocks.support.types import Array
from trussflow.blocks.support.validation import by_name, shown


class StateMachine(Block):
    """Sampled state machine: transitions between modes, triggered by conditions.

    At each sample, the block takes at most one transition: the first listed transition from the active mode
    whose condition is above 0.5. The outputs show the mode after the transition.

    Parameters
    ----------
    transitions : mapping of str to mapping of str to str
        Transitions of each mode: target mode by condition. The first mode is the initial mode. Each condition
        is an input of that name.
    sample_time : float
        Time between samples [s].
    offset : float
        First sample [s].

    Attributes
    ----------
    modes : tuple of str
        The modes, in the order of their numbers.

    Raises
    ------
    BlockError
        If a mode does not exist, or a name cannot be used.

    Examples
    --------
    >>> from trussflow.blocks import StateMachine
    >>> mission = StateMachine({"idle": {"go": "coast"}, "coast": {"near": "brake"}, "brake": {}}, 0.1)
    >>> mission.modes, [port.name for port in mission.inputs()]
    (('idle', 'coast', 'brake'), ['go', 'near'])
    """

    mode = Output(meaning="number of the mode, from 0 on")
    active = Output("number", meaning="1 for the mode that is active, 0 for the others")
    present = State(meaning="number of the mode")

    def __init__(
        self,
        transitions: Mapping[str, Mapping[str, str]],
        sample_time: float,
        *,
        offset: float = 0.0,
    ) -> None:
        given = {
            mode: by_name(f"transitions from '{mode}'", t)
            for mode, t in by_name("modes", transitions).items()
        }
        self.modes, self.number = tuple(given), len(given)
        conditions = dict.fromkeys(
            condition for leads in given.values() for condition in leads
        )
        unknown = [
            m for leads in given.values() for m in leads.values() if m not in self.modes
        ]
        if taken := sorted({*conditions} & {*self._declared}):
            raise BlockError(
                f"StateMachine cannot have a condition '{taken[0]}': it has a {taken[0]} already"
            )
        if not given or unknown:
            what = f"no mode {shown(unknown[0])}" if unknown else "no modes"
            raise BlockError(
                f"StateMachine has {what}; its modes are: {', '.join(self.modes) or 'none'}"
            )
        # Reversed: `_next` overwrites, so that the condition listed first is applied
        # last and wins.
        self._leads = [
            (source, condition, self.modes.index(target))
            for source, leads in enumerate(given.values())
            for condition, target in reversed([*leads.items()])
        ]
        self.extra_ports = {
            name: Input(meaning="condition: holds above 0.5") for name in conditions
        }
        super().__init__()
        self.sampled(sample_time, offset)

    def _next(self, x: Signals, u: Signals) -> Array:
        """Return the number of the next mode."""
        mode = x.present
        for source, condition, target in self._leads:
            holds = np.logical_and(x.present == source, u[condition] > 0.5)
            mode = np.where(holds, float(target), mode)
        return mode

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the mode."""
        mode = self._next(x, u)
        return {
            "mode": mode,
            "active": np.where(np.arange(self.number) == mode, 1.0, 0.0),
        }

    def update(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the mode after the transition."""
        return {"present": self._next(x, u)}
