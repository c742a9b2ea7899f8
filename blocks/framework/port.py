"""Ports: inputs and outputs of blocks, and their connection.

A block class declares its ports as class attributes, `Input` and `Output`. A block
instance has bound ports under the same names, which users connect::

    trajectory.position >> controller.reference
    plant.position[0:3] >> logger.u
    (controller.force - 2.0 * plant.velocity) >> plant.force
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from enum import Enum
from math import prod
from typing import TYPE_CHECKING, Any, Final, overload

import numpy as np

from trussflow.blocks.errors import WiringError
from trussflow.blocks.framework.signal_operators import Wired
from trussflow.blocks.framework.units import Unit, per_element
from trussflow.blocks.support.call_site import call_site
from trussflow.blocks.support.validation import shown

if TYPE_CHECKING:
    from trussflow.blocks.framework.block import Block
    from trussflow.blocks.framework.diagram import Diagram


class _Marker(Enum):
    """Values with a meaning of their own."""

    INFERRED = "inferred"
    REQUIRED = "required"

    def __repr__(self) -> str:
        return self.name


INFERRED: Final = _Marker.INFERRED
"""Shape, unit or frame of a port that is inferred from the connected port.

All ports of a block that infer the same property share it. If the input ``u`` of a saturation
has shape 6 and unit N, its output ``y`` has them too.
"""

REQUIRED: Final = _Marker.REQUIRED
"""Marks a parameter that has no default."""

Shape = int | str | tuple[int | str, ...] | _Marker
"""A size, a tuple of sizes, or names of block attributes with sizes."""

Axes = dict[str, tuple[str | int, ...]]
"""Labels along each axis of an array, by the name of the axis."""

VECTOR_AXIS = "coordinate"
"""Axis of a labelled vector that declares no name for it, or several."""


class Declaration:
    """Base of declarations, which know their `name` in the class."""

    name = ""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name


class _PortDeclaration(Declaration):
    """Base of the declarations of inputs and outputs."""

    def __init__(
        self,
        shape: Shape = (),
        *,
        unit: Unit | _Marker = None,
        frame: str | _Marker | None = None,
        meaning: str = "",
        labels: tuple[str | int, ...] | Axes | str | _Marker = INFERRED,
    ) -> None:
        self.shape, self.unit, self.frame = shape, unit, frame
        self.meaning, self.labels = meaning, labels
        self.default: float | None = None

    @overload
    def __get__(self, block: None, owner: type) -> _PortDeclaration: ...
    @overload
    def __get__(self, block: Block, owner: type) -> Port: ...
    def __get__(self, block: Block | None, owner: type) -> _PortDeclaration | Port:
        """Return the block's own port of this name."""
        return self if block is None else block.port(self.name)


class Input(_PortDeclaration):
    """Declare an input port (as a class attribute of a block).

    Parameters
    ----------
    shape : int, str, tuple or INFERRED
        Shape of the signal [-]; a string is the name of a block attribute with the shape.
    unit : str, tuple of str, None or INFERRED
        One unit, one per element, or None to accept any unit.
    frame : str, None or INFERRED
        Reference frame of the components.
    meaning : str
        Description in one line.
    labels : tuple or dict
        Labels of the elements in results, for the axis ``coordinate``, or labels along each axis, by its
        name. A vector may have several axes, one for each part; the whole vector then has the axis
        ``coordinate``. By default inferred from the wires, like the shape.
    default : float, optional
        Value of the input if it is not connected [unit of the port].
    **about
        Unit, frame, meaning and labels.
    """

    def __init__(
        self, shape: Shape = (), *, default: float | None = None, **about: Any
    ) -> None:
        super().__init__(shape, **about)
        self.default = default


class Output(_PortDeclaration):
    """Declare an output port; the arguments are those of `Input` without `default`."""


@dataclass(eq=False, slots=True)
class Inferable:
    """A property that may be fixed later, shared with all properties that were unified with it.

    Attributes
    ----------
    value : object
        The value; None while it is open, or if any value is accepted.
    fixed : bool
        Whether the value is fixed.
    fixed_by : str
        The line that fixed the value; empty if the declaration did.
    parent : Inferable, optional
        The property with which it was unified (union-find).
    own : bool
        Whether the block itself fixes the value, not a wire.
    """

    value: Any = None
    fixed: bool = False
    fixed_by: str = ""
    parent: Inferable | None = None
    own: bool = False

    def root(self) -> Inferable:
        """Return the representative of all properties unified with this one."""
        # No path compression: `origin` needs the chain.
        found = self
        while found.parent is not None:
            found = found.parent
        return found

    def get(self) -> Any:
        """Return the value; None while it is open, or if any value is accepted."""
        return self.root().value

    @property
    def is_open(self) -> bool:
        """Whether the value has not been inferred yet."""
        return not self.root().fixed

    def fix(self, value: Any, where: str, *, own: bool = False) -> None:
        """Fix an open `value`, with the line `where`, and whether it is the block's `own`."""
        root = self.root()
        root.value, root.fixed, root.fixed_by, root.own = value, True, where, own

    def forget(self) -> None:
        """Remove the value that was inferred from wires."""
        # All unifications are undone; the wires that remain make theirs again.
        self.parent = None
        if not self.own:
            self.value, self.fixed, self.fixed_by = None, False, ""

    def origin(self) -> str:
        """Return the line that fixed the value; empty if the declaration did."""
        # The first line up the chain is that of the wire which fixed the value here.
        found: Inferable | None = self
        while found is not None and not found.fixed_by:
            found = found.parent
        return "" if found is None else found.fixed_by

    def unify(self, other: Inferable, where: str) -> None:
        """Share one value with the `other` from the line `where`; two fixed values do not change."""
        a, b = self.root(), other.root()
        if a is b or (a.fixed and b.fixed):
            return
        # The fixed one, if any, is kept, so that its value reaches all others.
        loser, keeper = (b, a) if a.fixed else (a, b)
        loser.parent = keeper
        # Between two open ones, this wire fixes nothing.
        loser.fixed_by = where if keeper.fixed else ""


