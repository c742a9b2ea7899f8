"""Writing FMU files: whole or not at all, by function or from the command line."""

import os
import tempfile
import zipfile
from importlib.util import find_spec

import pytest
from fmpy import read_model_description, simulate_fmu
from fmpy.validation import validate_fmu
from systems import doubled, series

from trussflow.blocks import Constant, Integrator, Session
from trussflow.blocks.tracing import compiler
from trussflow.fmu import ExportError, Fmu, export
from trussflow.fmu.__main__ import main
from trussflow.fmu.exporting.native import binaries


def test_files_are_reproducible_without_headers_and_absolute_paths(systems, tmp_path):
    one, two = (
        export(systems.Oscillator(2), tmp_path / f"{name}.fmu")
        for name in ("one", "two")
    )
    assert one.read_bytes() == two.read_bytes()
    with zipfile.ZipFile(one) as archive:
        for name in archive.namelist():
            assert not name.endswith(".h")
            assert str(tmp_path).encode() not in archive.read(name)


def python_diagram():
    return doubled(Constant(1.0))


@pytest.mark.parametrize(
    "make, name, settings, text",
    [
        (
            Integrator,
            "x.fmu",
            {"kind": "java"},
            "unknown kind of FMU 'java'; choose from: native, python",
        ),
        (
            Integrator,
            "x.fmu",
            {"version": "1.0"},
            "unknown FMI version '1.0'; choose from: 2.0, 3.0",
        ),
        (
            Integrator,
            "x.fmu",
            {"platforms": ["amiga"]},
            "platform 'amiga'; choose from: x86_64-linux",
        ),
        (
            Integrator,
            "x.fmu",
            {"platforms": "all", "kind": "python"},
            "contains the binaries of pythonfmu",
        ),
        (
            Integrator,
            "x.fmu",
            {"solver": "euler"},
            "unknown solver for kind='native': 'euler'; choose from: rk4, RK45",
        ),
        (python_diagram, "x.fmu", {}, r"'double' \(PythonFunction\) runs Python code"),
        (
            Integrator,
            "x.fmu",
            {"about": {"autor": "N"}},
            "unknown attribute of an FMU 'autor'; choose from: author",
        ),
        (
            Integrator,
            "x.fmu",
            {"about": {"author": 1}},
            "its author must be text, not 1",
        ),
        (Integrator, "missing/x.fmu", {}, "there is no folder"),
        (Integrator, "", {}, "it is a folder; name a file"),
    ],
)
def test_exports_that_are_refused(make, name, settings, text, tmp_path):
    with pytest.raises(ExportError, match=text):
        export(make(), tmp_path / name, **settings)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", ["native", "python"])
def test_imported_fmus_are_refused_by_name(tmp_path, kind):
    """Their outputs at the start follow from code that cannot be analyzed."""
    inner = export(Integrator(), tmp_path / "inner.fmu")
    diagram = series(fmu=Fmu(inner))
    diagram.expose(u=diagram.fmu.u, y=diagram.fmu.y)
    with pytest.raises(
        ExportError, match=r"'fmu' \(Fmu\) .*there is trussflow.fmu.ssp.export_ssp"
    ):
        export(diagram, tmp_path / "x.fmu", kind=kind)
    assert list(tmp_path.iterdir()) == [inner]


def test_exported_again_beside_a_running_import(tmp_path):
    """The copy on trial is the new one, and the one that runs goes on running."""
    block = Fmu(export(python_diagram(), tmp_path / "one.fmu", kind="python"), step=0.1)
    with Session(block, step=0.1) as session:
        again = export(python_diagram(), tmp_path / "two.fmu", kind="python")
        session.advance(0.2)
        assert session.outputs["y"] == 2.0
    assert again.read_bytes() == (tmp_path / "one.fmu").read_bytes()
    assert export(python_diagram(), tmp_path / "three.fmu", kind="python").is_file()


