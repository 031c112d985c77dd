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


class _DeclarationError(Exception):
    """A document type, an entity or a reference to something outside."""


class _DepthError(Exception):
    """Elements nested deeper than MAX_XML_DEPTH."""


def check_no_entities(content: bytes, label: str) -> None:
    """Raise FieldError for XML with a document type or entities, which can expand to gigabytes or name other files.

    Text that is not XML is left to the parser.
    """
    _find_xml_error(expat.ParserCreate(), content, label)


def check_xml_root(content: bytes, label: str, format_name: str, roots: tuple[str, ...]) -> None:
    """Raise FieldError for text that is not well-formed XML with one of these roots (names without namespaces)."""
    parser, nesting = expat.ParserCreate(namespace_separator="}"), _NestingCounter()
    parser.StartElementHandler, parser.EndElementHandler = nesting.enter_element, nesting.leave_element
    error = _find_xml_error(parser, content, label)
    if error is not None:
        raise FieldError(
            f"{label} cannot be read as {format_name} (it is not XML: {error}); save it again as {format_name}."
        )
    if nesting.root not in roots:
        raise FieldError(
            f"{label} is XML but not {format_name} (its root is '{nesting.root[:40]}'); give a {format_name} file."
        )


def parse_root(content: bytes, label: str) -> ElementTree.Element:
    """The root element of an XML text.

    Raises:
        FieldError: it defines entities or is not XML.
    """
    check_no_entities(content, label)
    try:
        return ElementTree.fromstring(content)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise FieldError(f"{label} is not valid XML ({error}); save it again.") from None
    except RecursionError:
        raise FieldError(f"{label} is XML nested too deeply; save it again.") from None


class _NestingCounter:
    """The root of a document, and the current depth of nesting."""

    def __init__(self) -> None:
        self.root, self._depth = "", 0

    def enter_element(self, name: str, _attributes: dict[str, str]) -> None:
        self.root = self.root or name.rpartition("}")[2]
        self._depth += 1
        if self._depth > MAX_XML_DEPTH:
            raise _DepthError

    def leave_element(self, _name: str) -> None:
        self._depth -= 1


def _find_xml_error(parser: expat.XMLParserType, content: bytes, label: str) -> Exception | None:
    """Parse a text without using it and return the error if it is not XML.

    Raises:
        FieldError: it has declarations, entities or too deep nesting, which no field file needs.
    """
    parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = parser.UnparsedEntityDeclHandler = _refuse_declaration
    parser.ExternalEntityRefHandler = parser.SkippedEntityHandler = _refuse_declaration
    try:
        parser.Parse(content, True)
    except _DeclarationError:
        raise FieldError(
            f"{label} defines a document type or entities, which no field file needs; save it again."
        ) from None
    except _DepthError:
        raise FieldError(f"{label} is XML nested too deeply; save it again.") from None
    except (expat.ExpatError, ValueError, LookupError) as error:
        return error
    return None


def _refuse_declaration(*_arguments: object) -> NoReturn:
    raise _DeclarationError


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
