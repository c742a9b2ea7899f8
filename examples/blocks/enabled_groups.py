"""
A controller that is switched on
================================

A PI controller is in an enabled group: it heats a room while it is occupied and restarts each time. A meter reads
the energy once a day.
"""

from trussflow.blocks import (
    PID,
    Diagram,
    DiscreteTransferFunction,
    Gain,
    Integrator,
    Pulse,
    TransferFunction,
    enabled,
    simulate,
)

heating = Diagram("heating")  # degC to W
law = heating.add(law=PID(300.0, 0.1, lower=0.0, upper=3000.0))
heating.expose(wanted=law.reference, measured=law.measurement, power=law.y)

house = Diagram("house")
there, wish, heating, room, total, meter = house.add(
    # from 8 o'clock on, almost 10 hours
    there=Pulse(86400.0, width=0.4, delay=28800.0),
    wish=Gain(20.0),
    heating=enabled(heating, states="reset", outputs="reset"),
    room=TransferFunction([0.01], [7200.0, 1.0]),  # K above ambient
    total=Integrator(),
    # energy since the last reading, in J
    meter=DiscreteTransferFunction([1.0, -1.0], [1.0, 0.0], sample_time=86400.0),
)
there >> heating.enable
there >> wish >> heating.wanted
room >> heating.measured
heating.power >> room.u
heating.power >> total >> meter
result = simulate(
    house, 3 * 86400.0 + 600.0, step=2.0, log=[room.y, meter.y], log_step=600.0
)
for day in (1, 2, 3):
    reading = float(result["meter.y"].sel(time=day * 86400.0 + 600.0)) / 3.6e6
    print(
        f"day {day}: {reading:.2f} kWh, {float(result['room.y'].sel(time=(day - 0.5) * 86400.0)):.2f} K"
    )
