"""The Python blocks of a plan, opened for one run."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.framework.equations import Equations
from trussflow.blocks.framework.errors import SimulationError, TrussflowError
from trussflow.blocks.framework.running import Running, SelfStepping
from trussflow.blocks.framework.types import Vector
from trussflow.blocks.tracing.calling import running_errors
from trussflow.blocks.tracing.plan import Plan


def open_block(block: Block, p: Signals) -> Equations:
    """Return what states the equations of a `block` with parameters `p` [as declared] in one run.

    Raises
    ------
    SimulationError
        If the code of the block raises, or returns something else.
    """
    with running_errors(block, "open", 0.0):
        opened: object = block.open(p)
    wanted = SelfStepping if block.steps_itself else Running
    fits = isinstance(opened, wanted) and isinstance(opened, SelfStepping) == block.steps_itself
    if not isinstance(opened, Equations) or not (fits or opened is block):
        raise SimulationError(
            f"open() of block '{block.path}' ({type(block).__name__}) returned {opened!r}; it must be "
            f"a {wanted.__name__}, as the block says"
        )
    return opened


class OpenBlocks:
    """What states the equations of the Python blocks in one run, by path.

    Parameters
    ----------
    plan : Plan
        The plan.
    p : Vector
        All parameters of the run; blocks see it when they change [units as declared].

    Attributes
    ----------
    equations : dict of str to Equations
        The block itself, or what it keeps in this run, for each Python block.

    Raises
    ------
    SimulationError
        If a block cannot be opened; those that were opened are closed.
    """

    def __init__(self, plan: Plan, p: Vector) -> None:
        self.equations: dict[str, Equations] = {}
        self._blocks = {block.path: block for block in plan.python_blocks}
        try:
            for path, block in self._blocks.items():
                opened = open_block(block, plan.p.signals(path, p))
                self.equations[path] = SampledStepping(opened) if isinstance(opened, SelfStepping) else opened
        except BaseException:
            with contextlib.suppress(TrussflowError):  # the first error is the one to see
                self.close()
            raise

    def _kept(self) -> dict[str, Running]:
        """Return what keeps something, by path."""
        return {path: e for path, e in self.equations.items() if isinstance(e, Running)}

    @property
    def messages(self) -> dict[str, list[str]]:
        """What there is to tell of this run, by path."""
        return {path: list(running.messages) for path, running in self._kept().items() if running.messages}

    @property
    def unrestorable(self) -> list[str]:
        """Paths of the blocks that cannot go back to an earlier time."""
        return [path for path, running in self._kept().items() if not running.restores]

    def tuned(self) -> None:
        """Tell the blocks that parameters were changed."""
        for path, running in self._kept().items():
            with running_errors(self._blocks[path], "tuned", 0.0):
                running.tuned()

    def save(self) -> dict[str, Any]:
        """Return what the blocks keep, by path.

        Raises
        ------
        SimulationError
            If a block cannot go back.
        """
        if stuck := self.unrestorable:
            raise SimulationError(
                f"cannot save: block '{stuck[0]}' ({type(self._blocks[stuck[0]]).__name__}) keeps what "
                "it cannot hand over; what its open() returns would have to override save() and restore()"
            )
        saved = {}
        for path, running in self._kept().items():
            with running_errors(self._blocks[path], "save", 0.0):
                saved[path] = running.save()
        return saved

    def restore(self, saved: Mapping[str, Any]) -> None:
        """Give the blocks back what `save` returned."""
        for path, running in self._kept().items():
            with running_errors(self._blocks[path], "restore", 0.0):
                running.restore(saved[path])

    def close(self) -> None:
        """Let the blocks release everything.

        Raises
        ------
        SimulationError
            If the code of a block raises; the others are closed all the same.
        """
        faults = []
        for path, running in self._kept().items():
            try:
                with running_errors(self._blocks[path], "close", 0.0):
                    running.close()
            except TrussflowError as error:
                faults.append(error)
        self.equations = {}
        if faults:
            raise faults[0]


class SampledStepping(Running):
    """A block that steps itself, as a sampled block.

    At each instant it first takes the step from the instant before, with the inputs of then held.

    Parameters
    ----------
    inner : SelfStepping
        What steps itself.
    """

    def __init__(self, inner: SelfStepping) -> None:
        self._inner = inner
        self._time: float | None = None
        self._held: Vector | None = None

    @property
    def restores(self) -> bool:
        """Whether it can go back."""
        return self._inner.restores

    @property
    def messages(self) -> tuple[str, ...]:
        """What there is to tell of this run."""
        return self._inner.messages

    def tuned(self) -> None:
        """Pass on that parameters were changed."""
        self._inner.tuned()

    def reach(self, t: float, u: Vector, needed: NDArray[np.bool_], *, direct: bool) -> Vector:
        """Return the outputs at an instant.

        Parameters
        ----------
        t : float
            Time of the instant [s].
        u : Vector
            All inputs [units as declared].
        needed : array of bool
            Which of them outputs depend on at once.
        direct : bool
            Whether there are any.
        """
        if self._time is None or self._held is None:
            # Inputs that the outputs do not depend on may themselves still depend on these outputs.
            self._held = np.where(needed, u, np.nan) if direct else np.full(needed.size, np.nan)
            self._inner.start(t, self._held)
        else:
            self._inner.advance(self._time, t)
            if direct:
                self._held = np.where(needed, u, self._held)
                self._inner.set(self._held)
        self._time = t
        return self._inner.outputs()

    def hold(self, u: Vector) -> None:
        """Keep all inputs `u` [units as declared] for the step that follows."""
        self._held = u
        self._inner.set(u)

    def save(self) -> dict[str, Any]:
        """Return where it stands, and what the block keeps."""
        if self._time is None:
            return {"time": None}
        return {"time": self._time, "held": self._held, "state": self._inner.save()}

    def restore(self, saved: dict[str, Any]) -> None:
        """Go back to what `save` returned, perhaps in another run."""
        if saved["time"] is None:
            self._time = None
            return
        self._held = np.array(saved["held"])
        if self._time is None:
            self._inner.start(saved["time"], self._held)
        self._time = saved["time"]
        self._inner.restore(saved["state"])

    def close(self) -> None:
        """Release everything."""
        self._inner.close()
