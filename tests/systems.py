"""Small blocks and diagrams that many tests share. A test defines its own only to show a special property."""

import sys
from itertools import pairwise
from unittest import mock

import casadi as ca
import numpy as np
from numpy.testing import assert_allclose

from trussflow.blocks import (
    INFERRED,
    Block,
    Constant,
    Diagram,
    Event,
    Function,
    Gain,
    Input,
    Integrator,
    Mode,
    Output,
    Parameter,
    PythonFunction,
    Simulator,
    State,
    repeated,
    simulate,
)
from trussflow.blocks.framework.declarations import Signals
from trussflow.blocks.framework.run_state import Running
from trussflow.blocks.framework.system import flatten
from trussflow.blocks.simulation.executor import CompiledExecutor
from trussflow.blocks.simulation.solver import Solver
from trussflow.blocks.tracing.kernels import to_expression
from trussflow.blocks.tracing.plan import Plan
from trussflow.blocks.tracing.program import lower


class Time(Block):
    """y = t."""

    y = Output()

    def output(self, t, x, u, p):
        return {"y": t}


class Level(Block):
    """x' = u, y = x."""

    u, y = Input(), Output()
    x = State()

    def output(self, t, x, u, p):
        return {"y": x.x}

    def derivative(self, t, x, u, p):
        return {"x": u.u}


class Lag(Level):
    """x' = u - x, y = x."""

    x = State(initial="start")
    start = Parameter(0.0)

    def derivative(self, t, x, u, p):
        return {"x": u.u - x.x}


class Follower(Level):
    """A block that starts one above its input, and stays there."""

    def initial_state(self, u, p):
        return {"x": u.u + 1.0}

    def derivative(self, t, x, u, p):
        return {"x": 0.0 * u.u}


class Oscillator(Block):
    """m q'' = u - k q - d q', y = (q, q')."""

    u, y = Input(unit="N"), Output(2, unit=("m", "m/s"))
    q, v = State(unit="m", initial="start"), State(unit="m/s")
    start = Parameter(1.0, unit="m")
    mass = Parameter(1.0, unit="kg", above=0.0)
    stiffness = Parameter(4.0, unit="N/m")
    damping = Parameter(0.1, unit="N*s/m", minimum=0.0)

    def output(self, t, x, u, p):
        return {"y": np.stack([x.q, x.v])}

    def derivative(self, t, x, u, p):
        return {"q": x.v, "v": (u.u - p.stiffness * x.q - p.damping * x.v) / p.mass}


class DrivenPendulum(Block):
    """q'' = drive + wind - 9.81 sin(q) - 0.1 q', measured = sin(q)."""

    drive, wind = Input(unit="N*m"), Input(unit="N*m")
    measured = Output()
    q, v = State(unit="rad", initial=0.2), State(unit="rad/s")

    def output(self, t, x, u, p):
        return {"measured": np.sin(x.q)}

    def derivative(self, t, x, u, p):
        return {"q": x.v, "v": u.drive + u.wind - 9.81 * np.sin(x.q) - 0.1 * x.v}


class Pendulum(Block):
    """Two pendulums, stiff as the user likes."""

    torque = Input((2,), unit="N*m")
    angle = Output((2,), unit="rad", meaning="from the vertical")
    load = Output((2,), unit="N*m")
    q = State((2,), initial="release", unit="rad")
    v = State((2,), unit="rad/s")
    release = Parameter((0.3, -0.2), (2,), unit="rad", meaning="angle at the start")
    stiffness = Parameter(9.0, above=0.0, unit="N*m")

    def output(self, t, x, u, p):
        return {"angle": x.q, "load": u.torque - p.stiffness * np.sin(x.q)}

    def derivative(self, t, x, u, p):
        return {
            "q": x.v,
            "v": u.torque - p.stiffness * np.sin(x.q) + 0.1 * np.cos(3 * t),
        }


class Controller(Block):
    """A sampled law with memory, and a port that takes the unit of its source."""

    goal = Input((2,), unit="rad")
    angle = Input((2,), unit=INFERRED)
    torque = Output((2,), unit="N*m")
    total = State((2,))
    gain = Parameter(2.0)

    def output(self, t, x, u, p):
        return {"torque": p.gain * (u.goal - u.angle) + x.total}

    def update(self, t, x, u, p):
        return {"total": x.total + 0.1 * (u.goal - u.angle)}


