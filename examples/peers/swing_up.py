"""
A pendulum swung up and caught (jaxonomy)
=========================================

A torque of at most 4 N m drives the energy to that of the upright pendulum; near it a linear-quadratic
regulator catches it. For one degree of freedom Riccati's equation has a solution to write down. jaxonomy:
``energy_shaping_and_lqr.ipynb``.
"""

import numpy as np

from trussflow.blocks import (
    Block,
    Diagram,
    Input,
    Output,
    Saturation,
    State,
    as_block,
    linearize,
    lqr,
    simulate,
    trim,
)

g, b, q, r = 9.81, 0.1, 1.0, 0.5


class Pendulum(Block):
    """Angle from below, and rate, of 1 kg at 1 m."""

    torque, x = Input(), Output(2)
    state = State(2, initial=[0.1, 0.0])

    def output(self, t, x, u, p):
        """Return the state."""
        return {"x": x.state}

    def derivative(self, t, x, u, p):
        """Return rate and acceleration."""
        return {
            "state": np.stack(
                [x.state[1], u.torque - b * x.state[1] - g * np.sin(x.state[0])]
            )
        }


@as_block
def law(x, catch):
    """Return the torque: shape the energy, or catch."""
    energy = x[1] ** 2 / 2 - g * np.cos(x[0]) - g
    return np.where(
        np.abs(np.cos(x[0]) + 1.0) + x[1] ** 2 / 20 < 0.06,
        catch,
        -x[1] * energy + b * x[1],
    )


up = trim(Pendulum(), states={"state": [np.pi, 0.0]}, inputs={"torque": 0.0})
gain = lqr(linearize(Pendulum(), "torque", "x", at=up), q * np.eye(2), [[r]])
k1 = g + np.sqrt(g**2 + q / r)
exact = [k1, -b + np.sqrt(b**2 + 2 * k1 + q / r)]
loop = Diagram("swing up")
pendulum, limit, gain = loop.add(
    pendulum=Pendulum(), limit=Saturation(-4.0, 4.0), gain=gain
)
as_block(lambda x: np.stack([np.mod(x[0], 2 * np.pi) - np.pi, x[1]]))(pendulum) >> gain
law(pendulum, gain) >> limit >> pendulum
result = simulate(loop, 20.0, step=1e-3)
end, gains = result["pendulum.x"][-1].values, -linearize(gain).D[0]
print("gains", gains, "and by the law", exact, "; in the end", end)
assert np.allclose(gains, exact, rtol=1e-9, atol=0.0)
assert abs(np.cos(end[0]) + 1.0) < 1e-9
assert np.abs(result["limit.y"]).max() <= 4.0
