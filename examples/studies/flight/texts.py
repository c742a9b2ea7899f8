"""Texts of the report around its tables."""

HEAD = """\
# Robustness of the mean-axes controller

The [mean-axes controller](../mean_axes.md) with the default hardware, `Hardware.flight()`: geared drives with a
servo and power-off brakes. The plant is the accurate nonlinear model. `make flight` writes this report, by
default with 200 samples. Every number of this page is in [`evidence.json`](evidence.json) with its full value,
beside the fingerprints of the simulated diagrams. `PYTHONPATH=examples/studies python -m flight --check` compares
them with the present code.

## Summary

The tables have the worst values of all runs of a condition; [Details](details.md) has the single runs.
{definitions} The motion takes 60 s, a run {campaigns.DURATION:g} s unless stated. *Late* is its last second.
A run is *lost* if the position error exceeds {metrics.MAX_POSITION:g} m, a joint error exceeds
{metrics.MAX_JOINTS:g} rad, or the run diverges. *False alarms* counts bases that are isolated without a fault of
their own, or before it. *Isolated* counts the runs in which each faulty base is isolated at least once after its
fault; *isolated after* is the longest time until then. Bases that keep more than 35 % of their effect, or have an
open valve, should not be isolated. Some at 50 % or with an open valve are. With a base gain of 0.5 all
bases count as faulty. The loops with the Jaco arm
have at most {campaigns.MAX_JACO_SAMPLES} samples and every second run with a fault.

{tables}

Commands are held for 20 ms and delayed by 20 ms. The noise of truss frame and joints is 1e-4 m, rad, m/s and
rad/s. The thrust of each axis is at most 5 N in steps of 0.1 N. Torques of bases are at most 0.3 N·m (Case 2:
1 N·m), of joints 3 N·m. The controller has the nominal truss. *Healthy samples* deviate from it: mass and
frequencies by up to {samples.MAX_DEVIATION:.0%}, mode shapes at the grasps with a standard deviation of up to
{samples.MAX_DEVIATION:.0%}, a damping ratio from {samples.MIN_DAMPING:.1%} to {samples.MAX_DAMPING:.0%}, and a
payload of up to {samples.MAX_PAYLOAD:g} kg at the tip. Their seeds start at {campaigns.FIRST_SEED}; the
controller was tuned with smaller seeds. The goals for them are 3 mm, 3 mrad, 2 mrad of the joints and no false
alarm; for the {campaigns.LONG_SAMPLES} samples of {campaigns.LONG_DURATION:g} s also a late position error of
0.07 mm. In Case 2 with the Jaco arm, the nominal truss needs almost all torque of the bases, and heavy samples need
more ([Feasibility](#feasibility)): their attitude error is larger.

Faults begin at 10, 30 and 50 s, a stuck encoder at 10 s only. Biases, friction, gains, delays and other arms exist
from the start. The controller is not informed of them, except of an invalid pose. The nominal truss and those of
the seeds {campaigns.TRUSSES[1]} and {campaigns.TRUSSES[2]} take turns. Base 4 cannot fail completely within the
limits along body z, in Case 2 neither can base 3 ([Feasibility](#feasibility)), and with the Jaco arm no base can in
Case 2. They are simulated with at least half of their effect, and the controller never isolates them (`dispensable`).

* *Robot fails, braked*: base and drives have no effect. The brakes of the drives hold the joints.
* *Valve open*: a constant force at one base, along −z at 10 s, −x at 30 s and −y at 50 s in its axes.
  With 5 N it is as strong as a thruster.
* *Encoder bias*: equal for all joints, or with factors from −1 to 1. The servo has encoders of its own.
* *Encoder stuck*: angle and rate of the second joint of a robot repeat their last values. *No valid pose*: pose and
  rates of the truss frame do for 1 s, marked as invalid.
* *Base gain*: ratio of actual to commanded forces and torques of all bases. The limits of the actual ones are the
  same, and the controller has the corresponding limits of its commands.
* *Further delay*: of all commands by 40 ms, except joint references. The estimator receives the delayed thrusts and
  torques; in [Margins](#margins-under-thrust) it does not.
* *Arms*: heavier and longer than in the dynamics of the controller; in one loop only.
"""

MISSIONS = """\
Feasibility of the missions before any simulation: a linear program over all actuators at each instant, by
`trussflow.models.feasibility.survey`, on the accurate plant along body z. *Margin* is
the largest common factor of all demands within the limits. If it is below 1, the path needs the least duration, or
the needed torque. A failed robot with braked joints has the values of its failed base. In another attitude, Case 1
is feasible with every single failure ([What failing actuators can do](../feasibility.md)).

{table}"""

