"""Check of XML from untrusted files, before a library parses it into a tree."""

from __future__ import annotations

from xml.parsers import expat

from trussflow.fmu.errors import FmuDescriptionError

MAX_DEPTH = 100
"""Maximum nesting depth of elements; FMI needs six levels, annotations a few more."""


def check_xml(text: bytes, where: str) -> None:
    """Raise an error for XML that is not well-formed or declares a document type.

    Entities can expand a few lines to gigabytes or include other files. They need a document
    type declaration, which FMI does not use. After this check a parser has no entity to expand.

    Parameters
    ----------
    text : bytes
        The document.
    where : str
        Name of the document, for error messages.

    Raises
    ------
    FmuDescriptionError
        If the document is refused.
    """
    # reports unbound namespace prefixes as errors
    parser = expat.ParserCreate(namespace_separator=" ")
    depth = 0

    def refuse(*_: object) -> None:
        raise FmuDescriptionError(
            f"refused to read {where}: it declares a document type or entities, which FMI does "
            "not use and which can exhaust the memory or include other files"
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
        raise FmuDescriptionError(
            f"cannot read {where}: it is not well-formed XML ({error})"
        ) from error
