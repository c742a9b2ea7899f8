"""Compilers and cached files that are wrong in any way: one error or one hint, and nothing foreign runs."""

import ctypes
import hashlib
import os
import re
import subprocess
import sys
import time
import warnings
from pathlib import Path

import campaign
import numpy as np
import pytest

from trussflow.blocks.support import call_site, temporary_folders
from trussflow.blocks.tracing import compiler
from trussflow.blocks.tracing.compile_cache import CompilationError
from trussflow.blocks.tracing.compiler import compile_library

SOURCE = "double answer(void) { return 42.0; }\n"
OTHER_USER = 65534
pytestmark = [
    pytest.mark.skipif(os.name == "nt", reason="modes and signals of POSIX"),
    pytest.mark.usefixtures("cache"),
]


def answer():
    """Compile, load and call."""
    library = compile_library(SOURCE, lambda: [SOURCE], ["answer"])
    loaded = ctypes.CDLL(str(library))
    loaded.answer.restype = ctypes.c_double
    assert loaded.answer() == 42.0
    return library


# -- what is in the cache -----------------------------------------------------------------------


def empty(path):
    path.unlink()  # this process has it loaded: not in place
    path.write_bytes(b"")


def nonsense(path):
    path.unlink()
    path.write_bytes(b"\x7fELF\xff nonsense")


def foreign(path):
    os.chown(path, OTHER_USER, OTHER_USER)


def writable(path):
    path.chmod(0o622)


def gone(path):
    path.unlink()


def fifo(path):
    path.unlink()
    os.mkfifo(path)


def folder(path):
    path.unlink()
    path.mkdir()
    (path / "file").write_text("")


def link(path):
    path.symlink_to(path.rename(path.with_suffix(".elsewhere")))


def dangling(path):
    path.unlink()
    path.symlink_to("nowhere")


DAMAGES = [empty, nonsense, writable, gone, fifo, folder, link, dangling]
if os.name != "nt" and os.geteuid() == 0:  # only the superuser can give files away
    DAMAGES.append(foreign)


@pytest.mark.parametrize(
    "seed", [*range(6), *(campaign.only(6 + k) for k in range(100 * campaign.SIZE))]
)
def test_cached_files_that_are_damaged_or_not_ours_are_made_anew(seed, cache):
    """Damage the library; afterwards the cache is used again."""
    random = np.random.default_rng(campaign.SEED + seed)
    library = answer()
    good = library.read_bytes()
    DAMAGES[random.integers(len(DAMAGES))](library)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert compile_library(SOURCE, lambda: [SOURCE], ["answer"]) == library
    assert library.read_bytes() == good
    assert library.lstat().st_mode & 0o777 == 0o600
    compile_library(SOURCE, lambda: pytest.fail("it is not kept"), ["answer"])
    assert library.parent == cache


@pytest.mark.parametrize("content", [b"no library", None])
def test_a_library_that_fits_its_hash_and_is_none_is_made_anew(content):
    library = answer()
    if content is None:  # a library without the function
        content = compile_library(
            "int nothing;\n", lambda: ["int nothing;\n"]
        ).read_bytes()
    script = (
        "import sys; from trussflow.blocks.tracing.compiler import compile_library\n"
        f"print(compile_library({SOURCE!r}, lambda: [{SOURCE!r}], ['answer']))"
    )
    library.unlink()
    key, digest = library.name[:33], hashlib.sha256(content).hexdigest()[:32]
    unusable = library.with_name(f"{key}{digest}.so")
    unusable.write_bytes(content)
    unusable.chmod(0o600)
    for _ in range(2):  # a process that has loaded it would not see the new one
        ended = subprocess.run(
            [sys.executable, "-c", script], capture_output=True, text=True, check=True
        )
    assert (ended.stdout.strip(), ended.stderr) == (str(library), "")
    assert unusable.is_file()


@pytest.mark.parametrize(
    "spoil", [foreign, lambda path: path.chmod(0o777), lambda path: path.chmod(0o770)]
)
def test_folder_that_others_may_write_to_is_not_used(spoil, cache):
    """Refuse a folder that another user could have written to, whatever the hash."""
    if spoil is foreign and os.geteuid() != 0:
        pytest.skip("only the superuser can give files away")
    planted = answer()
    spoil(cache)
    with pytest.warns(
        RuntimeWarning, match="cannot be cached in .*others may write to it"
    ) as hints:
        used = answer()
    assert len(hints) == 1
    assert planted != used
    assert temporary_folders.process_folder() in used.parents
    assert answer() == used


def test_a_new_folder_is_ours_alone(cache):
    before = os.umask(0o002)  # of systems on which each user has a group
    try:
        assert answer().parent == cache
    finally:
        os.umask(before)
    assert cache.stat().st_mode & 0o777 == 0o700
    assert answer().parent == cache


# -- compilers ----------------------------------------------------------------------------------

