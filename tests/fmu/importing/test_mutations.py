"""FMUs and SSP files with something changed at random are used, or refused by one error of ours, in time."""

import copy
import gc
import io
import os
import random
import sys
import warnings
import zipfile
from collections import Counter
from pathlib import Path
from time import monotonic
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import campaign
import pytest

from trussflow.blocks import Diagram, simulate
from trussflow.blocks.errors import TrussflowError
from trussflow.fmu import Fmu
from trussflow.fmu.ssp import export_ssp, import_ssp

MUTATIONS = 200 * campaign.SIZE
RUN_INTERVAL = 10  # one in so many of the accepted files runs, in a process of its own: they hold native code
CALL_LIMIT = 1.0  # [s] for each call of a binary
MAX_SECONDS = 10.0  # [s] for one file

JUNK = [
    "",
    "0",
    "-1",
    "1",
    "2",
    "7",
    "nan",
    "INF",
    "1e999",
    "1.5",
    "x y",
    "../x",
    "a",
    "b",
    "h",
    "u[1]",
    "u[3]",
    "a.b",
    "[",
    "]",
    "der(h)",
    "der(x)",
    "\u00e9",
    "\U0001f680",
    "true",
    "false",
    "1 2 3",
    "2147483648",
    "-9e99",
    "input",
    "output",
    "parameter",
    "local",
    "independent",
    "structuralParameter",
    "calculatedParameter",
    "fixed",
    "tunable",
    "discrete",
    "continuous",
    "constant",
    "exact",
    "approx",
    "calculated",
    "m",
    "rad",
    "1.0",
    "2.0",
    "3.0",
    "model",
    "1" * 400,
    "9" * 5000,
    "2147483648",
    "resources/ball2.fmu",
]


def with_changed_tree(text, chance):
    """Change one to three elements or attributes."""
    root = ElementTree.fromstring(text)
    everything = list(root.iter())
    for _ in range(chance.randint(1, 3)):
        element, kind = chance.choice(everything), chance.randrange(8)
        if kind < 3 and element.attrib:
            element.set(chance.choice(list(element.attrib)), chance.choice(JUNK))
        elif kind == 3 and element.attrib:
            element.attrib.pop(chance.choice(list(element.attrib)))
        elif kind == 4 and len(element):
            element.remove(chance.choice(list(element)))
        elif kind == 5 and len(element):
            element.append(copy.deepcopy(chance.choice(list(element))))
        elif kind == 6:
            element.append(
                Element(chance.choice(everything).tag, chance.choice(everything).attrib)
            )
        else:
            element.tag = chance.choice(everything).tag
    return ElementTree.tostring(root, "unicode").encode()


def with_changed_bytes(data, chance):
    """Change, drop, double or insert bytes at one to four places."""
    for _ in range(chance.randint(1, 4)):
        begin, size = chance.randrange(len(data) + 1), chance.choice([1, 1, 2, 8, 300])
        here = data[begin : begin + size]
        changed = chance.choice(
            [
                b"",
                here * 2,
                chance.randbytes(len(here)),
                chance.randbytes(size),
                b"\0",
                b"<",
            ]
        )
        data = data[:begin] + changed + data[begin + len(here) :]
    return data


def with_changed_names(files, chance):
    """Rename, drop or add a file."""
    name = chance.choice(list(files))
    content = files[name] if chance.random() < 0.5 else b""
    kept = {n: c for n, c in files.items() if n != name or chance.random() < 0.3}
    other = chance.choice(
        [*JUNK[1:], *files, f"/{name}", f"{name}/x", name.upper(), f"a/{name}"]
    )
    return {**kept, other: content}


def mutated(data, chance):
    """Return a file in which one thing is changed, in its description or around it."""
    kind = chance.choice(["tree", "tree", "tree", "text", "names", "archive"])
    if kind == "archive":
        return with_changed_bytes(data, chance)
    with zipfile.ZipFile(io.BytesIO(data)) as old:
        files = {name: old.read(name) for name in old.namelist()}
    if kind == "names":
        files = with_changed_names(files, chance)
    else:
        name = chance.choice([n for n in files if n.endswith((".xml", ".ssd"))])
        files[name] = (with_changed_tree if kind == "tree" else with_changed_bytes)(
            files[name], chance
        )
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w") as new:
        for name, content in files.items():
            new.writestr(name, content)
    return made.getvalue()


def used(path, runs):
    """Build blocks of a file, and let them run."""
    if path.suffix == ".ssp":
        diagram = import_ssp(path, step=0.1)
    else:
        diagram = Diagram("d")
        seconds, size = (CALL_LIMIT, 500e6) if runs else (None, None)
        block = diagram.add(
            fmu=Fmu(path, step=0.1, time_limit=seconds, memory_limit=size)
        )
        for port in block.inputs():
            diagram.ground(port)
    if runs and path.suffix != ".ssp":
        simulate(diagram, 0.3, step=0.1, backend="interpreted")


def descriptors():
    return len(os.listdir("/proc/self/fd"))


def sources(make_fmu, folder):
    """Return the files that are changed."""
    found = [
        make_fmu(model, version)
        for model in ("ball", "relay", "stair", "types")
        for version in (2, 3)
    ]
    inner, outer = Diagram("inner"), Diagram("outer")
    a, b = inner.add(
        a=Fmu(found[2], step=0.1, kind="cs"), b=Fmu(found[6], step=0.1, kind="cs")
    )
    a.x >> b.u
    inner.ground(a.d, b.number, b.flag)
    inner.expose(u=a.u)
    outer.add(
        inner=inner, ball=Fmu(found[0], step=0.1, kind="cs", parameters={"g": 9.8})
    )
    outer.expose(u=inner.u)
    return [*found, *[export_ssp(outer, folder / "outer.ssp")] * len(found)]


@pytest.mark.campaign
@pytest.mark.filterwarnings("ignore")
@pytest.mark.skipif(
    not Path("/proc/self/fd").exists(),
    reason="descriptors and processes are found in /proc",
)
def test_changed_files_are_used_or_refused(make_fmu, children, tmp_path):
    originals = [
        (path.suffix, path.read_bytes()) for path in sources(make_fmu, tmp_path)
    ]
    outcomes = Counter()
    faults = []
    used(make_fmu("ball"), runs=True)  # what is opened once is opened now
    before = descriptors(), children()
    for seed in range(campaign.SEED, campaign.SEED + MUTATIONS):
        chance = random.Random(seed)
        suffix, data = chance.choice(originals)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of names that are twice in an archive
            (path := tmp_path / f"changed{suffix}").write_bytes(mutated(data, chance))
        outcome, wrong, started = "accepted", [], monotonic()
        try:
            used(path, runs=seed % RUN_INTERVAL == 0)
        except TrussflowError as error:
            outcome = type(error).__name__
            # which has lines of its own
            text = str(error).split("the FMU's own log:")[0].strip()
            wrong += ["more than a line"] * ("\n" in text)
        except Exception as error:  # noqa: BLE001 - none of ours
            wrong.append(repr(error))
        took = monotonic() - started
        wrong += [f"took {took:.1f} s"] * (took > MAX_SECONDS)
        wrong += ["left a descriptor or a process"] * (
            (descriptors(), children()) != before
        )
        outcomes[f"{suffix} {outcome}"] += 1
        faults += [f"seed {seed}: {wrong}"] if wrong else []
    gc.collect()  # folders of SSP files go with their diagrams
    sys.stdout.write(f"{dict(outcomes)}, faults: {len(faults)}\n")
    assert not faults, "\n".join(faults)
