"""External inputs of a system, which the caller sets."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.declarations import Attribute
from trussflow.blocks.framework.port import Output, Port
from trussflow.blocks.support.types import Vector


class External(Block):
    """Source block of an external input; its value is part of d.

    Parameters
    ----------
    port : Port
        The driven input; the source has the same shape, unit, frame and meaning.
    name : str, optional
        Name of the external input; by default that of the port.
    start : float, optional
        Value until the caller sets one; by default the default of the input [unit of the port].
    """

    traced: ClassVar[bool] = False

    y = Output("extent", unit=Attribute("own_unit"), frame=Attribute("own_frame"))

    def __init__(
        self, port: Port, name: str | None = None, *, start: float | None = None
    ) -> None:
        self.extent = port.shape or ()
        self.own_frame = port.frame
        units = port.element_units()
        # One unit for all elements if possible; no unit if the input has no elements.
        self.own_unit = units[0] if len(set(units)) == 1 else units or None
        self.meaning = port.declaration.meaning
        self.start: float = (
            (port.declaration.default or 0.0) if start is None else start
        )
        super().__init__()
        self.named(name or port.name)

    @property
    def path(self) -> str:
        """Name in parentheses, which differs from the path of every block of a diagram."""
        return f"({self.name})"

    def start_value(self) -> Vector:
        """Return the value of the input until the caller sets one."""
        return np.full(self.extent, self.start)

    def feedthrough(self) -> dict[str, tuple[str, ...]]:
        """Return that the output depends on no input."""
        return {"y": ()}
