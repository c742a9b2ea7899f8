"""
Events: a ball that bounces
===========================

A block may declare **events**: when an indicator crosses zero, states jump and modes change. The solver
locates the instant, the block handles the event, and the solver restarts. A mode, here whether the ball
rests, changes at events only. All of this is compiled; the rules are in :doc:`/hybrid`.
"""

import matplotlib.pyplot as plt
import numpy as np

from trussflow.blocks import (
    Block,
    Diagram,
    Event,
    Mode,
    Output,
    Parameter,
    State,
    simulate,
)


class Ball(Block):
    """A ball above a floor."""

    height = Output(unit="m")
    z = State(unit="m", initial=1.0)
    v = State(unit="m/s")
    rests = Mode(0.0)
    bounce = Event("falling", unit="m", meaning="the ball reaches the floor")
    restitution = Parameter(0.8, above=0.0)

    def output(self, t, x, u, p):
        """Return the height."""
        return {"height": x.z}

    def derivative(self, t, x, u, p):
        """Fall freely, or lie on the floor."""
        return {"z": x.v, "v": np.where(x.rests > 0.5, 0.0, -9.81)}

    def indicators(self, t, x, u, p):
        """Return the height; the event occurs when it falls to zero."""
        return {"bounce": x.z}

    def on_event(self, t, x, u, p, fired):
        """Reverse the speed at height zero, or come to rest."""
        slow = np.abs(x.v) < 0.1
        return {
            "z": 0.0,
            "v": np.where(slow, 0.0, -p.restitution * x.v),
            "rests": np.where(slow, 1.0, 0.0),
        }


room = Diagram("room")
ball = room.add(ball=Ball())
result = simulate(room, 5.0, step=0.005)
plt.plot(result["time"], result["ball.height"])
plt.gca().set(xlabel="time [s]", ylabel="height [m]")
plt.show()

# %%
# Between the first and the second bounce the ball rises to the square of the restitution:

fall = np.sqrt(2 / 9.81)  # s
again = result["ball.height"].sel(time=slice(fall, fall + 1.6 * fall))
print("second height", float(again.max()), "m; by the law of bouncing", 0.8**2, "m")
