"""Texts of the report around its tables."""

HEAD = """\
# Robustness of the mean-axes controller

The [mean-axes controller](../mean_axes.md) with the default hardware: the accurate nonlinear plant with
`Hardware.flight()`, geared drives with a servo and power-off brakes. `make flight` writes this report. Every
number is in [`evidence.json`](evidence.json) with its full value, beside the fingerprints of the simulated
diagrams. `PYTHONPATH=examples/studies python -m flight --check` compares them with the present code. The single
runs with faults are in [Details](details.md).

## Summary

The tables have the worst values of all runs of a condition. {definitions} The motion takes 60 s, a run 2 s
more; *final* is its last instant. A run is *lost* if the position error exceeds {position:g} cm, a joint error
exceeds {joints:g} rad, the final position error is {final:g} mm or more, or it diverges. A *false alarm*
is the isolation of a base without a fault. *Isolated* are the runs in which all faulty bases are isolated,
*isolated after* is the longest time from the fault until then. A base that keeps more than about a third of its effect
need not be isolated.

{tables}

Faults occur at 10, 30 and 50 s, biases, friction and gains exist from the start. The controller must detect
them. The runs of a condition have in turn the nominal truss and those of the seeds 8000 and 8001. Bases 1 to 3
(Case 2: 1 and 2) and robots 1 to 3 (1 and 2) lose their effect, since the others are not feasible
([Feasibility](#feasibility)). The other faults:

* *Valve open*: each base has a constant force along −z at 10 s, along −x at 30 s, or along −y at 50 s.
* *Encoder bias*: equal for all joints, or random with this standard deviation, twice. The servo has encoders of its own.
* *Encoder stuck*: the encoder of joint 2 of robots 1 to 3 repeats its value.
* *No valid pose*: the measured pose is constant and marked as invalid.
* *Commands late*: the delay is 60 ms instead of 20 ms.
* *Base gain*: forces and torques of all bases relative to the commands. Their limits are those of the hardware.
* *Arms heavier and longer*: mass and length of all arms exceed those that the controller has.
"""

SAMPLES = """\
Commands are held for 20 ms and delayed by 20 ms. The noise of truss frame and joints is 1e-4 m, rad, m/s and
rad/s. The thrust of each axis is at most 5 N in steps of 0.1 N. Torques of bases are at most 0.3 N·m (Case 2:
1 N·m), of joints 3 N·m. The controller has the nominal truss. Samples deviate from it: mass and frequencies by
up to {deviation:.0%}, mode shapes at the grasps with a standard deviation of up to {deviation:.0%}, a damping
ratio from {min_damping:.1%} to {max_damping:.0%}, and a payload of up to {payload:g} kg at the tip. Seeds start
at {first}; the controller was tuned with smaller ones. Runs last {duration:g} s. *Late* values are those of the last
{late:g} s of runs of {long:g} s, with {count} seeds; late grasp 4 is the elastic displacement of that grasp.

{table}"""

MISSIONS = """\
Feasibility of the missions with the literal arm before any simulation: a linear program over all actuators at
each instant, by `trussflow.models.feasibility.survey`, on the accurate plant along body z. The margin is the
largest factor of all demands. If it is below 1, the path takes at least the least duration, or needs the listed
torques. A robot with braked joints costs the same as its base. In another attitude every single
failure is feasible in Case 1 ([What failing actuators can do](../feasibility.md)).

{table}"""

MARGINS = """\
Plant and controller with the literal arm, linearized at instants of a run without noise and quantization, with
held commands. The servo is continuous, without its delay of 1.5 ms. The columns give the growth rate of the
slowest mode [1/s]; negative rates are stable. Gains multiply the feedback of all bases at constant thrust; *+40
ms* delays all commands. *Disk* is the smallest symmetric disk margin of one actuator or sensor with all other
loops closed; *delay* is the delay margin (∞: 0.2 s or more). Worst is the worst of {count} samples.

{table}"""

PROPELLANT = """\
Runs of {duration:g} s on the nominal truss with the literal arm, with and without `ActuatorCosts`. Initially, the
wheels of every base have a momentum of {momentum} N·m·s about its axes, and base 1 has used {propellant:g} kg of
propellant, the others none. The table has the propellant used in the run, and the largest final momentum of any
base.

{table}"""

LIMITS = """\
One imperfection at a time, while all else is exact; joints are gearless. The table has the largest value with
which Case 1 succeeds (bold), and the smallest value tried by bisection with which the run is lost. The paper's
law and its mode-neutral form use the six modes of their own plant and their exact states, with a sample time of
1 ms. The mean-axes controller has the accurate plant (38 modal coordinates), measures the truss frame and the
joints only, and has a sample time and a delay of 20 ms.

{table}"""

LOOPS = """\
All hardware is exact and joints are gearless, with a sample time of 1 ms, as the paper's law needs it. The
mean-axes controller has 1 ms of computing delay, and does not measure the modes. Runs last {duration:g} s. *Late
vibration* is the deviation from the mean in the last 10 s of the run.

{table}"""

DETAILS = """\
# Single runs of the robustness report

Runs of the [report](README.md) with faults, other gains, delays and arms, by loop. The metrics are defined there.
"""