class Ring(Block):
    """Seven equal equations, which become one kernel in lanes."""

    push = Input()
    x = State(7, initial=0.1)
    total = Output()

    def output(self, t, x, u, p):
        return {"total": np.sum(x.x)}

    def derivative(self, t, x, u, p):
        def one(a, push):
            return (
                push * np.sin(a) - np.exp(-a * a) * a + np.cos(a) * np.log(1.0 + a),
            )

        rates = repeated(one, [(x.x[i], u.push) for i in range(7)])
        return {"x": np.stack([rate for (rate,) in rates])}


class Counter(Block):
    """A discrete state that grows by one at each update."""

    y = Output()
    n = State()

    def output(self, t, x, u, p):
        return {"y": x.n}

    def update(self, t, x, u, p):
        return {"n": x.n + 1.0}


class Ball(Block):
    """A bouncing ball: z'' = -g, and v -> -e v where z = 0; it counts its bounces."""

    height, speed = Output(unit="m"), Output(unit="m/s")
    z, v = State(unit="m", initial="start"), State(unit="m/s")
    bounces = Mode()
    floor = Event("falling")
    restitution = Parameter(0.5, above=0.0)
    gravity = Parameter(10.0, unit="m/s**2")
    start = Parameter(1.0, unit="m")

    def output(self, t, x, u, p):
        return {"height": x.z, "speed": x.v}

    def derivative(self, t, x, u, p):
        return {"z": x.v, "v": -p.gravity}

    def indicators(self, t, x, u, p):
        return {"floor": x.z}

    def on_event(self, t, x, u, p, fired):
        return {"z": 0.0, "v": -p.restitution * x.v, "bounces": x.bounces + 1.0}


class PythonBall(Ball):
    """The same ball as a Python block."""

    traced = False

    def feedthrough(self):
        return {"height": (), "speed": ()}


class HiddenSum(Block):
    """A sampled Python block that sums tanh(u) where the framework cannot see it."""

    traced = False
    u, y = Input("size"), Output("size")

    def __init__(self, size=1):
        self.size = size
        super().__init__()

    def open(self, p):
        return HiddenSumRun(self.size)

    def feedthrough(self):
        return {"y": ()}


class HiddenSumRun(Running):
    """The sum of one run, which can be saved and restored."""

    def __init__(self, size):
        self.sum = np.zeros(size)

    def save(self):
        return self.sum.copy()

    def restore(self, saved):
        self.sum = saved.copy()

    def output(self, t, x, u, p):
        return {"y": self.sum}

    def update(self, t, x, u, p):
        self.sum = self.sum + np.tanh(u.u)
        return {}


def ports(**shapes):
    """Return the arguments `inputs` and `outputs` of a function block: shapes by name, the output last."""
    *names, last = shapes
    inputs = {name: Input(shapes[name]) for name in names}
    return {"inputs": inputs, "outputs": {last: Output(shapes[last])}}


def ball_height(time, restitution=0.8, gravity=10.0, start=1.0):
    """Return the exact height of a `Ball` that is dropped, and how often it has bounced."""
    begun, bounces = np.sqrt(2.0 * start / gravity), 0
    if time < begun:
        return start - gravity * time**2 / 2.0, bounces
    speed, flight = gravity * begun, 0.0
    while begun + flight <= time:
        begun, speed, bounces = begun + flight, restitution * speed, bounces + 1
        flight = 2.0 * speed / gravity
    return speed * (time - begun) - gravity * (time - begun) ** 2 / 2.0, bounces


def jacobian(function, x):
    """Return the Jacobian of an analytic function by complex steps, exact to round-off."""
    return np.column_stack(
        [function(x + 1e-30j * e).imag / 1e-30 for e in np.eye(x.size)]
    )


def by_default(backend):
    """Return the context in which this backend is that of runs which name none."""
    return mock.patch.dict(Solver.__init__.__kwdefaults__, backend=backend)


def interpreted(request):
    """Interpret equations in ordinary tests of a module, whose runs are too short to pay for the C compiler.

    Folders make an automatic fixture of it. The campaign compiles.
    """
    ordinary = request.config.option.markexpr == "not campaign"
    with by_default("interpreted" if ordinary else "auto"):
        yield


def assert_near(found, expected, tolerance, err_msg=""):
    """Check that arrays differ by an absolute tolerance at most."""
    assert_allclose(found, expected, rtol=0, atol=tolerance, err_msg=err_msg)


def here(ahead):
    """Return ``file:line`` of a line some lines after the call."""
    frame = sys._getframe(1)
    return f"{frame.f_code.co_filename}:{frame.f_lineno + ahead}"


