"""
A controller that is switched on
================================

Enabled and triggered groups: a PI controller heats a room while it is occupied and restarts each time; a
meter reads the energy once a day.
"""

from trussflow.blocks import (
    PID,
    Diagram,
    Gain,
    Integrator,
    Pulse,
    Sum,
    TransferFunction,
    UnitDelay,
    enabled,
    simulate,
    triggered,
)

heating = Diagram("heating")  # degC to W
law = heating.add(law=PID(300.0, 0.1, lower=0.0, upper=3000.0))
heating.expose(wanted=law.reference, measured=law.measurement, power=law.y)

meter = Diagram("meter")  # energy since the last reading, in J
used, before = meter.add(used=Sum("+-"), before=UnitDelay(86400.0))
before >> used.u2
meter.expose(energy=(used.u1, before.u), since_last=used.y)

house = Diagram("house")
there, wish, heating, room, total, midnight, meter = house.add(
    # from 8 o'clock on, almost 10 hours
    there=Pulse(86400.0, width=0.4, delay=28800.0),
    wish=Gain(20.0),
    heating=enabled(heating, states="reset", outputs="reset"),
    room=TransferFunction([0.01], [7200.0, 1.0]),  # K above ambient
    total=Integrator(),
    midnight=Pulse(86400.0, width=0.5, delay=86400.0),
    meter=triggered(meter),
)
there >> heating.enable
there >> wish >> heating.wanted
room >> heating.measured
heating.power >> room.u
heating.power >> total >> meter.energy
midnight >> meter.trigger
result = simulate(
    house, 3 * 86400.0 + 600.0, step=2.0, log=[room.y, meter.since_last], log_step=600.0
)
for day in (1, 2, 3):
    reading = float(result["meter.since_last"].sel(time=day * 86400.0 + 600.0)) / 3.6e6
    print(
        f"day {day}: {reading:.2f} kWh, {float(result['room.y'].sel(time=(day - 0.5) * 86400.0)):.2f} K"
    )
