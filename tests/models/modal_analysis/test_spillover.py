"""The map of control spillover."""

from __future__ import annotations

import pytest

from trussflow.models import ModelError
from trussflow.models.modal_analysis import Grid, spillover_map
from trussflow.models.modal_analysis.tables import spillover_table


def test_map_has_the_known_poles_and_tells_stable_from_unstable() -> None:
    grid = Grid(modes=(6,), damping=(0.0, 0.02), bandwidth=(0.0, 4.0))
    found = spillover_map(grid, loops=["Eq. 64"]).sel(loop="Eq. 64", modes=6)
    rate = found["growth_rate"]
    # The finite-element frequencies are 0.1 % below the printed ones.
    assert float(rate.sel(damping=0.0, bandwidth=0.0)) == pytest.approx(2.40, rel=0.01)
    assert float(rate.sel(damping=0.0, bandwidth=4.0)) == pytest.approx(10.96, rel=0.01)
    frequency = float(found["frequency"].sel(damping=0.0, bandwidth=0.0))
    assert frequency == pytest.approx(61.7, rel=0.01)
    assert (rate.sel(damping=0.02) < 0).all()


@pytest.mark.slow
def test_more_modes_need_more_damping() -> None:
    """2 % is enough for six modes, not for fourteen; the table says so."""
    grid = Grid(modes=(14,), damping=(0.0, 0.02), bandwidth=(4.0,))
    found = spillover_map(grid)
    unstable = found["growth_rate"].sel(modes=14, damping=0.02, bandwidth=4.0)
    assert float(unstable.sel(loop="published")) < 0
    assert float(unstable.sel(loop="Eq. 64")) > 0
    assert float(unstable.sel(loop="consistent")) < 0
    needed = [line.split("  ")[-1].strip() for line in spillover_table(found).splitlines()[2:]]
    assert needed == ["0 %", "> 2 %", "0 %"]


def test_unknown_loop() -> None:
    with pytest.raises(ModelError, match=r"no loop 'mine'; choose from: published, Eq\. 64"):
        spillover_map(Grid(modes=(6,)), loops=["mine"])


def test_fewer_modes_than_believed_in() -> None:
    with pytest.raises(ModelError, match="cannot map 4 modes: the controller believes in 6"):
        spillover_map(Grid(modes=(4,)))
