"""The sum junction, which port arithmetic builds."""

from __future__ import annotations

from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.framework.port import INFERRED, Input, Output
from trussflow.blocks.framework.types import Array
from trussflow.blocks.framework.validation import one_sign_each


class Sum(Block):
    r"""Add and subtract signals of one shape, unit and frame.

    .. math:: y = \sum_i \pm u_i

    Port arithmetic builds it: ``(a.y - b.y) >> c.u``.

    Parameters
    ----------
    signs : str
        One ``+`` or ``-`` for each input; the inputs are named ``u1``, ``u2``, ...

    Raises
    ------
    BlockError
        If `signs` holds anything else.
    """

    y = Output(INFERRED, unit=INFERRED, frame=INFERRED, meaning="signed sum of the inputs")

    def __init__(self, signs: str = "++") -> None:
        one_sign_each("Sum", signs, "+-", "signs such as '++-'")
        self.signs = signs
        self.extra_ports = {
            f"u{i}": Input(INFERRED, unit=INFERRED, frame=INFERRED, meaning=f"counts {sign}")
            for i, sign in enumerate(signs, 1)
        }
        super().__init__()

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the signed sum."""
        total = u.u1 if self.signs[0] == "+" else -u.u1
        for i, sign in enumerate(self.signs[1:], 2):
            total = total + u[f"u{i}"] if sign == "+" else total - u[f"u{i}"]
        return {"y": total}