@dataclass(eq=False, slots=True)
class Port(Wired):
    """A port of a block instance, or a slice of one.

    Attributes
    ----------
    block : Block
        The block of the port.
    name : str
        Name in the block.
    declaration : Input or Output
        Declaration in the class.
    inferable_shape, inferable_unit, inferable_frame, inferable_labels : Inferable
        Shape, unit, frame and labels, which may still be open.
    index : object, optional
        NumPy index of a slice; None for the whole port.
    """

    block: Block
    name: str
    declaration: _PortDeclaration
    inferable_shape: Inferable
    inferable_unit: Inferable
    inferable_frame: Inferable
    inferable_labels: Inferable = field(default_factory=Inferable)
    index: Any = field(default=None)

    # -- properties -----------------------------------------------------------------

    @property
    def is_input(self) -> bool:
        """Whether the port is an input."""
        return isinstance(self.declaration, Input)

    @property
    def path(self) -> str:
        """Name with the path of its block, such as ``loop.controller.force``."""
        return f"{self.block.path}.{self.name}"

    @property
    def full_path(self) -> str:
        """Path, with the index if this is a slice."""
        return (
            self.path
            if self.index is None
            else f"{self.path}[{_index_text(self.index)}]"
        )

    @property
    def whole_shape(self) -> tuple[int, ...] | None:
        """Shape of the whole port, or None while it is open."""
        shape: tuple[int, ...] | None = self.inferable_shape.get()
        return shape

    @property
    def shape(self) -> tuple[int, ...] | None:
        """Shape of this port or slice, or None while it is open."""
        if self.index is None:
            return self.whole_shape
        return tuple(self.elements().shape)

    @property
    def size(self) -> int:
        """Number of elements of the whole port.

        Raises
        ------
        WiringError
            If the shape is still open.
        """
        shape = self.whole_shape
        if shape is None:
            raise WiringError(
                f"the shape of '{self.path}' is not known yet: connect it to a port of known "
                "shape first, or give the block its shape"
            )
        return prod(shape)

    @property
    def unit(self) -> Unit:
        """Unit of the whole port."""
        unit: Unit = self.inferable_unit.get()
        return unit

    @property
    def frame(self) -> str | None:
        """Reference frame of the port."""
        frame: str | None = self.inferable_frame.get()
        return frame

    def elements(self) -> np.ndarray[Any, np.dtype[np.int64]]:
        """Return the row-major indices of the elements of this slice within the whole port."""
        # Indexing the indices lets NumPy interpret any index of the user.
        whole = np.arange(self.size).reshape(self.whole_shape or ())
        return np.asarray(whole if self.index is None else whole[self.index])

    def element_units(self) -> tuple[str | None, ...]:
        """Return the unit of each element of this port or slice.

        Raises
        ------
        WiringError
            If the numbers of units and elements differ.
        """
        units = per_element(self.unit, self.size)
        if len(units) != self.size:
            raise WiringError(
                f"'{self.path}' has {len(units)} units for {self.size} elements"
            )
        return tuple(units[i] for i in self.elements().ravel())

    def axes(self) -> Axes:
        """Return the labels along each axis; nothing without labels, or for a slice of a matrix.

        Raises
        ------
        WiringError
            If the numbers of labels and elements differ.
        """
        labels, shape = self.inferable_labels.get(), self.whole_shape or ()
        if labels is None:
            return {}
        axes = labels if isinstance(labels, dict) else {VECTOR_AXIS: labels}
        sizes = tuple(map(len, axes.values()))
        # One axis for each dimension, or several axes that are parts of a vector.
        if (sum(sizes),) != shape and sizes != shape:
            raise WiringError(
                f"'{self.path}' has labels for {sizes} elements, but its shape is {shape}"
            )
        if len(shape) > 1:
            return axes if self.index is None else {}
        each = [(axis, label) for axis, part in axes.items() for label in part]
        each = [each[i] for i in self.elements().ravel()]
        # A slice within one axis keeps its name; otherwise the parts
        # have no common one.
        parts = {axis for axis, _ in each} or {*axes}
        return {
            parts.pop() if len(parts) == 1 else VECTOR_AXIS: tuple(
                label for _, label in each
            )
        }

    def describe(self) -> str:
        """Return path, shape, unit and frame as text for messages."""
        shape = "open" if self.shape is None else self.shape
        facts = [f"shape {shape}"]
        if self.unit is not None:
            facts.append(
                f"unit {self.unit if isinstance(self.unit, str) else 'per element'}"
            )
        if self.frame is not None:
            facts.append(f"frame {self.frame}")
        return f"'{self.full_path}' ({', '.join(facts)})"

    @property
    def summary(self) -> str:
        """Name, shape and units as a short text."""
        shape = "" if self.whole_shape == () else f" {self.whole_shape or '(?)'}"
        units = self.unit if isinstance(self.unit, tuple) else (self.unit,)
        unit = ", ".join(dict.fromkeys(filter(None, units)))
        return self.name + shape + (f" [{unit}]" if unit else "")

    def __repr__(self) -> str:
        return f"<{'input' if self.is_input else 'output'} {self.describe()}>"

    # -- wiring ---------------------------------------------------------------------

    def __getitem__(self, index: Any) -> Port:
        """Return the slice of this port that a NumPy index selects."""
        where = call_site()
        if self.index is not None:
            raise WiringError(
                f"'{self.path}' is already a slice; give one index   [{where}]"
            )
        if self.whole_shape is None:
            raise WiringError(
                f"cannot index '{self.path}': its shape is not known yet   [{where}]\n  "
                "connect it to a port of known shape first, or give the block its shape"
            )
        # The slice shares the inferable properties of the whole port.
        part = replace(self, index=index)
        try:
            _check_bounds(index, self.whole_shape)
            empty = part.elements().size == 0
        except (IndexError, OverflowError, TypeError, ValueError) as error:
            raise WiringError(
                f"index [{_index_text(index)}] does not fit {self.describe()}: {error}   [{where}]"
            ) from None
        if empty:
            raise WiringError(
                f"index [{_index_text(index)}] of {self.describe()} selects no element   [{where}]"
            )
        return part

    def __iter__(self) -> Iterator[Port]:
        """Return the elements of a vector, or the rows of a matrix."""
        # index 0 of a scalar raises
        return (self[i] for i in range((self.shape or (1,))[0]))

    def __rshift__(self, other: Port | Block) -> Block:
        """Connect this output to an input (or to the only input of a block); return that block."""
        # Not isinstance: the module of Block imports this one.
        target = other.only_input() if hasattr(other, "only_input") else other
        self.wiring_diagram().connect(self, target, where=call_site())
        return target.block

    def __rrshift__(self, other: Any) -> Block:
        """Raise `WiringError`, as the left operand is not a port."""
        self.wiring_diagram().connect(other, self, where=call_site())
        return self.block

    def wiring_diagram(self) -> Diagram:
        """Return the diagram in which the port can be connected."""
        return self.block.diagram("wire")

    # Otherwise `if a > b` would always be true, and `a < b < c` would
    # drop its first half.
    def __bool__(self) -> bool:
        raise WiringError(
            f"'{self.path}' is a port, not a number: it has no truth value while wiring"
        )


