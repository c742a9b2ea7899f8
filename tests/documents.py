"""Markdown files of the project, and what is set apart in them as code."""

import re

from sources import ROOT

DOCS = ROOT / "docs"
FOLDERS = ("blocks", "docs", "examples", "fmu", "models")
GENERATED = {"gallery", "pages", "reference"}
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)


def heads(text):
    """Return the heads of the tables in a text."""
    return set(re.findall(r"^(\|.*)\n\| ---", text, re.MULTILINE))


FILES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *(
        path
        for folder in FOLDERS
        for path in sorted((ROOT / folder).rglob("*.md"))
        if path.relative_to(ROOT).parts[1] not in GENERATED
    ),
]
"""Files written by hand, not made when the site is built."""

TEXTS = {path: path.read_text(encoding="utf-8") for path in FILES}
FENCES = [
    (path, *fence) for path, text in TEXTS.items() for fence in FENCE.findall(text)
]
SAMPLES = {
    f"{path.relative_to(ROOT).as_posix()}-{number}": text
    for number, (path, language, text) in enumerate(FENCES)
    if language == "python"
}
SHELL = "\n".join(text for _, language, text in FENCES if language == "sh")
COMMANDS = sorted({line for line in SHELL.splitlines() if line.split("#")[0].strip()})
