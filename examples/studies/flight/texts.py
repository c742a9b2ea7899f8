"""What the report on flying says around its tables."""

HEAD = """\
# A loop that flies

What the source's loop needs, where it ends, and what flies in its place: the loop of the mean axes
([models/mean_axes](../../models/mean_axes/README.md)). Written by `make flight`; every number stands with
its full value in [`evidence.json`](evidence.json). Made by the code of digest `{digest}`;
`python -m flight --check` tells whether that is the code at hand.

{definitions}"""

LADDER = """\
How much of each imperfection a loop takes, alone, while all else is exact: the worst value that it flies
Case 1 with (bold), and the next at which it is lost, found by bisection. The source's law and its
mode-neutral form know the six modes of their own plant and their exact states, and begin with 1 ms of hold;
the mean axes fly the accurate plant (38 modal coordinates), see root and joints only, and begin with 20 ms
of hold and 20 ms of delay. Lost is what errs by more than {position} at the root or {joints} in a joint, or
ends with more than {late}.

{table}"""

DRAWS = """\
{counts}. The accurate nonlinear plant behind `Hardware.flight`: a command every 20 ms, 20 ms late; noise of
1e-4 m, rad, m/s and rad/s on root and joints; steps of 0.1 N; at most 5 N, and 0.3 N·m (Case 2: 1 N·m) for
each axis of a base and each joint. The controller knows the nominal truss; flown are draws of it: mass and
frequencies within {mass}, shapes at the grasps by a deviation of up to {mass}, damping {damping}, and up to
{payload} at the tip. Seeds begin at {tuned}: those below were tuned on. Flights last {duration}; *late* are
the last {settled}. Position is the root's distance from its path, late grasp 4 its elastic deflection.

{table}

![How the draws are spread](draws.png)"""

PAPER = """\
All is exact and held for 1 ms, as the source's loop needs it. The mean axes take another millisecond to
compute, and see no modes. *Late* are the last {settled} of 80 s, after the motion.

{table}"""

FAILURES = """\
On the nominal accurate plant behind `Hardware.flight`, Case 1 if not said otherwise, 80 s. What dies does so
at once and for good; nobody tells the controller. Along body z base 4 cannot be lost at these limits
(`trussflow.models.feasibility.survey` says so before the flight), so there robots 1 to 3 lose something; in
Case 2, where base 3 cannot be lost either, bases 1 and 2. *Turned* is the attitude that `best_attitude` finds
by turns about body x, in which every single loss can be survived. With brakes the joints of a dead robot are
held where the controller believes its drives dead; without, its arm swings.

{table}"""

MARGINS = """\
Plant and controller, linear at instants of a flight without noise and steps of thrust, commands held;
growth of the slowest motion, in 1/s: below 0 it decays. Gains multiply all that the actuators do beyond
what they did at that instant, +20 ms delays it. *Disk* is the least symmetric disk margin of a single
actuator or sensor with all others closed, *delay* what further delay is stood (∞: 0.2 s and more). Last,
the worst of {count} draws. Under thrust an arm leaves at 21 1/s: gains that change then, at unchanged
thrust, are lost. No linear controller stands more than 2/21 s = 95 ms of delay in all (Middleton,
Miller 2007, *On the achievable delay margin using LTI control for unstable plants*, IEEE Transactions on
Automatic Control 52 (7)), of which computing takes 20, and the hold 10 on average. And none that acts a
sample after it measures, and is held for one, stands gains farther apart than by a factor of {ratio}, even
if it does nothing else (`greatest_gain_ratio`); feedback of exact angle, exact rate and the last command
stands a factor of 3.6. From 0.5 to 2 it is 4.

{table}"""

EDGES = """\
Case 1 as in the draws, for 80 s, with one thing that the controller does not know, from the start: what all
actuators do is multiplied, thrust and torques alike, also beyond their limits; or masses or lengths of all
arms differ by {part} from those that are believed. Each time the nominal truss and three draws set out; flown
is what errs by less than {position} and {joints}. The worst is shown, as far as it got. An alarm is no false
one where actuators do half of what they are told.

{table}"""

LIMITS = """\
Whether the missions can be flown at all, before any flight: a linear programme over all actuators at each
instant, by `trussflow.models.feasibility.survey`, on the accurate plant along body z. The margin is what all
demands could be multiplied by; below 1 the path takes longer, at least as long as is said, or needs base and
joint torques of so many N·m. Limits are 5 N and 0.3 N·m (Case 2: 1 N·m).

{table}"""

SPARING = """\
The same flight with `ActuatorEconomy` and without, on the nominal truss for 100 s. At the start the wheels of
every base hold {held} N·m·s about its axes, and base 1 has used {spent} of propellant before, the others
none; what is used on this flight is shown, and the most that wheels of any base hold at its end.

{table}"""
