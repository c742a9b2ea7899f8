"""Files written in one piece."""

import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest

from trussflow.blocks.support.files import (
    LOCK_SUFFIX,
    deleted,
    locked,
    own_folder,
    replaced,
)

KILLED_WRITER = """
import os, sys
from trussflow.blocks.support.files import replaced
with replaced(sys.argv[1]) as partial:
    partial.write_text("half")
    os.kill(os.getpid(), 9)
"""
posix = pytest.mark.skipif(os.name == "nt", reason="nothing is locked there")


def test_the_new_file_appears_whole_and_alone(tmp_path):
    file = tmp_path / "result.txt"
    file.write_text("old")
    with replaced(file) as partial:
        partial.write_text("new")
        assert file.read_text() == "old"
    assert file.read_text() == "new"
    assert list(tmp_path.iterdir()) == [file]


def test_an_error_leaves_the_old_file_and_nothing_else(tmp_path):
    file = tmp_path / "result.txt"
    file.write_text("old")
    with pytest.raises(RuntimeError, match="half way"), replaced(file) as partial:  # noqa: PT012
        partial.write_text("ne")
        raise RuntimeError("half way")
    assert file.read_text() == "old"
    assert list(tmp_path.iterdir()) == [file]


@posix
def test_what_a_killed_process_left_goes_with_the_next_file(tmp_path):
    file, next_file = tmp_path / "result.txt", tmp_path / "next.txt"
    file.write_text("old")
    subprocess.run([sys.executable, "-c", KILLED_WRITER, str(file)], check=False)
    assert file.read_text() == "old"
    assert len(list(tmp_path.iterdir())) == 3
    with replaced(next_file) as partial:
        partial.write_text("new")
    assert sorted(tmp_path.iterdir()) == [next_file, file]


def test_several_are_written_at_once(tmp_path):
    first, second = tmp_path / "first.txt", tmp_path / "second.txt"
    with replaced(first) as a, replaced(second) as b, replaced(first) as c:
        for partial, text in ((a, "a"), (b, "b"), (c, "c")):
            partial.write_text(text)
    assert (first.read_text(), second.read_text()) == ("a", "b")
    assert sorted(tmp_path.iterdir()) == [first, second]


@posix
def test_file_systems_without_locks_will_do(tmp_path, monkeypatch):
    """Leftovers of killed processes cannot be recognized there, and stay."""
    import fcntl

    def refused(*_):
        raise OSError(38, "Function not implemented")

    first, second = tmp_path / "first.txt", tmp_path / "second.txt"
    monkeypatch.setattr(fcntl, "flock", refused)
    with replaced(first) as a, replaced(second) as b:
        a.write_text("a")
        b.write_text("b")
    assert sorted(tmp_path.iterdir()) == [first, second]


@posix
def test_folders_that_are_made_at_once_are_all_locked(tmp_path):
    with ThreadPoolExecutor(8) as pool:
        made = list(pool.map(lambda _: own_folder(tmp_path, ".trussflow-"), range(100)))
    for folder, lock in made:
        assert folder.is_dir()
        assert folder.with_suffix(LOCK_SUFFIX).is_file()
        lock.close()
    deleted(*own_folder(tmp_path, ".trussflow-"))
    assert list(tmp_path.iterdir()) == []


@posix
def test_a_deleted_file_cannot_be_locked(tmp_path, monkeypatch):
    """A new file under its name, of another process, would not be protected."""
    path = tmp_path / "lock"

    def replaced_file(*_):
        path.unlink()
        path.touch()

    monkeypatch.setattr("fcntl.flock", replaced_file)
    with pytest.raises(BlockingIOError, match="was deleted while"):
        locked(path)


@posix
@pytest.mark.parametrize("made", [True, False])
def test_what_is_cut_short_is_done_later(made, tmp_path, monkeypatch):
    """A process may be killed when it has made or deleted either of a folder and its lock."""
    first, second, theirs = (
        tmp_path / "first.txt",
        tmp_path / "second.txt",
        tmp_path / ".trussflow-theirs",
    )
    theirs.mkdir()
    with monkeypatch.context() as patched:
        patched.setattr(shutil, "rmtree", lambda *_, **__: None)
        with replaced(first) as partial:
            partial.write_text("a")
    (lock,) = tmp_path.glob("*.lock")
    assert lock.with_suffix("").is_dir()
    if not made:
        lock.with_suffix("").rmdir()
    with replaced(second) as partial:
        partial.write_text("b")
    assert sorted(tmp_path.iterdir()) == [theirs, first, second]
