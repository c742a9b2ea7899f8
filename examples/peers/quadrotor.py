"""
A quadrotor in hover (Drake)
============================

Four rotors on a cross; each thrust also turns the body about its axis. A linear-quadratic regulator for the
linear model at rest brings it back from a far and tilted start, and there each rotor carries a quarter of
the weight. Drake: ``run_quadrotor_lqr.cc``.
"""

import numpy as np

from trussflow.blocks import (
    Constant,
    Diagram,
    Input,
    Output,
    RigidBody,
    as_block,
    linearize,
    lqr,
    simulate,
)

m, g, arm, drag = 0.775, 9.81, 0.15, 0.0245
inertia, rest = [0.0015, 0.0025, 0.0035], [*np.zeros(6), 1.0, *np.zeros(6)]


@as_block(
    thrust=Input(4),
    force=Output(3, unit="N", frame="body"),
    torque=Output(3, unit="N*m", frame="body"),
)
def rotors(thrust):
    """Return force and torque of four rotors, at +x, +y, -x and -y."""
    a, b, c, d = thrust[0], thrust[1], thrust[2], thrust[3]
    turn = np.stack([arm * (b - d), arm * (c - a), drag * (a - b + c - d)])
    return np.array([0.0, 0.0, 1.0]) * (a + b + c + d), turn


air = Diagram("air")
body, four = air.add(body=RigidBody(m, inertia, gravity=[0.0, 0.0, -g]), four=rotors())
hover = air.add(hover=Constant(np.full(4, m * g / 4)))
four.force >> body.force
four.torque >> body.torque
hover >> four
outputs = [body.position, body.velocity, body.attitude, body.rate]
model = linearize(air, four.thrust, outputs)
law = air.add(law=lqr(model, np.diag([10.0] * 3 + [1.0] * 10), np.eye(4)))
(
    as_block(lambda r, v, q, w: np.concatenate([r, v, q, w]) - np.array(rest))(*outputs)
    >> law
)
air.disconnect(four.thrust)
hover.y + law.y >> four
air.expose(position=body.position)
start = {
    "body.r": [1.0, -0.5, 0.8],
    "body.q": [0.9, 0.3, -0.3, 0.1],
    "body.w": [0.5, 0.5, -0.5],
}
result = simulate(air, 20.0, step=2e-3, initial=start, log_step=0.1)
far = float(abs(result["body.position"][-1]).max())
print(
    f"{far:.1e} m from where it is to be; corrections", result["law.y"][-1].values, "N"
)
assert far < 1e-6
assert np.allclose(result["law.y"][-1], 0.0, rtol=0.0, atol=1e-6)
