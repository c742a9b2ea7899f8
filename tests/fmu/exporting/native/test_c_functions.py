"""Functions written in C: in FMUs and plain C they are what they are in simulations."""

import subprocess

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from systems import simulate_block

from trussflow.blocks import BoundedAllocation, Constant, RateBoundedAllocation, Sine
from trussflow.fmu import ExportError, Fmu, export

RANDOM = np.random.default_rng(4)
INPUTS = {
    "effectiveness": RANDOM.standard_normal((3, 6)),
    "spread": np.diag([1.0, 2.0, 3.0]),
    "lower": -np.ones(6),
    "upper": np.ones(6),
    "preferred": np.zeros(6),
}
AMPLITUDE = 4.0 * RANDOM.standard_normal(3)


def rate_bounded():
    """Return an allocation that is sampled every 0.1 s."""
    return RateBoundedAllocation(3, np.full(6, 0.01), np.full(6, 10.0), 0.1)


def commands(block):
    """Return the commands over 3 s."""
    sources = {name: Constant(value) for name, value in INPUTS.items()}
    sources["demand"] = Sine(AMPLITUDE, 1.0)
    result = simulate_block(block, 3.0, sources, step=0.05, backend="compiled")
    return result["block.command"].values


def test_an_fmu_gives_the_same_bits(version, tmp_path):
    path = export(
        rate_bounded(), tmp_path / "allocation.fmu", step=0.05, version=version
    )
    own, imported = commands(rate_bounded()), commands(Fmu(path))
    assert_array_equal(imported, own)
    assert np.any(np.abs(own) == 1.0)


def test_plain_c_compiles_without_a_warning(tmp_path):
    path = export(rate_bounded(), tmp_path / "allocation.c", kind="c", step=0.05)
    flags = ["-std=gnu99", "-O1", "-Wall", "-Wextra", "-Werror", "-c", path.name]
    subprocess.run(["cc", *flags], cwd=tmp_path, check=True)


def test_derivatives_that_an_fmu_cannot_have_are_refused(tmp_path):
    block = BoundedAllocation(1, [0.1])
    start = {"spread": [[1.0]]}
    with pytest.raises(
        ExportError, match=r"derivatives of bounded_least_squares, .* sample the block"
    ):
        export(block, tmp_path / "allocation.fmu", start=start)
