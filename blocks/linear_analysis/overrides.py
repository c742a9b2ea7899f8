r"""Blocks and groups that linear models replace.

For the deviations from the operating point (u_0, y_0) a block, or a nested diagram, becomes

.. math:: \dot z = A z + B (u - u_0), \qquad y = y_0 + C z + D (u - u_0)

(or the same with :math:`z_{k+1}`), with the elements of all its inputs, one port after the other,
in u and those of its outputs in y. At the point it gives out what the block does, so everything
around it is linearized where it would be.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from trussflow.blocks.errors import (
    Explained,
    LinearAnalysisError,
    NameLookupError,
    ParameterError,
)
from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Signals, State
from trussflow.blocks.framework.external_inputs import External
from trussflow.blocks.framework.layout import spans
from trussflow.blocks.framework.port import Input, Output, Port
from trussflow.blocks.framework.system import Driver, System, resolved, targets
from trussflow.blocks.support.types import Array, Vector
from trussflow.blocks.support.validation import by_name, finite_array, shown

if TYPE_CHECKING:
    import control

Override = Mapping[Any, Any]
"""Replacements of blocks and groups, keyed by path or block: a ``control.StateSpace``, a
``control.TransferFunction`` or a matrix of gains [units of its outputs per units of its inputs]."""

POINT_PORT = "operating point"
"""The input of u_0 and y_0: no port of a user can have a name with a blank."""


class Gains(Block):
    """Replacement of a block without states: its D.

    Parameters
    ----------
    block : Block
        The block or group.
    A, B, C, D : Vector
        The matrices [any].
    """

    def __init__(
        self, block: Block, A: Vector, B: Vector, C: Vector, D: Vector
    ) -> None:
        self.A = A
        self.B = B
        self.C = C
        self.D = D
        self.order = len(A)
        self.inner, self.outer = _inner(block.inputs()), _inner(block.outputs())
        self.extra_ports = {
            **{
                name: Input(
                    port.whole_shape or (),
                    unit=port.unit,
                    default=port.declaration.default,
                )
                for name, port in self.inner.items()
            },
            POINT_PORT: Input(sum(D.shape)),
            **{
                name: Output(port.whole_shape or (), unit=port.unit)
                for name, port in self.outer.items()
            },
        }
        super().__init__()
        self.named(block.path)

    @property
    def path(self) -> str:
        """Unit of the block."""
        return self.name

    def _deviation(self, u: Signals) -> Array:
        """Return u - u_0."""
        parts = [np.reshape(u[name], (port.size,)) for name, port in self.inner.items()]
        return np.concatenate([np.zeros(0), *parts]) - u[POINT_PORT][: self.D.shape[1]]

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return y_0 + C z + D (u - u_0)."""
        y = u[POINT_PORT][self.D.shape[1] :] + self.D @ self._deviation(u)
        return self._apart(y + self.C @ x.z if self.order else y)

    def at_rest(self, point: Vector) -> dict[tuple[str, str], Array]:
        """Return y_0 by path and port, of a `point` (u_0, y_0) [as declared]."""
        return {
            (self.path, name): value
            for name, value in self._apart(point[self.D.shape[1] :]).items()
        }

    def _apart(self, y: Array) -> Values:
        """Return the outputs that stand one after the other."""
        parts = spans(port.size for port in self.outer.values())
        return {
            name: np.reshape(y[part], port.whole_shape or ())
            for part, (name, port) in zip(parts, self.outer.items(), strict=True)
        }


