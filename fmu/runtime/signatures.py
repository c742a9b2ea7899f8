"""C signatures of the functions of FMI 2.0 and 3.0 that the import calls.

One letter per argument: c instance, p pointer, s text, d double, z size, i int or enumeration,
b C99 bool. A function returns a status unless `RESULT_TYPES` lists it.
FMI requires all functions, but some tools leave out unsupported ones. Functions are therefore
looked up when they are first called.
"""

from __future__ import annotations

import ctypes
from typing import Any

from trussflow.fmu.runtime.description import INTEGER_TYPES

_TYPES2 = ("Real", "Integer", "Boolean", "String")
_TYPES3 = ("Float32", "Float64", "Boolean", "String", *INTEGER_TYPES)

COMMON_FUNCTIONS = {
    "c": "FreeInstance Terminate ExitInitializationMode EnterEventMode EnterContinuousTimeMode",
    "cd": "SetTime",
    "cpz": "SetContinuousStates GetContinuousStates GetEventIndicators",
}
"""Functions with equal name and signature in both versions, by signature."""

FMI2_FUNCTIONS = {
    "c": "EnterInitializationMode",
    "sisspii": "Instantiate",
    "ciddid": "SetupExperiment",
    "cpzp": " ".join(
        [f"Get{kind} Set{kind}" for kind in _TYPES2] + ["DeSerializeFMUstate"]
    ),
    "cp": "GetFMUstate SetFMUstate FreeFMUstate NewDiscreteStates",
    "cpp": "SerializedFMUstateSize",
    "cppz": "SerializeFMUstate",
    "cddi": "DoStep",
    "cip": "GetRealStatus GetBooleanStatus",
    "cipp": "CompletedIntegratorStep",
    "cpz": "GetDerivatives",
    "cpzpzpp": "GetDirectionalDerivative",
}
"""Further functions of FMI 2.0, by signature."""

FMI3_FUNCTIONS = {
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
"""Further functions of FMI 3.0, by signature."""

FUNCTION_SIGNATURES = {
    (version, name): letters
    for version, table in (
        (2, COMMON_FUNCTIONS),
        (3, COMMON_FUNCTIONS),
        (2, FMI2_FUNCTIONS),
        (3, FMI3_FUNCTIONS),
    )
    for letters, names in table.items()
    for name in names.split()
}
"""Signature of each function, by major version of FMI and name without the prefix."""

RESULT_TYPES: dict[str, Any] = {
    "Instantiate": ctypes.c_void_p,
    "InstantiateCoSimulation": ctypes.c_void_p,
    "InstantiateModelExchange": ctypes.c_void_p,
    "FreeInstance": None,
}
"""Result types of the functions that do not return a status."""

ARGUMENT_TYPES: dict[str, Any] = {
    "c": ctypes.c_void_p,
    "p": ctypes.c_void_p,
    "s": ctypes.c_char_p,
    "d": ctypes.c_double,
    "z": ctypes.c_size_t,
    "i": ctypes.c_int,
    "b": ctypes.c_bool,
}
