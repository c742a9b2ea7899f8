"""The study of modes: its linear loop, map of spillover, poles, margins, delays, and the whole script."""

import numpy as np
import pytest
from modes import main
from scipy.linalg import block_diag, eigh
from spillover import rightmost_poles
from study_tools.stability import rightmost, stable_damping
from systems import assert_near
from truss_loop import TrussLoop

from trussflow.blocks import modal_table
from trussflow.blocks.linear_analysis.margins import response
from trussflow.models import SpaceTruss

INDEPENDENT = {
    "Eq. 64": {0.0: 2.3996 + 61.76j, 2.0: 6.4212 + 61.73j, 4.0: 10.963 + 61.86j},
    "published": {2.0: -0.1974 + 16.23j, 4.0: -0.2908 + 16.21j},
}
"""Rightmost oscillating poles over the bandwidth, undamped, linear law [1/s]: from a linear analysis that was
made independently of this code."""

ROUND_OFF = 1e-9  # of loop gains


DAMPINGS, BANDWIDTHS = [0.0, 0.01, 0.02], [0.0, 2.0, 4.0]


@pytest.fixture(scope="module")
def poles():
    return rightmost_poles(SpaceTruss.published(), DAMPINGS, BANDWIDTHS)


@pytest.fixture(scope="module")
def neutral():
    return TrussLoop(SpaceTruss.consistent(), 4.0)


@pytest.fixture(scope="module")
def driven():
    """Return a loop that is unstable, since the actuators drive a mode."""
    return TrussLoop(
        SpaceTruss.consistent(damping=0.01), 4.0, allocation="published", linear=True
    )


@pytest.mark.parametrize("name", INDEPENDENT)
def test_poles_are_those_of_an_independent_analysis(poles, name):
    for bandwidth, expected in INDEPENDENT[name].items():
        found = poles[name][0, BANDWIDTHS.index(bandwidth)]
        assert abs(found / expected - 1) < 0.01


def test_map_of_spillover_has_the_eigenvalues_of_the_diagram(poles, driven):
    """Also without an observer, at bandwidth zero."""
    assert poles["Eq. 64"][1, 2] == pytest.approx(rightmost(driven.closed)[0], rel=1e-7)
    plain = TrussLoop(SpaceTruss.published(), linear=True)
    assert poles["published"][0, 0] == pytest.approx(
        rightmost(plain.closed)[0], rel=1e-7
    )
    for name, least in (("Eq. 64", [np.inf, 0.02]), ("published", [0.0, 0.0])):
        growth = poles[name][:, -1].real
        assert [stable_damping(growth[:n], DAMPINGS[:n]) for n in (2, 3)] == least


def test_mode_neutral_feedback_leaves_no_loop_at_the_modes(neutral):
    assert_near(
        response(neutral.modal_loop, np.array([0.3, 15.0, 60.0])), 0.0, ROUND_OFF
    )


def test_at_its_gain_margin_a_channel_has_a_pole_on_the_axis(neutral, rng):
    """Within the disk margin of a group all gains may change at once."""
    found, loop = neutral.margins(range(6)), neutral.demand_loop
    for k, margins in enumerate(found.channels.values()):
        for gain in (margins.gain_down, margins.gain_up):
            if 0 < gain < np.inf:
                gains = np.where(np.arange(34) == k, gain, 1.0)
                pole = max(
                    np.linalg.eigvals(loop.A - loop.B * gains @ loop.C),
                    key=lambda s: s.real,
                )
                assert abs(pole.real) < 2e-3 * abs(pole), margins
    for _ in range(20):
        gains = np.ones(34)
        gains[:6] = 10 ** (rng.uniform(-found.gain, found.gain, 6) / 20)
        assert np.linalg.eigvals(loop.A - loop.B * gains @ loop.C).real.max() < 0


def test_modal_table_of_the_truss_has_the_modes_of_its_mass_and_stiffness():
    """Without damping; 34 rigid coordinates have no frequency."""
    truss = SpaceTruss.published()
    terms = truss.dynamics.evaluate(truss.dynamics.rest, np.zeros(truss.n))
    stiffness = block_diag(
        np.zeros((truss.rigid, truss.rigid)), np.diag(truss.dynamics.modes.stiffness)
    )
    squares, shapes = eigh(stiffness, terms.mass_matrix)
    effects = (shapes[: truss.rigid].T @ terms.actuation_matrix[: truss.rigid]) ** 2
    found = modal_table(truss, "actuation").modes
    assert [2 * np.pi * m.frequency for m in found] == pytest.approx(
        np.sqrt(squares[truss.rigid :]), rel=1e-8
    )
    for mode, effect in zip(found, effects[truss.rigid :], strict=True):
        assert_near(list(mode.shares.values()), effect / effect.sum(), 1e-7)


@pytest.mark.campaign
def test_quick_study_writes_tables_and_figures(tmp_path):
    main(["--quick", "--output", str(tmp_path)])
    figures = {*(f"bode_{d}_{L}.png" for d in (5, 100) for L in (0, 4))}
    assert {path.name for path in tmp_path.iterdir()} == {
        "tables.txt",
        "spillover.png",
        *figures,
    }
    text = (tmp_path / "tables.txt").read_text(encoding="utf-8")
    for line in (
        "Eq. 64      14     inf %  inf %  inf %",
        "Modes of the closed loop, linear law: published, L = 4",
    ):
        assert line in text
