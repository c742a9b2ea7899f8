"""Loops broken at any wire: the loop gain, ready for the margins of python-control."""

from contextlib import nullcontext
from unittest.mock import patch

import campaign
import control
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import minimize_scalar
from systems import ring

from trussflow.blocks import (
    PD,
    Constant,
    Diagram,
    DiscreteStateSpace,
    Gain,
    Integrator,
    MatrixGain,
    OperatingPoint,
    Operation,
    StateSpace,
    Terminator,
    loop_margins,
    loop_transfer,
    sensitivity,
)
from trussflow.blocks.errors import (
    LinearAnalysisError,
    SimulationWarning,
    TrussflowError,
)
from trussflow.blocks.linear_analysis.loop_transfer import margins_of
from trussflow.blocks.linear_analysis.margins import (
    frequencies_about,
    sensitivities,
    sensitivity_matrices,
)

KP, KD = 20.0, 3.0


def spring_loop():
    """Return the loop of the README."""
    loop = Diagram("mass on a spring")
    goal, law, plant, sink = loop.add(
        goal=Constant([1.0]),
        law=PD(KP, KD, shape=1),
        plant=StateSpace([[0.0, 1.0], [-4.0, -0.2]], [[0], [1]], np.eye(2)),
        sink=Terminator(),
    )
    goal >> law.reference_position
    loop.ground(law.reference_velocity)
    plant.y[0:1] >> law.position
    plant.y[1:2] >> law.velocity
    law.force >> plant.u
    law.force >> sink.u
    return loop


def gain_of(s):
    """Return the loop gain at the force."""
    return (KP + KD * s) / (s**2 + 0.2 * s + 4)


@pytest.mark.parametrize(
    "where", ["law.force", "plant.u", "plant.u[0]", "law.force[0:1]"]
)
def test_the_gain_at_the_force_is_that_of_the_textbook(where):
    model = loop_transfer(spring_loop(), where)
    for omega in (0.0, 0.5, 2.0, 7.0):
        assert model(1j * omega) == pytest.approx(gain_of(1j * omega), rel=1e-12)
    label = where.split("[")[0].replace(".", "/") + "[0]"
    assert (model.input_labels, model.output_labels) == ([label], [f"{label}_returned"])


def test_one_of_two_wires_is_broken_while_the_other_stays_closed():
    """1 + L at the position alone is the closed loop over that with the rate loop closed."""
    model = loop_transfer(spring_loop(), "law.position")
    for s in (0.3j, 2j, 9j):
        rate_loop = s**2 + (0.2 + KD) * s + 4
        assert model(s) == pytest.approx(KP / rate_loop, rel=1e-12)
    part = loop_transfer(spring_loop(), "plant.y[0]")
    assert_allclose(part(3j), model(3j), rtol=1e-12)


def test_breaking_both_channels_gives_the_matrix_whose_determinant_closes_the_loop():
    model = loop_transfer(spring_loop(), "plant.y")
    assert (model.ninputs, model.noutputs) == (2, 2)
    for s in (0.3j, 2j):
        matrix = np.eye(2) + model(s)
        assert np.linalg.det(matrix) == pytest.approx(1 + gain_of(s), rel=1e-12)


def test_loops_within_nested_diagrams_are_broken_too():
    outer, inner = Diagram("outer"), Diagram("inner.1")
    law, plant = inner.add(
        law=Gain([-3.0]), plant=StateSpace([[-1.0]], [[1.0]], [[1.0]])
    )
    law >> plant >> law
    inner.expose(y=plant.y)
    outer.add(inner=inner, sink=Terminator())
    outer.inner.y >> outer.sink.u
    assert loop_transfer(outer, "inner.law.y")(1j) == pytest.approx(3 / (1 + 1j))
    # a diagram, or a block, that is part of a larger one can be looked at by itself
    assert loop_transfer(inner, inner.law.u).name == inner.name == "inner"
    assert loop_transfer(inner, "inner.law.u")(1j) == pytest.approx(3 / (1 + 1j))
    # the port of the inner diagram stands for the plant's output, and all who read it
    assert loop_transfer(outer, "inner.y")(1j) == pytest.approx(3 / (1 + 1j))


