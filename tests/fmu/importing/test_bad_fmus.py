"""Bad FMUs: each a clear error, and nothing left running or on disk."""

from __future__ import annotations

import os
import struct
import tempfile
import time
import zipfile
from collections.abc import Callable
from pathlib import Path

import fmpy
import pytest

from trussflow.blocks import Diagram, simulate
from trussflow.fmu import (
    Fmu,
    FmuArchiveError,
    FmuBinaryError,
    FmuCallError,
    FmuCrashError,
    FmuDescriptionError,
    FmuError,
    FmuTimeoutError,
    FmuUnitError,
)
from trussflow.fmu.runtime import archive

MakeFmu = Callable[..., Path]
versions = pytest.mark.parametrize("version", [2, 3])


def fly(block):
    diagram = Diagram("bad")
    diagram.add(fmu=block)
    simulate(diagram, 1.0, step=0.1)


# -- archives -----------------------------------------------------------------------------------


def test_a_missing_file(tmp_path):
    with pytest.raises(FmuArchiveError, match=r"nowhere\.fmu': there is no such file"):
        Fmu(tmp_path / "nowhere.fmu")


def test_no_path():
    with pytest.raises(FmuError, match="cannot open the FMU 3: give the path of a file"):
        Fmu(3)  # type: ignore[arg-type]


def test_not_a_zip(tmp_path):
    path = tmp_path / "text.fmu"
    path.write_text("I am no FMU")
    with pytest.raises(FmuArchiveError, match="no zip archive, or a damaged one"):
        Fmu(path)


def test_a_folder(tmp_path):
    with pytest.raises(FmuArchiveError, match=r"cannot open .*[Dd]irectory"):
        Fmu(tmp_path)


def test_no_room_for_temporary_files(make_fmu, tmp_path, monkeypatch):
    path = make_fmu("ball")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "nowhere"))
    with pytest.raises(FmuDescriptionError, match=r"cannot read .* \(temporary files are in '.*nowhere'\)"):
        Fmu(path)
    with pytest.raises(FmuArchiveError, match=r"or unpack .* \(temporary files are in '.*nowhere'\)"):
        archive.unpack(path)


def test_a_truncated_zip(make_fmu):
    path = make_fmu("ball")
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(FmuArchiveError, match="no zip archive, or a damaged one"):
        Fmu(path)


def test_a_damaged_file_inside(make_fmu):
    """The checksum fails while the binary is unpacked; what was unpacked is deleted."""
    path = make_fmu("ball")
    content = bytearray(path.read_bytes())
    with zipfile.ZipFile(path) as archive:
        member = archive.infolist()[1]
    begin = member.header_offset + 30 + len(member.filename) + 100
    content[begin : begin + 8] = bytes(b ^ 0xFF for b in content[begin : begin + 8])
    path.write_bytes(content)
    with pytest.raises(FmuArchiveError, match="damaged"):
        fly(Fmu(path, kind="me"))


def test_no_model_description(make_fmu):
    with pytest.raises(FmuArchiveError, match=r"there is no modelDescription\.xml at its top"):
        Fmu(make_fmu("ball", more={"modelDescription.xml": None}))


@pytest.mark.parametrize(
    "name",
    ["../evil.so", "a/../../evil.so", "/etc/evil.so", "C:/evil.so", "a\\..\\evil.so", "../" + "a" * 5000],
)
def test_names_that_lead_outside(make_fmu, tmp_path, name):
    path = make_fmu("ball", more={name: b"evil"})
    with pytest.raises(FmuArchiveError, match=r"refused to unpack .*(outside|no part of a path)") as error:
        Fmu(path)
    assert len(str(error.value).removeprefix(f"refused to unpack '{path}'")) < 400  # long names are cut
    assert not list(tmp_path.rglob("evil*"))


def test_links(make_fmu):
    path = make_fmu("ball")
    link = zipfile.ZipInfo("resources/link")
    link.external_attr = 0o120777 << 16
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(link, "/etc/passwd")
    with pytest.raises(FmuArchiveError, match=r"link or a special file \('resources/link'\)"):
        Fmu(path)