def properties_of(ports: Iterable[Port]) -> list[tuple[object, ...]]:
    """Return name, shape, unit, frame and declaration of each of the `ports`."""
    return [(p.name, p.whole_shape, p.unit, p.frame, p.declaration) for p in ports]


def is_port(value: object) -> bool:
    """Return whether an argument from the user is a port."""
    return isinstance(value, Port)


def port_text(value: object) -> str:
    """Return the description of an argument from the user that should be a port."""
    return value.describe() if isinstance(value, Port) else shown(value)


def _check_bounds(index: Any, shape: tuple[int, ...]) -> None:
    """Raise IndexError for slices that exceed an axis, which NumPy would shorten without an error."""
    parts = index if isinstance(index, tuple) else (index,)
    # NumPy checks arrays of indices itself; None and Ellipsis shift the axes.
    if any(not isinstance(part, int | np.integer | slice) for part in parts):
        return
    for axis, (part, size) in enumerate(zip(parts, shape, strict=False)):
        ends = (part.start, part.stop) if isinstance(part, slice) else ()
        if any(end is not None and not -size <= end <= size for end in ends):
            raise IndexError(f"slice out of bounds for axis {axis} with size {size}")


def _index_text(index: Any) -> str:
    """Return an index as text, as the user writes it."""
    parts = index if isinstance(index, tuple) else (index,)

    def text(part: Any) -> str:
        if not isinstance(part, slice):
            return shown(part) if isinstance(part, int) else str(part)
        ends = f"{'' if part.start is None else part.start}:{'' if part.stop is None else part.stop}"
        return ends if part.step is None else f"{ends}:{part.step}"

    return ", ".join(text(p) for p in parts)
