"""A part of a diagram as a member of a co-simulation: compiled and integrated as in a session."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from trussflow.blocks.framework.external_inputs import External
from trussflow.blocks.framework.layout import spans
from trussflow.blocks.framework.run_state import SelfStepping
from trussflow.blocks.results.state_file import Snapshot
from trussflow.blocks.simulation.session import Session
from trussflow.blocks.simulation.solver import Solver
from trussflow.blocks.support.types import Vector


@dataclass(frozen=True, slots=True)
class Settings:
    """Settings of the integration of blocks that are not FMUs.

    Attributes
    ----------
    solver : Solver
        Solver and backend.
    parameters, initial : mapping
        Values of parameters and initial states by ``"block.name"`` [units as declared].
    """

    solver: Solver
    parameters: Mapping[str, Any]
    initial: Mapping[str, Any]


class DiagramMember(SelfStepping):
    """A part of a diagram, with external inputs, that the framework integrates.

    Parameters
    ----------
    session : Session
        Session of the part.
    sources : list of External
        External inputs of the part.
    settings : Settings
        Settings of the integration.
    """

    def __init__(
        self, session: Session, sources: list[External], settings: Settings
    ) -> None:
        self._session = session
        self._settings = settings
        sizes = [source.y.size for source in sources]
        self._places = [
            (s.name, place, s.extent)
            for s, place in zip(sources, spans(sizes), strict=True)
        ]
        self._has_clocks = session.prepared.has_clocks
        self._begun: tuple[float, Vector] | None = None

    @property
    def restores(self) -> bool:
        """Whether it can return to an earlier time, as all of its Python blocks must."""
        return self._session.restores

    @property
    def messages(self) -> tuple[str, ...]:
        """Messages of the Python blocks in this run."""
        said = self._session.messages if self._session.started else {}
        return tuple(
            f"{path}: {text}" for path, texts in said.items() for text in texts
        )

    def start(self, time: float, inputs: Vector) -> None:
        """Start the session; unknown inputs, on which initial states may depend, are zero."""
        # A session takes finite inputs only; the start is repeated when they are known.
        inputs = np.nan_to_num(inputs)
        begun = self._begun
        self._begun = (time, inputs.copy())
        if begun is not None and begun[0] == time and np.array_equal(begun[1], inputs):
            return  # called repeatedly until all initial signals are consistent
        self._session.start(
            parameters=self._settings.parameters,
            initial=self._settings.initial,
            inputs={
                name: inputs[place].reshape(shape)
                for name, place, shape in self._places
            },
            time=time,
        )

    def set(self, inputs: Vector) -> None:
        """Set all inputs."""
        # The session leaves its start: another start must not be skipped.
        self._begun = None
        self._session.set_row(inputs)

    def latch(self, inputs: Vector) -> None:
        """Evaluate sampled blocks whose clocks tick now with these inputs, not with later ones."""
        if self._has_clocks:
            self.set(inputs)
            self._session.latch()

    def advance(self, now: float, until: float) -> None:
        """Take one communication step, which is a whole number of steps of a fixed-step solver."""
        self._begun = None
        self._session.advance(until)

    def outputs(self) -> Vector:
        """Return all outputs, after the sampled blocks that tick at the present time."""
        return self._session.row()

    def save(self) -> Snapshot:
        """Return a snapshot."""
        return self._session.save()

    def restore(self, saved: Snapshot) -> None:
        """Restore a snapshot."""
        self._begun = None
        self._session.restore(saved)

    def close(self) -> None:
        """Stop the session; Python blocks release their resources."""
        self._begun = None
        self._session.stop()
