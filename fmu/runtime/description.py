"""Checked model description, in the form that the import uses."""

from __future__ import annotations

import io
import zipfile
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from math import prod
from typing import Any, Literal
from xml.etree import ElementTree

from trussflow.fmu.errors import FmuDescriptionError
from trussflow.fmu.fmi_units import FmiUnit
from trussflow.fmu.runtime.archive import DESCRIPTION_FILE
from trussflow.fmu.runtime.safe_xml import check_xml

Kind = Literal["cs", "me"]
"""Co-simulation, or model exchange."""

MAX_ELEMENTS = 10_000_000
"""Maximum number of elements of an array variable."""

INTEGER_TYPES = [f"{sign}Int{bits}" for sign in ("", "U") for bits in (8, 16, 32, 64)]
"""Integer types of FMI 3.0."""

REAL_TYPES = frozenset({"Real", "Float32", "Float64"})
"""FMI types of real numbers."""

NUMERIC_TYPES = REAL_TYPES | {"Integer", "Boolean", "Enumeration", *INTEGER_TYPES}
"""FMI types whose values fit into a vector of floats."""


@dataclass(frozen=True, slots=True, eq=False)
class FmuVariable:
    """A variable of an FMU: a scalar, or in FMI 3 an array.

    Attributes
    ----------
    name : str
        Name in the model description.
    reference : int
        Value reference.
    type : str
        ``"Real"``, ``"Float64"`` and so on.
    causality, variability, initial : str
        Attributes as defined by FMI; `initial` is empty where FMI defines none.
    start : str or None
        Start value as the text in the model description.
    unit : str
        Name of the unit; empty if none is stated.
    shape : tuple of int
        Shape of the array; ``()`` for a scalar.
    meaning : str
        Description, one line.
    dimensions : tuple of int or None
        Value reference of the structural parameter that sets each dimension, if any.
    """

    name: str
    reference: int
    type: str
    causality: str
    variability: str
    initial: str
    start: str | None
    unit: str
    shape: tuple[int, ...]
    meaning: str = ""
    dimensions: tuple[int | None, ...] = ()

    @property
    def size(self) -> int:
        """Number of elements."""
        return prod(self.shape)

    @property
    def is_continuous(self) -> bool:
        """Whether the variable may change between events."""
        return self.variability == "continuous" and self.type in REAL_TYPES

    @property
    def is_structural(self) -> bool:
        """Whether the variable sets array sizes."""
        return self.causality == "structuralParameter"


@dataclass(frozen=True, slots=True, eq=False)
class FmuDescription:
    """A model description.

    Attributes
    ----------
    name : str
        Name of the model.
    version : int
        Major version of FMI, 2 or 3.
    token : str
        GUID or instantiation token.
    kinds : dict
        Capability flags by kind, ``"cs"`` or ``"me"``: fmpy's object with the names of the standard.
    variables : dict
        All variables by name, in the order of the model description.
    units : dict
        Definitions of units by name.
    dependencies : dict
        Names of the variables that each output depends on directly, by output; None for all.
    states, derivatives : tuple of FmuVariable
        Continuous states and their derivatives, in the same order.
    stateless : str
        Name of a derivative without a state; model exchange is refused then. Empty if there is none.
    event_indicators : int
        Number of event indicators [-].
    differentiable : bool
        Whether model exchange has directional derivatives.
    tolerance, step : float or None
        Relative tolerance [-] of the default experiment, and its step size or else the fixed internal
        step of co-simulation [s].
    """

    name: str
    version: int
    token: str
    kinds: Mapping[str, Any]
    variables: Mapping[str, FmuVariable]
    units: Mapping[str, FmiUnit]
    dependencies: Mapping[str, frozenset[str] | None]
    states: tuple[FmuVariable, ...] = ()
    derivatives: tuple[FmuVariable, ...] = ()
    stateless: str = ""
    event_indicators: int = 0
    differentiable: bool = False
    tolerance: float | None = None
    step: float | None = None

    def numbers(self, causality: str) -> tuple[FmuVariable, ...]:
        """Return the numeric variables of one causality, in order."""
        return tuple(
            v
            for v in self.variables.values()
            if v.causality == causality and v.type in NUMERIC_TYPES
        )


def parse_description(text: bytes, where: str) -> FmuDescription:
    """Read a model description.

    Parameters
    ----------
    text : bytes
        The XML.
    where : str
        Name of the document, for error messages.

    Raises
    ------
    FmuDescriptionError
        If the description is unsafe, invalid, contradictory or of an unsupported version of FMI.
    """
    check_xml(text, where)
    try:
        root = ElementTree.fromstring(text)
        _check_structure(root, where)
        # imported here: it takes 0.3 s
        from fmpy.model_description import read_model_description

        archive = io.BytesIO()  # fmpy reads files and archives only
        with zipfile.ZipFile(archive, "w") as files:
            files.writestr(DESCRIPTION_FILE, text)
        return _converted(read_model_description(archive, validate=False), root)
    except FmuDescriptionError:
        raise
    except Exception as error:  # fmpy raises errors of many types
        raise FmuDescriptionError(
            f"cannot read {where}: {type(error).__name__}: {error}"
        ) from error


