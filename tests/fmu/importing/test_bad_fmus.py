"""Bad FMUs: each a clear error, and nothing left running or on disk."""

import struct
import tempfile
import time
import zipfile

import fmpy
import pytest
from systems import series

from trussflow.blocks import simulate
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

LIBRARY = f"binaries/{fmpy.platform}/model{fmpy.sharedLibraryExtension}"


def run(block):
    diagram = series(fmu=block)
    simulate(diagram, 1.0, step=0.1)


# -- archives -----------------------------------------------------------------------------------


def text_file(_make_fmu, folder):
    path = folder / "text.fmu"
    path.write_text("I am no FMU")
    return path


def truncated(make_fmu, _folder):
    path = make_fmu("ball")
    path.write_bytes(path.read_bytes()[:-200])
    return path


def linked(make_fmu, _folder):
    link = zipfile.ZipInfo("resources/link")
    link.external_attr = 0o120777 << 16
    return appended(make_fmu, link, "/etc/passwd")


def appended(make_fmu, *entry, **more):
    path = make_fmu("ball", **more)
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr(*entry)
    return path


def encrypted(make_fmu, _folder):
    path = make_fmu("ball")
    content = bytearray(path.read_bytes())
    content[content.find(b"PK\x01\x02") + 8] |= 1  # a flag in the list of contents
    path.write_bytes(content)
    return path


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda _, folder: folder / "nowhere.fmu", r"nowhere\.fmu': No such file"),
        (lambda _, folder: folder, "cannot open .*: it is a folder"),
        (lambda *_: "/dev/zero", "cannot open '/dev/zero': it is a device, a pipe"),
        (text_file, "not a zip archive, or it is damaged"),
        (truncated, "not a zip archive, or it is damaged"),
        (
            lambda make_fmu, _: make_fmu("ball", more={"modelDescription.xml": None}),
            r"it has no modelDescription\.xml at its top level",
        ),
        (linked, r"link or a special file \('resources/link'\)"),
        (encrypted, "an entry is encrypted"),
    ],
)
def test_archives_that_are_refused(make_fmu, tmp_path, make, message):
    with pytest.raises(FmuArchiveError, match=message):
        Fmu(make(make_fmu, tmp_path))


def test_no_room_for_temporary_files(make_fmu, tmp_path, monkeypatch):
    path = make_fmu("ball")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "nowhere"))
    with pytest.raises(
        FmuArchiveError, match=r"or unpack .* \(temporary files are in '.*nowhere'\)"
    ):
        archive.unpack(path)


@pytest.mark.parametrize(
    "name",
    [
        "../evil.so",
        "a/../../evil.so",
        "/etc/evil.so",
        "C:/evil.so",
        "a\\..\\evil.so",
        "../" + "a" * 5000,
    ],
)
def test_names_that_lead_outside(make_fmu, tmp_path, name):
    path = make_fmu("ball", more={name: b"evil"})
    with pytest.raises(
        FmuArchiveError, match=r"refused to unpack .*(outside|not allowed in a path)"
    ) as error:
        Fmu(path)
    # long names are cut
    assert len(str(error.value).removeprefix(f"refused to unpack '{path}'")) < 400
    assert not list(tmp_path.rglob("evil*"))


def test_names_twice(make_fmu):
    """Folders and files that are listed twice with the same content do no harm."""
    with pytest.warns(UserWarning, match="Duplicate"):
        path = appended(make_fmu, "modelDescription.xml", "<other/>")
    with pytest.raises(
        FmuArchiveError, match=r"'modelDescription\.xml' is there twice"
    ):
        Fmu(path)
    for name, content in (("extra/", b""), ("extra/a.xml", b"<a/>")):
        with pytest.warns(UserWarning, match="Duplicate"):
            path = appended(make_fmu, name, content, more={name: content})
        run(Fmu(path, kind="me"))


def test_archives_that_are_too_large(make_fmu, monkeypatch):
    """A thousand megabytes of zeros take one megabyte of zip; here it is a hundred to one."""
    path = make_fmu("ball", more={"resources/zeros": bytes(5_000_000)})
    assert path.stat().st_size < 100_000
    monkeypatch.setattr(archive, "MAX_XML_BYTES", 1000)
    with pytest.raises(
        FmuArchiveError, match=r"its modelDescription\.xml has .* MB, more than"
    ):
        Fmu(path)
    monkeypatch.setattr(archive, "MAX_BYTES", 4e6)
    with pytest.raises(FmuArchiveError, match=r"would take 5\.\d+ MB, more than 4 MB"):
        Fmu(path)
    monkeypatch.setattr(archive, "MAX_FILES", 1)
    with pytest.raises(FmuArchiveError, match="it has 3 files, more than 1"):
        Fmu(path)