MARGINS = """\
Plant and controller with the literal arm, linearized at instants of a run without noise and quantization, with held
commands. The servo is continuous, without its delay of 1.5 ms, and belongs to the plant. The columns give the
growth rate of the slowest mode [1/s]; negative rates are stable. Gains multiply the feedback of all bases at
constant thrust. *Disk* is the smallest symmetric disk margin of one actuator or sensor with all other loops closed.
*Delay* is the largest further delay of all commands, in steps of 20 ms up to 200 ms, up to which the loop is
stable, if the estimator does not know of it. *Worst sample* has the worst value of each column among {count}
samples.

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
large-scale flexible space structures*, MSc thesis, MIT 2007) compare two ways to damp the vibration of a structure
that thrusters move: by the thrusters, or by the arms. They found that the arms save propellant. The runs compare
both with the shipped feedback, which prefers base torques. Case 1, literal arm, {campaigns.LONG_DURATION:g} s, the
worst of {count} trusses. With *thrusters damp*, base and joint torques have {campaigns.AVOIDED_WEIGHT:g} times the
weight of thrusts in the feedback; with *arms damp*, thrusts and base torques have {campaigns.AVOIDED_WEIGHT:g}
times that of joint torques. The position feedback still uses thrusters, since the task has priority over these
weights. *Late vibration* is the deviation from the mean in the last second.

{table}"""

WORST_CASE = """\
Case 1 with the literal arm. Two random searches look for large position and attitude errors of simulated runs with
noise and quantization. Mass, frequencies, damping and payload have the bounds of the healthy samples. The shapes of
the {worst_case.SHAPE_COUNT} slowest modes at the grasps deviate by up to {worst_case.MAX_SHAPE:.0%}, the others are
nominal. The encoders of each robot have an equal bias of up to {worst_case.MAX_BIAS:g} rad. A search has
{generations} generations of {worst_case.POPULATION_SIZE} runs with the same noise. The first one, about the middle of
the bounds, is common to both; the others are about the worst run before. In the table,
shapes are those of the modes in ascending order, biases those of robots 1 to 4. The largest errors of the
healthy samples, which have no biases and different noise, are {position} and {attitude}.

{table}

The search gives no upper bound on the errors. For the growth rates of the linear loop, a condition is checked on a
grid of frequencies. The loop is that of
[Margins](#margins-under-thrust) at peak acceleration, for all trusses within the bounds of mass, frequencies, damping
and payload, with nominal shapes. The slowest mode has a growth rate of at most {growth} 1/s at the corners of these
bounds. No growth rate within them exceeds {bound} 1/s if the impedance of plant and controller is not singular
on this vertical line. That is shown at {frequencies} frequencies up to {worst_case.MAX_FREQUENCY:g} rad/s, not between
them, for impedances without aliases that are interpolated between the corners
(`examples/studies/flight/worst_case.py`). The exact growth rate for mean mass and payload, the
largest frequencies and the least damping is {middle} 1/s, and {interpolated} 1/s by the interpolation.
"""

LIMITS = """\
One imperfection at a time, while all else is exact and joints are gearless. The table has the largest value with
which Case 1 succeeds (bold), and the smallest value tried by bisection with which it fails: the run is lost, or
its late position error is not below 5 mm. The paper's law and its mode-neutral form use the six modes of their
own plant and their exact states, with a sample time of 1 ms. The mean-axes controller has the accurate plant (38
modal coordinates), measures the truss frame and the joints only, and has a sample time and a delay of 20 ms. The
limits are of revision 81363a8e.

{table}"""

LOOPS = """\
All hardware is exact and joints are gearless, with a sample time of 1 ms, as the paper's law needs it. The
mean-axes controller has 1 ms of computing delay, and does not measure the modes. Runs last
{campaigns.LONG_DURATION:g} s. *Late vibration* is the deviation from the mean over the late part of the run.

{table}"""

DETAILS = """\
# Single runs of the robustness report

Runs of the [report](README.md), which defines the metrics, except healthy samples of {campaigns.DURATION:g} s.
Brackets contain the number of the robot (encoder bias: of the pattern; without meaning for friction, gain, delay and
pose) and the time of the fault. Diverged runs have no metrics. *Isolated after* is ∞ if a faulty base is never
isolated.
"""
