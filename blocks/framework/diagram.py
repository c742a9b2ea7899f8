"""Diagrams: blocks and the wires between them. A diagram is itself a block."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar, overload

import numpy.typing as npt

from trussflow.blocks.errors import BlockError, DiagramError, NameLookupError
from trussflow.blocks.framework.block import Block
from trussflow.blocks.framework.connection_check import overlap, same, unite
from trussflow.blocks.framework.netlist import Netlist
from trussflow.blocks.framework.port import Port, is_port, port_text
from trussflow.blocks.framework.symbol import Symbol, brief, wrapped
from trussflow.blocks.support.call_site import call_site
from trussflow.blocks.support.files import written
from trussflow.blocks.support.summary import Description
from trussflow.blocks.support.types import Vector
from trussflow.blocks.support.validation import as_path, finite_array, one_of, shown

if TYPE_CHECKING:
    import xarray as xr

B = TypeVar("B", bound=Block)


class Picture(str):
    """SVG text that notebooks show as a picture."""

    __slots__ = ()

    def _repr_svg_(self) -> str:
        return self


class Diagram(Netlist):
    """Blocks wired together.

    Parameters
    ----------
    name : str
        Name for messages and results.
    loops : str
        Policy for algebraic loops of blocks that are all in this diagram or in diagrams within it:
        ``"refuse"``, or ``"solve"`` the equations at every instant.

    Raises
    ------
    DiagramError
        If `loops` is neither.

    Examples
    --------
    >>> from trussflow.blocks import Constant, Diagram, Integrator, simulate
    >>> diagram = Diagram("ramp")
    >>> one, integral = diagram.add(one=Constant(1.0), integral=Integrator())
    >>> _ = one.y >> integral.u
    >>> float(simulate(diagram, 2.0, step=0.1)["integral.y"][-1].round(9))
    2.0
    """

    def __init__(self, name: str = "diagram", *, loops: str = "refuse") -> None:
        # Before super().__init__(), after which blocks are frozen.
        self.analysis_points: dict[str, tuple[str, Port]] = {}
        one_of("policy for algebraic loops", loops, ("refuse", "solve"), DiagramError)
        self.loop_policy, self.loop_starts = loops, dict[tuple[str, str], Vector]()
        self.blocks, self.wires, self.exposed = {}, [], {}
        super().__init__()
        self.named(name)

    def __getattr__(self, name: str) -> Any:
        # Through __dict__: before __init__, and while pickle restores a diagram, the
        # attribute is missing, and looking it up would call this method again.
        blocks = self.__dict__.get("blocks", {})
        if name in blocks or name.startswith("_") or "ports" not in self.__dict__:
            return blocks[name] if name in blocks else super().__getattr__(name)
        return self.port(name)

    def port(self, name: str) -> Port:
        """Return the port of that name: a port of this diagram, or the port at an analysis point.

        Raises
        ------
        NameLookupError
            If there is none; the message lists ports, analysis points and blocks.
        """
        if name in self.analysis_points:
            # The name, since a block that was replaced may be in another diagram by now.
            block, port = self.analysis_points[name]
            if block not in self.blocks:
                raise NameLookupError(
                    f"analysis point '{name}' of '{self.name}' is at '{block}.{port.name}', but there is no '{block}'"
                )
            # The block may have been replaced since the point was added.
            return self._present(port, block)
        try:
            return super().port(name)
        except NameLookupError as error:
            points = (
                f"; analysis points: {', '.join(self.analysis_points)}"
                if self.analysis_points
                else ""
            )
            blocks = ", ".join(self.blocks) or "none"
            raise NameLookupError(f"{error}{points}; blocks: {blocks}") from None

    def __dir__(self) -> list[str]:
        own = self.__dict__
        return [
            *super().__dir__(),
            *own.get("blocks", ()),
            *own.get("analysis_points", ()),
        ]

    @overload
    def add(self, name: str, block: B, /) -> B: ...
    @overload
    def add(self, **blocks: Block) -> Any: ...
    def add(self, *one: object, **blocks: Block) -> Any:
        """Add blocks under the names of the keywords, or one block after its name.

        A block that already has such a name in the diagram is replaced. The new block keeps its wires and
        exposed ports if a port of the same name fits. Wires that do not fit are cut, with a warning; so are,
        without one, wires of ports that it does not have. So a notebook cell may be run again.

        Parameters
        ----------
        *one : str and Block
            Name and block; editors then infer the type of the result.
        **blocks : Block
            Name and block.

        Returns
        -------
        Block or tuple of Block
            The added blocks in the same order, for unpacking.

        Raises
        ------
        DiagramError
            If a name cannot be used, a block is already in a diagram, or it is not a block.
        """
        named: dict[Any, Any] = (
            dict([one]) if len(one) == 2 and isinstance(one[0], str) else {}
        )
        if one and not named:
            what = (one[0] if isinstance(one[0], type) else type(one[0])).__name__
            raise DiagramError(
                f"cannot add a {what} to diagram '{self.name}' without a name: "
                f"write diagram.add(name={what}(...))"
            )
        named |= blocks
        for name, block in named.items():
            # The same call again, as in a notebook, changes nothing.
            if name in self.blocks and self.blocks[name] is block:
                continue
            # A block that replaces another has the name already.
            if name not in self.blocks:
                self._check_name(name)
            fault = ""
            if isinstance(block, type) and issubclass(block, Block):
                fault = (
                    f"{block.__name__} is a class; write {name}={block.__name__}(...)"
                )
            elif not isinstance(block, Block):
                fault = f"{shown(block)} is not a block"
            elif block.parent is not None:
                fault = (
                    f"this {type(block).__name__} is already in diagram '{block.parent.name}' as "
                    f"'{block.name}'; build a second one (a copy of a block includes its diagram)"
                )
            elif block in self._surroundings():
                fault = "a diagram cannot contain itself"
            if fault:
                raise DiagramError(
                    f"cannot add '{name}' to diagram '{self.name}': {fault}"
                )
            self._put(name, block)
        added = tuple(named.values())
        return added[0] if len(added) == 1 else added

    def _check_name(self, name: str) -> None:
        """Raise `DiagramError` if a name is taken, or cannot be used as an attribute."""
        taken: dict[str, Collection[str]] = {
            "a block": self.blocks,
            "a port": self.ports,
            "an analysis point": self.analysis_points,
        }
        if what := next((what for what, names in taken.items() if name in names), ""):
            fault = f"it already has {what} of that name"
        elif name in self.__dict__ or hasattr(type(self), name):
            fault = "every diagram has an attribute of that name"
        elif not name.isidentifier():
            fault = "names consist of letters, digits and underscores"
        else:
            return
        raise DiagramError(
            f"diagram '{self.name}' cannot have a '{name}': {fault}; choose another name"
        )

    def expose(self, **ports: Port | tuple[Port, ...]) -> None:
        """Expose ports of inner blocks as ports of this diagram; a repeated call has no effect.

        A name has one meaning in a diagram, as ``diagram.name`` returns it: a block, a port or an analysis
        point.

        Parameters
        ----------
        **ports : Port or tuple of Port
            Name of the exposed port, and the inner port; an exposed input may drive several inputs.

        Raises
        ------
        DiagramError
            If a name is taken or a port is not of a block in this diagram.
        """
        where = call_site()
        for name, given in ports.items():
            inner = given if isinstance(given, tuple) else (given,)
            there = self.exposed.get(name, ())
            # The same call again, as in a notebook, changes nothing.
            if len(inner) == len(there) > 0 and all(
                is_port(p) and same(p, q) for p, q in zip(inner, there, strict=True)
            ):
                continue
            self._check_name(name)
            for port in inner:
                if fault := self._exposure_fault(port, inner):
                    raise DiagramError(
                        f"cannot expose {port_text(port)} as '{name}': {fault}   [{where}]"
                    )
            if not inner:
                raise DiagramError(
                    f"cannot expose an empty tuple as '{name}'   [{where}]"
                )
            first = inner[0]
            for port in inner[1:]:
                # One wire will drive all of them, so they must share
                # shape, unit and frame.
                unite(first, port, where)
            self.exposed[name] = inner
            self.ports[name] = replace(first, block=self, name=name)

    def add_analysis_points(self, **ports: Port) -> None:
        """Name signals for linear analysis: loop openings, inputs, outputs.

        All functions that take a reference to a port accept these names: `linearize`, `loop_transfer`,
        `trim`, the log of a simulation. In a nested diagram the name is ``"diagram.name"``. Ports and wires
        do not change. An existing name may be assigned again to another port.

        Parameters
        ----------
        **ports : Port
            Name, and a whole or sliced port of a block in this diagram.

        Raises
        ------
        DiagramError
            If a name is taken or a port is not of a block in this diagram.

        Examples
        --------
        >>> from trussflow.blocks import Diagram, Gain, Integrator, loop_transfer
        >>> loop = Diagram("loop")
        >>> integral, law = loop.add(integral=Integrator(), law=Gain(-2.0))
        >>> _ = integral >> law >> integral
        >>> loop.add_analysis_points(command=law.y)
        >>> loop_transfer(loop, "command").input_labels
        ['command']
        """
        for name, port in ports.items():
            if not self._owns(port):
                raise DiagramError(
                    f"cannot name {port_text(port)} '{name}': give a port of a block in diagram '{self.name}'; for "
                    "a block of a nested diagram, add the analysis point there"
                )
            if name not in self.analysis_points:
                self._check_name(name)
            self.analysis_points[name] = port.block.name, port

    def guess(self, port: Port, value: npt.ArrayLike) -> None:
        """Set the initial guess of a signal in an algebraic loop; the default is zero.

        The guess selects one of several solutions. The loop is torn at this signal.

        Parameters
        ----------
        port : Port
            An output of a block in this diagram.
        value : array_like
            Initial guess [unit of the signal].

        Raises
        ------
        DiagramError
            If the port is not a whole output of a block in this diagram.
        ParameterError
            If the value is not finite.
        """
        if not self._owns(port) or port.is_input or port.index is not None:
            raise DiagramError(
                f"cannot guess {port_text(port)}: give a whole output of a block in '{self.name}'"
            )
        guessed = finite_array(f"the guess of '{port.path}'", value)
        self.loop_starts[port.block.name, port.name] = guessed

    def _exposure_fault(self, port: Port, group: tuple[Port, ...]) -> str:
        """Return the reason why a port cannot be exposed with the others of its group, or an empty text."""
        if not self._owns(port) or port.index is not None:
            return f"give whole ports of blocks in diagram '{self.name}'"
        if len(group) > 1 and not port.is_input:
            return "only inputs can be grouped"
        if not port.is_input:
            return ""
        if group.count(port) > 1:
            return "it is in the group twice"
        for wire in self.wires:
            if overlap(wire.target, port):
                return f"it is driven inside   [{wire.where}]"
        for name, inner in self.exposed.items():
            if port in inner:
                return f"it is already exposed as '{name}'"
        return ""

    def draw(
        self, path: str | Path | None = None, *, result: xr.Dataset | None = None
    ) -> Picture:
        """Draw the diagram: signals run from left to right, feedback runs back below the blocks.

        Blocks have the symbols of textbooks. Each nested diagram is one block; its own `draw` shows its
        blocks. Sampled blocks are coloured, and show their sample times. Tooltips show complete names, shapes
        and units. A page has zoom, groups that open, and search.

        Parameters
        ----------
        path : str or pathlib.Path, optional
            File to write: a picture with the suffix .svg, or a page with .html. An existing file is replaced.
        result : xarray.Dataset, optional
            Result of a run, for a page: a click on a wire shows the chart of its signal.

        Returns
        -------
        Picture
            The SVG text, which notebooks show as a picture.

        Raises
        ------
        DiagramError
            If the file cannot be written, or has another suffix, or the result is not of this diagram.

        Examples
        --------
        >>> from trussflow.blocks import Constant, Diagram, Integrator
        >>> ramp = Diagram("ramp")
        >>> one, integral = ramp.add(one=Constant(1.0), integral=Integrator())
        >>> _ = one.y >> integral.u
        >>> ramp.draw()[:4]
        '<svg'
        """
        cannot, suffix = f"cannot draw diagram '{self.name}' to", ""
        if path is not None:
            suffix = as_path(DiagramError, cannot, path).suffix.lower()
        if result is not None and suffix != ".html":
            raise DiagramError(
                f"cannot draw diagram '{self.name}' with a result: only a page shows one; name a file .html"
            )
        picture = Picture(self._artists[".svg"](self))
        if path is None:
            return picture
        if suffix not in self._artists:
            raise DiagramError(
                f"{cannot} '{path}': pictures are SVG, pages HTML; name the file .svg or .html"
            )
        text = (
            self._artists[suffix](self, picture, result)
            if suffix == ".html"
            else picture
        )
        written(path, text, DiagramError, cannot)
        return picture

    _artists: ClassVar[dict[str, Callable[..., str]]] = {}
    """Drawing functions by suffix, set by the package `drawing`, which imports this one."""

    def live(
        self,
        path: str | Path | None = None,
        *,
        parameters: Mapping[str, tuple[float, float] | None]
        | Sequence[str]
        | None = None,
        signals: Mapping[str, Port | str] | Sequence[Port | str] | None = None,
        at: Port | str | None = None,
        duration: float = 10.0,
        step: float | None = None,
        panels: Sequence[Any] = (),
        pace: float | None = None,
    ) -> Path | None:
        """Write a page that simulates the diagram in the reader's browser, one HTML file without network; or serve it.

        The page has a slider for each chosen parameter, and charts of the chosen signals, which follow the
        sliders. The compiled equations and the step algorithm are those of `simulate`.

        Parameters
        ----------
        path : str or pathlib.Path, optional
            File to write; an existing file is replaced. Without it, this process serves the page at an address
            with a secret token, only to this computer, until Ctrl-C. It then computes the runs, so that the
            diagram may have Python blocks and FMUs.
        parameters : mapping or sequence of str, optional
            Parameters with a slider, such as ``"pid.kp"`` or ``"law.gain[0]"``, and optionally the ends of the
            slider [units as declared]; by default up to 12 numbers of the blocks in this diagram, gains first.
        signals : mapping or sequence, optional
            Signals in charts, as for the argument `log` of `simulate`; by default the exposed outputs, otherwise
            all outputs.
        at : Port or str, optional
            Scalar wire at which the loop is opened: the page shows poles, Bode plot and margins as
            `loop_margins` does. Not for diagrams with sampled blocks.
        duration : float
            Duration of a run [s].
        step : float, optional
            Fixed step of the solver ``"rk4"`` [s]; by default from the fastest mode and the sample times. At most
            4000 steps are logged.
        panels : sequence of Panel
            Further views that follow the cursor, see `trussflow.blocks.live.page.Panel`.
        pace : float, optional
            Simulated seconds in a second of wall time, of a served page [-]. A slider then acts on the run that
            goes on. By default runs are as fast as possible, and a slider starts a new run.

        Returns
        -------
        pathlib.Path or None
            Path of the page, if it was written.

        Raises
        ------
        DiagramError
            If a page is to be written and a block computes in Python, or the file cannot be written.
        SimulationError
            If an argument is invalid.
        LinearAnalysisError
            If the loop cannot be analysed.
        CompilationError
            If there is no compiler for WebAssembly: the package ziglang has one.
        """
        return type(self)._live_page(
            self,
            path,
            parameters=parameters,
            signals=signals,
            at=at,
            duration=duration,
            step=step,
            panels=panels,
            pace=pace,
        )

    _live_page: ClassVar[Callable[..., Path | None]]
    """Function that writes or serves a live page, set by the package `live`, which imports this one."""

    @property
    def _symbol(self) -> Symbol:
        names = wrapped(", ".join(map(brief, self.blocks)))
        many = f"{len(self.blocks)} blocks"
        return Symbol(caption=many if len(names) > 2 else "\n".join(names))

    def _repr_svg_(self) -> str:
        return self.draw()

    def _repr_html_(self) -> None:
        """Return None, as notebooks prefer HTML to the picture."""

    def _described(self) -> Description:
        own, blocks = super()._described(), self.__dict__.get("blocks", {}).values()
        return replace(
            own,
            title=f"{own.title}, {len(blocks)} blocks, {len(self.wires)} wires",
            parts=tuple(block._described() for block in blocks),
        )

    def sampled(self, every: float, offset: float = 0.0) -> Block:
        """Raise `BlockError`, as a diagram has no clock.

        Raises
        ------
        BlockError
            Always; the message gives the remedy.
        """
        raise BlockError(
            f"cannot sample diagram '{self.path}': sample the blocks in it one by one"
        )


def leaves(item: Block) -> list[Block]:
    """Return a block itself, or all blocks of a diagram and of the diagrams nested in it.

    Parameters
    ----------
    item : Block
        The block or diagram.
    """
    blocks = item.within() if isinstance(item, Diagram) else [item]
    return [block for block in blocks if not isinstance(block, Diagram)]