def test_sizes_that_lie(make_fmu, monkeypatch):
    """An archive that declares less than it holds: no more is unpacked than was declared."""
    path = make_fmu("ball", more={"resources/zeros": bytes(5_000_000)})
    content = bytearray(path.read_bytes())
    for signature, offset in ((b"PK\x03\x04", 22), (b"PK\x01\x02", 24)):
        place = -1
        while (place := content.find(signature, place + 1)) >= 0:
            if struct.unpack_from("<I", content, place + offset)[0] == 5_000_000:
                struct.pack_into("<I", content, place + offset, 1000)
    path.write_bytes(content)
    monkeypatch.setattr(archive, "MAX_BYTES", 4e6)
    with pytest.raises(FmuArchiveError, match="damaged"):
        run(Fmu(path, kind="me"))


# -- model descriptions -------------------------------------------------------------------------

BOMB = """<?xml version="1.0"?><!DOCTYPE x [<!ENTITY a "aaaaaaaaaa">
<!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;"><!ENTITY c "&b;&b;&b;&b;&b;&b;&b;&b;">]>
<fmiModelDescription fmiVersion="2.0" modelName="&c;"/>"""
READER = """<?xml version="1.0"?><!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]>
<fmiModelDescription fmiVersion="2.0" modelName="&a;"/>"""


