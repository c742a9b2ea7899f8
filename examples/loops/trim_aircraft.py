"""
Trimming an aircraft
====================

A business jet of 10 t in longitudinal flight. ``trim`` finds thrust, elevator and angle of attack for level
flight at 160 m/s, ``linearize`` gives the phugoid and the short period, and a run with an elevator pulse
shows both.
"""

import control
import matplotlib.pyplot as plt
import numpy as np

from trussflow.blocks import (
    Block,
    Constant,
    Diagram,
    Free,
    Input,
    Output,
    State,
    Step,
    linearize,
    simulate,
    trim,
)

# kg, kg*m^2, m^2, m, kg/m^3
MASS, INERTIA, AREA, CHORD, DENSITY, GRAVITY = (1e4, 5e4, 30.0, 2.5, 0.9, 9.81)


class Jet(Block):
    """Speed, path angle, pitch and pitch rate under thrust and elevator."""

    thrust, elevator = Input(unit="N"), Input(unit="rad")
    speed, climb, pitch = Output(unit="m/s"), Output(unit="rad"), Output(unit="rad")
    v, q = State(unit="m/s", initial=160.0), State(unit="rad/s")
    gamma, theta = State(unit="rad"), State(unit="rad", initial=0.02)

    def output(self, t, x, u, p):
        """Return speed, path angle and pitch."""
        return {"speed": x.v, "climb": x.gamma, "pitch": x.theta}

    def derivative(self, t, x, u, p):
        """Return the forces along and across the path, and the moment."""
        alpha, pressure = x.theta - x.gamma, 0.5 * DENSITY * x.v**2 * AREA
        lift = 0.2 + 5.0 * alpha + 0.4 * u.elevator
        moment = 0.02 - 0.8 * alpha - 1.2 * u.elevator - 12.0 * x.q * CHORD / (2 * x.v)
        along = u.thrust * np.cos(alpha) - pressure * (0.02 + 0.05 * lift**2)
        across = u.thrust * np.sin(alpha) + pressure * lift
        return {
            "v": along / MASS - GRAVITY * np.sin(x.gamma),
            "gamma": (across / MASS - GRAVITY * np.cos(x.gamma)) / x.v,
            "theta": x.q,
            "q": pressure * CHORD * moment / INERTIA,
        }


level = trim(
    Jet(),
    states={"v": 160.0, "gamma": 0.0},
    inputs={"thrust": Free(8e3), "elevator": Free()},
)
print(
    f"thrust {level.inputs['thrust']:.0f} N, elevator {np.degrees(level.inputs['elevator']):.3f} deg"
)
control.damp(linearize(Jet(), ["elevator"], ["pitch"], at=level))

# %%
# An elevator pulse after 5 s: pitch responds at once, speed slowly.
trimmed, flight = level.inputs["elevator"], Diagram("flight")
elevator = Step(5.0, initial_value=trimmed, final_value=trimmed - 0.001, unit="rad")
flight.add(
    jet=Jet(), thrust=Constant(level.inputs["thrust"], unit="N"), elevator=elevator
)
flight.thrust.y >> flight.jet.thrust
elevator.y >> flight.jet.elevator
flight.draw("flight.svg")
start = {
    f"jet.{name.rpartition('.')[2]}": value for name, value in level.states.items()
}
result = simulate(flight, 200.0, solver="DOP853", initial=start, log_step=0.1)
figure, (upper, lower) = plt.subplots(2, 1, sharex=True, layout="constrained")
upper.plot(result["time"], result["jet.speed"])
upper.set(ylabel="speed [m/s]")
lower.plot(result["time"], np.degrees(result["jet.pitch"]))
lower.set(xlabel="time [s]", ylabel="pitch [deg]")
plt.show()
