"""XML: untrusted files are checked before any parser reads them, and documents are written reproducibly.

All XML that Headland reads is checked here: no document types, no entities and nothing outside the file. The events of
expat itself are used, so that no spelling of a declaration can hide it.
"""

from __future__ import annotations

import re
from typing import NoReturn
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement, indent, tostring
from xml.parsers import expat

from fields.errors import FieldError

MAX_XML_DEPTH = 100
"""Nested elements; other parsers are recursive and could run out of stack."""
_FORBIDDEN_CHARACTERS = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML 1.0 does not allow."""


def check_xml_root(content: bytes, label: str, format_name: str, roots: tuple[str, ...]) -> None:
    """Raise FieldError for text that is not well-formed XML with one of these roots (names without namespaces)."""
    root, error = _find_root_name(content, label)
    if error is not None:
        raise FieldError(
            f"{label} cannot be read as {format_name} (it is not XML: {error}); save it again as {format_name}."
        )
    if root not in roots:
        raise FieldError(
            f"{label} is XML but not {format_name} (its root is '{root[:40]}'); give a {format_name} file."
        )


def parse_root(content: bytes, label: str) -> ElementTree.Element:
    """The root element of an XML text.

    Raises FieldError where it defines entities, is nested too deeply or is not XML.
    """
    _find_root_name(content, label)
    try:
        return ElementTree.fromstring(content)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise FieldError(f"{label} is not valid XML ({error}); save it again.") from None


def _find_root_name(content: bytes, label: str) -> tuple[str, Exception | None]:
    """Parse a text without using it: the name of its root without namespace, and the error if it is not XML.

    Raises FieldError where it has declarations, entities, which can expand to gigabytes or name other files, or too
    deep nesting; no field file needs them.
    """
    parser, root, depth = expat.ParserCreate(namespace_separator="}"), "", 0

    def enter_element(name: str, _attributes: dict[str, str]) -> None:
        nonlocal root, depth
        root, depth = root or name.rpartition("}")[2], depth + 1
        if depth > MAX_XML_DEPTH:
            raise FieldError(f"{label} is XML nested too deeply; save it again.")

    def leave_element(_name: str) -> None:
        nonlocal depth
        depth -= 1

    def refuse_declaration(*_arguments: object) -> NoReturn:
        raise FieldError(f"{label} defines a document type or entities, which no field file needs; save it again.")

    parser.StartElementHandler, parser.EndElementHandler = enter_element, leave_element
    parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = parser.UnparsedEntityDeclHandler = refuse_declaration
    parser.ExternalEntityRefHandler = parser.SkippedEntityHandler = refuse_declaration
    try:
        parser.Parse(content, True)
    except FieldError:
        raise
    except (expat.ExpatError, ValueError, LookupError) as error:
        return root, error
    return root, None


def serialise_xml(root: Element) -> bytes:
    """The bytes of an XML file, indented, in UTF-8."""
    indent(root, space=" ")
    body: bytes = tostring(root, encoding="utf-8")
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + body + b"\n"


def add_child(parent: Element, tag: str, text: str | None = None, **attributes: str) -> Element:
    """A new child element at the end of the parent."""
    element = SubElement(parent, tag, {key: remove_forbidden(value) for key, value in attributes.items()})
    if text is not None:
        element.text = remove_forbidden(text)
    return element


def remove_forbidden(text: str) -> str:
    """Text without the characters that XML does not allow."""
    return _FORBIDDEN_CHARACTERS.sub("", text)