def relative_error(found, expected):
    """Return the largest difference of two arrays, in units of the largest expected element."""
    return abs(found - expected).max() / abs(expected).max()


def respond(block, t=0.0, **inputs):
    """Return the outputs of a block without states; missing inputs have their defaults, or zero."""
    u = {
        port.name: np.full(port.whole_shape, port.declaration.default or 0.0)
        for port in block.inputs()
    }
    nothing = Signals("x", {})
    return block.output(
        t, nothing, Signals("u", u | inputs), Signals("p", block.parameters)
    )


def series(name="test", /, **blocks):
    """Return a diagram of blocks, each connected to the next."""
    diagram = Diagram(name)
    diagram.add(**blocks)
    for source, target in pairwise(diagram.blocks.values()):
        source >> target
    return diagram


def ring(name="test", /, **blocks):
    """Return a diagram of blocks, each connected to the next, and the last to the first."""
    diagram = series(name, **blocks)
    around = [*diagram.blocks.values()]
    around[-1] >> around[0]
    return diagram


def doubled(source):
    """Return a diagram that doubles a source every 0.1 s in Python."""
    double = PythonFunction(lambda u: 2 * u, 0.1, **ports(u=(), y=()))
    diagram = series(source=source, double=double)
    diagram.expose(y=diagram.double.y)
    return diagram


def approach(gain=1.0):
    """Return a diagram with y' = gain (1 - y), from 0."""
    diagram = Diagram("approach")
    goal, law, level = diagram.add(
        goal=Constant(1.0), law=Gain(gain), level=Integrator()
    )
    (goal.y - level.y) >> law
    law >> level
    return diagram


def decay(order=1, rate=1.0):
    """Return a diagram with x' = -rate x, x(0) = 1, for each of some states; `order=()` gives a scalar."""
    return ring("decay", x=Integrator(np.ones(order)), back=Gain(-rate, shape=order))


def cubic():
    """Return y + y^3 = x, dx/dt = -y, from x = 1: a loop that is solved in iterations."""
    diagram = Diagram("cubic", loops="solve")
    law = Function(lambda u, back: u - back**3, **ports(u=(), back=(), y=()))
    state, bent = diagram.add(state=Integrator(1.0), bent=law)
    state.y >> bent.u
    bent.y >> bent.back
    -bent.y >> state.u
    return diagram


def differences(diagram, duration, function, at, change, **settings):
    """Return a function of a run, and its central differences by parameters and initial states."""
    simulator = Simulator(diagram, **settings)
    states = {
        f"{block.path}.{name}"
        for block in diagram.blocks.values()
        for name in block.states()
    }

    def value(values):
        parameters = {
            name: number for name, number in values.items() if name not in states
        }
        initial = {name: values[name] for name in states & {*values}}
        run = simulator.run(
            duration, parameters=parameters, initial=initial, progress=False
        )
        return np.asarray(
            function({str(name): variable.values for name, variable in run.items()})
        )

    slopes = {}
    for name, number in at.items():
        columns = [
            (value(at | {name: number + e}) - value(at | {name: number - e}))
            / (2.0 * change)
            for e in change * np.eye(np.size(number)).reshape(-1, *np.shape(number))
        ]
        slopes[name] = np.stack(columns, axis=-1).reshape(
            columns[0].shape + np.shape(number)
        )
    return value(at), slopes


def compiled_program(expressions, x, trace=None):
    """Return a program of expressions in the symbol x, and a function that calls its compiled code."""
    inputs = [ca.SX.sym("t"), to_expression(x), ca.SX(0, 1), ca.SX(0, 1)]
    program = lower("derivative", inputs, ca.vertcat(*expressions), trace or ())
    plan = Plan(flatten(Constant(0.0), external=True))
    executor = CompiledExecutor([program], plan)
    return program, lambda values: executor.call(
        "derivative", 0.0, values, np.zeros(0), np.zeros(0)
    )


def simulate_block(block, duration, sources, **settings):
    """Simulate a block whose inputs are the outputs of sources, by name of the input."""
    diagram = Diagram("test")
    diagram.add(block=block)
    for name, source in sources.items():
        diagram.add(**{f"{name}_source": source}).y >> block.port(name)
    return simulate(diagram, duration, **settings)


def actuator_limits(dynamics, force, base_torque, joint_torque):
    """Return the limit of each actuator of a truss, equal for all bases and all joints."""
    bases = np.tile(np.repeat([force, base_torque], 3), len(dynamics.arms))
    return np.append(bases, np.full(dynamics.joints, joint_torque))
