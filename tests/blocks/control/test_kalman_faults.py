"""What cannot be estimated is refused, by name; so are covariances and times that are none."""

import contextlib
from inspect import signature

import control
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from trussflow.blocks import (
    Diagram,
    GaussMarkov,
    Signals,
    StateSpace,
    ZeroOrderHold,
    from_control,
    kalman_filter,
)
from trussflow.blocks.control import ExtendedKalmanFilter, KalmanFilter, LinearProcess
from trussflow.blocks.control.covariances import hidden
from trussflow.blocks.errors import (
    BlockError,
    LinearAnalysisError,
    NameLookupError,
    ParameterError,
    SimulationError,
    TrussflowError,
)


def oscillator(**settings):
    usual = {"every": 0.1, "measurement_noise": 1.0, "process_noise": [0.0, 1.0]}
    model = control.ss([[0, 1], [-4, 0]], [[0], [1]], [[1, 0]], 0)
    plant = settings.pop("plant", model)
    if isinstance(plant, control.StateSpace):
        plant = from_control(plant)
    return kalman_filter(plant, **usual | settings)


TWO = control.ss(
    np.kron(np.eye(2), np.eye(2, k=1)), [[0], [1], [0], [0]], np.eye(1, 4), 0
)
ACCELEROMETER = control.ss([[0, 1], [-4, -1]], [[0], [1]], [[-4, -1]], [[1]])
DECAYING = control.ss(
    [[0, 1, 0], [-4, 0, 0], [0, 0, -1]], [[0], [1], [1]], [[1, 0, 0]], 0
)
STEP = {"every": 0.1, "covariance": 1.0, "noise": 1.0}
SCALAR = LinearProcess([[0.5]], [[1.0]], [[1.0]], **STEP)


def held():
    diagram = Diagram("held")
    diagram.add(hold=ZeroOrderHold(0.1), lag=StateSpace([[-1.0]], [1.0], [1.0]))
    diagram.hold >> diagram.lag
    diagram.expose(u=diagram.hold.u, y=diagram.lag.y)
    return diagram


@pytest.mark.parametrize(
    "settings, error, text",
    [
        (
            {"plant": TWO, "process_noise": 1.0},
            LinearAnalysisError,
            r"cannot estimate 'StateSpace/x\[2\]', 'StateSpace/x\[3\]', which do not decay",
        ),
        (
            {"disturbances": {"u": 1.0, "x[1]": 1.0}},
            LinearAnalysisError,
            "'disturbance/u', 'disturbance/StateSpace/x",
        ),
        (
            {"process_noise": 0.0},
            LinearAnalysisError,
            r"no process noise drives 'StateSpace/x\[0\]', 'StateSpace/x\[1\]', which",
        ),
        (
            {"disturbances": {"u": 0.0}},
            LinearAnalysisError,
            "no process noise drives 'disturbance/u'",
        ),
        (
            {"plant": ACCELEROMETER, "process_noise": {"u": 1.0}},
            LinearAnalysisError,
            "process noise enters what is measured, y, with nothing in between",
        ),
        (
            {"process_noise": np.eye(3)},
            ParameterError,
            r"process_noise has shape \(3, 3\); give a matrix of shape",
        ),
        (
            {"process_noise": [[1, 1], [0, 1]]},
            ParameterError,
            "process_noise is not symmetric",
        ),
        (
            {"process_noise": {"x": -1.0}},
            ParameterError,
            "process_noise of 'x' is not positive semidefinite",
        ),
        (
            {"process_noise": {"wind": 1.0}},
            NameLookupError,
            r"nothing is called 'wind'; there are: StateSpace.x\[0\], Sta",
        ),
        ({"process_noise": {1: 1.0}}, NameLookupError, "1 is no name"),
        (
            {"measurement_noise": 0.0},
            ParameterError,
            "measurement noise is not positive definite",
        ),
        (
            {"measurement_noise": [1.0, 2.0]},
            ParameterError,
            r"measurement noise has shape \(2,\)",
        ),
        ({"every": 0.0}, SimulationError, "every = 0.0 must be a positive"),
        (
            {"command_delay": 0.25},
            SimulationError,
            "command_delay of KalmanFilter of 0.25 s is not a whole number",
        ),
        (
            {"measurement_delay": -0.1},
            BlockError,
            "measurement_delay of KalmanFilter is -0.1 s: it must be at least 0",
        ),
        ({"kind": "square"}, SimulationError, "choose from: steady, varying, extended"),
        ({"kind": "varying"}, ParameterError, "needs initial_covariance"),
        (
            {"plant": 3},
            LinearAnalysisError,
            "cannot make this Kalman filter of 3: give a block; from_control",
        ),
        (
            {"plant": control.c2d(TWO, 0.1)},
            LinearAnalysisError,
            "'DiscreteStateSpace': it has sampled blocks",
        ),
        ({"plant": held()}, LinearAnalysisError, "'held': it has sampled blocks"),
    ],
)
def test_design_refuses(settings, error, text):
    with pytest.raises(error, match=text):
        oscillator(**settings)


