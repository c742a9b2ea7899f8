"""Parameter files: every value has unit and source, and every mistake has its message."""

import os
import re
import tomllib

import numpy as np
import pint
import pytest
from numpy.testing import assert_array_equal

from trussflow.models import (
    ModelError,
    ParameterTable,
    RobotArm,
    Structure,
    shipped_file,
)
from trussflow.models.layered_file import LayeredFile
from trussflow.models.truss.truss_modes import TrussModes
from trussflow.models.viewer.motion import opened

SHIPPED = (
    "robot_arm_literal.toml",
    "robot_arm_jaco.toml",
    "space_truss.toml",
    "transport.toml",
    "mean_axes.toml",
    "hardware.toml",
    "case_1.toml",
    "case_2.toml",
)
SOURCES = re.compile(r"^(paper|Kinova|reconstructed|assumed|chosen|goal)\b")


def entries(table, place=""):
    """Yield every value of a parsed file with its place."""
    if isinstance(table, list):
        for i, item in enumerate(table):
            yield from entries(item, f"{place}[{i}]")
    elif isinstance(table, dict) and "value" in table:
        yield place, table
    elif isinstance(table, dict):
        for key, item in table.items():
            yield from entries(item, f"{place}.{key}")


@pytest.fixture(scope="module")
def units():
    return pint.UnitRegistry()


@pytest.mark.parametrize("name", SHIPPED)
def test_every_shipped_value_has_unit_and_source(name, units):
    values = list(
        entries(tomllib.loads(shipped_file(name).read_text(encoding="utf-8")))
    )
    assert len(values) >= 5
    for place, entry in values:
        assert set(entry) == {"value", "unit", "source"}, place
        assert SOURCES.match(entry["source"]), f"{place}: {entry['source']}"
        units.Unit(entry["unit"])
        assert np.all(np.isfinite(entry["value"])), place


@pytest.fixture
def table():
    text = """
        plain = 3
        name = "thing"
        length = { value = 2.5, unit = "m", source = "here" }
        vector = { value = [1, 2, 3], unit = "m", source = "here" }
        words = { value = "long", unit = "m", source = "here" }
        endless = { value = inf, unit = "m", source = "here" }
        bare = { value = 1.0, unit = "m" }
        [inner]
        deep = { value = 1, unit = "1", source = "here" }
        [[rows]]
        name = "first"
    """
    return ParameterTable(tomllib.loads(text), "file.toml")


def test_values_are_read_in_their_unit(table):
    assert table.scalar("length", "m") == 2.5
    assert_array_equal(table.array("vector", "m", (3,)), [1.0, 2.0, 3.0])
    assert_array_equal(table.array("vector", "m", (None,)), [1.0, 2.0, 3.0])
    assert table.table("inner").scalar("deep", "1") == 1.0
    assert table.tables("rows")[0].text("name") == "first"
    assert table.text("name") == "thing"
    assert "length" in table
    assert "width" not in table


def test_text_is_converted(tmp_path):
    path = tmp_path / "file.toml"
    path.write_text(
        'a = "60 deg"\nb = "[1, 2.5, -3e1] mm"\nc = "3 %"\nd = "1.5"\ne = "4 N*m"\n',
        encoding="utf-8",
    )
    table = ParameterTable.read(path)
    assert table.scalar("a", "rad") == pytest.approx(np.pi / 3, rel=1e-15)
    assert_array_equal(table.array("b", "m", (3,)), [1e-3, 2.5e-3, -30e-3])
    assert (
        table.scalar("c", "1"),
        table.scalar("d", "1"),
        table.scalar("e", "N*m"),
    ) == (0.03, 1.5, 4.0)


def test_errors_name_the_line(tmp_path):
    path = tmp_path / "file.toml"
    path.write_text(
        '# a comment\nx = "1 s"\n[a]\nx = "2 s"\n\n[[b]]\nx = "1 m"\n[[b]]\nx = "1 kg"\n',
        encoding="utf-8",
    )
    file = ParameterTable.read(path)
    for table, line in ((file, 2), (file.table("a"), 4), (file.tables("b")[1], 9)):
        with pytest.raises(ModelError, match=rf"'x' .*\(line {line}\)"):
            table.scalar("x", "m")


@pytest.mark.parametrize(
    "read, message",
    [
        (
            lambda table: table.scalar("length", "mm"),
            r"file.toml: 'length' is given in 'm'; it must be in 'mm'",
        ),
        (
            lambda table: table.table("inner").scalar("depth", "1"),
            r"inner: 'depth' is missing; found deep",
        ),
        (lambda table: table.scalar("bare", "m"), "'bare' has no 'source'"),
        (lambda table: table.scalar("plain", "m"), r"'plain' must read \{value"),
        (
            lambda table: table.array("vector", "m", (2,)),
            r"file.toml: 'vector' has shape \(3,\); it must be \(2,\)",
        ),
        (lambda table: table.scalar("endless", "m"), "'endless' is not finite"),
        (lambda table: table.scalar("words", "m"), "'words' must be numeric, not"),
        (lambda table: table.table("plain"), "'plain' must be a table"),
        (
            lambda table: table.tables("inner"),
            r"'inner' must be an array of tables, each headed \[\[inner",
        ),
        (lambda table: table.text("plain"), "'plain' must be text"),
    ],
)
def test_errors(table, read, message):
    with pytest.raises(ModelError, match=message):
        read(table)


def test_unreadable_files(tmp_path):
    with pytest.raises(ModelError, match=r"cannot read parameter file .*No such file"):
        ParameterTable.read(tmp_path / "absent.toml")
    broken = tmp_path / "broken.toml"
    for text, fault in (
        ("mass = = 3", "Invalid value"),
        ("a = " + "[" * 100_000, "it is nested too deeply"),
    ):
        broken.write_text(text)
        with pytest.raises(ModelError, match=rf"it is not TOML \({fault}"):
            ParameterTable.read(broken)
    broken.write_text(f'extends = "{"a" * 300}"')
    with pytest.raises(
        ModelError, match=r"'extends' names no file: no parameter file 'aaa"
    ):
        LayeredFile.read(broken)


READERS = {
    "parameters.toml": ParameterTable.read,
    "modes.json": TrussModes.load,
    "robot.urdf": lambda path: RobotArm.from_urdf(path, hand="a", base="b"),
    "places.npy": lambda path: Structure.from_matrices(
        np.eye(3), np.eye(3), path, units=("m", "kg", "s")
    ),
    "result.nc": opened,
}


@pytest.mark.skipif(os.name == "nt", reason="there are no such pipes")
@pytest.mark.parametrize("name", READERS)
def test_readers_take_regular_files_only(name, tmp_path):
    os.mkfifo(tmp_path / name)
    with pytest.raises(
        ModelError, match=rf"{re.escape(name)}': it is a device, a pipe or a socket"
    ):
        READERS[name](tmp_path / name)


def test_unknown_shipped_file():
    with pytest.raises(
        ModelError,
        match=r"'absent.toml' comes with trussflow; there are: case_1.toml, case_2.toml, hardware.toml, m",
    ):
        shipped_file("absent.toml")
