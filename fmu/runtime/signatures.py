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

INTEGERS = [f"{sign}Int{bits}" for sign in ("", "U") for bits in (8, 16, 32, 64)]
"""The types of FMI 3.0 that are whole numbers."""

_TYPES2 = ("Real", "Integer", "Boolean", "String")
_TYPES3 = ("Float32", "Float64", "Boolean", "String", *INTEGERS)

BOTH = {
    "c": "FreeInstance Terminate ExitInitializationMode EnterEventMode EnterContinuousTimeMode",
    "cd": "SetTime",
    "cpz": "SetContinuousStates GetContinuousStates GetEventIndicators",
}
"""The functions with the same name and signature in both versions, by signature."""

FMI2 = {
    "c": "EnterInitializationMode",
    "sisspii": "Instantiate",
    "ciddid": "SetupExperiment",
    "cpzp": " ".join([f"Get{kind} Set{kind}" for kind in _TYPES2] + ["DeSerializeFMUstate"]),
    "cp": "GetFMUstate SetFMUstate FreeFMUstate NewDiscreteStates",
    "cpp": "SerializedFMUstateSize",
    "cppz": "SerializeFMUstate",
    "cddi": "DoStep",
    "cpzpp": "SetRealInputDerivatives",
    "cip": "GetRealStatus GetBooleanStatus",
    "cipp": "CompletedIntegratorStep",
    "cpz": "GetDerivatives",
    "cpzpzpp": "GetDirectionalDerivative",
}
"""The functions of FMI 2.0 by signature, besides those of `BOTH`."""

FMI3 = {
    "c": "EnterConfigurationMode ExitConfigurationMode EnterStepMode",
    "sssbbbbpzppp": "InstantiateCoSimulation",
    "sssbbpp": "InstantiateModelExchange",
    "cbddbd": "EnterInitializationMode",
    "cpzpz": " ".join(f"Get{kind} Set{kind}" for kind in _TYPES3),
    "cp": "GetFMUState SetFMUState FreeFMUState",
    "cpp": "SerializedFMUStateSize",
    "cppz": "SerializeFMUState",
    "cpzp": "DeserializeFMUState",
    "cddbpppp": "DoStep",
    "cpppppp": "UpdateDiscreteStates",
    "cbpp": "CompletedIntegratorStep",
    "cpz": "GetContinuousStateDerivatives",
    "cpzpzpzpz": "GetDirectionalDerivative",
}
"""The functions of FMI 3.0 by signature, besides those of `BOTH`."""

SIGNATURES = {
    (version, name): letters
    for version, table in ((2, BOTH), (3, BOTH), (2, FMI2), (3, FMI3))
    for letters, names in table.items()
    for name in names.split()
}
"""The signature of each function by major version of FMI and name without the prefix."""

RESULTS: dict[str, Any] = {
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
    found.argtypes = [LETTERS[letter] for letter in SIGNATURES[version, name]]
    found.restype = RESULTS.get(name, ctypes.c_int)
    return found