COMPILER_SCRIPTS = {
    "fails": ("exit 3", "ended with code 3 and without a message"),
    "fails in no language": (
        r"printf '\377\376 no' >&2; exit 1",
        "failed:\n\ufffd\ufffd no",
    ),
    "killed": ("kill -9 $$", "ended with code -9"),
    "writes nothing": ("exit 0", "ended with code 0 and without a message"),
    "chats and writes nothing": (
        r"printf '\377 all is well'; exit 0",
        "ended with code 0",
    ),
    "writes nonsense": (
        r'for o; do :; done; printf nonsense > "$o"',
        "cannot store and load",
    ),
    "writes a folder": ('for o; do :; done; mkdir "$o"', "without a message"),
    "hangs": ("sleep 1000 & wait", r"did not end within 0\.2 s"),
    "hangs when asked": ("sleep 1000", r"--version did not end within 0\.2 s"),
}


@pytest.mark.parametrize("script", COMPILER_SCRIPTS)
def test_compilers_that_do_not_work(script, run, tmp_path, monkeypatch):
    """Compiled code is refused with one error, and "auto" interprets with one warning that says why."""
    code, message = COMPILER_SCRIPTS[script]
    mine = tmp_path / "cc"
    asked = "" if script == "hangs when asked" else '[ "$1" = --version ] && exit 0\n'
    mine.write_text(f"#!/bin/sh\n{asked}{code}\n")
    mine.chmod(0o755)
    monkeypatch.setenv("CC", str(mine))
    monkeypatch.setattr(compiler, "COMPILE_TIMEOUT", 0.2 if script == "hangs" else 20.0)
    monkeypatch.setattr(compiler, "VERSION_TIMEOUT", 0.2 if "asked" in script else 20.0)
    begin = time.monotonic()
    with pytest.raises(CompilationError, match=message):
        run("compiled")
    assert time.monotonic() - begin < 20.0
    call_site._said.clear()
    with pytest.warns(
        RuntimeWarning, match=rf"interpreter, 20 times slower(.|\n)*({message})"
    ) as hints:
        assert run().attrs["backend"] == "interpreted"
    assert sum("interpreter" in str(hint.message) for hint in hints) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run()


# -- temporary folders --------------------------------------------------------------------------

HOLDER_SCRIPT = (
    "import sys, time; from trussflow.blocks.support.temporary_folders import process_folder\n"
    "(process_folder() / 'file').write_text('')\n"
    "print(process_folder(), flush=True)\n"
    "sys.stdin.readline()\n"
)


def holder(place, start=subprocess.Popen):
    """Start a process that has a temporary folder."""
    process = start(
        [sys.executable, "-c", HOLDER_SCRIPT],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "TMPDIR": str(place)},
    )
    return process, Path(process.stdout.readline().strip())


def test_temporary_folders_go_with_their_process_or_at_the_next_start(tmp_path):
    (tmp_path / "trussflow-of-mine").mkdir()
    (tmp_path / "trussflow-link").symlink_to(tmp_path)
    (tmp_path / "lock").write_text("")
    killed, ended, lives = holder(tmp_path), holder(tmp_path), holder(tmp_path)
    killed[0].kill()
    killed[0].communicate()
    ended[0].communicate("\n")
    assert [p.exists() for _, p in (killed, ended, lives)] == [True, False, True]
    last = holder(tmp_path)
    assert [p.exists() for _, p in (killed, lives, last)] == [False, True, True]
    for process, _ in (lives, last):
        process.communicate("\n")
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "lock",
        "trussflow-link",
        "trussflow-of-mine",
    ]


# -- surroundings -------------------------------------------------------------------------------

SIMULATION_SCRIPT = """
import resource, signal, sys, tempfile
from trussflow.blocks import Constant, Diagram, Integrator, simulate
d = Diagram("d")
c, x = d.add(c=Constant(1.0), x=Integrator())
c.y >> x.u
if sys.argv[1] != "0":
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]),) * 2)
if len(sys.argv) > 2:
    tempfile.tempdir = sys.argv[2]
print(simulate(d, 1.0, step=0.1).attrs["backend"])
"""


in_campaign = pytest.mark.campaign
TOO_LARGE = r"if small: cannot compile \(temporary files are in '/.*File too large"
NO_FOLDER = "if small: cannot compile .*No such file or directory: '/nowhere"


@pytest.mark.parametrize(
    "variables, arguments, backend, message",
    [
        (
            {"TRUSSFLOW_CACHE": "/dev/null/x"},
            ["0"],
            "compiled",
            "code cannot be cached in '/dev/null/x'",
        ),
        pytest.param({"HOME": "/nowhere"}, ["0"], "compiled", "", marks=in_campaign),
        pytest.param({"TMPDIR": "/nowhere"}, ["0"], "compiled", "", marks=in_campaign),
        ({}, ["100"], "interpreted", TOO_LARGE),
        pytest.param(
            {},
            ["3000"],
            "interpreted",
            r"if small: .*\.so', which|File too large",
            marks=in_campaign,
        ),
        ({}, ["0", "/nowhere"], "interpreted", NO_FOLDER),
    ],
)
def test_surroundings_give_one_line(variables, arguments, backend, message):
    """Full disks, missing rights and missing folders; limits of 100 and 3000 bytes represent a full disk."""
    ended = subprocess.run(
        [sys.executable, "-c", SIMULATION_SCRIPT, *arguments],
        capture_output=True,
        text=True,
        env={**os.environ, **variables},
        check=False,
    )
    assert ended.stdout.strip() == backend, ended.stderr
    assert ended.stderr.count("Warning:") == bool(message), ended.stderr
    assert re.search(message, ended.stderr, re.DOTALL), ended.stderr
