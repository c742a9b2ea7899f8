"""Texts of the report around its tables."""

HEAD = """\
# Robustness of the mean-axes controller

The [mean-axes controller](../mean_axes.md) with the default hardware, `Hardware.flight()`: geared drives with a
servo and power-off brakes. The plant is the accurate nonlinear model. `make flight` writes this report. Every
number of this page is in [`evidence.json`](evidence.json) with its full value, beside the fingerprints of the
simulated diagrams. `PYTHONPATH=examples/studies python -m flight --check` compares them with the present code.

## Summary

The tables have the worst values of all runs of a condition; [Details](details.md) has the single runs.
{definitions} The motion takes 60 s, a run {campaigns.DURATION:g} s unless stated. *Late* is its last second.
A run is *lost* if the position error exceeds {metrics.MAX_POSITION:g} m, a joint error exceeds
{metrics.MAX_JOINTS:g} rad, or the run diverges. A *false alarm* is the isolation of a base without a fault, or
before it. *Isolated* are the runs in which all faulty bases are isolated, and *isolated after* is the longest
time from a fault until then. A base that keeps more than a third of its effect need not be isolated.

{tables}

Commands are held for 20 ms and delayed by 20 ms. The noise of truss frame and joints is 1e-4 m, rad, m/s and
rad/s. The thrust of each axis is at most 5 N in steps of 0.1 N. Torques of bases are at most 0.3 N·m (Case 2:
1 N·m), of joints 3 N·m. The controller has the nominal truss. *Healthy samples* deviate from it: mass and
frequencies by up to {samples.MAX_DEVIATION:.0%}, mode shapes at the grasps with a standard deviation of up to
{samples.MAX_DEVIATION:.0%}, a damping ratio from {samples.MIN_DAMPING:.1%} to {samples.MAX_DAMPING:.0%}, and a
payload of up to {samples.MAX_PAYLOAD:g} kg at the tip. Their seeds start at {campaigns.FIRST_SEED}; the
controller was tuned with smaller ones. The goals for them are 3 mm, 3 mrad, 2 mrad of the joints, no false alarm,
and a late position error of 0.07 mm after {campaigns.LONG_DURATION:g} s.

Faults occur at 10, 30 and 50 s; biases, friction, gains, delays and arms differ from the start. The controller
must detect them. The runs of a condition have in turn the nominal truss and those of the seeds
{campaigns.TRUSSES[1]} and {campaigns.TRUSSES[2]}. Base 4 cannot fail within the limits along body z, and in
Case 2 neither can base 3 ([Feasibility](#feasibility)); so only the others lose their effect.

* *Robot fails, braked*: base and drives have no effect. The brakes of the drives hold the joints.
* *Valve open*: a constant force at each base, against z at 10 s, x at 30 s or y at 50 s.
* *Encoder bias*: equal for all joints, or with factors from −1 to 1. The servo has encoders of its own.
* *Encoder stuck*: one encoder repeats its value. *No valid pose*: the pose does, marked as invalid.
* *Base gain*: actual by commanded forces and torques of all bases, with the same limits.
* *Further delay*: of the commands.
* *Arms*: heavier and longer than in the dynamics of the controller; in one loop only.
"""

MISSIONS = """\
Feasibility of the missions with the literal arm before any simulation: a linear program over all actuators at
each instant, by `trussflow.models.feasibility.survey`, on the accurate plant along body z. The margin is the
largest factor of all demands. If it is below 1, the path takes at least the least duration, or needs the listed
torques. A robot with braked joints costs the same as its base. In another attitude, Case 1 is feasible with every
single failure ([What failing actuators can do](../feasibility.md)).

{table}"""

MARGINS = """\
Plant and controller with the literal arm, linearized at instants of a run without noise and quantization, with
held commands. The servo is continuous, without its delay of 1.5 ms. The columns give the growth rate of the
slowest mode [1/s]; negative rates are stable. Gains multiply the feedback of all bases at constant thrust. *Disk*
is the smallest symmetric disk margin of one actuator or sensor with all other loops closed. *Delay* is the
largest further delay of all commands, in steps of 20 ms up to 200 ms, up to which the loop is stable. The worst
sample is that of {count}.

{table}"""

PROPELLANT = """\
Runs of {campaigns.LONG_DURATION:g} s on the nominal truss with the literal arm, with and without
`ActuatorCosts`. Initially, the wheels of every base have a momentum of {campaigns.INITIAL_MOMENTUM} N·m·s about
its axes. Base 1 has used {campaigns.INITIAL_PROPELLANT:g} kg of propellant, the others none. The table has the
propellant used in the run, and the largest final momentum of any base.

{table}"""

DAMPING = """\
Ishijima, Tzeranis and Dubowsky (*The on-orbit maneuvering of large space flexible structures by free-flying
robots*, i-SAIRAS 2005) and Ono (*Experimental validation of the efficient robotic transportation algorithm for
large-scale flexible space structures*, MSc thesis, MIT 2007) compare two ways to damp a structure that thrusters
move: by the thrusters, or by the arms, which needs less propellant. The runs compare both with the shipped
feedback, which prefers base torques. Case 1, literal arm, {campaigns.LONG_DURATION:g} s, the worst of
{count} trusses. With *thrusters damp*, base and joint torques have {campaigns.UNUSED:g} times the weight of thrusts in
the feedback; with *arms damp*, thrusts and base torques have {campaigns.UNUSED:g} times that of joint torques.
Thrusters still correct the position of the whole system. The feedforward is the same.

{table}"""

LIMITS = """\
One imperfection at a time, while all else is exact and joints are gearless. The table has the largest value with
which Case 1 succeeds (bold), and the smallest value tried by bisection with which it fails: the run is lost, or
its late position error is not below 5 mm. The paper's law and its mode-neutral form use the six modes of their
own plant and their exact states, with a sample time of 1 ms. The mean-axes controller has the accurate plant (38
modal coordinates), measures the truss frame and the joints only, and has a sample time and a delay of 20 ms.

{table}"""

LOOPS = """\
All hardware is exact and joints are gearless, with a sample time of 1 ms, as the paper's law needs it. The
mean-axes controller has 1 ms of computing delay, and does not measure the modes. Runs last
{campaigns.LONG_DURATION:g} s. *Late vibration* is the deviation from the mean over the late part of the run.

{table}"""

DETAILS = """\
# Single runs of the robustness report

Runs of the [report](README.md), which defines the metrics, except healthy samples. Brackets contain the number of
the robot, or of the pattern of biases, and the begin of the fault.
"""
