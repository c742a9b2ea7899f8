"""Compiled code: once per content, safe against damage and company, optional altogether."""

import ctypes
import os
import subprocess
import sys
import warnings

import numpy as np
import pytest

from trussflow.blocks.framework import call_site
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.declarations import State
from trussflow.blocks.framework.diagram import Diagram
from trussflow.blocks.framework.port import Output
from trussflow.blocks.simulation.simulator import simulate
from trussflow.blocks.tracing import codegen, compile_cache, compiler
from trussflow.blocks.tracing.compile_cache import CompilationError
from trussflow.blocks.tracing.compiler import compile_library, find_compiler

SOURCE = "double answer(void) { return 42.0; }\n"


class Spring(Block):
    y = Output()
    q = State(initial=1.0)
    v = State()

    def output(self, t, x, u, p):
        return {"y": x.q}

    def derivative(self, t, x, u, p):
        return {"q": x.v, "v": -x.q}


def library_of(source):
    return compile_library(source, lambda: [source])


def run(backend="auto"):
    diagram = Diagram("d")
    diagram.add(spring=Spring())
    return simulate(diagram, 1.0, step=0.1, backend=backend)


@pytest.fixture
def cache(tmp_path, monkeypatch):
    folder = tmp_path / "cache"
    monkeypatch.setenv("TRUSSFLOW_CACHE", str(folder))
    return folder


@pytest.fixture
def builds(monkeypatch):
    """Return a list that grows by one at each run of the compiler."""
    found: list[str] = []
    build = compiler._build

    def counted(command, sources):
        found.append("".join(sources))
        return build(command, sources)

    monkeypatch.setattr(compiler, "_build", counted)
    return found


@pytest.fixture
def no_compiler(monkeypatch):
    monkeypatch.setattr(compiler, "find_compiler", lambda: None)
    call_site._said.clear()
    yield
    call_site._said.clear()


def test_equal_content_is_compiled_once(cache, builds):
    first = library_of(SOURCE)
    assert library_of(SOURCE) == first
    assert len(builds) == 1
    assert library_of(SOURCE + "\n") != first
    assert len(builds) == 2
    assert sorted(p.suffix for p in cache.iterdir()) == [".sha256", ".sha256", ".so", ".so"]


@pytest.mark.usefixtures("cache")
@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("FLAGS", (*compiler.FLAGS, "-DOTHER")),
        ("find_compiler", lambda: (*(find_compiler() or ()), "-DOTHER")),
        ("_processor", lambda: "another processor"),
    ],
)
def test_whatever_makes_the_binary_is_part_of_its_name(name, value, builds, monkeypatch):
    compiler.identity.cache_clear()
    first = library_of(SOURCE)
    monkeypatch.setattr(compiler, name, value)
    compiler.identity.cache_clear()
    assert library_of(SOURCE) != first
    assert len(builds) == 2
    compiler.identity.cache_clear()


@pytest.mark.usefixtures("cache")
@pytest.mark.parametrize("file", ["codegen.py", "operations.py", "fma.h", "lanes.h", "driver.c"])
def test_code_that_writes_the_source_is_part_of_the_name(file, builds, monkeypatch):
    run("compiled")
    read = codegen._file
    monkeypatch.setattr(codegen, "_file", lambda n: read(n) + ("\n" if n == file else ""))
    run("compiled")
    assert len(builds) == 2


@pytest.mark.usefixtures("cache")
def test_cache_is_used_by_the_next_simulation(builds):
    first, second = run("compiled"), run("compiled")
    np.testing.assert_array_equal(first["spring.y"], second["spring.y"])
    assert len(builds) == 1


@pytest.mark.usefixtures("cache")
@pytest.mark.parametrize("suffix", [".so", ".sha256"])
@pytest.mark.parametrize("content", [b"", b"\xff\xfe damaged", None])
def test_damaged_files_are_made_again(suffix, content, builds):
    library = library_of(SOURCE)
    good = library.read_bytes()
    damaged = library.with_suffix(suffix)
    if content is None:
        damaged.unlink()
    else:
        damaged.write_bytes(content)
    assert library_of(SOURCE) == library
    assert len(builds) == 2
    assert library.read_bytes() == good
    library_of(SOURCE)
    assert len(builds) == 2


