"""Diagrams with FMUs are swept like others: each worker loads its own."""

import campaign
import numpy as np
import pytest
import xarray as xr
from numpy.testing import assert_allclose
from scipy import stats
from systems import series

from trussflow.blocks import Constant, TransferFunction, rerun, sweep
from trussflow.fmu import Fmu, export

ROUND_OFF = 1e-12


@pytest.mark.parametrize("kind", ["cs", campaign.only("me")])
def test_a_sweep_over_a_diagram_with_an_fmu(kind, tmp_path):
    export(TransferFunction([1.0], [1.0, 1.0]), tmp_path / "lag.fmu")
    diagram = series(
        constant=Constant(1.0),
        lag=Fmu(tmp_path / "lag.fmu", kind=kind, step=0.01 if kind == "cs" else None),
    )
    swept, alone = (
        sweep(
            diagram,
            1.0,
            vary={"constant.value": stats.uniform(1.0, 2.0)},
            samples=6,
            keep={"lag.y": "final"},
            executor=executor,
            workers=2,
            step=0.01,
        )
        for executor in ("processes", "serial")
    )
    xr.testing.assert_equal(swept, alone)
    ratio = swept["lag.y"] / swept["constant.value"]
    assert_allclose(ratio, ratio[0], rtol=ROUND_OFF)
    assert rerun(diagram, swept, 3)["lag.y"][-1] == swept["lag.y"][3]
    assert len(np.unique(swept["lag.y"])) == 6
