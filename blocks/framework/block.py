"""The block: ports, parameters, states and equations.

A block defines its equations once, as pure NumPy functions of time, states, inputs and
parameters::

    class Oscillator(Block):
        force = Input(unit="N")
        position = Output(unit="m")
        q = State(unit="m")
        v = State(unit="m/s")
        stiffness = Parameter(4.0, unit="N/m", above=0.0)

        def output(self, t, x, u, p):
            return {"position": x.q}

        def derivative(self, t, x, u, p):
            return {"q": x.v, "v": u.force - p.stiffness * x.q}

The same functions run with numbers for debugging and are traced for speed.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Self, TypeVar, final

import numpy as np

from trussflow.blocks.errors import BlockError, NameLookupError, ParameterError
from trussflow.blocks.framework.declarations import (
    Attribute,
    Event,
    History,
    Mode,
    Parameter,
    Signals,
    State,
)
from trussflow.blocks.framework.energy import EnergyAccount
from trussflow.blocks.framework.equations import EVENTS, Equations
from trussflow.blocks.framework.equations import Values as Values
from trussflow.blocks.framework.port import (
    INFERRED,
    REQUIRED,
    Inferable,
    Input,
    Output,
    Port,
    Shape,
)
from trussflow.blocks.framework.signal_operators import Wired
from trussflow.blocks.framework.symbol import Symbol, block_equations, wrapped
from trussflow.blocks.framework.units import check_declared
from trussflow.blocks.support.summary import Described, Description
from trussflow.blocks.support.types import Vector
from trussflow.blocks.support.validation import (
    as_shape,
    by_name,
    finite_array,
    meant,
    shown,
)

if TYPE_CHECKING:
    from trussflow.blocks.framework.diagram import Diagram

_Kind = TypeVar("_Kind", bound=State | Event | History)

SETTABLE_ATTRIBUTES = ("extra_ports", "traced", "_declared")
"""Attributes of `Block` that a subclass may set before ``super().__init__()``."""


def _explained(init: Callable[..., None]) -> Callable[..., None]:
    """Return an `__init__` whose errors about arguments name the class that is built, not a base of it."""

    @functools.wraps(init)
    def built(self: Block, *values: Any, **named: Any) -> None:
        try:
            init(self, *values, **named)
        except TypeError:
            signature = inspect.signature(init)
            try:
                # Fails only if the arguments are wrong; the body of __init__ may
                # raise TypeError too.
                signature.bind(self, *values, **named)
            except TypeError as fault:
                names = [*signature.parameters][1:]
                kinds = {p.kind for p in signature.parameters.values()}
                hints = (
                    f"; there is no '{name}'{meant(name.lower(), names)}"
                    for name in named
                    if name not in names and inspect.Parameter.VAR_KEYWORD not in kinds
                )
                raise TypeError(
                    f"cannot build a {type(self).__name__}: {fault}; its arguments are: {', '.join(names)}"
                    + "".join(hints)
                ) from None
            raise

    return built


class Block(Wired, Equations, Described):
    """Base of all blocks.

    Subclasses declare `Input`, `Output`, `State` and `Parameter` as class attributes and
    override `output`, and `derivative` (continuous states) or `update` (discrete states of
    a sampled block). Attributes set before ``super().__init__()`` are structural: they may
    hold sizes, to which shapes refer by name. After construction a block is frozen, and a run
    does not change it. A Python block with internal state besides its declared states overrides
    `open`.

    Parameters
    ----------
    **parameters : array_like
        Values of the declared parameters, by name.

    Raises
    ------
    ParameterError
        If a name is not declared, or a value is missing or not allowed.
    """

    traced: ClassVar[bool] = True
    """Whether the equations are traced; False in a Python block."""

    energy_account: ClassVar[EnergyAccount | None] = None
    """Energy balance of the block, for `energy_audit`."""

    _declared: Mapping[str, Any] = MappingProxyType({})
    """Declarations by name: those of the class, or of the instance if they depend on its arguments."""

    name: str
    parent: Diagram | None
    ports: dict[str, Port]
    parameters: dict[str, Vector]
    extra_ports: dict[str, Input | Output]
    sample_time: float | None
    sample_offset: float
    inferred_shape: Inferable

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        # Base classes first, so that a class overrides the declarations of its bases.
        declared: dict[str, Any] = {}
        for base in reversed(cls.__mro__[1:]):
            declared |= getattr(base, "_declared", {})
        for name, value in vars(cls).items():
            is_declared = isinstance(
                value, Input | Output | State | Parameter | Event | History
            )
            taken = hasattr(Block, name) or name in Block.__annotations__
            # typing.final() sets __final__: nothing may override such a method. Other
            # names of Block may be overridden, but not by a declaration.
            if getattr(getattr(Block, name, None), "__final__", is_declared and taken):
                raise BlockError(
                    f"{cls.__name__} declares '{name}', which every block already has; choose another name "
                    "(equations are output, derivative and update)"
                )
            if is_declared:
                declared[name] = value
        cls._declared = declared
        if "__init__" in vars(cls):
            cls.__init__ = _explained(cls.__init__)  # type: ignore[method-assign]
        if (
            cls.derivative is not Equations.derivative
            and cls.update is not Equations.update
        ):
            raise BlockError(
                f"{cls.__name__} has both derivative() and update(): a block is continuous or "
                "sampled; make it two blocks"
            )

    def __init__(self, **parameters: Any) -> None:
        # Directly, as __setattr__ refuses the names that every block has.
        values = self.__dict__
        extra = values["extra_ports"] = by_name(
            f"extra_ports of {type(self).__name__}", values.get("extra_ports")
        )
        values.update(
            name=type(self).__name__, parent=None, sample_time=None, sample_offset=0.0
        )
        declared = {**self._declared, **extra}
        # One of each for all ports of the block that infer it: if u is in N, so is y.
        shape, unit, frame, labels = (Inferable() for _ in range(4))
        values["inferred_shape"] = shape
        ports: dict[str, Port] = {}
        for name, declaration in declared.items():
            if name in extra and not isinstance(declaration, Input | Output):
                raise BlockError(
                    f"{type(self).__name__}: extra port '{name}' must be an Input(...) or an Output(...), "
                    f"not {shown(declaration)}"
                )
            # An attribute of the instance would hide the port of that name.
            if name in values or (name in extra and hasattr(Block, name)):
                raise BlockError(
                    f"{type(self).__name__} declares '{name}', but the block has an attribute of "
                    "that name; choose another name"
                )
            own_unit = self._resolved(declaration.unit)
            check_declared(
                f"{type(self).__name__}.{name}",
                None if own_unit is INFERRED else own_unit,
            )
            if isinstance(declaration, Input | Output):
                # Extra ports are in no class body, so __set_name__ was not called.
                declaration.name = declaration.name or name
                is_inferred = declaration.shape is INFERRED
                ports[name] = Port(
                    self,
                    name,
                    declaration,
                    shape
                    if is_inferred
                    else Inferable(
                        self._shape(declaration.shape, name), fixed=True, own=True
                    ),
                    self._inferable(declaration.unit, unit),
                    self._inferable(declaration.frame, frame),
                    self._inferable(
                        declaration.labels, labels if is_inferred else Inferable()
                    ),
                )
        self._set_parameters(declared, parameters)
        values["ports"] = ports
        # Last: from here on, __setattr__ refuses everything.
        values["_frozen"] = True

    def _set_parameters(self, declared: dict[str, Any], given: dict[str, Any]) -> None:
        """Check and store the values of all parameters."""
        owner = type(self).__name__
        known = {n: d for n, d in declared.items() if isinstance(d, Parameter)}
        for name in given:
            if name not in known:
                raise ParameterError(
                    f"{owner} has no parameter '{name}'; it has: {', '.join(known) or 'none'}"
                )
        stored: dict[str, Vector] = {}
        for name, declaration in known.items():
            value = given.get(name, declaration.default)
            if value is REQUIRED:
                raise ParameterError(
                    f"{owner} needs a value for its parameter '{name}'"
                )
            shape = (
                None
                if declaration.shape is None
                else self._shape(declaration.shape, name)
            )
            stored[name] = declaration.convert(value, shape, owner)
        self.__dict__["parameters"] = stored
        self.check_parameters(Signals(owner, stored))

    def check_parameters(self, p: Signals) -> None:
        """Check that the parameter values are consistent; by default, all values are accepted.

        The method is called when the block is built, and when a run changes its parameters. It raises
        `ParameterError` for inconsistent values.

        Parameters
        ----------
        p : Signals
            Values of all parameters, each checked separately before [units as declared].
        """

    def _shape(self, shape: Shape, name: str) -> tuple[int, ...] | None:
        """Return a declared shape with names replaced by the sizes in this block's attributes."""
        if shape == ():
            return ()
        if shape is INFERRED:
            inferred: tuple[int, ...] | None = self.inferred_shape.get()
            return inferred
        resolved: list[Any] = []
        for part in shape if isinstance(shape, tuple) else (shape,):
            # Only attributes that were set before super().__init__() are there.
            value = self.__dict__.get(part) if isinstance(part, str) else part
            if value is None:
                raise BlockError(
                    f"{type(self).__name__}.{name} has shape '{part}', but the block has no such "
                    "attribute; set it before super().__init__()"
                )
            # A name may mean a whole shape: with extent = (2, 3),
            # 'extent' gives two axes.
            resolved += value if isinstance(value, tuple) else [value]
        return as_shape(f"{type(self).__name__}.{name}", resolved)

    def _inferable(self, value: Any, shared: Inferable) -> Inferable:
        """Return the `Inferable` of a unit, frame or labels; `shared` is that of all ports that infer it."""
        resolved = self._resolved(value)
        return (
            shared
            if resolved is INFERRED
            else Inferable(resolved, fixed=True, own=True)
        )

    def _resolved(self, value: Any) -> Any:
        return self.__dict__[value] if isinstance(value, Attribute) else value

    def parameter_value(self, name: str, value: Any) -> Vector:
        """Return the checked `value` of the parameter `name` [unit as declared].

        Raises
        ------
        ParameterError
            If it is not a number, not finite, of the wrong shape or out of bounds.
        """
        declaration: Parameter = self._declared[name]
        return declaration.convert(
            value, self.parameters[name].shape, f"block '{self.path}'"
        )

    # -- ports --------------------------------------------------------------------------

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self.__dict__.get("ports", ())]

    @final
    def declared(self, kind: type[_Kind]) -> dict[str, _Kind]:
        """Return the declarations of a `kind`, such as `Mode` or `Event`, by name."""
        return {n: d for n, d in self._declared.items() if isinstance(d, kind)}

    def port(self, name: str) -> Port:
        """Return the port of that name.

        Raises
        ------
        NameLookupError
            If there is none; the message lists the ports.
        """
        try:
            port: Port = self.ports[name]
        except KeyError:
            inputs = ", ".join(p.name for p in self.inputs()) or "none"
            outputs = ", ".join(p.name for p in self.outputs()) or "none"
            hint = f", it is a state: log it as '{self.path}.{name}'; to connect it, add an output"
            hint = hint if name in self.declared(State) else ""
            raise NameLookupError(
                f"block '{self.path}' ({type(self).__name__}) has no port '{name}'{hint}; "
                f"inputs: {inputs}; outputs: {outputs}"
            ) from None
        return port

    @final
    def inputs(self) -> list[Port]:
        """Return the input ports in order of declaration."""
        return [p for p in self.ports.values() if isinstance(p.declaration, Input)]

    @final
    def outputs(self) -> list[Port]:
        """Return the output ports in order of declaration."""
        return [p for p in self.ports.values() if isinstance(p.declaration, Output)]

    def only_input(self) -> Port:
        """Return the input of a block that has exactly one."""
        return self._only(self.inputs(), "input")

    def only_output(self) -> Port:
        """Return the output of a block that has exactly one."""
        return self._only(self.outputs(), "output")

    def _only(self, ports: list[Port], kind: str) -> Port:
        if len(ports) != 1:
            raise NameLookupError(
                f"'{self.path}' has {len(ports)} {kind}s "
                f"({', '.join(p.name for p in ports) or 'none'}); name the one to connect"
            )
        return ports[0]

    def wiring_diagram(self) -> Diagram:
        """Return the diagram in which the block can be connected."""
        return self.only_output().wiring_diagram()

    def __getitem__(self, index: Any) -> Port:
        """Return a slice of the only output."""
        return self.only_output()[index]

    def __rshift__(self, other: Port | Block) -> Block:
        """Connect the only output of this block; see `Port`."""
        return self.only_output() >> other

    def __rrshift__(self, other: Any) -> Block:
        """Raise `WiringError`, as the left operand is not a port; see `Port`."""
        block: Block = other >> self.only_input()
        return block

    # -- names --------------------------------------------------------------------------

    def __setattr__(self, name: str, value: Any) -> None:
        if self.__dict__.get("_frozen"):
            hint = (
                f"; connect it with 'source >> block.{name}'"
                if name in self.ports
                else "; set it before super().__init__(), build a new block with the new value, or keep "
                "data that change in a run in the object that open() returns"
            )
            raise BlockError(
                f"cannot set '{name}' of '{self.path}': blocks are frozen{hint}"
            )
        if (
            hasattr(Block, name) or name in Block.__annotations__
        ) and name not in SETTABLE_ATTRIBUTES:
            raise BlockError(
                f"{type(self).__name__} sets '{name}', but every block has Block.{name}; choose another name"
            )
        self.__dict__[name] = value

    def __getattr__(self, name: str) -> Any:
        # Python calls this method only if the attribute is missing:
        # Block.__init__ did not run.
        if name in Block.__annotations__:
            raise BlockError(
                f"this {type(self).__name__} is not built yet: its __init__ must call super().__init__(), "
                "and set only attributes of shapes and units before that call"
            )
        # Not for names with an underscore: copy and pickle test for methods
        # such as __deepcopy__.
        if "ports" in self.__dict__ and not name.startswith("_"):
            return self.port(name)
        raise AttributeError(name)

    @final
    def named(self, name: str) -> Self:
        """Set the `name` of a block outside any diagram; return the block.

        Raises
        ------
        BlockError
            If the block is in a diagram, whose names its wires use.
        """
        if self.parent is not None:
            raise BlockError(
                f"cannot call '{self.path}' '{name}': it is in diagram '{self.parent.name}'"
            )
        self.__dict__["name"] = name
        return self

    @property
    def path(self) -> str:
        """Name with the names of the enclosing diagrams, except the outermost one."""
        # The name of the outermost diagram would be in every path.
        if self.parent is None or self.parent.parent is None:
            return str(self.name)
        return f"{self.parent.path}.{self.name}"

    @final
    def diagram(self, purpose: str) -> Diagram:
        """Return the diagram this block was added to.

        Raises
        ------
        BlockError
            If it was not added to any.
        """
        if self.parent is None:
            raise BlockError(
                f"cannot {purpose}: this {type(self).__name__} is in no diagram yet; "
                "add it with diagram.add(name=block)"
            )
        parent: Diagram = self.parent
        return parent

    def sampled(self, every: float, offset: float = 0.0) -> Block:
        """Make this block compute at sample instants only, and hold its outputs in between.

        Parameters
        ----------
        every : float
            Sample time [s].
        offset : float
            First instant [s], at least 0 and less than `every`.

        Returns
        -------
        Block
            This block.

        Raises
        ------
        BlockError
            If the block has continuous states, or a time is not allowed.
        """
        if self.continuous:
            raise BlockError(
                f"cannot sample '{self.path}': it has continuous states; discretize it first"
            )
        try:
            every, offset = float(every), float(offset)
            sensible = np.isfinite(every) and every > 0 and 0 <= offset < every
        except (TypeError, ValueError, OverflowError):
            sensible = False
        if not sensible:
            raise BlockError(
                f"cannot sample '{self.path}' every {shown(every)} s with offset {shown(offset)} s: the "
                "sample time must be positive and finite, the offset at least 0 and less than the sample time"
            )
        self.__dict__.update(sample_time=every, sample_offset=offset)
        return self

    def _described(self) -> Description:
        """Return the rate, ports, states and parameters; the block may be incomplete."""
        kind = type(self).__name__
        # A debugger may show a block in the middle of its __init__.
        if "ports" not in vars(self):
            return Description(f"{kind}, not built yet")
        offset = f" from {self.sample_offset:g} s" if self.sample_offset else ""
        facts = {
            "sampled": ""
            if self.sample_time is None
            else f"every {self.sample_time:g} s{offset}",
            "in": ", ".join(port.summary for port in self.inputs()),
            "out": ", ".join(port.summary for port in self.outputs()),
            "states": ", ".join(
                n + (f" [{s.unit}]" if s.unit else "") for n, s in self.states().items()
            ),
            "parameters": ", ".join(
                f"{name} {value.shape}" if value.ndim else f"{name} = {value:g}"
                for name, value in self.parameters.items()
            ),
        }
        return Description(kind if self.name == kind else f"{self.name}: {kind}", facts)

    # -- equations ----------------------------------------------------------------------

    @property
    def continuous(self) -> bool:
        """Whether the block has continuous states."""
        return self.states_own("derivative")

    @property
    def _symbol(self) -> Symbol:
        text, kind = block_equations(self), type(self)
        summary = (kind.__doc__ or kind.__name__).partition("\n")[0]
        return Symbol(text, caption="" if text else "\n".join(wrapped(summary)))

    @property
    def hides(self) -> bool:
        """Whether the block has internal state besides its declared states."""
        return type(self).open is not Block.open

    @property
    def fingerprint(self) -> str:
        """Text that identifies the computation of a block beyond its equations; it is stored in results."""
        return ""

    @property
    def steps_itself(self) -> bool:
        """Whether `open` returns a `SelfStepping`; such a block must override this property."""
        return False

    @property
    def has_events(self) -> bool:
        """Whether the block has events; override it if only the object from `open` has `on_step`."""
        return bool(self.declared(Event)) or self.states_own("on_step")

    def open(self, p: Signals) -> Equations:
        """Return the equation object for one run; by default the block itself.

        A Python block with internal state returns a new `Running` for each run. A block that steps
        itself returns a `SelfStepping`.

        Parameters
        ----------
        p : Signals
            Parameters by name; they are updated when they change during the run [units as
            declared].
        """
        return self

    @final
    def states(self) -> dict[str, State]:
        """Return the declared states by name."""
        return {
            n: d for n, d in self.declared(State).items() if not isinstance(d, Mode)
        }

    def state_shape(self, name: str) -> tuple[int, ...]:
        """Return the shape of a state, mode or event; an inferred one is known after the connection."""
        declaration = self._declared[name]
        shape = self._shape(declaration.shape, name)
        if shape is None:
            raise BlockError(
                f"the shape of {type(declaration).__name__.lower()} '{name}' of '{self.path}' is not known: "
                "connect the block to a port of known shape, or give the block its shape"
            )
        return shape

    def initial(self, name: str, p: Signals) -> Vector:
        """Return the initial value of the state or mode `name`, with the parameters `p`."""
        value = self._declared[name].initial
        # A text names the parameter with the initial value.
        value = getattr(p, value) if isinstance(value, str) else value
        what = f"initial value of state '{name}' of '{self.path}'"
        # Infinity is allowed, as for a mode that holds the time of an
        # event that never occurs.
        return finite_array(what, value, self.state_shape(name), infinite=True).copy()

    def feedthrough(self) -> dict[str, tuple[str, ...]]:
        """Return the inputs with direct feedthrough to each output of a Python block.

        A Python block without direct feedthrough is allowed in a feedback loop. For traced blocks, the
        feedthrough is found by tracing.
        """
        return {
            port.name: tuple(p.name for p in self.inputs()) for port in self.outputs()
        }

    def breakpoints(self) -> tuple[float, ...]:
        """Return times [s] at which an output is not smooth; adaptive solvers stop there."""
        return ()


def check_kind(block: Block) -> None:
    """Check that every declaration and method of a `block` takes effect.

    Raises
    ------
    BlockError
        If a sample time is missing, or a method would never be called.
    """
    fault = ""
    declares = {**block.declared(Event), **block.declared(Mode)}
    if block.traced and block.hides:
        fault = "its open() would never be called: only Python blocks (traced = False) have one"
    elif block.sample_time is None and block.states() and not block.continuous:
        fault = (
            "discrete states need a sample time; add it with block.sampled(every=...), or write "
            "derivative() if they are continuous"
        )
    elif declares and not block.hides and not block.states_own("indicators"):
        fault = "it declares events or modes, but has no indicators() that trigger the events"
    elif not block.has_events:
        if block.states_own(*EVENTS):
            fault = "its event methods would never be called: declare an event, as in hit = Event('falling')"
    elif block.traced and block.states_own("on_step"):
        fault = "its on_step() would never be called: only Python blocks (traced = False) have one"
    elif block.sample_time is not None:
        fault = "a sampled block cannot have events, as it computes at its instants only; leave out sampled()"
    if fault:
        raise BlockError(
            f"cannot run block '{block.path}' ({type(block).__name__}): {fault}"
        )