def test_names_twice(make_fmu):
    path = make_fmu("ball")
    with pytest.warns(UserWarning, match="Duplicate"), zipfile.ZipFile(path, "a") as archive:
        archive.writestr("modelDescription.xml", "<other/>")
    with pytest.raises(FmuArchiveError, match=r"'modelDescription\.xml' is there twice"):
        Fmu(path)


def test_folders_twice_are_no_harm(make_fmu):
    path = make_fmu("ball", more={"extra/": b""})
    with pytest.warns(UserWarning, match="Duplicate"), zipfile.ZipFile(path, "a") as archive:
        archive.writestr("extra/", b"")
    fly(Fmu(path, kind="me"))


def test_too_large_archives(make_fmu):
    """A thousand megabytes of zeros take one megabyte of zip; here it is a hundred to one."""
    path = make_fmu("ball", more={"resources/zeros": bytes(5_000_000)})
    assert path.stat().st_size < 100_000
    with pytest.raises(FmuArchiveError, match=r"would take 5\.\d+ MB, more than 4 MB"):
        Fmu(path, max_bytes=4e6)


def test_sizes_that_lie(make_fmu):
    """An archive that says less than it holds: no more is unpacked than was said."""
    path = make_fmu("ball", more={"resources/zeros": bytes(5_000_000)})
    content = bytearray(path.read_bytes())
    for signature, offset in ((b"PK\x03\x04", 22), (b"PK\x01\x02", 24)):
        place = -1
        while (place := content.find(signature, place + 1)) >= 0:
            if struct.unpack_from("<I", content, place + offset)[0] == 5_000_000:
                struct.pack_into("<I", content, place + offset, 1000)
    path.write_bytes(content)
    with pytest.raises(FmuArchiveError, match="damaged"):
        fly(Fmu(path, kind="me", max_bytes=4e6))


def test_encrypted_archives(make_fmu):
    path = make_fmu("ball")
    content = bytearray(path.read_bytes())
    content[content.find(b"PK\x01\x02") + 8] |= 1  # a flag in the list of contents
    path.write_bytes(content)
    with pytest.raises(FmuArchiveError, match="an entry is encrypted"):
        Fmu(path)


def test_too_many_files_and_too_long_descriptions(make_fmu, monkeypatch):
    path = make_fmu("ball")
    monkeypatch.setattr(archive, "MAX_XML_BYTES", 1000)
    with pytest.raises(FmuArchiveError, match=r"its modelDescription\.xml has .* MB, more than"):
        Fmu(path)
    monkeypatch.setattr(archive, "MAX_FILES", 1)
    with pytest.raises(FmuArchiveError, match="it has 2 files, more than 1"):
        Fmu(path)


# -- model descriptions -------------------------------------------------------------------------

BOMB = """<?xml version="1.0"?><!DOCTYPE x [<!ENTITY a "aaaaaaaaaa">
<!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;"><!ENTITY c "&b;&b;&b;&b;&b;&b;&b;&b;">]>
<fmiModelDescription fmiVersion="2.0" modelName="&c;"/>"""
READER = """<?xml version="1.0"?><!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]>
<fmiModelDescription fmiVersion="2.0" modelName="&a;"/>"""


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<broken", "not well-formed XML"),
        ("", "not well-formed XML"),
        (BOMB, "declares a document type or entities"),
        (BOMB.encode("utf-16"), "declares a document type or entities"),
        (READER, "declares a document type or entities"),
        ("<a>" * 200 + "</a>" * 200, "nested more than 100 deep"),
        ("<a/>", "no model description of FMI"),
        ('<fmiModelDescription fmiVersion="1.0"/>', r"FMI 1\.0; FMI 2\.0 and 3\.0 can be imported"),
        ('<fmiModelDescription fmiVersion="2.0"/>', "has no ModelVariables"),
        (
            '<fmiModelDescription fmiVersion="2.0" modelName="x" guid="x"><ModelVariables/>'
            "</fmiModelDescription>",
            "neither co-simulation nor model exchange",
        ),
    ],
)
def test_broken_and_hostile_xml(make_fmu, text, message):
    with pytest.raises(FmuDescriptionError, match=message):
        Fmu(make_fmu("ball", more={"modelDescription.xml": text}))