def _check_structure(root: ElementTree.Element, where: str) -> None:
    """Raise a clear error for faults that fmpy misses or reports unclearly."""
    version = root.get("fmiVersion", "")
    if root.tag != "fmiModelDescription" or not version:
        raise FmuDescriptionError(
            f"cannot read {where}: it is not an FMI model description"
        )
    if version != "2.0" and not version.startswith("3."):
        raise FmuDescriptionError(
            f"cannot use {where}: its version is FMI {version}; FMI 2.0 and 3.0 can be imported"
        )
    listed = root.find("ModelVariables")
    if listed is None:
        raise FmuDescriptionError(f"cannot read {where}: it has no ModelVariables")
    counts = Counter(
        v.get("name") for v in listed.iter() if v.get("valueReference") is not None
    )
    counts.update(a.get("name") for a in listed.iter("Alias"))
    counts.subtract(d.get("name") for d in listed.iter("Dimension"))
    for name, count in counts.items():
        if name is not None and count > 1:
            raise FmuDescriptionError(
                f"cannot use {where}: {count} variables are named '{name}', so the name is "
                "ambiguous; the tool that made the FMU must use unique names"
            )
    by_reference = {v.get("valueReference"): v for v in listed}
    for variable in listed:
        size = 1
        for dimension in variable.findall("Dimension"):
            start = dimension.get("start")
            source = dimension.get("valueReference")
            if start is None and source in by_reference:
                start = by_reference[source].get("start")
            if start is None or not start.strip().isdecimal():
                raise FmuDescriptionError(
                    f"cannot use {where}: the size of array '{variable.get('name')}' is unknown; "
                    "each dimension needs a start, or the value reference of a structural "
                    "parameter that has one"
                )
            size *= int(start)
        if size > MAX_ELEMENTS:
            raise FmuDescriptionError(
                f"refused to use {where}: array '{variable.get('name')}' has {size} elements, "
                f"more than {MAX_ELEMENTS}"
            )


def _converted(read: Any, root: ElementTree.Element) -> FmuDescription:
    """Convert fmpy's description, read from `root`, to an `FmuDescription`."""
    stated = {"cs": read.coSimulation, "me": read.modelExchange}
    kinds = {kind: flags for kind, flags in stated.items() if flags is not None}
    if not kinds:
        raise FmuDescriptionError(
            f"cannot use FMU '{read.modelName}': it offers neither co-simulation nor model exchange"
        )
    variables = {v.name: _variable(v) for v in read.modelVariables}
    experiment = read.defaultExperiment
    rates = [u.variable for u in read.derivatives] if "me" in kinds else []
    stateless = [rate.name for rate in rates if rate.derivative is None]
    # The error is raised only if model exchange is chosen, see `FmuFile.kind`.
    if stateless:  # co-simulation does not need the derivatives
        rates = []
    return FmuDescription(
        name=read.modelName or "",
        version=int(read.fmiVersion[0]),
        token=read.guid or "",
        kinds=kinds,
        variables=variables,
        units={u.name: _unit(u) for u in read.unitDefinitions},
        dependencies={
            u.variable.name: None
            if u.dependencies is None
            else frozenset(v.name for v in u.dependencies)
            for u in read.outputs
        },
        states=tuple(variables[rate.derivative.name] for rate in rates),
        derivatives=tuple(variables[rate.name] for rate in rates),
        stateless="".join(stateless[:1]),
        event_indicators=read.numberOfEventIndicators or 0,
        # FMI 3 uses another name for this attribute, which fmpy does not read.
        differentiable=any(
            element.get(f"providesDirectionalDerivative{s}") in ("true", "1")
            for element in root.findall("ModelExchange")
            for s in ("", "s")
        ),
        tolerance=_number(experiment, "tolerance"),
        step=_number(experiment, "stepSize")
        or _number(read.coSimulation, "fixedInternalStepSize"),
    )


def _number(read: Any, name: str) -> float | None:
    """Return a number that fmpy stores as text, or None if it is not stated."""
    text = getattr(read, name, None)
    return None if text is None else float(text)


def _variable(read: Any) -> FmuVariable:
    declared = read.declaredType
    return FmuVariable(
        name=read.name,
        reference=read.valueReference,
        type=read.type,
        causality=read.causality,
        variability=read.variability,
        initial=read.initial or "",
        start=read.start,
        unit=read.unit or (declared.unit if declared is not None else None) or "",
        shape=tuple(read.shape),
        meaning=read.description
        or (declared.description if declared is not None else "")
        or "",
        dimensions=tuple(d.valueReference for d in read.dimensions),
    )


def _unit(read: Any) -> FmiUnit:
    base = read.baseUnit
    if base is None:
        return FmiUnit(read.name)
    exponents = {
        n: int(getattr(base, n)) for n in ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
    }
    return FmiUnit(read.name, exponents, float(base.factor), float(base.offset))
