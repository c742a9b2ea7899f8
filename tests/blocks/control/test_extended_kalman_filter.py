"""The extended filter: against a recursion written by hand, and what it takes for its functions."""

from functools import partial

import numpy as np
import pytest
from systems import assert_near, jacobian

from trussflow.blocks.control import ExtendedKalmanFilter, NonlinearProcess
from trussflow.blocks.errors import BlockError, ParameterError, TracingError

EVERY = 0.05  # s
Q, R = np.diag([1e-6, 1e-3]), np.diag([1e-4, 4e-4])


def rates(t, x, u):
    return np.stack(
        [x[1], u[0] - 9.81 * np.sin(x[0]) - 0.3 * x[1] ** 3 + 0.1 * np.sin(3 * t)]
    )


def outputs(t, x, u):
    return np.stack([np.sin(x[0]) + 0.01 * t, x[0] * x[1] + 0.1 * u[0]])


def stepped(t, x, u, h):
    k1 = rates(t, x, u)
    k2 = rates(t + h / 2, x + h / 2 * k1, u)
    k3 = rates(t + h / 2, x + h / 2 * k2, u)
    return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + rates(t + h, x + h * k3, u))


def by_hand(y, u, x, P, parts):
    """Return the outputs of the textbook's recursion, inverse and all."""
    found, h = [], EVERY / parts
    for k in range(len(y)):
        t = k * EVERY
        H = jacobian(partial(outputs, t, u=u[k]), x)
        S = H @ P @ H.T + R
        K = P @ H.T @ np.linalg.inv(S)
        x, P = x + K @ (y[k] - outputs(t, x, u[k])), (np.eye(2) - K @ H) @ P
        found.append(np.vstack([x, P, S]))
        for i in range(parts):
            s = t + i * h
            first = jacobian(partial(stepped, s, u=u[k], h=h / 2), x)
            middle = stepped(s, x, u[k], h / 2)
            second = jacobian(partial(stepped, s + h / 2, u=u[k], h=h / 2), middle)
            x, F = stepped(s + h / 2, middle, u[k], h / 2), second @ first
            P = F @ P @ F.T + h / 6 * (F @ Q @ F.T + 4 * second @ Q @ second.T + Q)
    return found


MODEL = {
    "rates": rates,
    "outputs": outputs,
    "states": 2,
    "measurements": 2,
    "commands": 1,
    "density": Q,
    "noise": R,
    "every": EVERY,
}


def extended(settings=None, **model):
    start = {"initial_covariance": 0.01, "initial_estimate": [0.5, 0.0]}
    return ExtendedKalmanFilter(
        NonlinearProcess(**MODEL | model), **start | (settings or {})
    )


@pytest.mark.parametrize("steps", [1, 3])
def test_recursion_is_that_of_the_textbook(steps, follow, rng):
    y, u = rng.normal(size=(40, 2)) * 0.1, rng.normal(size=(40, 1))
    found = follow(extended(steps=steps), y, u)
    expected = by_hand(y, u, np.array([0.5, 0.0]), 0.01 * np.eye(2), steps)
    names = "covariance", "innovation_covariance"
    together = [found["estimate"][:, None], *(found[name] for name in names)]
    assert_near(np.concatenate(together, axis=1), expected, 1e-10)


@pytest.mark.parametrize("behind", [1, 3])
def test_delay_shifts_it(behind, follow, rng):
    """Time of its functions too: it looks at the plant as it was."""
    y, u = rng.normal(size=(30, 2)) * 0.1, rng.normal(size=(30, 1))

    def late(function):
        return lambda t, x, u: function(t + behind * EVERY, x, u)

    plain = follow(extended(), y, u)
    settings = {"measurement_delay": behind * EVERY, "initial_command": u[:behind]}
    block = extended(settings, rates=late(rates), outputs=late(outputs))
    found = follow(block, y[: 30 - behind], u[behind:])
    assert_near(found["innovation"], plain["innovation"][: 30 - behind], 1e-12)
    x = plain["estimate"][10]
    for k in range(10, 10 + behind):
        x = stepped(
            k * EVERY + EVERY / 2,
            stepped(k * EVERY, x, u[k], EVERY / 2),
            u[k],
            EVERY / 2,
        )
    assert_near(found["estimate"][10], x, 1e-12)


def test_without_commands_there_is_no_port_for_them(follow):
    block = extended(
        {"measurement_delay": 2 * EVERY},
        measurements=1,
        commands=0,
        rates=lambda _, x, __: -x,
        outputs=lambda _, x, __: x[:1],
        noise=1e-2,
    )
    assert [port.name for port in block.inputs()] == ["measurement"]
    assert np.isfinite(follow(block, np.ones((5, 1)))["estimate"]).all()


@pytest.mark.parametrize(
    "model, error, text",
    [
        (
            {"rates": lambda t, x, _: x if t > 0 else -x},
            TracingError,
            "'rates' of a Kalman filter .* cannot be traced.*np.where",
        ),
        (
            {"outputs": lambda _, x: x},
            TracingError,
            r"'outputs' .* is called with \(t, x, u\)",
        ),
        (
            {"outputs": lambda _, x, __: x[0]},
            BlockError,
            "'outputs' .* must return 2 elements, not 1",
        ),
        ({"density": np.eye(3)}, ParameterError, r"process noise has shape \(3, 3\)"),
        ({"commands": -1}, BlockError, "sizes are non-negative whole numbers"),
    ],
)
def test_nonsense_is_refused(model, error, text):
    with pytest.raises(error, match=f"(?s){text}"):
        extended(**model)