@pytest.mark.parametrize(
    "where, message",
    [
        ("goal.y", "no loop passes through 'goal.y'; .*: 'law.force', 'plant.y'$"),
        ("sink.u", "no loop passes through 'sink.u'"),
    ],
)
def test_wires_without_a_loop_are_refused_with_those_that_have_one(where, message):
    with pytest.raises(LinearAnalysisError, match=message):
        loop_transfer(spring_loop(), where)


def test_a_diagram_without_a_loop_is_refused():
    chain = Diagram()
    source, gain = chain.add(source=Constant(1.0), gain=Gain(1.0))
    source >> gain
    with pytest.raises(
        LinearAnalysisError, match=r"through 'gain.u'; there is no loop$"
    ):
        loop_transfer(chain, "gain.u")


@pytest.mark.parametrize("where", ["law.force", "plant.u"])
def test_sensitivities_are_those_of_the_textbook(where):
    loop = spring_loop()
    S, T = sensitivity(loop, where), sensitivity(loop, where, complementary=True)
    opened = sensitivity(loop, where, openings="law.velocity")
    for omega in (0.5, 2.0, 7.0):
        s = 1j * omega
        assert S(s) == pytest.approx(1 / (1 + gain_of(s)), rel=1e-12)
        assert T(s) == pytest.approx(gain_of(s) / (1 + gain_of(s)), rel=1e-12)
        assert opened(s) == pytest.approx(
            1 / (1 + KP / (s**2 + 0.2 * s + 4)), rel=1e-12
        )


def test_loops_without_margins_and_bad_frequencies_are_refused():
    with pytest.raises(
        LinearAnalysisError, match=r"closed, it has the unstable poles 1\+2j, 1-2j"
    ):
        loop_margins(turned_loop(), "law.y")
    for omega in ([], 1.0, [1.0, 1.0], "fast", [[1.0, 2.0]]):
        with pytest.raises(TrussflowError, match=r"^omega "):
            loop_margins(spring_loop(), "plant.u", omega=omega)


def test_margins_of_a_known_loop():
    """L = 1 / (s (s + 1)^2): gain margin 2, phase margin 21.39 degrees at 0.6823 rad/s."""
    model = control.tf2ss([1], [1, 2, 1, 0])
    margins = margins_of(model, np.geomspace(0.01, 100, 400))
    (found,) = margins.channels.values()
    assert (found.gain_up, found.gain_down) == (pytest.approx(2.0, rel=1e-4), 0.0)
    assert found.phase == pytest.approx(21.386, rel=1e-3)
    assert found.crossover == pytest.approx(0.68233, rel=1e-4)
    assert found.delay == pytest.approx(np.radians(21.386) / 0.68233, rel=1e-3)
    scan = np.geomspace(0.1, 10, 20_000)
    disk = control.disk_margins(model, scan)[0]
    assert [found.disk, margins.disk] == pytest.approx([disk, disk], rel=1e-6)


def closed_loop(A, B, C):
    """Return the loop gain whose closed loop has the state matrix A."""
    A, B, C = (np.array(matrix, dtype=float) for matrix in (A, B, C))
    return control.ss(A + B @ C, B, C, 0)


def test_an_unstable_pole_beside_nearly_equal_ones_is_refused():
    """The eigenvectors of the pair at -1 are nearly parallel, so their residues are 1e12 times larger."""
    A = [[-1.0, 1.0, 0.0], [0.0, -1.0 - 1e-12, 0.0], [0.0, 0.0, 0.1]]
    with pytest.raises(
        LinearAnalysisError, match=r"closed, it has the unstable poles 0\.1"
    ):
        margins_of(closed_loop(A, [[0], [1], [1]], [[1, 0, 1]]))


