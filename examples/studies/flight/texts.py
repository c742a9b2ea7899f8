"""Texts of the report around its tables."""

HEAD = """\
# Robustness of the mean-axes controller

Requirements and robustness limits of the paper's control law, and robustness of the mean-axes controller
([models/mean_axes](../../models/mean_axes/README.md)). `make flight` writes this report. Every number is in
[`evidence.json`](evidence.json) with its full value, beside the fingerprints of the simulated diagrams.
`PYTHONPATH=examples/studies python -m flight --check` compares them with the present code.

All runs have gearless joints that follow torque commands, `Hardware.flight(control="torque")`. Results with
geared drives, the default hardware, are in [docs/mean_axes.md](../mean_axes.md#geared-drives).

{definitions} *Late* is the last 10 s of a run, after the motion.
"""

LIMITS = """\
One imperfection at a time, while all else is exact. The table has the largest value with which Case 1
succeeds (bold), and the smallest value tried by bisection with which it fails. The paper's law and its
mode-neutral form use the six modes of their own plant and their exact states, with a sample time of 1 ms. The
mean-axes controller has the accurate plant (38 modal coordinates), measures the truss frame and the joints
only, and has a sample time and a delay of 20 ms. A run fails if the position error exceeds 5 cm, a joint
error exceeds 0.2 rad, or the late position error exceeds 5 mm.

{table}"""

SAMPLES = """\
Complete runs: {counts}. Plant: the accurate nonlinear model with `Hardware.flight`. Commands are held for
20 ms and delayed by 20 ms. The noise of truss frame and joints is 1e-4 m, rad, m/s and rad/s. The thrust of
each axis is at most 5 N in steps of 0.1 N. Torques of bases and joints are at most 0.3 N·m (Case 2: 1 N·m).
The controller has the nominal truss. Samples deviate from it: mass and frequencies by up to {deviation:.0%},
mode shapes at the grasps with a standard deviation of up to {deviation:.0%}, a damping ratio from
{min_damping:.1%} to {max_damping:.0%}, and a payload of up to {payload:g} kg at the tip. Seeds start at
{first}; the controller was tuned with smaller ones. Runs last {duration:g} s. Late grasp 4 is the elastic
displacement of that grasp.

{table}

![Distributions over the samples](samples.png)"""

MISSIONS = """\
Feasibility of the missions before any simulation: a linear programme over all actuators at each instant, by
`trussflow.models.feasibility.survey`, on the accurate plant along body z. The margin is the largest factor of
all demands. If it is below 1, the path takes at least the least duration, or needs the listed torques of
bases and joints. The limits are 5 N and 0.3 N·m (Case 2: 1 N·m).

{table}"""

FAILURES = """\
The nominal accurate plant with `Hardware.flight`, Case 1 unless stated otherwise, 80 s. Failures are sudden
and permanent, and the controller must detect them. Along body z, the failure of base 4 is not feasible within
the limits (see above), so robots 1 to 3 fail there; in Case 2, base 3 is not feasible either. *Turned* is the
attitude by `best_attitude`, turned about body x, in which every single failure is feasible. Brakes hold the
joints of a robot whose drives the controller has isolated; without brakes, its arm moves freely.

{table}"""

MARGINS = """\
Plant and controller, linearized at instants of a run without noise and quantization, with held commands. The
columns give the growth rate of the slowest mode [1/s]; negative rates are stable. Gains multiply the feedback
at constant thrust; *+20 ms* delays it. *Disk* is the smallest symmetric disk margin of one actuator or sensor
with all other loops closed; *delay* is the delay margin (∞: 0.2 s or more). The last columns are the worst
of {count} samples. Under thrust an arm buckles at 21 1/s, so that changed gains at constant thrust are
unstable. No linear controller can stabilize more than 2/21 s = 95 ms of total delay (Middleton, Miller 2007,
*On the achievable delay margin using LTI control for unstable plants*, IEEE Transactions on Automatic Control
52 (7)); computation takes 20 ms of it, and the hold 10 ms on average. A controller that acts one sample after
the measurement, with a hold of one sample, can stabilize a ratio of gains of at most {ratio}
(`max_gain_ratio`). Feedback of exact angle, exact rate and last command reaches 3.6. From 0.5 to 2 the ratio
is 4.

{table}"""

OFF_NOMINAL = """\
Case 1 with the hardware of the samples, for 80 s, with one constant deviation that the controller does not
know. Actuator gains multiply all thrusts and torques, also above their limits. Masses or lengths of all arms
differ by {error:.0%} from the nominal ones. Each case has the nominal truss and three samples. A run fails
as above: by its position, joint or late position error. The table has the worst values. With an actuator
gain of 0.5 an alarm is not false.

{table}"""

PROPELLANT = """\
Runs of 100 s on the nominal truss, with and without `ActuatorCosts`. Initially, the wheels of every base
have a momentum of {momentum} N·m·s about its axes, and base 1 has used {propellant:g} kg of propellant, the
others none. The table has the propellant used in the run, and the largest final momentum of any base.

{table}"""

LOOPS = """\
All hardware is exact, with a sample time of 1 ms, as the paper's law needs it. The mean-axes controller has
1 ms of computing delay, and does not measure the modes. Runs last 80 s. *Late vibration* is the deviation
from the mean over the late part of the run.

{table}"""
