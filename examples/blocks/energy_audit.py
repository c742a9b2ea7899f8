"""
Energy audit of a diagram
=========================

A motor turns a flywheel through a flexible shaft. Each block declares the ports through which power flows;
the audit finds a wire with a wrong sign, which no single block can detect.
"""

from trussflow.blocks import (
    Block,
    Constant,
    Diagram,
    EnergyAccount,
    Input,
    Output,
    Parameter,
    State,
)
from trussflow.blocks.testing import energy_audit


class Motor(Block):
    """Armature and rotor; power enters by voltage and current and leaves through the shaft."""

    # of the supply; of the shaft, against the motion
    voltage, torque = (Input(unit="V"), Input(unit="N*m"))
    current, rate = Output(unit="A"), Output(unit="rad/s")
    energy, heat = Output(unit="J"), Output(unit="W")
    i, w = State(unit="A"), State(unit="rad/s")
    L, R = Parameter(2e-3, unit="H"), Parameter(0.5, unit="ohm")
    K, J = Parameter(0.05, unit="N*m/A"), Parameter(2e-4, unit="kg*m**2")
    energy_account = EnergyAccount(
        supplied=[("voltage", "current")],
        delivered=[("torque", "rate")],
        stored="energy",
        dissipated="heat",
    )

    def output(self, t, x, u, p):
        """Return the measurements and the energies."""
        stored = (p.L * x.i**2 + p.J * x.w**2) / 2
        return {"current": x.i, "rate": x.w, "energy": stored, "heat": p.R * x.i**2}

    def derivative(self, t, x, u, p):
        """Return the rates of current, twist and speeds."""
        return {
            "i": (u.voltage - p.R * x.i - p.K * x.w) / p.L,
            "w": (p.K * x.i - u.torque) / p.J,
        }


class FlywheelOnShaft(Block):
    """Flywheel at the end of the shaft; both store energy."""

    rate, torque, energy = Input(unit="rad/s"), Output(unit="N*m"), Output(unit="J")
    twist, w = State(unit="rad"), State(unit="rad/s")
    k, J = Parameter(3.0, unit="N*m/rad"), Parameter(1e-3, unit="kg*m**2")
    energy_account = EnergyAccount(supplied=[("torque", "rate")], stored="energy")

    def output(self, t, x, u, p):
        """Return the measurements and the energies."""
        return {
            "torque": p.k * x.twist,
            "energy": (p.k * x.twist**2 + p.J * x.w**2) / 2,
        }

    def derivative(self, t, x, u, p):
        """Return the rates of current, twist and speeds."""
        return {"twist": u.rate - x.w, "w": p.k * x.twist / p.J}


for sign in (1.0, -1.0):
    drive = Diagram("drive")
    supply, motor, wheel = drive.add(
        supply=Constant(12.0), motor=Motor(), wheel=FlywheelOnShaft()
    )
    supply.y >> motor.voltage
    motor.rate >> wheel.rate
    (sign * wheel.torque) >> motor.torque
    print(energy_audit(drive, 0.1, step=1e-4, supplied=[(supply.y, motor.current)]))