@pytest.mark.parametrize("excited, seen", [(0, 1), (1, 0), (0, 0)])
def test_a_hidden_unstable_pole_is_a_warning(excited, seen):
    """Hidden poles do not change the margins, and a chain of two integrals is not unstable."""
    A = np.zeros((4, 4))
    A[0, 0], A[1, 1], A[2, 3] = -2.0, 0.5, 1.0
    A[3, 0] = 1.0
    loop = closed_loop(A, [[1], [excited], [0], [0]], [[1, seen, 0, 0]])
    with pytest.warns(
        SimulationWarning,
        match=r"loop at '.*' hides the unstable poles 0\.5 of the diagram",
    ):
        found = margins_of(loop)
    assert found.disk == pytest.approx(
        margins_of(control.ss(-1, 1, 1, 0)).disk, rel=1e-9
    )


def test_a_loop_without_gain_takes_no_search():
    """Its disk margin is the same at all frequencies, which are no minima."""
    with (
        patch("scipy.optimize.minimize_scalar", wraps=minimize_scalar) as search,
        pytest.warns(SimulationWarning, match="identically zero"),
    ):
        assert loop_margins(spring_loop(), "plant.u", openings="plant.y").disk == 2.0
    assert search.call_count == 2  # of the channel, and of all channels


