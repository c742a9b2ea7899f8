"""C signatures of the functions of FMI 2.0 and 3.0 that are called here.

One letter per argument: c instance, p pointer, s text, d double, z size, i int or enumeration,
b C99 bool. Results are a status, except where `RESULTS` says otherwise.
FMUs that leave out functions they do not support can still be used without these; the standards
ask for all, but not every tool obeys.
"""

from __future__ import annotations

import ctypes
from typing import Any

from trussflow.fmu.errors import FmuBinaryError

FMI2 = {
    "GetVersion": "",
    "Instantiate": "sisspii",
    "FreeInstance": "c",
    "SetDebugLogging": "cizp",
    "SetupExperiment": "ciddid",
    "EnterInitializationMode": "c",
    "ExitInitializationMode": "c",
    "Terminate": "c",
    "Reset": "c",
    "GetReal": "cpzp",
    "GetInteger": "cpzp",
    "GetBoolean": "cpzp",
    "GetString": "cpzp",
    "SetReal": "cpzp",
    "SetInteger": "cpzp",
    "SetBoolean": "cpzp",
    "SetString": "cpzp",
    "GetFMUstate": "cp",
    "SetFMUstate": "cp",
    "FreeFMUstate": "cp",
    "SerializedFMUstateSize": "cpp",
    "SerializeFMUstate": "cppz",
    "DeSerializeFMUstate": "cpzp",
    "DoStep": "cddi",
    "SetRealInputDerivatives": "cpzpp",
    "GetRealStatus": "cip",
    "GetBooleanStatus": "cip",
    "GetStringStatus": "cip",
    "EnterEventMode": "c",
    "NewDiscreteStates": "cp",
    "EnterContinuousTimeMode": "c",
    "CompletedIntegratorStep": "cipp",
    "SetTime": "cd",
    "SetContinuousStates": "cpz",
    "GetContinuousStates": "cpz",
    "GetDerivatives": "cpz",
    "GetEventIndicators": "cpz",
}

_INTEGERS = [f"{sign}Int{bits}" for sign in ("", "U") for bits in (8, 16, 32, 64)]
_TYPES3 = ("Float32", "Float64", "Boolean", "String", *_INTEGERS)

FMI3 = {
    "GetVersion": "",
    "InstantiateCoSimulation": "sssbbbbpzppp",
    "InstantiateModelExchange": "sssbbpp",
    "FreeInstance": "c",
    "SetDebugLogging": "cbzp",
    "EnterInitializationMode": "cbddbd",
    "ExitInitializationMode": "c",
    "EnterConfigurationMode": "c",
    "ExitConfigurationMode": "c",
    "Terminate": "c",
    "Reset": "c",
    **{f"{what}{kind}": "cpzpz" for kind in _TYPES3 for what in ("Get", "Set")},
    "GetFMUState": "cp",
    "SetFMUState": "cp",
    "FreeFMUState": "cp",
    "SerializedFMUStateSize": "cpp",
    "SerializeFMUState": "cppz",
    "DeserializeFMUState": "cpzp",
    "EnterStepMode": "c",
    "DoStep": "cddbpppp",
    "EnterEventMode": "c",
    "UpdateDiscreteStates": "cpppppp",
    "EnterContinuousTimeMode": "c",
    "CompletedIntegratorStep": "cbpp",
    "SetTime": "cd",
    "SetContinuousStates": "cpz",
    "GetContinuousStates": "cpz",
    "GetContinuousStateDerivatives": "cpz",
    "GetEventIndicators": "cpz",
}

RESULTS: dict[str, Any] = {
    "GetVersion": ctypes.c_char_p,
    "Instantiate": ctypes.c_void_p,
    "InstantiateCoSimulation": ctypes.c_void_p,
    "InstantiateModelExchange": ctypes.c_void_p,
    "FreeInstance": None,
}
"""What functions return that return no status."""

LETTERS: dict[str, Any] = {
    "c": ctypes.c_void_p,
    "p": ctypes.c_void_p,
    "s": ctypes.c_char_p,
    "d": ctypes.c_double,
    "z": ctypes.c_size_t,
    "i": ctypes.c_int,
    "b": ctypes.c_bool,
}


def function(library: ctypes.CDLL, version: int, name: str) -> Any:
    """Return a function of an FMU, ready to be called.

    Parameters
    ----------
    library : ctypes.CDLL
        The binary.
    version : int
        Major version of FMI [-].
    name : str
        Name without the prefix.

    Raises
    ------
    FmuBinaryError
        If the binary does not have it.
    """
    full = f"fmi{version}{name}"
    try:
        found = library[full]
    except AttributeError:
        raise FmuBinaryError(
            f"the binary of the FMU has no function {full}; it was built incompletely"
        ) from None
    letters = (FMI2 if version == 2 else FMI3)[name]
    found.argtypes = [LETTERS[letter] for letter in letters]
    found.restype = RESULTS.get(name, ctypes.c_int)
    return found
