"""Blocks from the linear systems and designs of python-control."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from trussflow.blocks.errors import BlockError, Explained
from trussflow.blocks.framework.arithmetic import Operation
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.port import Input
from trussflow.blocks.framework.units import Unit
from trussflow.blocks.library.continuous import StateSpace
from trussflow.blocks.library.discrete import DiscreteStateSpace
from trussflow.blocks.library.linear import realization
from trussflow.blocks.support.validation import finite_array, shown

if TYPE_CHECKING:
    import control


def from_control(
    system: control.StateSpace | control.TransferFunction,
    *,
    initial_value: npt.ArrayLike = 0.0,
    input_unit: Unit = None,
    output_unit: Unit = None,
) -> StateSpace | DiscreteStateSpace:
    """Return the block of a linear system of python-control.

    A system with one input and one output has scalar ports, any other has vectors. A discrete
    system becomes a sampled block.

    Parameters
    ----------
    system : control.StateSpace or control.TransferFunction
        Transfer functions with several inputs or outputs go through ``control.ss`` first.
    initial_value : array_like, shape (n,)
        Initial state [any].
    input_unit, output_unit : str, tuple of str or None
        Units of u and y, or one per element; None leaves them unchecked.

    Returns
    -------
    StateSpace or DiscreteStateSpace

    Raises
    ------
    BlockError
        If the system has another type, is a transfer function with several inputs or outputs, or is discrete
        with an unknown sample time.
    """
    import control

    scalar = getattr(system, "ninputs", 0) == getattr(system, "noutputs", 0) == 1
    if isinstance(system, control.StateSpace):
        A, B, C, D = system.A, system.B, system.C, system.D
        if scalar:
            # A vector B or C makes the port a scalar, see `matrices`.
            B, C, D = B[:, 0], C[0], D[0, 0]
    elif isinstance(system, control.TransferFunction) and scalar:
        A, B, C, D = realization("from_control", system.num[0][0], system.den[0][0])
    else:
        raise BlockError(
            f"cannot make a block of {shown(system)}: it must be a control.StateSpace, or a "
            "control.TransferFunction with one input and one output; control.ss(system) converts others"
        )
    settings: dict[str, Any] = {
        "initial_value": initial_value,
        "input_unit": input_unit,
        "output_unit": output_unit,
    }
    if system.isctime():
        return StateSpace(A, B, C, D, **settings)
    # python-control marks a discrete system of unknown sample time by True.
    if system.dt is True:
        raise BlockError(
            "cannot make a block of a discrete system whose sample time is not given; build it "
            "with dt in seconds"
        )
    return DiscreteStateSpace(A, B, C, D, sample_time=system.dt, **settings)


def lqr(system: control.StateSpace, Q: npt.ArrayLike, R: npt.ArrayLike) -> Block:
    r"""Return the linear-quadratic regulator of a system as a block.

    .. math:: y = -K x

    minimizes the integral of :math:`x^T Q x + u^T R u`, or the sum for a discrete system, for which the
    block is sampled. With one command y is a scalar.

    Parameters
    ----------
    system : control.StateSpace
        The system to regulate, by feedback of its whole state.
    Q : array_like, shape (n, n)
        Weight of the states [any].
    R : array_like, shape (m, m)
        Weight of the commands [any].

    Returns
    -------
    Block
        Block with the single input ``u2``, the state, and the output ``y``.

    Raises
    ------
    BlockError
        If the system is no state space, or the design fails.
    """
    import control

    if not isinstance(system, control.StateSpace) or system.dt is True:
        raise BlockError(
            f"lqr needs a control.StateSpace, with its sample time if discrete, not {shown(system)}"
        )
    weights = finite_array("Q of lqr", Q), finite_array("R of lqr", R)
    design = control.lqr if system.isctime() else control.dlqr
    with Explained(
        lambda error: BlockError(f"lqr cannot regulate this system: {error}")
    ):
        K = np.asarray(design(system, *weights)[0])
    state = Input(system.nstates, meaning="state")
    gain = Operation(np.matmul, -K[0] if len(K) == 1 else -K, state)
    return gain if system.isctime() else gain.sampled(system.dt)
