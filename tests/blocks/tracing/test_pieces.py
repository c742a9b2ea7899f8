"""Long programs become several C functions, which compute the same."""

import pytest
from numpy.testing import assert_allclose
from systems import Ring, series

from trussflow.blocks import Simulator
from trussflow.blocks.tracing import codegen


@pytest.mark.parametrize("length, file", [(1, 300), (5, 900), (40, 10**9)])
def test_pieces_compute_the_same(length, file, tmp_path, monkeypatch):
    diagram = series(ring=Ring(), other=Ring())
    diagram.ground(diagram.ring.push)
    expected = Simulator(diagram, step=1e-2, backend="interpreted").run(1.0)
    monkeypatch.setenv("TRUSSFLOW_CACHE", str(tmp_path))
    monkeypatch.setattr(codegen, "MAX_PIECE_INSTRUCTIONS", length)
    monkeypatch.setattr(codegen, "MIN_FILE_SIZE", file)
    simulator = Simulator(diagram, step=1e-2, backend="compiled")
    main, *others = codegen.c_sources(simulator.prepared.programs)
    assert (len(others) > 1) == (file < 10**9)
    assert (main.count("hidden") if others else main.count("noinline")) > 40 / length
    found = simulator.run(1.0)
    assert_allclose(found["other.total"], expected["other.total"], rtol=1e-13)
