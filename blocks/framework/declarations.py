"""Declarations of a block besides its ports: parameters, states, modes and events."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, overload

import numpy as np
import numpy.typing as npt

from trussflow.blocks.errors import BlockError, NameLookupError, ParameterError
from trussflow.blocks.framework.port import REQUIRED, Axes, Declaration, Shape
from trussflow.blocks.support.types import Array, Vector
from trussflow.blocks.support.validation import finite_array, first_element

if TYPE_CHECKING:
    from trussflow.blocks.framework.block import Block


class Attribute(str):
    """Name of a block attribute with a unit, a frame or labels; shapes use plain names."""

    __slots__ = ()


VIOLATED = {
    "at least": np.less,
    "above": np.less_equal,
    "at most": np.greater,
    "below": np.greater_equal,
}
"""Comparison of a value with a bound that is true if the value is not allowed."""


class Parameter(Declaration):
    """Declare a tunable number or array of a block (as a class attribute).

    A parameter is an input of the compiled code, so a change does not recompile it. Data that
    change the structure (sizes, functions) are ordinary attributes instead.

    Parameters
    ----------
    default : array_like
        Default value [unit]; `REQUIRED` if the user must give one.
    shape : shape or None
        Shape of the value [-]; None accepts any shape.
    unit : str
        Unit of the value.
    meaning : str
        Description in one line.
    minimum, maximum : float, optional
        Smallest and largest allowed value of all elements [unit].
    above, below : float, optional
        Exclusive bounds of all elements [unit].
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
        maximum: float | None = None,
        below: float | None = None,
    ) -> None:
        self.default, self.shape, self.unit, self.meaning = (
            default,
            shape,
            unit,
            meaning,
        )
        bounds = {
            "at least": minimum,
            "above": above,
            "at most": maximum,
            "below": below,
        }
        self.bounds = {
            word: bound for word, bound in bounds.items() if bound is not None
        }

    @overload
    def __get__(self, block: None, owner: type) -> Parameter: ...
    @overload
    def __get__(self, block: Block, owner: type) -> Vector: ...
    def __get__(self, block: Block | None, owner: type) -> Parameter | Vector:
        """Return the block's own value."""
        return self if block is None else block.parameters[self.name]

    def convert(self, value: Any, shape: tuple[int, ...] | None, owner: str) -> Vector:
        """Return `value` as a checked float array of the given `shape`, for a block `owner`.

        Raises
        ------
        ParameterError
            If it is not a number, not finite, of the wrong shape or out of bounds.
        """
        where = f"parameter '{self.name}' of {owner}"
        # Copied and read-only: a later change of the user's array must
        # not change the block.
        array = finite_array(where, value, shape).copy()
        bad = np.zeros(array.shape, dtype=bool)
        for word, bound in self.bounds.items():
            bad |= VIOLATED[word](array, bound)
        if bad.any():
            allowed = [f"{word} {bound:g}" for word, bound in self.bounds.items()]
            place, element = first_element(bad)
            raise ParameterError(
                f"{where} is {array[place]}{element}; it must be {' and '.join(allowed)}"
                + (f" [{self.unit}]" if self.unit else "")
            )
        array.setflags(write=False)
        return array


class State(Declaration):
    """Declare a state of a block (as a class attribute).

    States are continuous in a block with `derivative`, and discrete in a sampled block with `update`.

    Parameters
    ----------
    shape : shape
        Shape of the state [-].
    initial : array_like or str
        Initial value [unit], or the name of the parameter with this value.
    unit : str
        Unit of the state.
    meaning : str
        Description in one line.
    labels : tuple or dict, optional
        Labels of the elements, as for `Input`.

    Raises
    ------
    BlockError
        If the shape is a float, as that is probably the initial value.
    """

    def __init__(
        self,
        shape: Shape = (),
        *,
        initial: npt.ArrayLike = 0.0,
        unit: str | tuple[str, ...] = "",
        meaning: str = "",
        labels: tuple[str | int, ...] | Axes | str | None = None,
    ) -> None:
        # State(1.0) is a likely mistake for State(initial=1.0).
        if isinstance(shape, float):
            raise BlockError(
                f"{shape} is no shape of a state; its initial value is State(initial={shape})"
            )
        self.shape, self.initial, self.unit, self.meaning = (
            shape,
            initial,
            unit,
            meaning,
        )
        self.labels = labels


