"""Contents of FMU files, their builds by others, and a run without Python."""

import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import campaign
import fmpy
import pytest
from fmpy import simulate_fmu
from fmpy.build import build_platform_binary
from fmpy.validation import validate_fmu
from systems import assert_near

from trussflow.blocks.tracing.compiler import find_compiler
from trussflow.fmu.exporting.export import export
from trussflow.fmu.exporting.native.binaries import (
    KNOWN_PLATFORMS,
    Platform,
    chosen,
    here,
)

HEADERS = Path(fmpy.__file__).parent / "c-code"
HOST = Path(__file__).parents[2] / "host.c"

needs_host = pytest.mark.skipif(
    sys.platform != "linux", reason="the host is written for Linux"
)


def unzipped(path, folder):
    with zipfile.ZipFile(path) as archive:
        archive.extractall(folder)
    return folder


def library(folder):
    return next(f for f in (folder / "binaries").rglob("*") if f.is_file())


@pytest.mark.campaign
def test_the_plant_is_small(plant_fmu):
    assert plant_fmu.stat().st_size < 2e6


@pytest.mark.parametrize("name", ["Oscillator", "Rotor", "hybrid"])
def test_small_systems_are_valid_and_simulate_in_every_kind(
    name, version, exported, systems
):
    path = exported(getattr(systems, name)(), version)
    assert validate_fmu(str(path)) == []
    for kind in ("CoSimulation", "ModelExchange"):
        result = simulate_fmu(str(path), fmi_type=kind, stop_time=0.1)
        assert result["time"][-1] == pytest.approx(0.1)


def functions(header):
    """Return the functions that a header of the standard declares."""
    text = (HEADERS / header).read_text()
    return set(re.findall(r"^\s*FMI\d_Export\s+\w+\s+(fmi\d\w+);", text, re.MULTILINE))


@needs_host
@pytest.mark.parametrize(
    "version, header", [("2.0", "fmi2Functions.h"), ("3.0", "fmi3Functions.h")]
)
def test_exactly_the_functions_of_the_standard_are_exported(
    version, header, exported, systems, tmp_path
):
    binary = library(unzipped(exported(systems.Oscillator(), version), tmp_path))
    found = {
        line.split()[-1]
        for line in printed("nm", "-D", "--defined-only", binary).splitlines()
    }
    assert found == functions(header)


@needs_host
def test_runs_in_a_process_without_python(exported, systems, tmp_path, instance):
    path = exported(systems.Oscillator(2), "2.0", "two")
    binary = str(library(unzipped(path, tmp_path / "fmu")))
    compiler, host = find_compiler(), tmp_path / "host"
    subprocess.run(
        [*compiler, f"-I{HEADERS}", str(HOST), "-o", str(host), "-ldl"], check=True
    )
    assert "python" not in printed("ldd", binary).lower()
    one = instance(path).start({"force": [0.0, 0.25], "initial_position": [1.0, -0.5]})
    refs = {name: str(references[-1]) for name, references in one.references.items()}
    command = [host, binary, one.guid, refs["position"], "30", "0.02"]
    command += [refs["force"], "0.25", refs["initial_position"], "-0.5"]
    ended = printed(*command, env={})
    one.step(0, 30, 0.02)
    assert float(ended) == one.get("position")[1]
    command[2] = "{wrong}"
    wrong = subprocess.run(command, capture_output=True, text=True)
    assert wrong.returncode == 4
    assert "the GUID is not that of this binary" in wrong.stderr


def printed(*command, **options):
    return subprocess.run(
        command, capture_output=True, text=True, check=True, **options
    ).stdout


@pytest.mark.skipif(shutil.which("cmake") is None, reason="fmpy builds with cmake")
@pytest.mark.parametrize(
    "version, target, position",
    [
        ("2.0", {"target[1]": 0.7}, "position[1]"),
        campaign.only("3.0", {"target": [0.7]}, "position"),
    ],
)
def test_fmpy_builds_it_from_its_sources(
    version, target, position, systems, exported, tmp_path
):
    path = export(
        systems.hybrid(), tmp_path / "source.fmu", version=version, platforms=()
    )
    folder = unzipped(path, tmp_path / "unzipped")
    assert not (folder / "binaries").exists()
    (tmp_path / "build").mkdir()
    build_platform_binary(folder, tmp_path / "build")
    built, expected = (
        simulate_fmu(str(fmu), stop_time=0.5, start_values=target)[position]
        for fmu in (folder, exported(systems.hybrid(), version))
    )
    assert_near(built, expected, 1e-13)


@pytest.mark.campaign
def test_one_machine_compiles_for_all_platforms(systems, tmp_path):
    """Ziglang builds its C library anew for each; CI has the two that differ most, a larger campaign all."""
    foreign = [Platform("windows", "x86_64"), Platform("darwin", "aarch64")]
    platforms = KNOWN_PLATFORMS if campaign.SIZE > 1 else [here(), *foreign]
    path = export(
        systems.Oscillator(1),
        tmp_path / "all.fmu",
        version="3.0",
        platforms=[platform.name for platform in platforms],
    )
    magic = {"linux": b"\x7fELF", "windows": b"MZ", "darwin": b"\xcf\xfa\xed\xfe"}
    machine = {
        ("linux", "x86_64"): (18, b"\x3e\x00"),
        ("linux", "aarch64"): (18, b"\xb7\x00"),
        ("darwin", "x86_64"): (4, b"\x07\x00\x00\x01"),
        ("darwin", "aarch64"): (4, b"\x0c\x00\x00\x01"),
    }
    with zipfile.ZipFile(path) as archive:
        for platform in platforms:
            binary = archive.read(
                f"binaries/{platform.name}/Oscillator{platform.suffix}"
            )
            assert binary.startswith(magic[platform.system])
            place, expected = machine.get(
                (platform.system, platform.processor), (0, b"")
            )
            assert binary[place : place + len(expected)] == expected
    assert simulate_fmu(str(path), stop_time=0.1)["time"][-1] == pytest.approx(0.1)


def test_folders_of_both_versions():
    assert chosen(["all"]) == KNOWN_PLATFORMS
    arm, intel = Platform("linux", "aarch64"), Platform("linux", "x86_64")
    assert intel.folder("2.0", [intel, arm]) == "linux64"
    assert arm.folder("2.0", [intel, arm]) == "aarch64-linux"
    assert arm.folder("2.0", [arm]) == "linux64"
    assert Platform("windows", "x86_64").folder("2.0", []) == "win64"
    assert arm.folder("3.0", [arm]) == "aarch64-linux"
