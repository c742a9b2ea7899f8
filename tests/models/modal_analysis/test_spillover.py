"""The map of control spillover."""

import pytest

from trussflow.models import ModelError
from trussflow.models.modal_analysis import Grid, spillover_map
from trussflow.models.modal_analysis.margins import is_stable
from trussflow.models.modal_analysis.tables import spillover_table


def test_two_percent_of_damping_is_enough_for_six_modes(published_loop):
    for bandwidth in (None, 2.0, 4.0):
        loop = published_loop.loop(bandwidth=bandwidth, damping=0.02, modal_actuation=True)
        assert is_stable(loop.closed_matrix)


@pytest.mark.campaign
def test_but_not_for_fourteen():
    """Nor does the table say so."""
    grid = Grid(modes=(14,), damping=(0.0, 0.02), bandwidth=(4.0,))
    found = spillover_map(grid)
    rates = found["growth_rate"].sel(modes=14, damping=0.02, bandwidth=4.0)
    assert rates.sel(loop="published") < 0
    assert rates.sel(loop="Eq. 64") > 0
    assert rates.sel(loop="consistent") < 0
    assert (found["frequency"] > 1.0).all()
    needed = [line.split("  ")[-1].strip() for line in spillover_table(found).splitlines()[2:]]
    assert needed == ["0 %", "> 2 %", "0 %"]


def test_unknown_loop():
    with pytest.raises(ModelError, match=r"no loop 'mine'; choose from: published, Eq\. 64"):
        spillover_map(Grid(modes=(6,)), loops=["mine"])


def test_fewer_modes_than_believed_in():
    with pytest.raises(ModelError, match="cannot map 4 modes: the controller believes in 6"):
        spillover_map(Grid(modes=(4,)))
