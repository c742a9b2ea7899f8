"""
A Kalman filter designed from the plant
=======================================

A filter estimates all states and an unknown force from a noisy, delayed position measurement.
"""

import numpy as np

from trussflow.blocks import (
    Block,
    Constant,
    Diagram,
    Input,
    Noise,
    Output,
    State,
    UnitDelay,
    kalman_filter,
    simulate,
)

PERIOD, NOISE = 0.04, 1e-3  # s, m; the sensor has 40 ms of delay


class TwoMasses(Block):
    """Cart of 2 kg that pulls a load of 1 kg by a spring; sensor on the cart, wind on the load."""

    force, wind = Input(unit="N"), Input(unit="N")
    cart, everything = Output(unit="m"), Output(4)
    position, velocity = State(2, unit="m"), State(2, unit="m/s")

    def output(self, t, x, u, p):
        """Return the measurement and all states."""
        return {
            "cart": x.position[0],
            "everything": np.concatenate([x.position, x.velocity]),
        }

    def derivative(self, t, x, u, p):
        """Return velocities and accelerations."""
        spring = 20.0 * (x.position[1] - x.position[0]) + 0.3 * (
            x.velocity[1] - x.velocity[0]
        )
        return {
            "position": x.velocity,
            "velocity": np.stack([(u.force + spring) / 2.0, u.wind - spring]),
        }


observer = kalman_filter(
    TwoMasses(),
    measured="cart",
    inputs="force",
    every=PERIOD,
    measurement_delay=PERIOD,
    measurement_noise=NOISE**2,  # m²
    process_noise={"velocity": 1e-6},  # (m/s²)² s, at both masses
    disturbances={"wind": 1e-3},  # slow random walk, N²/s
)
loop = Diagram("what a late sensor tells")
loop.add(
    plant=TwoMasses(),
    filter=observer,
    late=UnitDelay(PERIOD),
    wind=Constant(0.5, unit="N"),
)
loop.add(
    command=Noise(1.0, 1.0, seed=1, unit="N"),
    noise=Noise(NOISE, PERIOD, seed=2, unit="m"),
)
loop.command >> loop.plant.force
loop.command.y >> loop.filter.command[0]
loop.wind >> loop.plant.wind
(loop.plant.cart + loop.noise.y) >> loop.late
loop.late.y >> loop.filter.measurement[0]
loop.draw("late_sensor.svg")
result = simulate(loop, 20.0, step=1e-3, log_step=0.2)
truth = [*result["plant.everything"][-1].values, 0.5]
for name, true, found in zip(
    observer.state_names, truth, result["filter.estimate"][-1].values, strict=True
):
    print(f"{name:22} {true:9.4f}, estimated {found:9.4f}")
