"""What mission files say of their path, of what is uncertain, and of what is logged."""

import numpy as np
import pytest
from sources import MISSIONS
from systems import assert_near

from trussflow.blocks import Session
from trussflow.models import QUATERNION, FreeModes, ModelError
from trussflow.models.transport import MissionFile

BOOM = (MISSIONS / "boom_mission.toml").read_text(encoding="utf-8")
VIA = 'through_position = "[[0, 0.3, 0.5]] m"\nthrough_attitude = "[[0, 0, 5]] deg"\n'
DURATION_TOLERANCE = 1e-6
"""What linear programmes and round-off leave."""


def boom(tmp_path, path="", more=""):
    """Return the mission of the boom, with other words on its path, and more tables."""
    text = BOOM.replace('duration = "60 s"\n', path or 'duration = "60 s"\n') + more
    for name in ("boom.toml", "walker.urdf", "slider.urdf"):
        (tmp_path / name).write_bytes((MISSIONS / name).read_bytes())
    file = tmp_path / "mission.toml"
    file.write_text(text, encoding="utf-8")
    return MissionFile.read(file)


def outputs(path, times, name="position"):
    """Return an output of a path at some times."""
    found = []
    with Session(path, step=0.01) as session:
        for time in times:
            session.advance(time)
            found.append(session.outputs[name])
    return np.array(found)


def fastest(tmp_path, more):
    return boom(tmp_path, f'duration = "fastest"\n{VIA}{more}\n')


def test_four_times_the_force_takes_half_the_time(tmp_path):
    weak, strong = (
        fastest(tmp_path, f'strength = "{k} %"').mission.duration for k in (25, 100)
    )
    assert weak == pytest.approx(2.0 * strong, rel=DURATION_TOLERANCE)


def test_the_fastest_path_keeps_limits_of_speed(tmp_path):
    flown = fastest(tmp_path, 'speed = "0.05 m/s"\nturn_rate = "1 deg/s"')
    times = np.linspace(0.0, flown.mission.duration, 200)
    largest = np.abs(outputs(flown.path, times[1:], "velocity")[:, :6]).max(axis=0)
    assert largest[:3].max() == pytest.approx(0.05, rel=1e-2)
    assert largest[3:].max() < np.deg2rad(1.0) * (1.0 + 1e-2)
    assert flown.mission.duration > 1.0 / 0.05
    assert flown.diagram().blocks