def least_disk(loop, omega, turned):
    """Return the least disk margin over the frequencies, the most sensitive ones first.

    A structured singular value is at most the largest singular value: most frequencies need not be looked at.
    """
    bounds = 1.0 / np.linalg.norm(turned, 2, axis=(1, 2))
    least = np.inf
    for part in np.array_split(np.argsort(bounds), omega.size // 100 + 1):
        if bounds[part[0]] > least:
            break
        few = np.sort(omega[part])
        least = min(least, control.disk_margins(loop, few, returnall=True)[0].min())
    return least


def disks_and_scans(loop):
    """Return the disk margins of all channels at once and of each, and the least of a denser scan of each."""
    poles = np.concatenate(
        [loop.poles(), np.linalg.eigvals(sensitivity_matrices(loop)[0])]
    )
    sizes = np.abs(poles)
    scan = frequencies_about(poles, 1e-3 * sizes.min(), 1e3 * sizes.max(), points=1200)
    S = sensitivities(loop, scan)
    scanned = (
        least_disk(loop, scan, S - 0.5 * np.eye(loop.ninputs)),
        *(1.0 / np.abs(np.einsum("kii->ki", S) - 0.5)).min(axis=0),
    )
    found = margins_of(loop)
    return np.array(
        [found.disk, *(one.disk for one in found.channels.values())]
    ), np.array(scanned)


@pytest.mark.parametrize("a", [1.0, 2.0, 3.0, 5.0, 10.0, 30.0, 100.0])
def test_disk_margin_of_the_spinning_satellite(a):
    A, C = [[0.0, a], [-a, 0.0]], [[1.0, a], [-a, 1.0]]
    loop = ring(plant=StateSpace(A, np.eye(2), C), back=Gain([-1.0, -1.0]))
    _, scanned = disks_and_scans(control.ss(A, np.eye(2), C, 0))
    assert loop_margins(loop, "back.y").disk == pytest.approx(scanned[0], rel=1e-6)


def test_margins_of_several_channels_need_slycot():
    with (
        patch("control.margins.ab13md", None),
        pytest.raises(
            LinearAnalysisError,
            match=r"of 2 channels at once needs slycot: pip install",
        ),
    ):
        loop_margins(spring_loop(), "plant.y")


@pytest.mark.parametrize("loops", [5, campaign.only(15 * campaign.SIZE)])
def test_disk_margins_are_never_above_a_scan(loops):
    rng = np.random.default_rng(campaign.SEED)
    while loops:
        n, m = rng.integers(2, 7), rng.integers(2, 4)
        A, B, C = (
            rng.standard_normal((n, n)),
            rng.standard_normal((n, m)),
            rng.standard_normal((m, n)),
        )
        if np.linalg.eigvals(A - B @ C).real.max() < -0.01:
            loops -= 1
            margins, scanned = disks_and_scans(control.ss(A, B, C, 0))
            assert np.all(
                (0.99 * scanned < margins) & (margins <= (1.0 + 1e-6) * scanned)
            )


def turned_loop():
    """Return a loop with closed poles 1 ± 2i, and an integral beside it, no pole of the loop."""
    loop = Diagram("turned")
    law, plant, beside = loop.add(
        law=Gain(-3.0),
        plant=StateSpace([[0.0, 1.0], [-2.0, 2.0]], [[0.0], [1.0]], [[1.0, 0.0]]),
        beside=Integrator([0.0]),
    )
    plant >> law >> plant
    plant.y >> beside.u
    return loop


def test_a_sampled_loop_has_the_margins_of_its_discrete_gain():
    """L = k / (z - 1): phase margin 90 degrees less half the angle at which |z - 1| = k."""
    period, k = 0.1, 0.5
    loop = ring(
        total=DiscreteStateSpace([[1.0]], [[1.0]], [[1.0]], sample_time=period),
        law=Gain(-k),
    )
    (channel,) = loop_margins(loop, "law.u").channels.values()
    angle = 2 * np.arcsin(k / 2)
    assert channel.phase == pytest.approx(90.0 - np.degrees(angle) / 2, rel=1e-3)
    assert channel.crossover == pytest.approx(angle / period, rel=1e-3)
    assert channel.gain_down == 0.0
    assert channel.gain_up == pytest.approx(2.0 / k, rel=1e-6)  # z = -1


@pytest.mark.parametrize(
    "pole, gain, direct, limits",
    [
        (1.0, 3.0, 0.0, (1 / 3, np.inf)),  # 3 / (s - 1) needs a third of its gain: at 0
        (-1.0, -0.5, 0.0, (0.0, 2.0)),  # -1/2 / (s + 1) bears twice its gain: at 0
        (-1.0, 1.0, -0.5, (0.0, 2.0)),  # 1 / (s + 1) - 1/2: at infinity
        (0.0, 1.0, 0.0, (0.0, np.inf)),  # 1 / s bears all
    ],
)
def test_a_pole_may_leave_along_the_real_axis(pole, gain, direct, limits):
    """At the gain margin the closed loop has a pole at zero, or at infinity, where no frequency is."""
    loop = Diagram("real", loops="solve")
    law, system = loop.add(
        law=Gain(-1.0), system=StateSpace([[pole]], [[1.0]], [[gain]], [[direct]])
    )
    law >> system >> law
    (channel,) = loop_margins(loop, "law.y").channels.values()
    assert (channel.gain_down, channel.gain_up) == pytest.approx(
        limits, rel=1e-6, abs=1e-12
    )


def test_actuators_that_do_the_same_work_have_margins_of_their_own():
    """Share w of (3 s^2 + 3 s + 1) / s^3, the rest closed: stable while w k + 1 - w > 1/9."""
    share = np.array([[0.95, 0.05]])
    loop = ring(
        law=MatrixGain(-np.array([[1.0, 3.0, 3.0], [1.0, 3.0, 3.0]])),
        system=StateSpace(
            np.diag([1.0, 1.0], 1), np.vstack([np.zeros((2, 2)), share]), np.eye(3)
        ),
    )
    found = [
        (m.gain_down, m.gain_up) for m in loop_margins(loop, "law.y").channels.values()
    ]
    assert_allclose(
        found, [((1 / 9 - 0.05) / 0.95, np.inf), (0.0, np.inf)], rtol=1e-4, atol=1e-9
    )


@pytest.mark.parametrize("at_rest", [True, False])
def test_a_loop_gain_of_zero_is_a_warning(at_rest):
    """The gain of the loop through the product is its other input, zero at rest."""
    diagram = Diagram()
    plant, product = diagram.add(
        plant=StateSpace([[-1.0]], [[1.0]], [[1.0]]), product=Operation(np.multiply)
    )
    diagram.expose(factor=product.u1)
    plant.y >> product.u2
    product >> plant
    point = OperatingPoint(inputs={"factor": [0.0 if at_rest else 2.0]})
    expected = pytest.warns(
        SimulationWarning, match=r"loop gain at 'plant.y' is identically zero: .*at="
    )
    with expected if at_rest else nullcontext():
        model = loop_transfer(diagram, "plant.y", at=point)
    assert model(2j) == pytest.approx(0.0 if at_rest else -2.0 / (1 + 2j))
