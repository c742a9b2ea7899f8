"""
Tutorial 3: sampled control and hardware
========================================

A flight computer holds its commands, sensors are noisy, and thrusters have a smallest thrust. The tutorial finds the
slowest sample time of the paper's loop, and then adds hardware to one axis of it.
"""

from dataclasses import replace

import pandas as pd

from trussflow.blocks import (
    Diagram,
    DisturbanceObserver,
    Gain,
    IntegralSlidingMode,
    Integrator,
    Quantizer,
    Quintic,
    Saturation,
    ZeroOrderHold,
    linearize,
    plot,
    sampled_delay,
    simulate,
)
from trussflow.blocks.errors import DivergenceError
from trussflow.models import Measurement, SpaceTruss
from trussflow.models.transport import Mission, transport_diagram

# %%
# A computer that holds its commands
# ----------------------------------
#
# ``ZeroOrderHold`` samples its input and holds it. It is inserted between allocation and truss: ``disconnect``
# removes a wire, and ``>>`` draws the two new ones. The exponent of the law is 1, as in :doc:`tutorial 2
# </gallery/02_linearize_and_margins>`.

law = replace(Mission.of_case(1), exponent=1.0, switching_gain=0.0)


def held(period):
    """Return the paper's loop with commands that are held for a period [s]."""
    loop = transport_diagram(law, SpaceTruss.published())
    loop.disconnect(loop.truss.actuation)
    hold = loop.add(hold=ZeroOrderHold(period))
    loop.allocation.command >> hold >> loop.truss.actuation
    return loop


held(2e-3).draw("held_loop.svg")

# %%
# Colours mark sample times: the coloured block is sampled, all others are continuous.
#
# A loop with sampled blocks has a linear model from sample to sample. It is stable if all poles are inside the
# unit circle. The largest size of a pole, for four periods:

sizes = {}
for period in (0.5e-3, 1e-3, 1.5e-3, 2e-3):  # s
    ports = ["truss.modal_force"], ["truss.modal_demand"]
    sizes[f"{1e3 * period} ms"] = abs(linearize(held(period), *ports).poles()).max()
pd.DataFrame({"largest pole": sizes}).round(5)

# %%
# The loop tolerates 1.5 ms, but not 2 ms. Tutorial 2 found a delay margin of 1.3 ms at one force. A hold delays
# its input by half a period on average, and here it delays all 52 commands at once.
#
# The simulation agrees. A run that diverges raises an error, which names the first signal and the time:

try:
    simulate(held(2e-3), 5.0, step=1e-3, log=["errors.error"])
except DivergenceError as error:
    print(error)

# %%
# One axis of the loop
# --------------------
#
# Flight computers sample about every 20 ms, ten times too slow for this loop. The fast part is the coupling of
# joints and bases. Without the joints, truss and robots are a mass of 577 kg on each axis, and the same laws work.
# The rest of the tutorial builds this axis and gives it hardware.
#
# Output ports can be added: ``+`` and ``-`` make a ``Sum``.

TRUSS_MASS = 577.3  # kg
SAMPLE_TIME = 0.02  # s


def axis(bandwidth, noise, quantum):
    """Return the loop of an axis: bandwidth [1/s], noise [m, m/s], smallest thrust [N]."""
    loop = Diagram("axis")
    sensor = Measurement(sample_time=SAMPLE_TIME, noise=noise)
    trajectory, control, observer, sensed_position, sensed_velocity = loop.add(
        trajectory=Quintic([6.0], 60.0),
        control=IntegralSlidingMode(
            gamma=1.0, mu=0.25, beta=0.9, eta=1e-3, sigma=0.3, boundary_layer=1e-3
        ),
        observer=DisturbanceObserver(bandwidth),
        sensed_position=sensor.sensor(1, seed=1),
        sensed_velocity=sensor.sensor(1, seed=2),
    )
    demand, computer, limit, valves, acceleration, velocity, position = loop.add(
        demand=Gain(TRUSS_MASS),
        computer=sampled_delay(SAMPLE_TIME, delay=SAMPLE_TIME),
        limit=Saturation(-10.0, 10.0),
        valves=Quantizer(quantum, SAMPLE_TIME),
        acceleration=Gain(1.0 / TRUSS_MASS),
        velocity=Integrator([0.0]),
        position=Integrator([0.0]),
    )
    trajectory.position >> control.reference_position
    trajectory.velocity >> control.reference_velocity
    trajectory.acceleration >> control.reference_acceleration
    position >> sensed_position >> control.position
    velocity >> sensed_velocity >> control.velocity
    sensed_velocity >> observer.velocity
    (control.feedforward + control.feedback - observer.disturbance_estimate) >> demand
    (limit.y / TRUSS_MASS) >> observer.nominal_acceleration
    demand >> computer >> limit >> valves >> acceleration >> velocity >> position
    return loop