@versions
def test_duplicate_names(make_fmu, version):
    path = make_fmu("ball", version, replace={'name="e"': 'name="g"'})
    with pytest.raises(FmuDescriptionError, match="2 variables are named 'g'"):
        Fmu(path)


@pytest.mark.parametrize(
    "dimension", ["<Dimension/>", '<Dimension valueReference="77"/>', '<Dimension start="²"/>']
)
def test_arrays_of_unknown_size(make_fmu, dimension):
    path = make_fmu("types", 3, replace={'<Dimension valueReference="20"/>': dimension})
    with pytest.raises(FmuDescriptionError, match="the size of array 'in' is not known"):
        Fmu(path)


def test_arrays_of_absurd_size(make_fmu):
    path = make_fmu("types", 3, replace={'start="3"': 'start="30000000000"'})
    with pytest.raises(FmuDescriptionError, match="'in' has 30000000000 elements"):
        Fmu(path)
    path = make_fmu("types", 3, replace={'start="3"': f'start="{"9" * 5000}"'})
    with pytest.raises(FmuDescriptionError, match="cannot read the model description"):
        Fmu(path)


@pytest.mark.parametrize(
    ("old", "new"), [('index="1"', 'index="99"'), ('valueReference="0"', 'valueReference="x"')]
)
def test_references_that_lead_nowhere(make_fmu, old, new):
    with pytest.raises(FmuDescriptionError, match="cannot read the model description of"):
        Fmu(make_fmu("ball", replace={old: new}))


@versions
def test_derivatives_of_nothing(make_fmu, version):
    state = "1" if version == 2 else "0"
    path = make_fmu("ball", version, replace={f'derivative="{state}"': ""})
    with pytest.raises(FmuDescriptionError, match=r"'der\(h\)' is listed as a derivative of a st"):
        Fmu(path)


@versions
def test_derivatives_that_nobody_needs_may_be_wrong(make_fmu, version):
    """States are for model exchange alone."""
    state = "1" if version == 2 else "0"
    path = make_fmu("ball", version, ["cs"], replace={f'derivative="{state}"': ""})
    fly(Fmu(path, step=0.1))


def test_start_values_that_are_no_numbers(make_fmu):
    path = make_fmu("ball", replace={'start="9.81"': 'start="much"'})
    with pytest.raises(FmuError, match="start value 'much' of variable 'g' does not fit"):
        Fmu(path)


@versions
def test_units_that_do_not_fit(make_fmu, version):
    """An FMU whose metre is a foot: the name means something else there than here."""
    path = make_fmu("ball", version, replace={'<BaseUnit m="1"/>': '<BaseUnit m="1" factor="0.3"/>'})
    with pytest.raises(FmuUnitError, match=r"'m' means 0\.3 m there, and something else here"):
        Fmu(path, kind="me")
    with pytest.raises(FmuUnitError, match=r"'ft' does not fit 'm' of FMU 'ball'.*0\.3 m"):
        Fmu(path, kind="me", units={"m": "ft"})
    assert Fmu(path, kind="me", units={"m": None}).h.unit is None


# -- binaries -----------------------------------------------------------------------------------


@versions
def test_a_missing_platform(make_fmu, version):
    folder = fmpy.platform if version == 2 else fmpy.platform_tuple
    here = f"binaries/{folder}/model{fmpy.sharedLibraryExtension}"
    path = make_fmu("ball", version, more={here: None, "binaries/amiga/model.so": b""})
    with pytest.raises(FmuBinaryError, match=r"no binary for this machine .*it has: amiga"):
        Fmu(path)