class ContinuousSystem(Gains):
    """Replacement with continuous states."""

    z = State("order")

    def derivative(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return A z + B (u - u_0)."""
        return {"z": self.A @ x.z + self.B @ self._deviation(u)}


class SampledSystem(Gains):
    """Replacement with discrete states."""

    z = State("order")

    def update(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return A z + B (u - u_0)."""
        return {"z": self.A @ x.z + self.B @ self._deviation(u)}


@dataclass(slots=True)
class Overridden:
    """A system in which given systems stand for some blocks and groups.

    Attributes
    ----------
    system : System
        With them.
    paths : frozenset of str
        The blocks that are no longer there.
    places : dict
        The port that stands for one of a block that is no longer there, by path and name of that.
    points : list
        For each of those systems what comes from outside: u_0 and y_0; and the block that stands for it.
    """

    system: System
    paths: frozenset[str]
    places: dict[tuple[str, str], Port]
    points: list[tuple[External, Gains]]

    def now(self, port: Port) -> Port:
        """Return the port that stands for one of the system as it was, or that itself.

        Raises
        ------
        LinearAnalysisError
            If it is not there any more.
        """
        leaves = targets(port) if port.is_input else [resolved(port)]
        if self.paths.isdisjoint(leaf.block.path for leaf in leaves):
            return port
        found = {self.places.get((leaf.block.path, leaf.name)) for leaf in leaves}
        stand_in = found.pop()
        if found or stand_in is None:
            raise LinearAnalysisError(
                f"'{port.full_path}' is within what override={{...}} replaces; name a port at its border"
            )
        return stand_in if port.index is None else stand_in[port.index]

    def keeps(self, reference: str) -> bool:
        """Tell whether the block of a state, held output or parameter ``"block.name"`` is still there."""
        return reference.rpartition(".")[0] not in self.paths


def overridden(system: System, override: Override | None) -> Overridden:
    """Return a system in which given systems stand for blocks and groups.

    Parameters
    ----------
    system : System
        The system; it stays as it is.
    override : mapping, optional
        Value from the user.

    Raises
    ------
    NameLookupError
        If there is no such block or group; the message lists those there are.
    LinearAnalysisError
        If what is given is no linear system, or one of another size.
    """
    result = Overridden(system, frozenset(), {}, [])
    for reference, value in by_name("override", override, str | Block).items():
        block = _block(system, reference)
        inside = {
            path
            for path, leaf in system.blocks.items()
            if leaf is block or _within(leaf, block)
        }
        if inside & result.paths:
            raise LinearAnalysisError(
                f"'{block.path}' is overridden twice, or within another override"
            )
        stand_in = _stand_in(block, value)
        for ports in (stand_in.inner, stand_in.outer):
            for name, leaf in ports.items():
                for each in targets(block.port(name)) if leaf.is_input else [leaf]:
                    if (each.block.path, each.name) in result.places:
                        raise LinearAnalysisError(
                            f"cannot override '{block.path}': it exposes '{leaf.path}' under two names"
                        )
                    result.places[each.block.path, each.name] = stand_in.port(name)
        result.paths |= inside
        result.points.append(
            (
                External(
                    stand_in.port(POINT_PORT), f"point of {block.path}", start=0.0
                ),
                stand_in,
            )
        )
    if not result.points:
        return result
    blocks = {
        path: block for path, block in system.blocks.items() if path not in result.paths
    }
    drivers = {
        key: found
        for key, found in system.drivers.items()
        if key[0] not in result.paths
    }
    for point, stand_in in result.points:
        blocks |= {stand_in.path: stand_in, point.path: point}
        everything = np.arange(point.y.size)
        drivers[stand_in.path, POINT_PORT] = [
            Driver(point.y, everything, everything, "override")
        ]
        for name, leaf in stand_in.inner.items():
            drivers[stand_in.path, name] = system.drivers[leaf.block.path, leaf.name]

    def now(driver: Driver) -> Driver:
        source = driver.source
        if (
            source is None
            or (key := (source.block.path, source.name)) not in result.places
        ):
            return driver
        return replace(driver, source=result.places[key])

    drivers = {key: [now(driver) for driver in found] for key, found in drivers.items()}
    result.system = replace(system, blocks=blocks, drivers=drivers)
    return result


def _inner(ports: list[Port]) -> dict[str, Port]:
    """Return the ports of leaf blocks that ports stand for, the first where there are several, by name."""
    return {port.name: resolved(port) for port in ports}


def _within(leaf: Block, group: Block) -> bool:
    """Tell whether a block is in a group, at any depth."""
    parent = leaf.parent
    while parent is not None and parent is not group:
        parent = parent.parent
    return parent is group


def _block(system: System, reference: str | Block) -> Block:
    """Return the block or group that a user names."""
    path = reference.path if isinstance(reference, Block) else reference
    found = system.blocks.get(path) or system.diagrams.get(path)
    wrong = isinstance(reference, Block) and found is not reference
    if found is None or wrong or not path or isinstance(found, External):
        known = ", ".join(
            p for p in (*system.blocks, *system.diagrams) if p and not p.startswith("(")
        )
        raise NameLookupError(
            f"no block '{path}' to override; blocks and groups are: {known}"
        )
    return found


def _stand_in(block: Block, value: Any) -> Gains:
    """Return what stands for a block."""
    system = _state_space(block, value)
    sizes = tuple(
        sum(port.size for port in ports) for ports in (block.outputs(), block.inputs())
    )
    if (system.noutputs, system.ninputs) != sizes:
        inputs, outputs = (
            ", ".join(p.name for p in ports)
            for ports in (block.inputs(), block.outputs())
        )
        raise LinearAnalysisError(
            f"cannot override '{block.path}' by a system with {system.ninputs} inputs and {system.noutputs} "
            f"outputs: its ports have {sizes[1]} elements ({inputs}) and {sizes[0]} elements ({outputs})"
        )
    matrices = [
        np.asarray(matrix, dtype=float)
        for matrix in (system.A, system.B, system.C, system.D)
    ]
    if system.isdtime(strict=True):
        return SampledSystem(block, *matrices).sampled(system.dt)  # type: ignore[return-value]
    return (ContinuousSystem if system.nstates else Gains)(block, *matrices)


def _state_space(block: Block, value: Any) -> control.StateSpace:
    """Return what a user gave as a state space."""
    import control

    def explain(error: Exception) -> LinearAnalysisError:
        return LinearAnalysisError(
            f"cannot override '{block.path}' by {shown(value)}: {error}"
        )

    if isinstance(value, control.StateSpace | control.TransferFunction):
        with Explained(explain):
            system = (
                value if isinstance(value, control.StateSpace) else control.ss(value)
            )
    else:
        try:
            gains = finite_array("what stands for it", value)
        except ParameterError as error:
            raise LinearAnalysisError(
                f"cannot override '{block.path}': {error}; or a control.StateSpace or a TransferFunction"
            ) from None
        system = control.ss([], [], [], np.atleast_2d(gains))
    if system.dt is True:
        raise LinearAnalysisError(
            f"cannot override '{block.path}' by a discrete system whose sample time is not given; build it "
            "with dt in seconds"
        )
    return system
