"""Compiled code: once per content, safe with several processes, optional altogether."""

import ctypes
import os
import subprocess
import sys
import time
import warnings

import pytest
from numpy.testing import assert_array_equal

from trussflow.blocks.tracing import codegen, compile_cache, compiler
from trussflow.blocks.tracing.compile_cache import CompilationError
from trussflow.blocks.tracing.compiler import compile_library, find_compiler

SOURCE = "double answer(void) { return 42.0; }\n"

pytestmark = pytest.mark.usefixtures("cache")


def library_of(source):
    return compile_library(source, lambda: [source])


@pytest.fixture
def builds(monkeypatch):
    """Return a list that grows by one at each run of the compiler."""
    found = []
    build = compiler._build

    def counted(command, sources, flags):
        found.append("".join(sources))
        return build(command, sources, flags)

    monkeypatch.setattr(compiler, "_build", counted)
    return found


@pytest.fixture
def no_compiler(monkeypatch):
    monkeypatch.setattr(compiler, "find_compiler", lambda: None)


def test_equal_content_is_compiled_once(cache, builds):
    first = library_of(SOURCE)
    assert library_of(SOURCE) == first
    assert len(builds) == 1
    assert library_of(SOURCE + "\n") != first
    assert len(builds) == 2
    assert [p.suffix for p in cache.iterdir()] == [".so", ".so"]


@pytest.mark.parametrize(
    "name, value",
    [
        ("FLAGS", (*compiler.FLAGS, "-DOTHER")),
        ("find_compiler", lambda: (*(find_compiler() or ()), "-DOTHER")),
        ("_processor", lambda: "another processor"),
    ],
)
def test_compiler_flags_and_processor_are_part_of_the_name(
    name, value, builds, monkeypatch
):
    first = library_of(SOURCE)
    monkeypatch.setattr(compiler, name, value)
    compiler.identity.cache_clear()
    assert library_of(SOURCE) != first
    assert len(builds) == 2


@pytest.mark.usefixtures("cache")
def test_options_of_the_user_are_the_last_ones_and_part_of_the_name(monkeypatch):
    monkeypatch.delenv("TRUSSFLOW_CFLAGS", raising=False)
    used = []
    whole = compiler.compiled
    monkeypatch.setattr(
        compiler,
        "compiled",
        lambda command, file: used.append(command) or whole(command, file),
    )

    def last():
        """Return the options behind those of all code, when it was compiled last."""
        options = used[-2][used[-2].index("-fPIC") + 1 :]
        return options[: options.index("-c")]

    first = library_of(SOURCE)
    assert last() == []
    monkeypatch.setenv("TRUSSFLOW_CFLAGS", "-O3 -g")
    assert library_of(SOURCE) != first
    assert last() == ["-O3", "-g"]
    monkeypatch.setattr(compiler, "LARGE_SOURCE", len(SOURCE))
    library_of(SOURCE + "\n")
    assert last() == ["-O1", "-O3", "-g"]


@pytest.mark.parametrize(
    "file", ["codegen.py", "operations.py", "fma.h", "lanes.h", "driver.c"]
)
def test_code_that_writes_the_source_is_part_of_the_name(
    file, run, builds, monkeypatch
):
    first, second = run("compiled"), run("compiled")
    assert_array_equal(first["spring.y"], second["spring.y"])
    assert len(builds) == 1
    read = codegen.c_file
    monkeypatch.setattr(
        codegen, "c_file", lambda n: read(n) + ("\n" if n == file else "")
    )
    run("compiled")
    assert len(builds) == 2


def test_folder_that_cannot_be_written_is_replaced(tmp_path, run, monkeypatch, builds):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("TRUSSFLOW_CACHE", str(tmp_path / "file" / "cache"))
    with pytest.warns(
        RuntimeWarning, match="compiled code cannot be cached in .*Not a directory"
    ) as hints:
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

    def started():
        command = [sys.executable, "-c", code, SOURCE]
        return subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    processes = [started() for _ in range(2)]
    for process in processes:
        assert process.stdout.readline() == "ready\n"
    for process in processes:
        process.stdin.write("go\n")
        process.stdin.flush()
    assert [process.communicate()[0] for process in processes] == ["42.0\n"] * 2
    assert len(list(cache.iterdir())) == 1


@pytest.mark.usefixtures("no_compiler")
def test_without_a_compiler_the_interpreter_runs_with_one_hint(run):
    """The hint names the line of the user, here that of the fixture."""
    expected = run("interpreted")
    with pytest.warns(
        RuntimeWarning, match="no C compiler was found.*pip install ziglang"
    ) as hints:
        result = run()
    (hint,) = hints
    assert hint.filename == run.__code__.co_filename
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        again = run()
    assert result.attrs["backend"] == again.attrs["backend"] == "interpreted"
    assert_array_equal(result["spring.y"], expected["spring.y"])
    with pytest.raises(CompilationError, match="no C compiler was found"):
        run("compiled")


def test_several_files_become_one_library():
    """The files are compiled at the same time, and refer to each other."""
    caller = "double part(void);\ndouble answer(void) { return 2 * part(); }\n"
    callee = "double part(void) { return 21.0; }\n"
    library = ctypes.CDLL(
        str(compile_library(caller + callee, lambda: [caller, callee]))
    )
    library.answer.restype = ctypes.c_double
    assert library.answer() == 42.0


def test_compiler_that_cannot_be_run_is_reported(tmp_path, monkeypatch):
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
    monkeypatch.setenv("CC", f"{mine} -m64")
    assert find_compiler() == (str(mine), "-m64")
    for name in ("missing-compiler", "", "\t \n"):
        find_compiler.cache_clear()
        monkeypatch.setenv("CC", name)
        command = find_compiler()
        assert command is None or command[0] not in (name, "")


def test_files_that_are_old_or_too_much_are_deleted(cache, builds, monkeypatch):
    """The file used longest ago goes first, never one that another process may be about to load."""
    libraries = [library_of(SOURCE + "\n" * k) for k in range(4)]
    size = libraries[0].stat().st_size
    assert compile_cache.cache_size() == 4 * size
    monkeypatch.setattr(compile_cache, "MAX_BYTES", 1.5 * size)
    for library, days in zip(libraries, (100.0, 2.0, 1.0, 0.0), strict=True):
        os.utime(library, times=(0.0, time.time() - days * 86_400.0))
    assert library_of(SOURCE) == libraries[0]  # used now
    hash_of_version_1 = libraries[1].with_suffix(".sha256")
    hash_of_version_1.write_text("")
    os.utime(hash_of_version_1, times=(0.0, 0.0))
    compile_cache._prune.cache_clear()
    fifth = library_of(SOURCE + "\n" * 4)
    assert {*cache.iterdir()} == {libraries[0], libraries[3], fifth}
    os.utime(fifth, times=(0.0, time.time() - 91.0 * 86_400.0))
    compile_cache._prune.cache_clear()
    monkeypatch.setattr(compile_cache, "MAX_BYTES", 10.0 * size)
    library_of(SOURCE + "\n" * 5)
    assert not fifth.exists()
    assert len(builds) == 6


def test_cache_is_in_the_users_folder_by_default(monkeypatch):
    monkeypatch.delenv("TRUSSFLOW_CACHE")
    assert compile_cache.cache_folder().name == "trussflow"