@pytest.mark.parametrize(
    "text, message",
    [
        ("<broken", "not well-formed XML"),
        ("", "not well-formed XML"),
        (BOMB, "declares a document type or entities"),
        (BOMB.encode("utf-16"), "declares a document type or entities"),
        (READER, "declares a document type or entities"),
        ("<a>" * 200 + "</a>" * 200, "nested more than 100 deep"),
        ("<a/>", "it is not an FMI model description"),
        (
            '<fmiModelDescription fmiVersion="1.0"/>',
            r"FMI 1\.0; FMI 2\.0 and 3\.0 can be imported",
        ),
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


SIZE = '<Dimension valueReference="20"/>'
NO_SIZE = "the size of array 'in' is unknown"
UNREADABLE = "cannot read the model description"


@pytest.mark.parametrize(
    "model, version, old, new, message",
    [
        ("ball", 2, 'name="e"', 'name="g"', "2 variables are named 'g'"),
        ("ball", 3, 'name="e"', 'name="g"', "2 variables are named 'g'"),
        ("types", 3, SIZE, "<Dimension/>", NO_SIZE),
        ("types", 3, SIZE, '<Dimension valueReference="77"/>', NO_SIZE),
        ("types", 3, SIZE, '<Dimension start="²"/>', NO_SIZE),
        (
            "types",
            3,
            'start="3"',
            'start="30000000000"',
            "'in' has 30000000000 elements",
        ),
        ("types", 3, 'start="3"', f'start="{"9" * 5000}"', UNREADABLE),
        ("ball", 2, 'index="1"', 'index="99"', UNREADABLE),
        ("ball", 2, 'valueReference="0"', 'valueReference="x"', UNREADABLE),
        (
            "ball",
            2,
            'start="9.81"',
            'start="much"',
            "start value 'much' of variable 'g' does not fit",
        ),
    ],
)
def test_descriptions_that_are_refused(make_fmu, model, version, old, new, message):
    with pytest.raises(FmuError, match=message):
        Fmu(make_fmu(model, version, replace={old: new}))


def test_derivatives_that_nobody_needs_may_be_wrong(make_fmu, version):
    """States are for model exchange alone."""
    state = "1" if version == 2 else "0"
    for kinds in (["cs"], ["cs", "me"]):
        path = make_fmu("ball", version, kinds, replace={f'derivative="{state}"': ""})
        run(Fmu(path, kind="cs", step=0.1))
    with pytest.raises(
        FmuDescriptionError,
        match=r"model exchange: 'der\(h\)' is listed as a derivative",
    ):
        Fmu(path, kind="me")


def test_units_that_do_not_fit(make_fmu, version):
    """An FMU whose metre is a foot: the name means something else there than here."""
    path = make_fmu(
        "ball", version, replace={'<BaseUnit m="1"/>': '<BaseUnit m="1" factor="0.3"/>'}
    )
    with pytest.raises(
        FmuUnitError, match=r"defines its unit 'm' as 0\.3 m; .*no equal unit"
    ):
        Fmu(path, kind="me")
    with pytest.raises(
        FmuUnitError, match=r"'ft' does not fit 'm' of FMU 'ball'.*0\.3 m"
    ):
        Fmu(path, kind="me", units={"m": "ft"})
    assert Fmu(path, kind="me", units={"m": None}).h.unit is None


# -- binaries -----------------------------------------------------------------------------------


def test_a_missing_platform(make_fmu, version):
    folder = fmpy.platform if version == 2 else fmpy.platform_tuple
    here = LIBRARY.replace(fmpy.platform, folder)
    path = make_fmu("ball", version, more={here: None, "binaries/amiga/model.so": b""})
    with pytest.raises(
        FmuBinaryError, match=r"no binary for this machine .*it has: amiga"
    ):
        Fmu(path)


def test_a_binary_that_is_none(make_fmu):
    with pytest.raises(FmuBinaryError, match="cannot be loaded"):
        run(Fmu(make_fmu("ball", more={LIBRARY: b"not a library"}), kind="me"))


def test_a_kind_that_is_not_there(make_fmu):
    with pytest.raises(FmuError, match="offers me, not 'cs'"):
        Fmu(make_fmu("ball", kinds=("me",)), kind="cs")


def test_a_wrong_token(make_fmu, version):
    token = "guid" if version == 2 else "instantiationToken"
    path = make_fmu("ball", version, replace={f'{token}="ball"': f'{token}="bell"'})
    with pytest.raises(
        FmuCallError, match=r"could not be instantiated(.|\n)*this is not my token"
    ):
        run(Fmu(path, kind="me"))


def test_a_file_that_was_written_anew(make_fmu):
    block = Fmu(make_fmu("ball"), kind="me")
    make_fmu("ball", replace={'start="9.81"': 'start="1.6"'})
    with pytest.raises(FmuError, match=r"'ball2\.fmu' was changed since it was read"):
        run(block)


# -- failing calls ------------------------------------------------------------------------------


def test_a_failing_initialization(make_fmu, version, kind):
    """The error has the FMU's own text, with what C's printf would write into it."""
    given = {"fault": 1, "text": "too much fuel"}
    block = Fmu(
        make_fmu("ball", version),
        kind=kind,
        start=given,
        step=0.1 if kind == "cs" else None,
    )
    with pytest.raises(FmuCallError, match=r"too much fuel \(number 1\)") as caught:
        run(block)
    assert caught.value.status == 3


@pytest.mark.parametrize(
    "fault, text, more, status",
    [
        (2, r"DoStep returned status 'error'(.|\n)*spring broke \(n", {}, 3),
        (
            2,
            r"DoStep returned status 'error'(.|\n)*spring broke \(n",
            {"time_limit": 20.0},
            3,
        ),
        (5, "and all parts of it", {}, 2),
        (
            12,
            r"discarded its step of 0\.1 s from t = 0 s, and fails in the step after it",
            {},
            2,
        ),
    ],
)
def test_a_failing_step(make_fmu, version, fault, text, more, status):
    """A text that the FMU logs after a discarded step is not the cause."""
    block = Fmu(
        make_fmu("ball", version), step=0.1, parameters={"fault": fault}, **more
    )
    with pytest.raises(FmuCallError, match=text) as caught:
        run(block)
    assert caught.value.status == status


def test_discarded_steps_that_cannot_be_shorter(make_fmu, version):
    path = make_fmu("ball", version, replace={'StepSize="true"': 'StepSize="false"'})
    with pytest.raises(FmuCallError, match="and does not take smaller ones"):
        run(Fmu(path, step=0.1, parameters={"fault": 5}))


@pytest.mark.parametrize(
    "fault, limit, error, text",
    [
        (3, 0.5, FmuTimeoutError, r"'do_step' within 0\.5 s; its process was ended"),
        (
            4,
            20.0,
            FmuCrashError,
            r"signal 6 .Aborted(.|\n)*about to crash \(number 7\)",
        ),
    ],
)
def test_a_step_that_never_ends_or_crashes(
    make_fmu, children, version, fault, limit, error, text
):
    before, begin = children(), time.monotonic()
    block = Fmu(
        make_fmu("ball", version),
        step=0.1,
        parameters={"fault": fault},
        time_limit=limit,
    )
    with pytest.raises(error, match=text):
        run(block)
    assert time.monotonic() - begin < 30
    assert children() <= before
