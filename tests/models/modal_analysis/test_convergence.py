"""The convergence table: bounds, limits, and what it looks like."""

import numpy as np
import pytest

from trussflow.models import ModelError, RobotArm
from trussflow.models.modal_analysis import convergence, convergence_text, summary_text

# Pynite gives massless freedoms a tiny mass, which moves frequencies by about 1e-7.
SAME_MODEL = 1e-6
# Of eigenvalues, whose condition takes some digits.
ROUND_OFF = 1e-9
NUMBERS = (4, 6, 10, 20, 40)


@pytest.fixture(scope="module")
def comparison():
    """Return the table for the true arm, whose long lever turns the grasp points most."""
    return convergence(
        arms=(RobotArm.jaco(),) * 4, numbers_of_modes=NUMBERS, robot_scales=(0.0, 0.25, 1.0, 4.0)
    )


def test_more_modes_lower_every_frequency(comparison):
    """Rayleigh–Ritz in nested spaces: it holds to round-off."""
    steps = comparison["frequency"].diff("number_of_modes") / comparison["frequency"]
    assert steps.max() < ROUND_OFF
    assert steps.min() < -0.1


def test_the_modal_model_is_above_its_limit_and_that_above_the_direct_model(comparison):
    assert comparison["truncation_error"].min() > -SAME_MODEL
    assert comparison["error"].min() > -SAME_MODEL
    assert comparison["basis_error"].min() > -ROUND_OFF
    assert comparison["face_error"].min() > -ROUND_OFF


def test_the_error_of_truncation_goes_to_zero(comparison):
    """Forty modes leave a twentieth of the error of six in what they can describe.

    Free with the paper's robots, where it is largest; the first six frequencies.
    """
    error = comparison["truncation_error"].sel(support="free", robot_scale=1.0)
    worst = error.max("mode")
    assert worst.sel(number_of_modes=40) < 0.05 * worst.sel(number_of_modes=6)
    # The last frequencies of a six-mode model are of no use; the first of forty are good.
    assert error.sel(number_of_modes=6, mode=5) > 0.5
    assert error.sel(number_of_modes=40, mode=slice(1, 3)).max() < 2e-3


def test_the_truss_alone_needs_no_more_than_its_modes(comparison):
    """Clamped it is exact; free it converges to the finite-element truss."""
    alone = comparison.sel(robot_scale=0.0)
    own = alone["error"].sel(support="clamped", number_of_modes=slice(6, None))
    assert np.abs(own).max() < SAME_MODEL
    assert np.abs(alone["basis_error"]).max() < ROUND_OFF
    free = alone["error"].sel(support="free", number_of_modes=40)
    assert 0.0 < free.max() < 1e-3


def test_no_number_of_modes_describes_the_grasp_points_rods(comparison):
    """The robots' torque bends the rods at the grasp points: 2 % in f2, 12 % in f4, and stays."""
    basis = comparison["basis_error"].sel(support="free", robot_scale=1.0)
    assert float(basis.sel(mode=2)) == pytest.approx(0.0199, abs=5e-4)
    assert float(basis.sel(mode=4)) == pytest.approx(0.122, abs=2e-3)


def test_attachment_shapes_do(comparison):
    """With twenty modes besides, all six are within 0.03 %, and never below."""
    errors = comparison["component_error"].sel(support="free")
    assert errors.min() > -SAME_MODEL
    assert errors.sel(robot_scale=1.0, number_of_modes=20).max() < 3e-4
    assert errors.sel(number_of_modes=40).max() < 1e-3
    rows = [row for row in convergence_text(comparison).splitlines() if "+ shapes" in row]
    assert len(rows) == 2 * 4 * len(NUMBERS)
    assert rows[-1].startswith("40 + shapes")


def test_frequencies_are_named_and_have_units(comparison):
    assert comparison["frequency"].dims == ("number_of_modes", "support", "robot_scale", "mode")
    assert comparison["robot_mass"].values == pytest.approx(np.array([0, 0.25, 1, 4]) * 77.5888)
    assert comparison["robot_mass"].attrs["units"] == "kg"
    for name, variable in comparison.data_vars.items():
        assert variable.attrs["units"] == ("Hz" if "frequency" in str(name) else "1")
    few = comparison["frequency"].sel(number_of_modes=4)
    assert np.all(np.isnan(few.sel(mode=slice(5, None))))
    assert np.all(np.isfinite(few.sel(mode=slice(1, 4))))
    flexible = comparison["flexible_face_frequency"]
    assert np.all(np.isnan(flexible.sel(support="clamped")))


def test_tables_show_the_numbers(comparison):
    text = convergence_text(comparison)
    lines = text.splitlines()
    assert lines[0] == "free, no robots"
    assert "clamped, robots of 77.6 kg in all" in lines
    start = lines.index("free, robots of 77.6 kg in all")
    table = lines[start + 1 : start + 1 + 2 + 1 + len(NUMBERS) + 2]
    assert table[0].split() == ["f1", "f2", "f3", "f4", "f5", "f6"]
    assert table[2].startswith("direct FE [Hz]   1.9738")
    assert table[3].split()[:4] == ["4", "modes", *f"{error(comparison, 4, 1):.3f} %".split()]
    assert table[3].split()[-1] == "-"
    assert [row[:15].strip() for row in table[-2:]] == ["all modes", "rigid root face"]


def test_summary_shows_the_largest_errors(comparison):
    lines = summary_text(comparison, first=2).splitlines()
    assert lines[0] == "largest error of the 2 lowest frequencies"
    assert len(lines) == 3 + 2 * 4
    row = next(line for line in lines if line.startswith("free     77.6")).split()
    worst = max(error(comparison, 40, 1), error(comparison, 40, 2))
    assert row[10] == f"{worst:.3f}"


def error(comparison, modes, mode):
    """Return an error of the free system with the paper's robots [%]."""
    case = comparison["error"].sel(support="free", robot_scale=1.0)
    return 100.0 * float(case.sel(number_of_modes=modes, mode=mode))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"numbers_of_modes": ()}, r"numbers_of_modes is \[\]; give at least one"),
        ({"numbers_of_modes": (6, 0)}, r"numbers_of_modes is \[6, 0\]"),
        ({"robot_scales": ()}, r"robot_scales is \[\]; give at least one"),
        ({"robot_scales": (-1.0,)}, r"robot_scales is \[-1.0\]"),
        ({"compared": 0}, "compared is 0; compare at least one frequency"),
        ({"arms": (RobotArm.jaco(),)}, "4 grasp points but 1 arms"),
        ({"joint_angles": np.zeros(3)}, r"joint_angles has shape \(3,\)"),
        ({"grasp_points": np.ones((4, 3))}, "no mesh point at grasp point"),
    ],
)
def test_refused(options, message):
    with pytest.raises(ModelError, match=message):
        convergence(**options)
