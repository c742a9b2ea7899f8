"""Cases with events and their exact answers; ``docs/hybrid.md`` has the rules."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from systems import Ball, assert_near, ports, ring, series

from trussflow.blocks import (
    Block,
    Constant,
    Diagram,
    Event,
    Function,
    Input,
    Integrator,
    Mode,
    Output,
    Parameter,
    Ramp,
    Sine,
    State,
    Step,
    TransportDelay,
    UnitDelay,
    VariableDelay,
    ZeroOrderHold,
    enabled,
    simulate,
)

TIME_STEP = 0.02
FIXED_STEP = {"step": TIME_STEP}
PRECISE = {"rtol": 1e-11, "atol": 1e-13}
TOLERANCES = {"RK45": 3e-9, "Rodas5P": 1e-7}


class RestingBall(Ball):
    """A bouncing ball that stays on the floor if it arrives slower than `slow`."""

    slow = Parameter(0.0)

    def derivative(self, t, x, u, p):
        moves = np.where(x.bounces < 0.0, 0.0, 1.0)
        return {"z": moves * x.v, "v": -p.gravity * moves}

    def on_event(self, t, x, u, p, fired):
        rests = np.abs(x.v) < p.slow
        speed = np.where(rests, 0.0, -p.restitution * x.v)
        return {
            "z": 0.0,
            "v": speed,
            "bounces": np.where(rests, -x.bounces - 1.0, x.bounces + 1.0),
        }


class Relay(Block):
    """1 below the lower bound, -1 above the upper one, in between what it was."""

    u, y = Input(), Output()
    on = Mode("start")
    rise, fall = Event("rising"), Event("falling")
    width, start = Parameter(0.5), Parameter(1.0)

    def output(self, t, x, u, p):
        return {"y": 2.0 * x.on - 1.0}

    def indicators(self, t, x, u, p):
        return {"rise": u.u - p.width, "fall": u.u + p.width}

    def on_event(self, t, x, u, p, fired):
        return {"on": np.where(fired.rise, 0.0, 1.0)}


class Slider(Block):
    """A unit mass with dry friction 1 under a force: it slides, sticks, and is torn loose."""

    force, y = Input(), Output()
    q, v = State(), State(initial=1.0)
    stuck = Mode()
    stops, slips = Event("falling"), Event("rising")

    def output(self, t, x, u, p):
        return {"y": x.q}

    def derivative(self, t, x, u, p):
        return {"q": x.v, "v": np.where(x.stuck > 0.5, 0.0, u.force - 1.0)}

    def indicators(self, t, x, u, p):
        return {"stops": x.v, "slips": u.force - 1.0}

    def on_event(self, t, x, u, p, fired):
        return {
            "v": np.where(fired.stops, 0.0, x.v),
            "stuck": np.where(fired.slips, 0.0, 1.0),
        }


class Tank(Block):
    """A level that rises by one per second; where level + u reaches 1 it is emptied. It shows the sum."""

    u, y = Input(), Output()
    level = State()
    full = Event("rising")

    def output(self, t, x, u, p):
        return {"y": x.level + u.u}

    def derivative(self, t, x, u, p):
        return {"level": 1.0}

    def indicators(self, t, x, u, p):
        return {"full": x.level + u.u - 1.0}

    def on_event(self, t, x, u, p, fired):
        return {"level": 0.0}


class Counter(Block):
    """It counts by ones where inputs rise above zero, by hundreds where they fall; and a half if at once."""

    u, y, above = Input(2), Output(), Output()
    count, last = Mode(), Mode()
    rise, fall = Event("rising", 2), Event("falling", 2)

    def output(self, t, x, u, p):
        return {"y": x.count, "above": x.last}

    def indicators(self, t, x, u, p):
        return {"rise": u.u, "fall": u.u}

    def on_event(self, t, x, u, p, fired):
        rises, falls = (
            np.sum(np.where(fired.rise, 1.0, 0.0)),
            np.sum(np.where(fired.fall, 1.0, 0.0)),
        )
        at_once = np.where(rises + falls > 1.5, 0.5, 0.0)
        return {
            "count": x.count + rises + 100.0 * falls + at_once,
            "last": np.where(rises > 0.5, 1.0, -1.0),
        }


class Stair(Block):
    """It rises by one at 0.3 s, 0.6 s and so on, four times; then the next time is infinite."""

    y = Output()
    level, following = Mode(), Mode("period")
    step = Event("time")
    period = Parameter(0.3)

    def output(self, t, x, u, p):
        return {"y": x.level}

    def indicators(self, t, x, u, p):
        return {"step": x.following}

    def on_event(self, t, x, u, p, fired):
        ends = np.logical_and(x.level > 2.5, p.period > 0.0)
        return {
            "level": x.level + 1.0,
            "following": np.where(ends, np.inf, x.following + p.period),
        }


@dataclass(frozen=True)
class Case:
    """A diagram without inputs that exposes `y`, and the exact y at some times [s]."""

    name: str
    build: Callable[[], Diagram]
    exact: dict[float, float]
    straight: bool = True  # whether its states are straight lines between events, exact for Euler too
    tolerance: float = (
        1e-9  # for solvers that are exact but for round-off and their own tolerances
    )

    def check(self, found, solver="rk4"):
        """Compare y at the times, in a list or in a result."""
        if not isinstance(found, list):
            found = [
                float(found["y"].sel(time=t, method="nearest")) for t in self.exact
            ]
        tolerance = TOLERANCES.get(solver, self.tolerance)
        assert_near(found, list(self.exact.values()), tolerance)

    def run(self, solver, diagram=None, **options):
        """Simulate it, or the `diagram` that holds it as an FMU, and check the logged y."""
        y = "fmu.y"
        if diagram is None:
            diagram = self.build()
            y = diagram.port("y")
        settings = FIXED_STEP if solver in ("rk4", "euler") else PRECISE
        settings = {
            "log": {"y": y},
            "log_step": 0.1,
            "progress": False,
            **settings,
            **options,
        }
        self.check(
            simulate(diagram, max(self.exact), solver=solver, **settings), solver
        )


def exposed(diagram, port):
    diagram.expose(y=port)
    return diagram


def ball(**parameters):
    diagram = Diagram("ball")
    return exposed(diagram, diagram.add(ball=RestingBall(**parameters)).height)


def flights(t, height=1.0):
    """Return the height of the ball: parabolas, each half as long as the one before."""
    begin, speed = -np.sqrt(height / 5.0), np.sqrt(20.0 * height)
    while t > begin + speed / 5.0:
        begin, speed = begin + speed / 5.0, speed / 2.0
    return speed * (t - begin) - 5.0 * (t - begin) ** 2


def oscillator(begin=0.0, **parameters):
    diagram = ring("oscillator", relay=Relay(**parameters), integral=Integrator(begin))
    return exposed(diagram, diagram.integral.y)


def thermostat():
    """Warm a room by 2 K/s, cooled by its difference to 0."""
    diagram = Diagram("thermostat")
    relay, room = diagram.add(relay=Relay(), room=Integrator())
    (relay.y - room.y) >> room.u
    room.y >> relay.u
    return exposed(diagram, room.y)


def exponentials(t):
    """Return the temperature: from 0 to 1/2 in ln 2, and then to and fro between the halves in ln 3."""
    if t < np.log(2.0):
        return 1.0 - np.exp(-t)
    number, rest = divmod(t - np.log(2.0), np.log(3.0))
    return (-1.0 + 1.5 * np.exp(-rest)) * (-1.0) ** number


def slider():
    diagram = series(force=Ramp(1.0, start_time=2.0), mass=Slider())
    return exposed(diagram, diagram.mass.y)


def tank():
    diagram = series(constant=Constant(0.25), tank=Tank())
    return exposed(diagram, diagram.tank.y)


def stair(period=0.3):
    diagram = Diagram("stair")
    return exposed(diagram, diagram.add(stair=Stair(period=period)).y)


def stair_at_samples():
    """Let a sampler see the step of a stair."""
    diagram = Diagram("sampled stair")
    stair, hold = diagram.add(stair=Stair(period=0.5), hold=ZeroOrderHold(0.5))
    return exposed(diagram, (stair >> hold).y)


def crossings():
    """Count the zeros of a sine and of its negative, which are at one time."""
    diagram = Diagram("crossings")
    wave, counter = diagram.add(wave=Sine(1.0, 1.0, phase=0.3), counter=Counter())
    clock = diagram.add(clock=Integrator())  # solvers step from state to state
    wave.y >> counter.u[0]
    (-1.0 * wave.y) >> counter.u[1]
    wave.y >> clock.u
    return exposed(diagram, counter.y)


def cascade():
    """Let a stair make a counter count, which makes another one count; and show how long ago that was."""
    diagram = Diagram("cascade")
    stair, half, since = diagram.add(
        stair=Stair(), half=Constant(-0.5), since=Integrator()
    )
    source = stair.y
    for name in ("first", "second"):
        counter = diagram.add(name, Counter())
        (source > 0.5) >> counter.u[0]  # 0 at the start
        half.y >> counter.u[1]
        source = counter.above
    source >> since.u
    return exposed(diagram, since.y)


def sampled_jump():
    """Put a relay behind a sampler, and integrate what it says."""
    diagram = series(
        jump=Step(0.6, final_value=2.0),
        hold=ZeroOrderHold(0.5),
        relay=Relay(),
        integral=Integrator(),
    )
    return exposed(diagram, diagram.integral.y)


def multirate():
    """Add what two samplers see of a stair, at 0.1 + 0.2 k and at 0.5 k, the second a period late."""
    diagram = Diagram("multirate")
    stair, odd, late = diagram.add(
        stair=Stair(), odd=ZeroOrderHold(0.2, offset=0.1), late=UnitDelay(0.5)
    )
    return exposed(diagram, (stair >> odd).y + (stair >> late).y)


RATES = (0.26, 0.04, 0.22, 0.06, 0.14, 0.1)


def many_rates():
    """Hold the time at one rate, what that shows at another, and so on."""
    diagram = Diagram("many rates")
    last = diagram.add(time=Ramp())
    for i, rate in enumerate(RATES):
        last = last >> diagram.add(f"hold{i}", ZeroOrderHold(rate))
    return exposed(diagram, last.y)


def bent_oscillator():
    """Let a relay look at y, y + y^3 = u + v, that depends on it: y jumps where the relay switches."""
    diagram = Diagram("bent oscillator", loops="solve")
    law = Function(lambda u, v, y: u + v - y**3, **ports(u=(), v=(), y=(), z=()))
    relay, integral, bent = diagram.add(
        relay=Relay(width=1.0), integral=Integrator(), bent=law
    )
    bent >> relay >> integral
    (2.0 * integral.y) >> bent.u
    (0.5 * relay.y) >> bent.v
    bent.z >> bent.y
    return exposed(diagram, bent.z)


def grouped():
    """Put a group that adds up the time next to the relay that it heeds."""
    diagram, inner, group = Diagram("grouped"), oscillator(), Diagram("group")
    total = group.add(total=Integrator())
    group.expose(u=total.u, y=total.y)
    inner.expose(on=inner.relay.y)
    clock, inner, group = diagram.add(
        clock=Ramp(1.0), inner=inner, group=enabled(group)
    )
    clock.y >> group.u
    inner.on >> group.inputs()[-1]
    return exposed(diagram, group.y)


def delayed_oscillator():
    """Delay what the relay of an oscillator says."""
    diagram = Diagram("delayed oscillator")
    relay, late, integral = diagram.add(
        relay=Relay(), late=TransportDelay(0.25), integral=Integrator()
    )
    relay >> late >> integral >> relay
    return exposed(diagram, integral.y)


def delayed_samples():
    """Delay a step behind a sampler, and integrate it."""
    diagram = Diagram("delayed samples")
    jump, hold, late, integral = diagram.add(
        jump=Step(0.6, initial_value=1.0, final_value=2.0),
        hold=ZeroOrderHold(0.5),
        late=TransportDelay(0.33, -1.0),
        integral=Integrator(),
    )
    jump >> hold >> late >> integral
    return exposed(diagram, integral.y)


def varying_delay():
    """Delay a step by 0.4 s + t/5, and integrate it."""
    diagram = Diagram("varying delay")
    jump, delay, late, integral = diagram.add(
        jump=Step(0.6, initial_value=1.0, final_value=2.0),
        delay=Ramp(0.2, initial_value=0.4),
        late=VariableDelay(0.1, 3.0, -1.0),
        integral=Integrator(),
    )
    jump >> late.u
    delay >> late.tau
    late.y >> integral
    return exposed(diagram, integral.y)


def bent(integral, relay):
    roots = np.roots([1, 0, 1, -2 * integral - relay / 2])
    return roots[np.isreal(roots)].real[0]


# Height [m] from which a ball bounces until 1.403 s: at 1.4 s its flights last some milliseconds.
LAST_HEIGHT = 5.0 * (1.403 / 3.0) ** 2

CASES = [
    Case(
        "bouncing ball",
        ball,
        {t: flights(t) for t in (0.4, 0.8, 1.2, 1.3)},
        straight=False,
    ),
    Case(
        "flights shorter than a step",
        lambda: ball(start=LAST_HEIGHT),
        {1.3: flights(1.3, height=LAST_HEIGHT), 1.4: flights(1.4, height=LAST_HEIGHT)},
        False,
    ),
    Case(
        "a ball comes to rest",
        lambda: ball(slow=1.0),
        {1.0: flights(1.0), 1.4: 0.0, 3.0: 0.0},
        False,
    ),
    Case("relay oscillator", oscillator, {0.4: 0.4, 0.8: 0.2, 1.8: -0.2, 10.3: 0.3}),
    Case(
        "thermostat",
        thermostat,
        {t: exponentials(t) for t in (0.4, 1.0, 3.0, 5.0)},
        False,
        1e-8,
    ),
    Case(
        "stick and slip",
        slider,
        {0.5: 0.375, 1.5: 0.5, 3.0: 0.5, 4.0: 0.5 + 1 / 6},
        straight=False,
    ),
    Case("reset with feedthrough", tank, {0.5: 0.75, 1.0: 0.5, 1.6: 0.35}),
    Case(
        "event at a sample",
        stair_at_samples,
        {0.4: 0.0, 0.6: 1.0, 1.2: 2.0, 1.4: 2.0, 3.0: 4.0},
    ),
    Case(
        "simultaneous events", crossings, {0.2: 0.0, 0.5: 101.5, 1.2: 203.0, 3.2: 609.0}
    ),
    Case("a cascade", cascade, {0.2: 0.0, 0.4: 0.1, 0.5: 0.2}),
    Case("an input jumps", sampled_jump, {0.8: 0.8, 1.0: 1.0, 1.5: 0.5}),
    Case("time events", stair, {0.2: 0.0, 0.4: 1.0, 1.3: 4.0, 2.0: 4.0}),
    Case(
        "algebraic loop with events",
        bent_oscillator,
        {0.4: bent(0.4, 1.0), 1.0: bent(0.5, -1.0), 2.6: bent(-0.4, 1.0)},
    ),
    Case(
        "enabled group", grouped, {0.4: 0.08, 1.0: 0.125, 1.8: 0.62, 3.0: 2.125}, False
    ),
    Case(
        "many rates", many_rates, {0.2: 0.0, 0.6: 0.26, 1.1: 0.78, 5.7: 5.46, 6.0: 5.72}
    ),
    Case(
        "a delayed relay",
        delayed_oscillator,
        {0.2: 0.0, 0.9: 0.65, 1.2: 0.55, 2.4: -0.65, 4.2: 0.55, 10.6: 0.15},
    ),
    Case("a varying delay", varying_delay, {0.4: -0.4, 1.2: 0.2, 1.5: 0.75, 2.0: 1.75}),
    Case(
        "delayed jumps", delayed_samples, {0.3: -0.3, 1.2: 0.54, 1.5: 1.01, 2.0: 2.01}
    ),
    Case(
        "several rates", multirate, {0.2: 0.0, 0.4: 1.0, 0.6: 1.0, 0.8: 2.0, 1.1: 4.0}
    ),
]

ENDLESS = {
    "a ball that bounces ever lower": (ball, r"1\.34164"),
    "a relay without hysteresis": (
        lambda: oscillator(0.3, width=0.0, start=0.0),
        r"0\.3",
    ),
    "the same, zero to the bit": (
        lambda: oscillator(0.25, width=0.0, start=0.0),
        r"0\.25",
    ),
    "the same, from the start on": (
        lambda: oscillator(0.0, width=0.0, start=0.0),
        r"\S+e-1\d",
    ),
    "a time that stays": (lambda: stair(0.0), "0"),
}
"""Diagrams whose events never end, and when [s]."""

NAMES = [case.name for case in CASES]
ORDINARY = {
    "test_simulated_by_other_solvers": (
        "bouncing ball",
        "stick and slip",
        "an input jumps",
    ),
    "test_native_fmus": [*NAMES[::4], "a delayed relay", "several rates"],
    "test_native_fmus_of_fmi_2": (
        "stick and slip",
        "event at a sample",
        "time events",
        "enabled group",
        "a delayed relay",
    ),
    "test_a_foreign_importer": ("bouncing ball", "simultaneous events"),
    "test_python_fmus": (
        "bouncing ball",
        "time events",
        "enabled group",
        "a delayed relay",
    ),
}
"""Cases that these tests always run; the campaign runs them with the others."""


def pytest_generate_tests(metafunc):
    if "case" in metafunc.fixturenames:
        cases = []
        always = ORDINARY.get(metafunc.function.__name__, NAMES)
        for case in CASES:
            marks = [] if case.name in always else [pytest.mark.campaign]
            cases.append(pytest.param(case, id=case.name, marks=marks))
        metafunc.parametrize("case", cases)
    if "endless" in metafunc.fixturenames:
        metafunc.parametrize("endless", ENDLESS.values(), ids=list(ENDLESS))


@pytest.fixture
def cases():
    return {case.name: case for case in CASES}