class Mode(State):
    """Declare a mode of a block: a number or array that changes only at events, in `on_event`.

    Equations read a mode like a state, for example the position of a relay or a stuck contact. Between
    events it is constant for every solver, and linear analysis does not change it.

    Parameters
    ----------
    initial : array_like or str
        Initial value [unit], or the name of the parameter with this value.
    shape : shape
        Shape of the mode [-].
    unit : str
        Unit of the mode.
    meaning : str
        Description in one line.
    """

    def __init__(
        self,
        initial: npt.ArrayLike = 0.0,
        shape: Shape = (),
        *,
        unit: str = "",
        meaning: str = "",
    ) -> None:
        super().__init__(shape, initial=initial, unit=unit, meaning=meaning)


class History(Declaration):
    """Declare that a run stores an input of a block, after each accepted step and event.

    Equations read the history by the functions of ``tracing/history.py``. The block has events, and an
    attribute `points`: the largest number of points stored [-], or None for a default.

    Parameters
    ----------
    of : str
        Name of the input.
    longest, step : str
        Attributes with the longest time for which points are needed, and the longest step [s].
    """

    shape, unit, meaning, initial = (), "", "", 0.0

    def __init__(self, of: str, longest: str, step: str) -> None:
        self.of, self.longest, self.step = of, longest, step


RISING, FALLING, EITHER, TIMED, TERMINAL = 1, -1, 0, 2, 3
"""Codes of the kinds of events, as in ``tracing/events.h``."""

KINDS = {
    "both": EITHER,
    "rising": RISING,
    "falling": FALLING,
    "time": TIMED,
    "terminal": TERMINAL,
}
"""Code of each kind of event, by its name in a declaration."""


class Event:
    """Declare an event of a block: the solver stops at it, and `on_event` may change states and modes.

    The value that `indicators` returns under the name of the event determines its time.

    Parameters
    ----------
    kind : str
        ``"rising"``: a negative indicator becomes zero or positive. ``"falling"``: a positive indicator
        becomes zero or negative. ``"both"``: either. ``"time"``: the indicator is the time of the next
        event [s], and changes only at events. ``"terminal"``: like ``"rising"``, and the run ends with the
        status "ended", without a call of `on_event`; the block's attribute `message`, if there is one, is
        the reason. An indicator that is zero at the initial time counts as
        negative, or for ``"falling"`` as positive. So it triggers the event when it leaves zero in the
        declared direction, for ``"both"`` only upwards.
    shape : shape
        Shape of the indicator [-]; each element is one event.
    unit : str
        Unit of the indicator.
    meaning : str
        Description in one line.

    Raises
    ------
    BlockError
        If there is no such kind.
    """

    def __init__(
        self,
        kind: str = "both",
        shape: Shape = (),
        *,
        unit: str = "",
        meaning: str = "",
    ) -> None:
        if kind not in KINDS:
            raise BlockError(
                f"cannot declare an event of kind {kind!r}; the kinds are: {', '.join(KINDS)}"
            )
        self.kind, self.shape, self.unit, self.meaning = kind, shape, unit, meaning


class Signals(dict[str, Array]):
    """Named arrays with attribute access: ``u.position`` is ``u["position"]``.

    Parameters
    ----------
    owner : str
        Name of the owner, for messages.
    values : dict of str to array
        The arrays by name.
    """

    __slots__ = ("owner",)

    def __init__(self, owner: str, values: dict[str, Array]) -> None:
        super().__init__(values)
        self.owner = owner

    def __getattr__(self, name: str) -> Array:
        # Python calls this method only for names that are no methods of dict: a signal
        # named `values` needs u["values"].
        try:
            return self[name]
        except KeyError:
            raise NameLookupError(
                f"{self.owner} has no '{name}'; it has: {', '.join(sorted(self)) or 'none'}"
            ) from None