def test_a_path_of_given_duration_passes_its_waypoints(tmp_path):
    flown = boom(tmp_path, f'duration = "40 s"\n{VIA}')
    assert flown.mission.duration == pytest.approx(40.0, rel=1e-12)
    via, end = (
        [0.0, 0.3, 0.5, 0.0, 0.0, np.deg2rad(5.0)],
        [0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
    )
    legs = np.linalg.norm([via, np.subtract(end, via)], axis=1)
    found = outputs(flown.path, [40.0 * legs[0] / legs.sum(), 40.0, 45.0])[:, :6]
    assert_near(found, [via, end, end], 1e-9)


@pytest.mark.parametrize("more", ["", VIA])
def test_a_path_too_fast_for_the_actuators_is_refused(tmp_path, more):
    least = boom(tmp_path, f'duration = "60 s"\n{more}').least_duration()
    assert boom(tmp_path, f'duration = "{1.01 * least} s"\n{more}').hardware is not None
    short = f'duration = "{0.99 * least} s"\n{more}'
    with pytest.raises(
        ModelError,
        match=rf"at least {least:.4g} s for this path; increase it.* \(line \d+\)",
    ):
        boom(tmp_path, short)
    assert boom(
        tmp_path, f'{short}\ninfeasible = "allowed"\n'
    ).least_duration() == pytest.approx(least)


def test_a_path_that_rests_needs_no_time(tmp_path):
    boom(tmp_path)
    file = tmp_path / "mission.toml"
    file.write_text(
        file.read_text().replace("[0, 0, 1] m", "[0, 0, 0] m"), encoding="utf-8"
    )
    assert MissionFile.read(file).least_duration() == 0.0


def turning(tmp_path, path):
    """Return the mission of the boom with a quaternion, turned over on its way up."""
    boom(tmp_path)
    file = tmp_path / "turning.toml"
    file.write_text(
        'title = "over"\nextends = "mission.toml"\n[structure]\nattitude = "quaternion"\n'
        f'[path]\nattitude = "[240, 0, 0] deg"\n{path}\n',
        encoding="utf-8",
    )
    return MissionFile.read(file)


def test_quaternions_have_waypoints_and_a_fastest_path(tmp_path):
    """Turned by 240 degrees about x, which no Euler angles reach: about that axis, and the long way."""
    flown = turning(tmp_path, 'duration = "fastest"')
    assert flown.least_duration() == pytest.approx(
        flown.mission.duration / np.sqrt(2.0), rel=0.01
    )
    times = np.linspace(0.0, flown.mission.duration, 31)[1:]
    w, x, y, z = outputs(flown.path, times)[:, 3:7].T
    angle = np.rad2deg(2.0 * np.arctan2(x, w))
    assert np.all(np.diff(angle) > 0.0)
    assert angle[-1] == pytest.approx(240.0, abs=1e-9)
    assert max(np.abs(y).max(), np.abs(z).max()) < 1e-12


def test_quaternions_pass_their_waypoints(tmp_path):
    via = (
        'through_position = "[[0, 0.3, 0.5]] m"\nthrough_attitude = "[[80, 0, 0]] deg"'
    )
    flown = turning(tmp_path, f'{via}\nduration = "40 s"')
    turned = QUATERNION.integrate(
        np.array(QUATERNION.rest), np.deg2rad([80.0, 0.0, 0.0])
    )
    away = np.abs(
        outputs(flown.path, np.arange(0.1, 40.0, 0.05))[:, :7]
        - [0.0, 0.3, 0.5, *turned]
    )
    assert away.max(axis=1).min() < 5e-3


def test_quaternions_are_not_shaped(tmp_path):
    with pytest.raises(
        ModelError, match="'shaping' adds paths, which is not possible with quaternions"
    ):
        turning(tmp_path, 'shaping = "ZV"')


@pytest.mark.parametrize("kind, halves", [("ZV", 1), ("ZVD", 2)])
def test_shaping_takes_half_periods_of_the_first_mode(tmp_path, kind, halves):
    flown = boom(tmp_path, f'duration = "60 s"\nshaping = "{kind}"\n')
    free = FreeModes.of(flown.believed.dynamics, 1)
    damped = free.frequencies[0] * np.sqrt(1.0 - free.damping_ratios[0] ** 2)
    assert flown.mission.duration == pytest.approx(
        60.0 + halves * np.pi / damped, rel=1e-9
    )


def test_what_is_uncertain_is_drawn_and_not_believed(tmp_path):
    nominal = boom(tmp_path).truss.dynamics.modes
    both = 'draw = 7\nmass = "10 %"\nfrequency = "5 %"'
    one, more = (
        boom(tmp_path, more=f"[uncertainties]\n{said}\n")
        for said in (both, f'{both}\npayload = "20 kg"\ndamping = "[1, 2] %"')
    )
    assert one.believed.dynamics.modes.masses.sum() == pytest.approx(
        nominal.masses.sum(), rel=1e-12
    )
    drawn, loaded = one.truss.dynamics.modes, more.truss.dynamics.modes
    heavier = drawn.masses.sum() / nominal.masses.sum()
    assert 1e-3 < abs(heavier - 1.0) < 0.1
    stiffer = drawn.frequencies / nominal.frequencies
    assert np.ptp(stiffer) < 1e-9
    assert 1e-3 < abs(stiffer[0] - 1.0) < 0.05
    carried = loaded.masses - drawn.masses  # the same draw, one more thing uncertain
    assert np.count_nonzero(np.abs(carried) > 1e-9) == 1
    assert 0.0 < carried.sum() < 20.0
    assert 0.01 < loaded.damping_ratios[0] < 0.02
    assert drawn.damping_ratios[0] == nominal.damping_ratios[0]


def test_draws_differ_and_draw_0_is_what_is_believed(tmp_path):
    table = '[uncertainties]\nmass = "10 %"\ndraw = {}\n'
    masses = [
        boom(tmp_path, more=table.format(k)).truss.dynamics.modes.masses.sum()
        for k in (0, 1, 2)
    ]
    assert masses[0] == boom(tmp_path).truss.dynamics.modes.masses.sum()
    assert len(set(masses)) == 3


def test_more_can_be_logged(tmp_path):
    flown = boom(tmp_path, more='log = ["controller.effectiveness"]\n')
    logged = [
        channel.name for channel in flown.simulator(flown.diagram()).prepared.channels
    ]
    assert "controller.effectiveness" in logged


def test_drives_give_no_more_than_their_joint_bears(tmp_path):
    flown = boom(tmp_path)
    joints = flown.truss.dynamics.joint_data
    assert flown.hardware.limits(flown.truss)[12:] == pytest.approx(
        [3.0] * len(joints), rel=1e-12
    )
    weak = [joints[0]._replace(effort=0.1), *joints[1:]]
    assert flown.hardware.drives(weak).parameters["maximum"][:2] == pytest.approx(
        [0.1, 3.0], rel=1e-12
    )