def test_unobserved_states_that_decay_are_left_to_the_model():
    block = oscillator(plant=DECAYING, process_noise=1.0)
    assert block.gain[2] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    "build, error, text",
    [
        (
            lambda: LinearProcess(
                np.eye(2), np.eye(2), np.eye(2), **STEP, state_names=["a"]
            ),
            BlockError,
            "1 names",
        ),
        (lambda: LinearProcess(1.0, 1.0, 1.0, **STEP), BlockError, "A has shape"),
        (lambda: GaussMarkov(0.0, 1.0), SimulationError, "standard_deviation = 0.0"),
        (
            lambda: oscillator().of("speed"),
            NameLookupError,
            "nothing is called 'speed'",
        ),
        (
            lambda: oscillator(kind="varying", initial_covariance=-1.0),
            ParameterError,
            "initial_covariance is not",
        ),
        (
            lambda: ExtendedKalmanFilter(
                SCALAR, initial_covariance=1.0
            ).check_parameters(
                Signals("filter", {"initial_covariance": np.array([[-1.0]])})
            ),
            ParameterError,
            r"initial_covariance' of .* is not positive semidefinite",
        ),
    ],
)
def test_parts_refuse(build, error, text):
    with pytest.raises(error, match=text):
        build()


@given(st.integers(0, 2**32), st.integers(1, 6), st.integers(1, 5), st.booleans())
@example(2**32 - 1, 1, 1, True)
def test_hidden_states_are_named(seed, seen, unseen, rough):
    """Two chains, one measured at its end, shuffled; in random units, or with round-off instead of zeros."""
    g = np.random.default_rng(seed)
    n = seen + unseen
    A = np.eye(n)
    for start, size in ((0, seen), (seen, unseen)):
        part = np.diag(g.uniform(0.1, 1.0, size - 1), 1) + np.diag(
            g.choice([0.0, -0.3, 0.05], size)
        )
        A[start : start + size, start : start + size] += 0.1 * part
    # those measured move the others
    A[seen:, :seen] += 0.1 * g.normal(size=(unseen, seen))
    C = np.eye(1, n) + rough * 1e-17 * g.normal(size=n)
    A += rough * 1e-17 * g.normal(size=(n, n))
    order, unit = g.permutation(n), 10.0 ** (g.uniform(-1.5, 1.5, n) * (not rough))
    A, C = (A / unit[:, None] * unit)[order][:, order], (C * unit)[:, order]
    names = [f"s{i}" for i in order]
    expected = {f"'s{i}'" for i in range(seen, n)}
    assert set(hidden(A, C, names, slowest=0.0).split(", ")) == expected
    assert (
        hidden(A, np.vstack([C, np.eye(n)[order.argsort()[seen:]]]), names, slowest=0.0)
        == ""
    )


ODD = [
    None,
    3,
    -1.0,
    np.nan,
    "x",
    [1.0, 2.0],
    np.eye(3),
    {},
    {"x": 1.0},
    {"force": "a"},
    {3: 4},
    [[1, 2], [3]],
]


NAMES = sorted(signature(kalman_filter).parameters.keys() - {"at"})


@given(st.fixed_dictionaries({}, optional=dict.fromkeys(NAMES, st.sampled_from(ODD))))
def test_nonsense_is_refused_by_errors_of_ours(settings):
    with contextlib.suppress(TrussflowError):
        assert isinstance(oscillator(**settings), KalmanFilter)
