"""Rules about the documents: links lead somewhere, commands exist, the site shows each public name."""

import json
import re
import runpy
import subprocess
from collections import Counter
from importlib.util import find_spec

import pytest
from documents import COMMANDS, DOCS, FENCES, FILES, GENERATED, TEXTS
from sources import ROOT

from trussflow.blocks import Constant, Diagram, Gain

LINK = re.compile(r"\]\(([^)#:]+)(?:#[^)]*)?\)")


def test_fences_are_of_languages_that_are_checked_here():
    assert {language for _, language, _ in FENCES} == {"", "python", "sh"}


def test_targets_of_make_exist():
    lines = [line for line in COMMANDS if line.startswith("make ")]
    targets = {line.split()[1] for line in lines}
    targets.update(
        name for text in TEXTS.values() for name in re.findall(r"`make ([\w-]+)", text)
    )
    subprocess.run(
        ["make", "--dry-run", *sorted(targets)],
        cwd=ROOT,
        capture_output=True,
        check=True,
    )


def test_modules_named_as_commands_exist():
    for module in {
        name
        for text in TEXTS.values()
        for name in re.findall(r"`python3? -m ([\w.]+)", text)
    }:
        spec = find_spec(module)
        assert spec is not None, module
        if spec.submodule_search_locations is not None:
            assert find_spec(f"{module}.__main__"), module


def test_links_lead_somewhere():
    """In a clone, where no page is generated; `make docs` follows the links of the site."""
    generated = [DOCS / name for name in GENERATED]
    dead = []
    for path, text in TEXTS.items():
        for target in LINK.findall(text):
            file = (path.parent / target).resolve()
            if not file.exists() or any(
                file.is_relative_to(folder) for folder in generated
            ):
                dead.append(f"{path.relative_to(ROOT)}: {target}")
    assert dead == []


def test_documents_state_the_verdicts_of_the_report():
    report = json.loads((DOCS / "reproduction/evidence.json").read_text("utf-8"))
    verdicts = Counter(claim["verdict"].strip("*") for claim in report["claims"])
    expected = [
        len(report["claims"]),
        verdicts["reproduced"],
        verdicts["reproduced with the paper's step only"],
        verdicts["differs"],
        verdicts["cannot be judged"],
    ]
    stated = re.compile(r"\d+ (?:statements|claims)\b(?:\D+\d+){4}")
    found = {
        path.relative_to(ROOT).as_posix(): [
            int(n) for n in re.findall(r"\d+", sentence)
        ]
        for path, text in TEXTS.items()
        for sentence in stated.findall(text)
    }
    assert {"README.md", "docs/validation.md"} <= found.keys()
    assert [path for path, counts in found.items() if counts != expected] == []


def test_files_named_with_their_folder_exist():
    """Files of other projects and of users are named without a folder."""
    tops = ("blocks", "models", "fmu", "tests", "examples", "docs")
    files = {
        f"/{path.relative_to(ROOT).as_posix()}"
        for top in tops
        for path in (ROOT / top).rglob("*.*")
    }
    missing = [
        f"{path.relative_to(ROOT)}: {name}"
        for path, text in TEXTS.items()
        for name in re.findall(r"`([\w-]+/[\w/-]+\.(?:py|h|c|toml|md))`", text)
        if not any(file.endswith(f"/{name}") for file in files)
    ]
    assert missing == []


def test_links_to_examples_lead_to_pages_of_the_site():
    pytest.importorskip("latex2mathml")
    linked = runpy.run_path(str(DOCS / "conf.py"))["linked"]
    for target, page in {
        "../examples/peers/quadrotor.py": "/gallery/peers/quadrotor.rst",
        "../examples": "/gallery/index.rst",
        "../examples/loops/pid.py": "/gallery/loops/pid.rst",
        "sweeps.md": "sweeps.md",
    }.items():
        assert linked(f"[it]({target})", DOCS) == f"[it]({page})"


def test_notebooks_have_the_texts_of_links_to_pages():
    pytest.importorskip("latex2mathml")
    link = runpy.run_path(str(DOCS / "conf.py"))["PAGE_LINK"]
    for source in (":doc:`a page </page>`", r":doc:`a page\n</page>`"):  # JSON
        assert link.sub(r"\1", f"see {source}, twice") == "see a page, twice"


@pytest.mark.usefixtures("ziglang")
def test_last_cell_of_an_example_shows_its_whole_diagram_live(tmp_path):
    pytest.importorskip("latex2mathml")
    scrape = runpy.run_path(str(DOCS / "conf.py"))["scrape"]
    scrape.__globals__.update(HERE=tmp_path, EXAMPLES=tmp_path, LIVE=[tmp_path])
    (tmp_path / "pages").mkdir()
    source = tmp_path / "loop.py"
    source.write_text("first = 1\n\nlast = plt.draw()\n\n# %%\n# The end.\n")
    inner, whole = Diagram("inner"), Diagram("whole")
    inner.add(gain=Gain(2.0))
    inner.expose(u=inner.gain.u, y=inner.gain.y)
    whole.add(one=Constant(1.0), inner=inner)
    whole.one >> inner.u
    seen = {"example_globals": {"whole": whole, "inner": inner}, "src_file": source}
    assert scrape(("code", "first = 1\n", 1), seen, {}) == ""
    assert 'src="../loop_live.html"' in scrape(
        ("code", "last = plt.draw()\n", 3), seen, {}
    )
    page = (tmp_path / "pages" / "loop_live.html").read_text(encoding="utf-8")
    assert "inner.gain" in page
    seen["example_globals"] = {"without_input": Diagram("open")}
    seen["example_globals"]["without_input"].add(gain=Gain(1.0))
    assert scrape(("code", "last = plt.draw()\n", 3), seen, {}) == ""


def test_every_page_is_in_the_contents():
    contents = (DOCS / "index.md").read_text(encoding="utf-8")
    pages = [
        path.relative_to(DOCS).with_suffix("")
        for path in FILES
        if path.is_relative_to(DOCS)
    ]
    listed = {line.rpartition("<")[2].rstrip(">") for line in contents.splitlines()}
    assert [
        page for page in pages if page.name != "index" and page.as_posix() not in listed
    ] == []


def test_reference_shows_each_public_name_once():
    pytest.importorskip("latex2mathml")
    shown = runpy.run_path(str(DOCS / "conf.py"))["public"]()
    assert [subject for subject, names in shown.items() if not names] == []
    paths = [path for names in shown.values() for path, _ in names]
    assert len(paths) == len(set(paths))
    for package in ("blocks", "models", "fmu"):
        text = (ROOT / package / "__init__.py").read_text(encoding="utf-8")
        public = {
            name
            for name in re.findall(r" as (\w+)$", text, re.MULTILINE)
            if not name.isupper()
        }
        missing = public - {path.rpartition(".")[2] for path in paths}
        assert not missing, f"docs/conf.py has no subject for {missing}"
