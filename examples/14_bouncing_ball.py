"""
Events: a ball that bounces
===========================

A Python block may have continuous states and events. The solver finds the instant at which the height
becomes zero, lets the block turn the speed around, and starts afresh: no bounce is missed or late.
"""

import matplotlib.pyplot as plt
import numpy as np

from trussflow.blocks import Block, Diagram, Output, Parameter, State, simulate


class Ball(Block):
    """A ball above a floor."""

    traced = False
    continuous = has_events = True
    height = Output(unit="m")
    z = State(unit="m", initial=1.0)
    v = State(unit="m/s")
    restitution = Parameter(0.8, above=0.0)

    def output(self, t, x, u, p):
        """Return the height."""
        return {"height": x.z}

    def derivative(self, t, x, u, p):
        """Fall freely."""
        return {"z": x.v, "v": -9.81}

    def indicators(self, t, x, u, p):
        """Return the height: an event is where it becomes zero."""
        return np.array([x.z])

    def on_event(self, t, x, u, p):
        """Bounce, if it is the floor and the ball comes from above."""
        return {"v": -p.restitution * x.v} if x.z <= 0.0 and x.v < 0.0 else {}


room = Diagram("room")
ball = room.add(ball=Ball())
result = simulate(room, 3.0, solver="RK45", rtol=1e-9, log_step=0.005)
plt.plot(result["time"], result["ball.height"])
plt.gca().set(xlabel="time [s]", ylabel="height [m]")
plt.show()

# %%
# Between the first and the second bounce the ball rises to the square of the restitution:

fall = np.sqrt(2 / 9.81)  # s
again = result["ball.height"].sel(time=slice(fall, fall + 1.6 * fall))
print("second height", float(again.max()), "m; by the law of bouncing", 0.8**2, "m")
