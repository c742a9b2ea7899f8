"""Python functions run as they are, at their samples."""

from collections.abc import Callable

import numpy as np
import pytest
import xarray as xr

from trussflow.blocks import BlockError, Input, Output, PythonFunction, Ramp
from trussflow.blocks.framework.types import Array


def decide(u: Array, v: Array) -> tuple[Array, Array]:
    """Do what cannot be traced."""
    if u > 0.25:
        return v, float("".join(["4", "2"]))
    return -v, 0.0


def test_function_may_do_anything(respond: Callable[..., xr.Dataset]) -> None:
    block = PythonFunction(
        decide, 0.1, inputs={"u": Input(), "v": Input(2)}, outputs={"y": Output(2), "n": Output()}
    )
    block_result = respond(block, 0.5, {"log_step": 0.1}, u=Ramp(), v=[1.0, 2.0])
    signs = np.array([-1, -1, -1, 1, 1, 1])
    np.testing.assert_array_equal(block_result["block.y"], np.outer(signs, [1.0, 2.0]))
    np.testing.assert_array_equal(block_result["block.n"], np.where(signs > 0, 42.0, 0.0))


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (
            lambda: PythonFunction(abs, 0.0, inputs={"u": Input()}, outputs={"y": Output()}),
            "cannot sample 'PythonFunction' every 0.0 s",
        ),
        (
            lambda: PythonFunction(decide, 0.1, inputs={}, outputs={"y": Input()}),  # type: ignore[dict-item]
            r"PythonFunction: output 'y' must be an Output\(...\)",
        ),
        (
            lambda: PythonFunction(decide, 0.1, inputs={"name": Input()}, outputs={"y": Output()}),
            "declares 'name'",
        ),
    ],
)
def test_nonsense_is_refused(build: Callable[[], object], message: str) -> None:
    with pytest.raises(BlockError, match=message):
        build()