@pytest.mark.skipif(
    os.name == "nt" or os.geteuid() == 0, reason="the superuser may write anywhere"
)
def test_folder_without_permission(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(ExportError, match="is not writable"):
        export(Integrator(), tmp_path / "x.fmu")


def test_no_compiler(tmp_path, monkeypatch):
    monkeypatch.setattr(binaries, "find_compiler", lambda: None)
    with pytest.raises(
        ExportError, match="no C compiler was found; install gcc or clang"
    ):
        export(Integrator(), tmp_path / "x.fmu")
    assert list(tmp_path.iterdir()) == []
    path = export(Integrator(), tmp_path / "x.fmu", platforms=())
    with zipfile.ZipFile(path) as archive:
        assert not [name for name in archive.namelist() if name.startswith("binaries")]


def test_a_compiler_that_fails(tmp_path, monkeypatch):
    """Nothing is left behind, and the compiler's output is in the message."""
    monkeypatch.setattr(binaries, "COMPILER_FLAGS", ("-fno-such-flag",))
    compiler.identity.cache_clear()
    with pytest.raises(ExportError, match="no-such-flag"):
        export(Integrator(), tmp_path / "x.fmu")
    assert list(tmp_path.iterdir()) == []


def test_no_room_for_temporary_files(tmp_path, monkeypatch):
    """One error with the path, although the compiled code is in the cache."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "nowhere"))
    with pytest.raises(
        ExportError, match=r"cannot export .*No such file or directory: '.*nowhere"
    ):
        export(Integrator(), tmp_path / "x.fmu")
    assert list(tmp_path.iterdir()) == []


def test_other_platforms_without_ziglang(tmp_path, monkeypatch):
    def find(name):
        return None if name == "ziglang" else find_spec(name)

    monkeypatch.setattr(binaries, "find_spec", find)
    other = "x86_64-windows" if binaries.here().system != "windows" else "x86_64-linux"
    with pytest.raises(
        ExportError, match=f"cannot compile for {other} on .*pip install ziglang"
    ):
        export(Integrator(), tmp_path / "x.fmu", platforms=[other])


def test_command_line(tmp_path, capsys):
    path = tmp_path / "sum.fmu"
    arguments = ["export", "trussflow.blocks:Integrator", str(path), "--version", "3.0"]
    assert main([*arguments, "--parameter", "initial_value=2.5"]) == 0
    assert str(path) in capsys.readouterr().out
    result = simulate_fmu(
        str(path), stop_time=1.0, start_values={"u": 2.0}, output=["y"]
    )
    assert result["y"][-1] == pytest.approx(4.5, abs=1e-12)


@pytest.mark.parametrize(
    "item, options, text",
    [
        ("nowhere.to.be.found:x", [], "cannot import 'nowhere.to.be.found'"),
        (
            "trussflow.blocks:Intergator",
            [],
            "there is no 'Intergator'; did you mean 'Integrator'?",
        ),
        (
            "trussflow.blocks:Integrator",
            ["--solver", "euler"],
            "unknown solver for kind='native': 'euler'",
        ),
        ("trussflow.blocks:StateSpace", [], "cannot be called without arguments"),
        ("math:pi", [], "not a block; write module:name or file.py:name of a block"),
        (
            "trussflow.blocks:Integrator",
            ["--parameter", "initial_value=x"],
            "write name=number",
        ),
    ],
)
def test_command_line_errors(item, options, text, tmp_path, capsys):
    assert main(["export", item, str(tmp_path / "x.fmu"), *options]) == 2
    assert text in capsys.readouterr().err


def test_scalars_of_fmi_3(exported, systems):
    """One variable per element: value references count them, which OMSimulator takes for granted."""
    path = exported(
        systems.Oscillator(2), "3.0", "scalars", arrays=False, about={"author": "N. N."}
    )
    assert validate_fmu(str(path)) == []
    about = read_model_description(str(path))
    assert about.author == "N. N."
    found = {v.name: v.valueReference for v in about.modelVariables if not v.dimensions}
    assert list(found.values()) == list(range(1, 1 + len(about.modelVariables)))
    assert {u.variable.name for u in about.outputs} == {
        "position[1]",
        "position[2]",
        "angle",
        "total",
    }
    rows = [
        simulate_fmu(str(p), stop_time=1.0, start_values={f"stiffness{end}": value})[
            "total"
        ]
        for p, end, value in (
            (path, "[1]", 7.0),
            (exported(systems.Oscillator(2), "3.0"), "", "7 4"),
        )
    ]
    assert rows[0].tolist() == rows[1].tolist()
