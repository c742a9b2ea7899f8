"""Site: the pages of this folder, executed examples, and the reference, generated from the code.

The generated folders (`reference`, `gallery`, `pages`) are not kept in the repository.
"""

import importlib
import inspect
import re
import shutil
import sys
from pathlib import Path

from latex2mathml.converter import convert
from sphinx.util.logging import getLogger
from tqdm import tqdm

import trussflow
from trussflow.blocks import INFERRED, Block, Diagram, Equations, Input, Output
from trussflow.blocks.errors import DiagramError

HERE = Path(__file__).parent
ROOT = HERE.parent
EXAMPLES = ROOT / "examples"
(HERE / "pages").mkdir(exist_ok=True)
sys.path.insert(0, str(HERE))

project, author, release = "trussflow", "trussflow developers", trussflow.__version__
copyright = author
extensions = [
    "sphinx.ext.autodoc",
    "numpydoc",
    "myst_parser",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = ["*/evidence.json", "gallery/*.ipynb", "gallery/*.py"]
html_theme = "furo"
html_title = "trussflow"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sphinx = False
html_copy_source = False
html_math_renderer = "mathml"
html_extra_path = ["pages"]
myst_enable_extensions = ["dollarmath", "colon_fence", "attrs_inline"]
myst_heading_anchors = 4
highlight_language = "none"  # for code without a language
nitpicky = False
numpydoc_show_class_members = False
numpydoc_validation_checks: set[str] = set()
autodoc_typehints = "none"
autodoc_class_signature = "mixed"
autodoc_member_order = "bysource"
suppress_warnings = ["config.cache"]


# -- the gallery ------------------------------------------------------------------------------


def scrape(block, variables, settings):
    """Return the pictures and pages that a cell of an example wrote, and the live page of its last diagram."""
    source = Path(variables["src_file"])
    folder, shown = source.parent, []
    text = source.read_text(encoding="utf-8")
    diagrams = [
        v
        for v in variables["example_globals"].values()
        if isinstance(v, Diagram) and v.parent is None
    ]
    for whole in diagrams[-1:]:
        if not re.search(r"plt\.|draw\(", text):
            # no picture of its own
            whole.draw(source.with_suffix(".svg"))
        # After the last cell with code, as earlier diagrams may not be complete.
        below = text.rpartition(block[1].rstrip())[2].splitlines()
        # Flexible trusses of missions would take minutes to compile.
        if folder.name != "missions" and all(line[:1] in ("", "#") for line in below):
            try:
                whole.live(folder / "live.html")
            except DiagramError as error:  # Python blocks, FMUs, or open inputs
                getLogger(__name__).info("%s has no live page: %s", source.name, error)
    for file in sorted(
        [*folder.glob("*.svg"), *folder.glob("*.html")], key=lambda f: f.stat().st_mtime
    ):
        if file.suffix == ".svg":
            picture = Path(next(variables["image_path_iterator"])).with_suffix(".svg")
            shutil.move(file, picture)
            name = picture.relative_to(HERE / "gallery").as_posix()
            shown.append(
                f".. image:: /gallery/{name}\n   :class: diagram\n   :alt: {file.stem}\n"
            )
        else:
            page = f"{source.stem}_{file.name}"  # names of files are not unique
            shutil.move(file, HERE / "pages" / page)
            up = "../" * len(source.relative_to(EXAMPLES).parts)
            if file.name == "live.html":
                shown.append("This page simulates the last diagram, in the browser:\n")
            shown.append(
                f'.. raw:: html\n\n   <iframe class="replay" loading="lazy" src="{up}{page}"></iframe>\n'
            )
    return "\n".join(shown)


sphinx_gallery_conf = {
    "examples_dirs": str(EXAMPLES),
    "gallery_dirs": "gallery",
    "filename_pattern": r"\.py$",
    "ignore_pattern": r"/_",
    "within_subsection_order": "FileNameSortKey",
    "image_scrapers": (scrape, "matplotlib"),
    "capture_repr": ("_repr_html_",),
    "ignore_repr_types": r"trussflow\.blocks\.(?!linear_analysis)",  # values of wires
    "download_all_examples": False,
    "show_signature": False,
    "show_memory": False,
    "write_computation_times": False,
    "abort_on_example_error": True,
    "min_reported_time": 1e9,
    "plot_gallery": "True",
}

# -- links ------------------------------------------------------------------------------------

LINK = re.compile(r"(?<!!)\[([^\]]*)\]\(([^)#:]+)(#[^)]*)?\)")


def linked(text: str, folder: Path) -> str:
    """Return the text of a page with links to files outside this folder replaced by their paths."""

    def led(link: re.Match[str]) -> str:
        target, anchor = (folder / link.group(2)).resolve(), link.group(3) or ""
        if target == EXAMPLES or (
            target.is_relative_to(EXAMPLES) and target.suffix == ".py"
        ):
            page = (
                target.relative_to(EXAMPLES).with_suffix("")
                if target.suffix
                else Path("index")
            )
            return f"[{link.group(1)}](/gallery/{page.as_posix()}.rst{anchor})"
        if target.is_relative_to(HERE) or not target.is_relative_to(ROOT):
            return link.group(0)
        return f"`{target.relative_to(ROOT).as_posix()}`"

    return LINK.sub(led, text)


def relink(app, name, source) -> None:
    """Replace links of a page, and the folder of the repository in the output of examples."""
    if (HERE / f"{name}.md").is_file():
        source[0] = linked(source[0], (HERE / name).parent)
    source[0] = source[0].replace(f"{ROOT}/", "")


PAGE_LINK = re.compile(r":doc:`([^`<]*?)(?:\\n|\s)*<[^`]*>`")


def unlink_notebooks(app) -> None:
    """Replace links to pages in notebooks by their texts."""
    for file in (HERE / "gallery").rglob("*.ipynb"):
        text = PAGE_LINK.sub(r"\1", file.read_text(encoding="utf-8"))
        file.write_text(text, encoding="utf-8")


# -- the reference ------------------------------------------------------------------------------

SUBJECTS = {
    "Diagrams and blocks": ["blocks.framework", "blocks.drawing", "blocks.tracing"],
    "Simulation": ["blocks.simulation", "blocks.results", "blocks.testing"],
    "Errors": ["blocks.errors"],
    "Sweeps and tuning": ["blocks.sweeps"],
    "Sources and tables": [
        f"blocks.library.{m}" for m in ("sources", "noise", "tables")
    ],
    "Algebra and nonlinearities": [
        f"blocks.library.{m}"
        for m in ("algebra", "nonlinear", "switching", "groups", "python_function")
    ],
    "Continuous and discrete dynamics": [
        f"blocks.library.{m}"
        for m in (
            "continuous",
            "discrete",
            "transport_delay",
            "rigid_body",
            "python_control",
        )
    ],
    "Trajectories": [
        f"blocks.control.{m}" for m in ("trajectory", "time_scaling", "input_shaping")
    ],
    "Control laws and allocation": [
        "blocks.library.state_machine",
        *(
            f"blocks.control.{m}"
            for m in ("pd", "pid", "sliding_mode", "disturbance_observer", "allocation")
        ),
    ],
    "Kalman filters": [
        f"blocks.control.{m}"
        for m in ("kalman_filter", "kalman_design", "process_models", "covariances")
    ],
    "Linear analysis": ["blocks.linear_analysis"],
    "Co-simulation": ["blocks.cosimulation", "blocks.library.udp"],
    "FMUs": ["fmu"],
    "Truss, robots and plants": [
        f"models.{m}"
        for m in (
            "geometry",
            "truss",
            "robots",
            "dynamics",
            "plant",
            "errors",
            "parameter_files",
        )
    ],
    "Hardware": ["models.hardware"],
    "Feasibility": ["models.feasibility"],
    "Mean-axes control": ["models.mean_axes"],
    "Missions": ["models.transport"],
    "Replay": ["models.viewer"],
}
"""Subjects of the reference pages, and the modules that define their names."""

FACADES = (
    "blocks",
    "blocks.control",
    "blocks.errors",
    "blocks.linear_analysis.uncertainty",
    "blocks.testing",
    "fmu",
    "models",
    "models.feasibility",
    "models.transport",
    "models.viewer",
)


def public() -> dict[str, list[tuple[str, object]]]:
    """Return the names of the facades by subject: import path and object."""
    found: dict[str, list[tuple[str, object]]] = {subject: [] for subject in SUBJECTS}
    seen: set[str] = set()
    for facade in FACADES:
        module = importlib.import_module(f"trussflow.{facade}")
        for name, thing in vars(module).items():
            home = getattr(thing, "__module__", "").removeprefix("trussflow.")
            if name.startswith("_") or not callable(thing) or name in seen:
                continue
            seen.add(name)
            places = {
                p: s
                for s, all_of in SUBJECTS.items()
                for p in all_of
                if f"{home}.".startswith(f"{p}.")
            }
            if places:
                found[places[max(places, key=len)]].append(
                    (f"trussflow.{facade}.{name}", thing)
                )
    return {subject: sorted(things, key=place) for subject, things in found.items()}


ORDER = (
    "Diagram",
    "Block",
    "Input",
    "Output",
    "Parameter",
    "State",
    "simulate",
    "Simulator",
    "SpaceTruss",
)
"""Names that come first on their page."""


def is_error(thing: object) -> bool:
    """Return whether an object is an exception class."""
    return inspect.isclass(thing) and issubclass(thing, BaseException)


def place(pair: tuple[str, object]) -> tuple[bool, int]:
    """Return the sort key of a name: `ORDER` first, errors last."""
    name = pair[0].rpartition(".")[2]
    return is_error(pair[1]), ORDER.index(name) if name in ORDER else len(ORDER)


EQUATIONS = (
    *(
        name
        for name, thing in vars(Equations).items()
        if callable(thing) and name[0] != "_"
    ),
    *(
        "open",
        "check_parameters",
        "breakpoints",
        "feedthrough",
        "initial",
        "parameter_value",
    ),
)
"""Methods that every block has; `Block` and `Equations` document them."""


def reference_index(subjects: dict[str, list[tuple[str, object]]]) -> str:
    """Return the source of the index: all pages, and every public name with its summary."""
    text = "Reference\n=========\n\n.. toctree::\n   :maxdepth: 1\n\n"
    text += "".join(f"   {slug(subject)}\n" for subject in subjects)
    for subject, things in subjects.items():
        text += f"\n{subject}\n{'-' * len(subject)}\n\n"
        for path, thing in things:
            summary = (inspect.getdoc(thing) or "").partition("\n")[0]
            text += f"* :py:obj:`~{path}`: {summary}\n"
    return text


def slug(subject: str) -> str:
    """Return the file name of a subject."""
    return re.sub(r"\W+", "-", subject.lower())


def reference_page(subject: str, things: list[tuple[str, object]]) -> str:
    """Return the source of a reference page."""
    text = f"{subject}\n{'=' * len(subject)}\n\n"
    errors = [path for path, thing in things if is_error(thing)]
    for path, thing in things:
        if path not in errors:
            kind = "class" if inspect.isclass(thing) else "function"
            members = "   :members:\n" if kind == "class" else ""
            if kind == "class" and issubclass(thing, Block) and thing is not Block:
                members += f"   :exclude-members: {', '.join(EQUATIONS)}\n"
            text += f".. auto{kind}:: {path}\n{members}\n"
    if errors:
        text += "Errors\n------\n\n" + "".join(
            f".. autoexception:: {path}\n\n" for path in errors
        )
    return text


def add_declarations(app, what, name, thing, options, lines) -> None:
    """Add a table of ports, states and parameters to the docstring of a block."""
    if what != "class" or not issubclass(thing, Block) or not thing._declared:
        return
    lines += ["", ".. list-table::", "   :header-rows: 1", "   :class: declared", ""]
    rows = [("", "name", "shape", "unit", "meaning")]
    for port, declared in thing._declared.items():
        kind = {Input: "in", Output: "out"}.get(
            type(declared), type(declared).__name__.lower()
        )
        shape, unit = getattr(declared, "shape", ""), getattr(declared, "unit", None)
        rows.append(
            (
                kind,
                f"``{port}``",
                said(shape),
                said(unit),
                getattr(declared, "meaning", "") or "",
            )
        )
    for row in rows:
        lines += [f"   {'*' if k == 0 else ' '} - {cell}" for k, cell in enumerate(row)]
    lines += [""]


def said(value: object) -> str:
    """Return a shape or unit of a declaration as readable text."""
    if value is INFERRED:
        return "as wired"
    if value in (None, "", ()):
        return (
            ""
            if value is None
            else "scalar"
            if value == ()
            else "set by the constructor"
        )
    return f"``{value}``" if isinstance(value, str) else str(value).replace("'", "``")


def skip_fields(app, what, name, thing, skipped, options) -> bool | None:
    """Skip the fields of a named tuple, which its docstring lists."""
    return (
        True
        if (getattr(thing, "__doc__", "") or "").startswith("Alias for field")
        else None
    )


# -- formulas, without a network: the browser's own ----------------------------------------------


def mathml(text: str, display: str = "inline") -> str:
    """Return a formula as MathML, with the spaces that TeX sets and the converter does not."""
    text = re.sub(rf"(?<=[\w)}}])\s*(?=\\{FUNCTION})", r"\\,", text)
    text = re.sub(rf"(\\{FUNCTION})\s*(?=\w|\\(?!left|,|;))", r"\1\\,", text)
    bar = '<mo stretchy="false"{}>&#x0007C;</mo>'
    found = convert(text, display=display).replace(
        bar.format(""), bar.format(' lspace="0" rspace="0"')
    )
    if re.search(r"<m[io]>(\\|&<)", found):
        raise ValueError(f"the formula converter does not support {text!r}")
    return re.sub("<mo>(min|max)</mo>", r"<mi>\1</mi>", found)


FUNCTION = r"(?:sin|cos|tan|tanh|exp|ln|log|min|max)\b"


def inline_formula(translator, node) -> None:
    """Write an inline formula."""
    translator.body.append(mathml(node.astext()))
    raise importlib.import_module("docutils.nodes").SkipNode


def formula(translator, node) -> None:
    """Write a displayed formula."""
    text = node.astext()
    if r"\\" in text and r"\begin" not in text:
        text = rf"\begin{{align*}}{text}\end{{align*}}"
    translator.body.append(f'<div class="math">{mathml(text, "block")}</div>')
    raise importlib.import_module("docutils.nodes").SkipNode


def write_sources(app) -> None:
    """Write the pages of the reference."""
    folder = HERE / "reference"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    subjects = public()
    (folder / "index.rst").write_text(reference_index(subjects), encoding="utf-8")
    for subject, things in subjects.items():
        (folder / f"{slug(subject)}.rst").write_text(
            reference_page(subject, things), encoding="utf-8"
        )


def setup(app) -> None:
    """Register the extensions above."""
    tqdm.display = lambda *_, **__: None  # no progress bars on pages
    app.add_html_math_renderer(
        "mathml",
        inline_renderers=(inline_formula, None),
        block_renderers=(formula, None),
    )
    app.connect("builder-inited", write_sources, priority=1)
    app.connect("builder-inited", unlink_notebooks, priority=900)  # after the gallery
    app.connect("source-read", relink)
    app.connect("autodoc-skip-member", skip_fields)
    app.connect("autodoc-process-docstring", add_declarations, priority=900)
