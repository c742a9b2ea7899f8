"""A first look at XML from elsewhere, before any library builds a tree of it."""

from __future__ import annotations

from xml.parsers import expat

from trussflow.fmu.errors import FmuDescriptionError

MAX_DEPTH = 100
"""Nesting above which a document is refused; FMI needs six levels, annotations some more."""


def check_xml(text: bytes, where: str) -> None:
    """Refuse XML that is not well-formed, or that declares a document type.

    Entities, with which a few lines grow to gigabytes or read other files, need such a
    declaration, and FMI has none. After this check a parser has nothing left to expand.

    Parameters
    ----------
    text : bytes
        The document.
    where : str
        What it is, for messages.

    Raises
    ------
    FmuDescriptionError
        If the document is refused.
    """
    parser = expat.ParserCreate(namespace_separator=" ")  # names of no known space are faults too
    depth = 0

    def refuse(*_: object) -> None:
        raise FmuDescriptionError(
            f"refused to read {where}: it declares a document type or entities, which FMI does "
            "not use and which can be made to fill the memory or to read other files"
        )

    def enter(*_: object) -> None:
        nonlocal depth
        depth += 1
        if depth > MAX_DEPTH:
            raise FmuDescriptionError(
                f"refused to read {where}: its elements are nested more than {MAX_DEPTH} deep"
            )

    def leave(_: str) -> None:
        nonlocal depth
        depth -= 1

    parser.StartDoctypeDeclHandler = refuse
    parser.EntityDeclHandler = refuse
    parser.StartElementHandler = enter
    parser.EndElementHandler = leave
    try:
        parser.Parse(text, True)
    except (expat.ExpatError, ValueError, LookupError) as error:
        if isinstance(error, FmuDescriptionError):
            raise
        raise FmuDescriptionError(f"cannot read {where}: it is not well-formed XML ({error})") from error