def test_a_binary_that_is_none(make_fmu):
    here = f"binaries/{fmpy.platform}/model{fmpy.sharedLibraryExtension}"
    with pytest.raises(FmuBinaryError, match="cannot be loaded"):
        fly(Fmu(make_fmu("ball", more={here: b"not a library"}), kind="me"))


def test_a_kind_that_is_not_there(make_fmu):
    with pytest.raises(FmuError, match="offers me, not 'cs'"):
        Fmu(make_fmu("ball", kinds=("me",)), kind="cs")


@versions
def test_a_wrong_token(make_fmu, version):
    token = "guid" if version == 2 else "instantiationToken"
    path = make_fmu("ball", version, replace={f'{token}="ball"': f'{token}="bell"'})
    with pytest.raises(FmuCallError, match=r"could not be instantiated(.|\n)*this is not my token"):
        fly(Fmu(path, kind="me"))


def test_a_file_that_was_written_anew(make_fmu):
    block = Fmu(make_fmu("ball"), kind="me")
    make_fmu("ball", replace={'start="9.81"': 'start="1.6"'})
    with pytest.raises(FmuError, match=r"'ball2\.fmu' was written anew since it was read"):
        fly(block)


# -- failing calls ------------------------------------------------------------------------------


@versions
@pytest.mark.parametrize("kind", ["cs", "me"])
def test_a_failing_initialization(make_fmu, version, kind):
    """The error has the FMU's own text, with what C's printf would write into it."""
    step = 0.1 if kind == "cs" else None
    given = {"fault": 1, "text": "too much fuel"}
    block = Fmu(make_fmu("ball", version), kind=kind, start=given, step=step)
    with pytest.raises(FmuCallError, match=r"too much fuel \(number 1\)") as caught:
        fly(block)
    assert caught.value.status == 3


@versions
@pytest.mark.parametrize("time_limit", [None, 20.0])
def test_a_failing_step(make_fmu, version, time_limit):
    block = Fmu(make_fmu("ball", version), step=0.1, parameters={"fault": 2}, time_limit=time_limit)
    with pytest.raises(FmuCallError, match=r"DoStep returned status 'error'(.|\n)*spring broke \(n"):
        fly(block)


@versions
def test_steps_that_are_always_discarded(make_fmu, version):
    path = make_fmu("ball", version)
    with pytest.raises(FmuCallError, match="and all parts of it"):
        fly(Fmu(path, step=0.1, parameters={"fault": 5}))
    path = make_fmu("ball", version, replace={'StepSize="true"': 'StepSize="false"'})
    with pytest.raises(FmuCallError, match="and does not take smaller ones"):
        fly(Fmu(path, step=0.1, parameters={"fault": 5}))


@versions
def test_what_an_fmu_says_after_a_discarded_step_is_not_the_cause(make_fmu, version):
    block = Fmu(make_fmu("ball", version), step=0.1, parameters={"fault": 12})
    with pytest.raises(
        FmuCallError, match=r"discarded its step of 0\.1 s from t = 0 s, and does not go on"
    ) as caught:
        fly(block)
    assert caught.value.status == 2


def processes():
    """Return the processes whose parent is this one."""
    found = set()
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if fields[1] == str(os.getpid()):
            found.add(folder.name)
    return found


@versions
def test_a_step_that_never_ends(make_fmu, version):
    before = processes()
    block = Fmu(make_fmu("ball", version), step=0.1, parameters={"fault": 3}, time_limit=0.5)
    begin = time.monotonic()
    with pytest.raises(FmuTimeoutError, match=r"'do_step' within 0\.5 s; its process was ended"):
        fly(block)
    assert time.monotonic() - begin < 30
    assert processes() <= before


@versions
def test_a_step_that_crashes(make_fmu, version):
    before = processes()
    block = Fmu(make_fmu("ball", version), step=0.1, parameters={"fault": 4}, time_limit=20.0)
    with pytest.raises(FmuCrashError, match=r"signal SIGABRT(.|\n)*about to crash \(number 7\)"):
        fly(block)
    assert processes() <= before
