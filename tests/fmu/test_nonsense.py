"""Nonsense in any argument of export and import is refused by one of our errors."""

from functools import partial
from itertools import product
from typing import Any

import numpy as np
import pytest

from trussflow.blocks import Integrator, TrussflowError
from trussflow.fmu import Fmu, export, export_ssp, import_ssp

SCALARS = (None, True, 5, -1, 0.5, 1e300, 10**400, np.nan, object())
TEXTS = ("", "a", "yes", "10", "a\0", "a" * 300, b"x")
LISTS: Any = ([], [1], ["cs"], [[]], (), np.ones(2), iter([1]))
MAPPINGS: Any = ({}, {5: 1}, {"u": "a"}, {"u": [1]}, {"s": 5})
NONSENSE: list[Any] = [*SCALARS, *TEXTS, *LISTS, *MAPPINGS]
EXPORT = ("path", "kind", "version", "step", "stop_time", "tolerance", "parameters", "start", "solver")
IMPORT = ("path", "kind", "step", "parameters", "start", "units", "delayed", "tolerance")
LIMITS = ("time_limit", "memory_limit", "logging", "max_bytes")
COUPLED = ("path", "step", "stop_time")


@pytest.fixture(scope="module")
def fmu(tmp_path_factory):
    return export(Integrator(), tmp_path_factory.mktemp("fmu") / "integrator.fmu", platforms=None)


@pytest.fixture
def calls(fmu, tmp_path, monkeypatch):
    """Return each function, and the arguments that it takes."""
    monkeypatch.chdir(tmp_path)  # some nonsense is a good name of a file
    native = partial(_call, export, {"item": Integrator(), "path": "made.fmu", "platforms": ()})
    plain = partial(_call, export, {"item": Integrator(), "path": "made.c", "kind": "c"})
    loop = Fmu(fmu, step=0.1).named("loop")
    return {
        "export": (native, (*EXPORT, "platforms")),
        "plain C": (plain, EXPORT),
        "Fmu": (partial(_call, Fmu, {"path": fmu}), (*IMPORT, *LIMITS)),
        "export_ssp": (partial(_call, export_ssp, {"diagram": loop, "path": "a.ssp"}), COUPLED),
        "import_ssp": (partial(_call, import_ssp, {"path": fmu}), ("path", "folder", "step", "max_bytes")),
    }


def _call(function, good, **given):
    function(**{**good, **given})


@pytest.mark.parametrize("name", ["export", "plain C", "Fmu", "export_ssp", "import_ssp"])
def test_nonsense_is_refused_by_our_errors(name, calls):
    function, arguments = calls[name]
    refused = 0
    for argument, value in product(arguments, NONSENSE):
        try:
            function(**{argument: value})
        except TrussflowError:
            refused += 1
        except Exception as error:
            raise AssertionError(f"{name}({argument}={value!r}) raised {error!r}") from error
    assert refused > len(arguments) * len(NONSENSE) / 2


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"time_limit": 1e10}, r"time_limit = 1e\+10 is more than 1e\+06; leave it out for no limit"),
        ({"time_limit": 1.0, "memory_limit": 1e300}, r"memory_limit = 1e\+300 is more than 1e\+15"),
        ({"delayed": "no"}, r"Fmu needs delayed=True or delayed=False, not 'no'"),
        ({"logging": "yes"}, r"Fmu needs logging=True or logging=False, not 'yes'"),
        ({"units": ["N"]}, r"units must be given by name, as a dict, not as \['N'\]"),
        ({"parameters": {5: 1}}, r"parameters must be given by name: 5 is no name"),
        ({"kind": ["cs"]}, r"offers cs and me, not '\['cs'\]'"),
        ({"path": "a" * 300}, r"cannot open the FMU 'aaa.*give the path of a file as text, not too long"),
    ],
)
def test_what_was_taken_in_silence_or_by_errors_of_others(given, message, fmu):
    with pytest.raises(TrussflowError, match=message):
        Fmu(**{"path": fmu, **given})


@pytest.mark.parametrize("name", ["double", "class", "exp", "gamma", "math", "string", "tf_now", "NULL"])
def test_names_with_a_meaning_in_c_are_refused(name, tmp_path):
    with pytest.raises(TrussflowError, match=rf"'{name}' means something in C; choose another name"):
        export(Integrator(), tmp_path / f"{name}.c", kind="c")
    assert not list(tmp_path.iterdir())


def test_headers_of_others_are_not_overwritten(tmp_path):
    """Our own are: the same export may be repeated."""
    source, header = tmp_path / "hh.c", tmp_path / "hh.h"
    header.write_text("#define MINE 1\n")
    with pytest.raises(TrussflowError, match=r"hh\.h' beside 'hh\.c': that file is not one of ours"):
        export(Integrator(), source, kind="c")
    assert header.read_text() == "#define MINE 1\n"
    assert not source.exists()
    header.unlink()
    export(Integrator(), source, kind="c", step=0.1)
    export(Integrator(), source, kind="c", step=0.2)
    assert "0.2 s" in header.read_text()
