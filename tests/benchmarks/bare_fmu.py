"""An FMU of FMI 2.0 called without any wrapper of Python around the C functions but ctypes."""

from __future__ import annotations

import ctypes
import zipfile

import fmpy

REAL = ctypes.c_double


def array(kind, values):
    """Return a C array."""
    return (kind * len(values))(*values)


class BareFmu:
    """A co-simulation slave at time 0, whose calls have their arrays ready."""

    def __init__(self, path, outputs):
        folder = path.with_suffix(".unpacked")
        with zipfile.ZipFile(path) as archive:
            archive.extractall(folder)
        description = fmpy.read_model_description(str(path))
        variables = description.modelVariables
        self.given = [v.valueReference for v in variables if v.causality == "input"]
        self.taken = [
            v.valueReference for v in variables if v.name.split("[")[0] in outputs
        ]
        binary = next(f for f in (folder / "binaries").rglob("*") if f.is_file())
        self.library = ctypes.CDLL(str(binary))
        self.library.fmi2Instantiate.restype = ctypes.c_void_p
        callbacks = (ctypes.c_void_p * 5)()
        guid = description.guid.encode()
        self.slave = ctypes.c_void_p(
            self.library.fmi2Instantiate(b"one", 1, guid, b"", callbacks, 0, 0)
        )
        self.library.fmi2SetupExperiment(self.slave, 0, REAL(0), REAL(0), 0, REAL(0))
        self.library.fmi2EnterInitializationMode(self.slave)
        self.library.fmi2ExitInitializationMode(self.slave)
        self._given, self._taken = (
            array(ctypes.c_uint, self.given),
            array(ctypes.c_uint, self.taken),
        )
        self._inputs, self._outputs = (
            array(REAL, [0.1] * len(self.given)),
            array(REAL, [0.0] * len(self.taken)),
        )
        self._steps = 0

    def write(self):
        """Set all inputs."""
        self.library.fmi2SetReal(self.slave, self._given, len(self.given), self._inputs)

    def step(self, h=1e-3):
        """Make the next step [s]."""
        self.library.fmi2DoStep(self.slave, REAL(self._steps * h), REAL(h), 1)
        self._steps += 1

    def read(self):
        """Get all outputs."""
        self.library.fmi2GetReal(
            self.slave, self._taken, len(self.taken), self._outputs
        )
