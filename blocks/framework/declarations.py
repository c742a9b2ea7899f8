"""What a block declares besides its ports: parameters and states."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, overload

import numpy as np

from trussflow.blocks.framework.errors import NameLookupError, ParameterError
from trussflow.blocks.framework.port import Shape
from trussflow.blocks.framework.types import Array, Vector

if TYPE_CHECKING:
    from trussflow.blocks.framework.block import Block


class _Required:
    """The type of `REQUIRED`."""

    def __repr__(self) -> str:
        return "REQUIRED"

    def __reduce__(self) -> str:
        return "REQUIRED"  # there is only one, also in copies


REQUIRED: Final = _Required()
"""Marks a parameter that has no default."""


class Attribute(str):
    """Name of a block attribute that holds a unit or a frame (shapes take plain names)."""

    __slots__ = ()


class Parameter:
    """Declare a tunable number or array of a block (as a class attribute).

    A parameter is an input of the compiled code, so changing it never recompiles. What
    changes the structure (sizes, functions) is an ordinary attribute instead.

    Parameters
    ----------
    default : array_like
        Value where none is given [unit]; `REQUIRED` if there is no sensible one.
    shape : shape or None
        Shape of the value [-]; None takes it from the value given.
    unit : str
        Unit of the value.
    meaning : str
        One line for people.
    minimum, above : float, optional
        Smallest allowed value, and bound that all elements must exceed [unit].
    """

    def __init__(
        self,
        default: Any = REQUIRED,
        shape: Shape | None = (),
        *,
        unit: str = "",
        meaning: str = "",
        minimum: float | None = None,
        above: float | None = None,
    ) -> None:
        self.default, self.shape, self.unit, self.meaning = default, shape, unit, meaning
        self.minimum, self.above = minimum, above
        self.name = ""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    @overload
    def __get__(self, block: None, owner: type) -> Parameter: ...
    @overload
    def __get__(self, block: Block, owner: type) -> Vector: ...
    def __get__(self, block: Block | None, owner: type) -> Parameter | Vector:
        """Return the block's own value."""
        return self if block is None else block.parameters[self.name]

    def convert(self, value: Any, shape: tuple[int, ...] | None, owner: str) -> Vector:
        """Return `value` as a float array of the given `shape`, checked, for a block `owner`.

        Raises
        ------
        ParameterError
            If it is no number, not finite, of the wrong shape or out of bounds.
        """
        where = f"parameter '{self.name}' of {owner}"
        try:
            array = np.array(value, dtype=float)
        except (TypeError, ValueError):
            raise ParameterError(f"{where} must be numeric, not {value!r}") from None
        if shape is not None and array.shape != shape:
            try:
                array = np.broadcast_to(array, shape).copy()
            except ValueError:
                raise ParameterError(f"{where} has shape {array.shape}; it must have shape {shape}") from None
        bad = ~np.isfinite(array)
        if self.minimum is not None:
            bad |= array < self.minimum
        if self.above is not None:
            bad |= array <= self.above
        if bad.any():
            allowed = ["finite"]
            allowed += [] if self.minimum is None else [f"at least {self.minimum:g}"]
            allowed += [] if self.above is None else [f"above {self.above:g}"]
            first = np.argwhere(bad)[0]
            at = f" (element {', '.join(map(str, first))})" if array.ndim else ""
            raise ParameterError(
                f"{where} is {array[tuple(first)]}{at}; it must be {' and '.join(allowed)}"
                + (f" [{self.unit}]" if self.unit else "")
            )
        array.setflags(write=False)
        return array


class State:
    """Declare a state of a block (as a class attribute).

    Continuous in a block with `derivative`, discrete in a sampled block with `update`.

    Parameters
    ----------
    shape : shape
        Shape of the state [-].
    initial : float or str
        Initial value [unit], or the name of the parameter that holds it.
    unit : str
        Unit of the state.
    meaning : str
        One line for people.
    """

    def __init__(
        self,
        shape: Shape = (),
        *,
        initial: float | str = 0.0,
        unit: str | tuple[str, ...] = "",
        meaning: str = "",
    ) -> None:
        self.shape, self.initial, self.unit, self.meaning = shape, initial, unit, meaning
        self.name = ""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name


class Signals(dict[str, Array]):
    """Named arrays with attribute access: ``u.position`` is ``u["position"]``.

    Parameters
    ----------
    owner : str
        Whose they are, for messages.
    values : dict of str to array
        The arrays by name.
    """

    __slots__ = ("owner",)

    def __init__(self, owner: str, values: dict[str, Array]) -> None:
        super().__init__(values)
        self.owner = owner

    def __getattr__(self, name: str) -> Array:
        try:
            return self[name]
        except KeyError:
            raise NameLookupError(
                f"{self.owner} has no '{name}'; it has: {', '.join(sorted(self)) or 'none'}"
            ) from None
