"""Whatever an FMU does in a process of its own: one error of ours in time, or a run, and nothing stays."""

import os
import time
from contextlib import suppress
from pathlib import Path

import campaign
import numpy as np
import pytest

from trussflow.blocks import Diagram, Session
from trussflow.blocks.errors import TrussflowError
from trussflow.fmu import Fmu
from trussflow.fmu.errors import FmuCrashError, FmuTimeoutError

CALL_LIMIT = 1.0  # [s] for each call
LONG_LIMIT = 60.0  # [s] for a call that ends by itself, however busy the machine is
MAX_DELAY = 2.0  # [s] over the limit, until all is gone
MEMORY_LIMIT = 300e6  # [B]

SETUP = (
    "load",
    "Instantiate",
    "SetReal",
    "EnterInitializationMode",
    "ExitInitializationMode",
    "GetReal",
)
STATES = (
    "GetFMUstate",
    "SerializedFMUstateSize",
    "SerializeFMUstate",
    "DeSerializeFMUstate",
)
RESTORED = ("SetFMUstate", "FreeFMUstate")
CONTINUOUS = (
    "SetTime",
    "SetContinuousStates",
    "GetDerivatives",
    "GetEventIndicators",
    "NewDiscreteStates",
)
EVENTS = (
    "CompletedIntegratorStep",
    "EnterEventMode",
    "EnterContinuousTimeMode",
    "GetContinuousStates",
)
END = ("Terminate", "FreeInstance")
FUNCTIONS = {
    "cs": (*SETUP, *STATES, *RESTORED, "DoStep", *END),
    "me": (*SETUP, *STATES, *RESTORED, *CONTINUOUS, *EVENTS, *END),
}
OF_FMI3 = {
    "SetReal": "SetFloat64",
    "GetReal": "GetFloat64",
    "GetDerivatives": "GetContinuousStateDerivatives",
    "NewDiscreteStates": "UpdateDiscreteStates",
    "DeSerializeFMUstate": "DeserializeFMUState",
}
MISDEEDS = (
    *(
        "hang",
        "sleep",
        "stop",
        "segv",
        "abort",
        "trap",
        "kill",
        "realtime",
        "exit",
        "_exit",
    ),
    *("garbage", "zeros", "huge", "byte", "close", "close_hang"),
    *("fork", "fork_hang", "daemon", "daemon_crash", "daemons", "daemon_exec"),
    *("allocate", "allocate_quietly", "flood"),
)


def name_in_c(function, version, kind):
    """Return what the C code calls a function."""
    if function == "load":
        return function
    if version == 2:
        return f"fmi2{function}"
    if function == "Instantiate":
        return f"fmi3Instantiate{'CoSimulation' if kind == 'cs' else 'ModelExchange'}"
    return "fmi3" + OF_FMI3.get(function, function.replace("FMUstate", "FMUState"))


