"""What the site is made of is whole: pages are reached, links lead somewhere, all that is public is shown."""

import re
import runpy
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[1] / "docs"
LINK = re.compile(r"\]\(([^)#:]+)(?:#[^)]*)?\)")
MADE = ("gallery/index.rst", "reference/", "rooms/")
"""Made when the site is built."""
PAGES = sorted([*DOCS.glob("*.md"), *DOCS.glob("reproduction/*.md")])


def test_every_page_is_in_the_contents():
    listed = (DOCS / "index.md").read_text(encoding="utf-8")
    for page in PAGES:
        name = page.relative_to(DOCS).with_suffix("").as_posix()
        assert name == "index" or f"\n{name}\n" in listed


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(DOCS).as_posix())
def test_links_lead_somewhere(page):
    """`make docs` looks at all of them; this needs none of what that takes."""
    for target in LINK.findall(page.read_text(encoding="utf-8")):
        path = (page.parent / target).resolve()
        if (page.parent / target).as_posix().startswith((DOCS / "gallery").as_posix()):
            path = DOCS.parent / "examples" / path.relative_to(DOCS / "gallery").with_suffix(".py")
        elif target.startswith(MADE):
            folder = "/".join(Path(target).stem.split("-")[1:])
            path = DOCS.parent / folder / "README.md"  # of the room
        assert path.exists() or Path(target).name == "index.rst", f"{page.name}: {target}"


def test_reference_shows_all_that_is_public():
    """Each thing once; subjects without anything in them are mistakes."""
    pytest.importorskip("latex2mathml")
    site = runpy.run_path(str(DOCS / "conf.py"))
    shown = site["public"]()
    assert all(shown.values()), [subject for subject, things in shown.items() if not things]
    paths = [path for things in shown.values() for path, _ in things]
    assert len(paths) == len(set(paths))
    for facade in ("blocks", "models", "fmu"):
        text = (DOCS.parent / facade / "__init__.py").read_text(encoding="utf-8")
        public = {name for name in re.findall(r" as (\w+)$", text, re.MULTILINE) if not name.isupper()}
        missing = public - {path.rpartition(".")[2] for path in paths}
        assert not missing, f"docs/conf.py has no subject for {missing}"
