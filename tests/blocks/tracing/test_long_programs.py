"""Programs that are written in parts compute what they compute in one piece."""

from __future__ import annotations

import numpy as np
import pytest

from trussflow.blocks import Diagram, Simulator
from trussflow.blocks.simulation import executor
from trussflow.blocks.tracing import codegen
from trussflow.blocks.tracing.codegen import content
from trussflow.models import SpaceTruss


@pytest.mark.parametrize("part", [40, 1000])
def test_parts_compute_the_same(monkeypatch: pytest.MonkeyPatch, part: int) -> None:
    """Kernels between the parts; products and sums are contracted elsewhere, so but for round-off."""
    results = []
    for long in (codegen.LONG, 0):
        monkeypatch.setattr(codegen, "LONG", long)
        monkeypatch.setattr(codegen, "PART", part)
        unlike = f"in parts {long} {part}"  # nothing kept from elsewhere
        monkeypatch.setattr(executor, "content", lambda programs, unlike=unlike: content(programs) + unlike)
        truss = SpaceTruss.published(modes=2)
        diagram = Diagram("free")
        diagram.add(truss=truss)
        diagram.ground(truss.actuation)
        start = {"truss.v": np.linspace(-0.1, 0.1, truss.n)}
        run = Simulator(diagram, step=1e-2, log=["truss.coordinates"], backend="compiled").run(
            0.1, initial=start, progress=False
        )
        results.append(run["truss.coordinates"].values)
    assert np.max(np.abs(results[0] - results[1])) < 1e-12
    assert np.max(np.abs(results[0][-1] - results[0][0])) > 1e-3