axis(1.0, 1e-4, 0.1).draw("axis.svg")

# %%
# ``Measurement`` describes a sensor, and ``sensor`` makes a block of it: sampled every 20 ms, with a different
# noise for each seed. The computer holds its command for 20 ms and delays it by another 20 ms. The thrusters give
# at most 10 N, in steps of 0.1 N. The observer gets the limited thrust: otherwise it takes the missing thrust for a
# disturbance. The law itself is computed in continuous time between the samples.


def run(bandwidth, noise, quantum):
    """Return the run of an axis, with its position error [mm] and its thrust [N]."""
    result = simulate(axis(bandwidth, noise, quantum), 80.0, step=5e-3, log_step=0.01)
    error = result["trajectory.position"] - result["position.y"]
    result["error"] = (1e3 * error).assign_attrs(units="mm")
    result["thrust"] = result["valves.y"].assign_attrs(units="N")
    return result[["error", "thrust"]]


plot(run(4.0, 1e-4, 0.1))

# %%
# The truss is up to 2.0 mm ahead of its trajectory: it moves at up to 0.19 m/s, and the sensor holds a position
# that is 10 ms old on average. The thrust is rough, and the thrusters fire after the motion, too.
#
# Bandwidth and noise
# -------------------
#
# The paper's observer has a bandwidth of 4 1/s. It takes noise of the velocity for a disturbance, and the
# thrusters follow. The mean sizes in the last 10 s, after the motion, for three bandwidths:

rows = {}
for bandwidth in (4.0, 1.0, 0.25):  # 1/s
    mean = abs(run(bandwidth, 1e-4, 0.1)).isel(time=slice(-1000, None)).mean()
    rows[f"bandwidth {bandwidth} 1/s"] = {
        "error [mm]": float(mean["error"]),
        "thrust [N]": float(mean["thrust"]),
    }
pd.DataFrame(rows).T.round(4)

# %%
# The error is the same, since it is that of the sensors. With 1 1/s the thrusters fire 40 % less than with 4 1/s.
# The price is a slower reaction to real disturbances.
#
# The smallest thrust
# -------------------
#
# Without noise, the steps of the thrusters remain. With steps of 2 N the truss coasts between short pulses, and
# the position oscillates by 0.4 mm:

coarse = run(1.0, 0.0, 2.0)
plot(coarse.isel(time=slice(6000, None)))

# %%
# To try
# ------
#
# * ``Hardware.flight()`` has thrusters, wheels, drives and sensors of the whole truss, and ``mean_axes_transport``
#   a controller that needs a sample only every 20 ms (:doc:`mean-axes control </mean_axes>`, :doc:`a base that
#   fails </gallery/missions/hardware>`).
# * ``ThrusterSet.pairs`` has twelve pulsed thrusters for force and torque on all axes (:doc:`table of hardware
#   </missions>`).
# * ``Session`` advances a run step by step, for hardware in the loop (:doc:`example </gallery/blocks/session>`).
# * ``trussflow.fmu.export(law, "law.c", kind="c", step=0.02)`` writes a controller as C for the flight computer
#   (:doc:`example </gallery/loops/controller_in_c>`).