ALL = [
    (version, kind, name_in_c(function, version, kind), misdeed)
    for version in (2, 3)
    for kind, functions in FUNCTIONS.items()
    for function in functions
    for misdeed in MISDEEDS
]
COUNT = 20 * campaign.SIZE
CHOSEN = np.random.default_rng(3 + campaign.SEED).permutation(len(ALL))[:COUNT]
PARTS = np.array_split(CHOSEN, -(-COUNT // 50))


def run(path, kind, limit=CALL_LIMIT):
    """Call each function that an FMU has here."""
    step = 0.1 if kind == "cs" else None
    diagram = Diagram("d")
    block = Fmu(
        path,
        step=step,
        parameters={"g": 9.8},
        time_limit=limit,
        memory_limit=MEMORY_LIMIT,
    )
    ball = diagram.add(ball=block)
    diagram.expose(h=ball.h)
    with Session(
        diagram, step=step, solver="rk4" if kind == "cs" else "RK45"
    ) as session:
        session.advance(0.3)
        saved = session.save()
        session.advance(0.6)  # it bounces
        session.restore(saved)
        session.advance(0.4)


@pytest.mark.parametrize(
    "function, misdeed, error, message",
    [
        ("load", "hang", FmuTimeoutError, "'open' within 1 s"),
        (
            "fmi2DoStep",
            "huge",
            FmuCrashError,
            "wrote into the descriptor reserved for answers",
        ),
        # announces more than it sends
        ("fmi2DoStep", "garbage", FmuTimeoutError, "'do_step' within 1 s"),
        ("fmi2DoStep", "allocate", FmuCrashError, "'do_step' with signal 6 .Aborted"),
        ("fmi2DoStep", "realtime", FmuCrashError, r"'do_step' with signal \d\d .*;"),
        (
            "fmi2DoStep",
            "close_hang",
            FmuCrashError,
            "descriptor reserved for answers in 'do_step', or closed it",
        ),
        (
            "fmi2SetFMUstate",
            "segv",
            FmuCrashError,
            "'state_from_bytes' with signal 11 .Segmentation",
        ),
    ],
)
def test_error_messages(
    make_fmu, hostile_binaries, tmp_path, monkeypatch, function, misdeed, error, message
):
    monkeypatch.setenv("MISDEED", f"{function}:{misdeed}")
    monkeypatch.setenv("MISDEED_DONE", str(tmp_path / "done"))
    with pytest.raises(error, match=message):
        run(
            make_fmu("ball", 2, kinds=("cs",), more=hostile_binaries),
            "cs",
            CALL_LIMIT if error is FmuTimeoutError else LONG_LIMIT,
        )


def marked(mark):
    """Return processes whose environment names a path."""
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if str(mark).encode() in (folder / "environ").read_bytes():
                yield (folder / "cmdline").read_bytes().decode(errors="replace")


@pytest.mark.campaign
@pytest.mark.parametrize(
    "chosen", PARTS, ids=lambda part: f"{len(part)} from {part[0]}"
)
@pytest.mark.skipif(
    not Path("/proc/self/environ").exists(),
    reason="processes that fled are found in /proc",
)
def test_whatever_an_fmu_does(
    make_fmu, hostile_binaries, tmp_path, monkeypatch, chosen
):
    files = {
        (version, kind): make_fmu(
            "ball", version, kinds=(kind,), more=hostile_binaries
        ).rename(tmp_path / f"{version}{kind}.fmu")
        for version in (2, 3)
        for kind in ("cs", "me")
    }
    run(files[2, "cs"], "cs")  # what is opened once is opened now
    lines = []
    faults = []
    for number in chosen:
        version, kind, function, misdeed = ALL[number]
        case, mark = (
            f"FMI {version} {kind}: {misdeed} in {function}",
            tmp_path / f"done{number}",
        )
        monkeypatch.setenv("MISDEED", f"{function}:{misdeed}")
        monkeypatch.setenv("MISDEED_DONE", str(mark))
        descriptors = len(os.listdir("/proc/self/fd"))
        outcome, wrong = "ran", []
        try:
            run(files[version, kind], kind)
        except TrussflowError as error:
            outcome = type(error).__name__
        except Exception as error:  # noqa: BLE001 - none of ours
            wrong += [repr(error)]
        took = time.time() - mark.stat().st_mtime if mark.exists() else 0.0
        monkeypatch.delenv("MISDEED_DONE")
        wrong += [f"took {took:.2f} s"] * (took > CALL_LIMIT + MAX_DELAY)
        wrong += [f"left process {process}" for process in marked(mark)]
        wrong += ["left a descriptor"] * (
            len(os.listdir("/proc/self/fd")) > descriptors
        )
        left = (tmp_path / "scratch").glob("trussflow-*/*")
        wrong += [f"left {path}" for path in left if path.name != "lock"]
        lines.append(
            f"{case}: {outcome}, {took:.2f} s, {'' if mark.exists() else 'not called, '}{wrong}"
        )
        faults += [lines[-1]] if wrong else []
    (tmp_path / "outcomes.txt").write_text("\n".join(lines))
    assert not faults, "\n".join(faults)
