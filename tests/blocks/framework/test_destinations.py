"""Targets of files: special files are refused, links are followed, temporary folders are named."""

import os
import stat
import subprocess
import sys

import pytest
from systems import series

from trussflow.blocks import Constant, Integrator, save, simulate
from trussflow.blocks.errors import TrussflowError
from trussflow.blocks.support import temporary_folders
from trussflow.blocks.support.files import replaced
from trussflow.fmu import export


def growing():
    diagram = series(one=Constant(1.0), state=Integrator())
    diagram.expose(y=diagram.state.y)
    return diagram


@pytest.mark.skipif(os.name != "posix", reason="pipes with names")
def test_what_is_no_file_is_not_replaced(tmp_path):
    pipe = tmp_path / "run.nc"
    os.mkfifo(pipe)
    with pytest.raises(OSError, match="a pipe"), replaced(pipe) as partial:
        partial.write_text("new")
    result = simulate(growing(), 1.0, step=0.1, backend="numpy")
    for write in (
        lambda: save(result, pipe),
        lambda: simulate(growing(), 1.0, step=0.1, backend="numpy", stream_to=pipe),
        lambda: export(growing(), pipe),
    ):
        with pytest.raises(
            TrussflowError, match=r"cannot write .*run\.nc': it is a device, a pipe"
        ):
            write()
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    assert list(tmp_path.iterdir()) == [pipe]


@pytest.mark.skipif(os.name != "posix", reason="links need rights elsewhere")
def test_links_are_followed(tmp_path):
    file, link = tmp_path / "there" / "run.nc", tmp_path / "run.nc"
    file.parent.mkdir()
    link.symlink_to(file)
    result = simulate(growing(), 1.0, step=0.1, backend="numpy", stream_to=link)
    assert (file.is_file(), link.is_symlink(), result.sizes["time"]) == (True, True, 11)
    result.close()
    save(result, link)
    assert (file.is_file(), link.is_symlink()) == (True, True)
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["run.nc", "run.nc", "there"]


def test_temporary_folders_are_named_and_made_anew():
    code = (
        "import shutil, tempfile; from trussflow.blocks.support.temporary_folders import *\n"
        "print(with_place(OSError('full')))\n"
        "shutil.rmtree(process_folder())\n"
        "print(process_folder().is_dir(), tempfile.gettempdir())"
    )
    said = subprocess.check_output([sys.executable, "-c", code], text=True)
    first, made, place = said.replace("\n", " ").rpartition(" True ")
    assert (first, made) == (
        f"(temporary files are in '{place.strip()}'): full",
        " True ",
    )


def test_libraries_that_cannot_be_mapped_say_what_may_be_why():
    said = temporary_folders.not_loaded(
        OSError("a.so: failed to map segment from shared object")
    )
    assert said.endswith("mounted noexec? TMPDIR and TRUSSFLOW_CACHE name another")
    assert temporary_folders.not_loaded(OSError("no such file")) == "no such file"