def test_folder_that_cannot_be_written_is_replaced(tmp_path, monkeypatch, builds):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("TRUSSFLOW_CACHE", str(tmp_path / "file" / "cache"))
    call_site._said.clear()
    with pytest.warns(RuntimeWarning, match="compiled code is not kept in .*Not a directory") as hints:
        assert run("compiled").attrs["backend"] == "compiled"
    assert len(hints) == 1
    library = library_of(SOURCE)
    assert library.is_file()
    assert tmp_path not in library.parents
    assert library_of(SOURCE) == library
    assert builds.count(SOURCE) == 1, "the temporary folder is a cache too"


def test_two_processes_may_compile_at_once(cache):
    code = (
        "import ctypes, sys\n"
        "from trussflow.blocks.tracing.compiler import compile_library\n"
        "print('ready', flush=True); sys.stdin.readline()\n"
        "library = ctypes.CDLL(str(compile_library(sys.argv[1], lambda: [sys.argv[1]])))\n"
        "library.answer.restype = ctypes.c_double\n"
        "print(library.answer())\n"
    )
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", code, SOURCE],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=os.environ,
        )
        for _ in range(3)
    ]
    for process in processes:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
    for process in processes:
        assert process.stdin is not None
        process.stdin.write("go\n")
        process.stdin.flush()
    outputs = [process.communicate()[0] for process in processes]
    assert outputs == ["42.0\n"] * 3
    assert len(list(cache.iterdir())) == 2


@pytest.mark.usefixtures("no_compiler")
def test_without_a_compiler_the_interpreter_runs_with_one_hint():
    expected = run("interpreted")
    with pytest.warns(RuntimeWarning, match="no C compiler was found.*pip install ziglang") as hints:
        result = run()
    assert len(hints) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        again = run()
    assert result.attrs["backend"] == again.attrs["backend"] == "interpreted"
    np.testing.assert_array_equal(result["spring.y"], expected["spring.y"])


@pytest.mark.usefixtures("no_compiler")
def test_the_hint_points_at_the_users_line():
    diagram = Diagram("d")
    diagram.add(spring=Spring())
    with pytest.warns(RuntimeWarning) as hints:
        simulate(diagram, 1.0, step=0.1)
    assert hints[0].filename == __file__


@pytest.mark.usefixtures("no_compiler")
def test_compiled_code_without_a_compiler_is_an_error():
    with pytest.raises(CompilationError, match="no C compiler was found"):
        run("compiled")


def test_several_files_become_one_library():
    """They are compiled at the same time, and refer to each other."""
    caller = "double part(void);\ndouble answer(void) { return 2 * part(); }\n"
    callee = "double part(void) { return 21.0; }\n"
    library = ctypes.CDLL(str(compile_library(caller + callee, lambda: [caller, callee])))
    library.answer.restype = ctypes.c_double
    assert library.answer() == 42.0


def test_compiler_that_fails_is_told(cache):
    with pytest.raises(CompilationError, match=r"failed:\n(.|\n)*error"):
        library_of("this is no C")
    assert not cache.exists() or not list(cache.iterdir())


@pytest.mark.usefixtures("cache")
def test_compiler_that_cannot_be_run_is_told(tmp_path, monkeypatch):
    broken = tmp_path / "broken-cc"
    broken.write_text("no executable format")
    broken.chmod(0o755)
    monkeypatch.setattr(compiler, "find_compiler", lambda: (str(broken),))
    with pytest.raises(CompilationError, match="broken-cc cannot be run"):
        library_of(SOURCE)


def test_compiler_of_the_environment_comes_first(tmp_path, monkeypatch):
    mine = tmp_path / "my-cc"
    mine.write_text("#!/bin/sh\n")
    mine.chmod(0o755)
    compiler.find_compiler.cache_clear()
    monkeypatch.setenv("CC", f"{mine} -m64")
    assert compiler.find_compiler() == (str(mine), "-m64")
    compiler.find_compiler.cache_clear()
    monkeypatch.setenv("CC", "missing-compiler")
    assert compiler.find_compiler() != ("missing-compiler",)
    compiler.find_compiler.cache_clear()


def test_cache_is_in_the_users_folder_by_default(monkeypatch):
    monkeypatch.delenv("TRUSSFLOW_CACHE")
    assert compile_cache.cache_folder().name == "trussflow"


@pytest.mark.usefixtures("cache")
def test_compiled_and_interpreted_code_agree():
    round_off = 1e-14  # of ten steps with and without fused multiply-add
    np.testing.assert_allclose(
        run("compiled")["spring.y"], run("interpreted")["spring.y"], rtol=0, atol=round_off
    )
