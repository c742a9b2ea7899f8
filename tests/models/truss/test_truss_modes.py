"""Modal data: integrals, truncation, files, and errors."""

import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.integrate import solve_bvp

from trussflow.models import ModelError, TrussModes
from trussflow.models.truss.truss_modes import LINEAR_LIMIT

TOLERANCE = 1e-12  # round-off of sums over 128 points


def test_shipped_truss_is_the_paper_s(modes):
    """Table 1: mass and frequencies; Table 2: grasp points."""
    assert modes.mass == pytest.approx(499.7333, rel=TOLERANCE)
    assert_array_equal(
        modes.frequencies, [0.3593, 0.97, 1.4392, 2.0239, 2.6408, 4.7984]
    )
    points = [
        [0.0, 0.0, 0.0],
        [3.825, 0.0, 0.0],
        [7.65, 0.0, 0.0],
        [9.5625, -3.312, 0.0],
    ]
    assert_array_equal(modes.grasp_positions, points)
    assert not np.any(modes.damping_ratios)
    assert (modes.modes, modes.grasps) == (6, 4)


def test_truncation_keeps_the_first_modes(modes):
    three = modes.truncated(3)
    assert three.modes == 3
    assert_array_equal(three.second_moments, modes.second_moments[:4, :4])
    assert_array_equal(three.grasp_rotations, modes.grasp_rotations[:, :, :3])
    rigid = modes.truncated(0)
    assert rigid.modes == 0
    assert_array_equal(rigid.inertia, modes.inertia)
    assert rigid.momentum_coefficients.shape == (3, 0)
    assert rigid.modal_mass.shape == (0, 0)


@pytest.mark.parametrize("count", [-1, 7])
def test_truncation_to_modes_that_are_not_there(modes, count):
    with pytest.raises(
        ModelError, match=f"cannot keep {count} modes of 6; choose 0 to 6"
    ):
        modes.truncated(count)


@pytest.mark.parametrize("count", [0, 4])
def test_files_are_read_back_exactly(modes, tmp_path, count):
    path, kept = tmp_path / "modes.json", modes.truncated(count)
    kept.save(path)
    again = TrussModes.load(path)
    assert_array_equal(again.second_moments, kept.second_moments)
    assert_array_equal(again.grasp_rotations, kept.grasp_rotations)
    assert again.source == modes.source


ERROR_CASES = [
    (
        {"masses": np.ones(127)},
        r"positions has shape \(128, 3\); it must be \(127, 3\)",
    ),
    (
        {"shapes": np.zeros((128, 3, 5))},
        r"shapes has shape \(128, 3, 5\); it must be \(128, 3, 6\)",
    ),
    (
        {"frequencies": [1.0, 2.0, 3.0, np.nan, 5.0, 6.0]},
        "truss modes: frequencies is not finite",
    ),
    (
        {"frequencies": [1.0, 2.0, 3.0, -4.0, 5.0, 6.0]},
        r"frequencies\[3\] is -4.0 Hz; it must be",
    ),
    (
        {"damping_ratios": [0.0, -0.1, 0.0, 0.0, 0.0, 0.0]},
        r"damping_ratios\[1\] is -0.1; none may",
    ),
    ({"masses": np.zeros(128)}, "total mass is zero"),
    ({"masses": -np.ones(128)}, r"masses\[0\] is -1.0 kg; none may be negative"),
    ({"grasp_positions": [[0.0], [1.0, 2.0]]}, "grasp_positions must be numeric, not"),
]


@pytest.mark.parametrize("values, message", ERROR_CASES)
def test_errors_of_data(modes, values, message):
    with pytest.raises(ModelError, match=message):
        replace(modes, **values)


def test_modes_must_be_orthonormal(modes):
    shapes = modes.shapes.copy()
    shapes[:, :, 2] *= 1.01
    with pytest.raises(
        ModelError, match=r"sum m T\^T T is 1.0201 at modes \(3, 3\), it must be 1"
    ):
        replace(modes, shapes=shapes)


def test_points_must_not_lie_on_a_line(modes):
    line = np.zeros((128, 3))
    line[:, 0] = modes.positions[:, 0]
    with pytest.raises(ModelError, match="lie on one line"):
        replace(modes, positions=line)


def test_missing_file():
    with pytest.raises(
        ModelError, match=r"cannot read truss modes from 'none.json': No such file"
    ):
        TrussModes.load("none.json")


@pytest.mark.parametrize(
    "change, message",
    [
        (lambda _: "{ mass", "it is not JSON"),
        (lambda _: "[1, 2]", "it must be an object with 'format': 'trussflow truss"),
        (
            lambda _: '{"format": "something else"}',
            "it must be an object with 'format'",
        ),
        (
            lambda content: json.dumps({**content, "colour": "grey"}),
            r"unknown keys \['colour'\]",
        ),
        (
            lambda content: json.dumps({"format": content["format"]}),
            r"missing keys \['damping",
        ),
        (
            lambda content: json.dumps({**content, "mass_kg": [1.0]}),
            "cannot use the data in .*modes: pos",
        ),
    ],
)
def test_unusable_files(modes, tmp_path, change, message):
    path = tmp_path / "modes.json"
    modes.save(path)
    path.write_text(change(json.loads(path.read_text())))
    with pytest.raises(ModelError, match=message):
        TrussModes.load(path)


def test_the_linear_range_is_where_a_cantilever_is_right_to_a_percent():
    """The elastica under an end load, against linear theory, at a deflection of `LINEAR_LIMIT`."""
    load = 3.0 * LINEAR_LIMIT  # P L^2 / (E I): the linear deflection is a third of it

    def elastica(_, y):
        angle, curvature, _, _ = y
        along, across = np.cos(angle), np.sin(angle)
        return np.stack([curvature, -load * along, along, across])

    def clamped(start, end):
        return np.array([start[0], start[2], start[3], end[1]])

    s = np.linspace(0.0, 1.0, 21)
    straight = np.stack([0 * s, 0 * s, s, 0 * s])
    along, across = solve_bvp(elastica, clamped, s, straight, tol=1e-9).y[2:, -1]
    assert LINEAR_LIMIT / across - 1.0 == pytest.approx(0.0102, abs=1e-4)
    assert 1.0 - along == pytest.approx(0.6 * LINEAR_LIMIT**2, rel=0.02)


def test_deflection_is_the_greatest_of_displacement_and_rotation(modes):
    modal = np.outer(np.linspace(-1.0, 0.5, 4), np.eye(6)[2])
    size = np.linalg.norm(np.ptp(modes.positions, axis=0))
    moved = np.linalg.norm(modes.shapes[:, :, 2], axis=1).max() / size
    turned = np.linalg.norm(modes.grasp_rotations[:, :, 2], axis=1).max()
    assert modes.deflection(modal) == pytest.approx(max(moved, turned), rel=1e-12)
    assert modes.truncated(0).deflection(np.zeros((4, 0))) == 0.0
