"""XML from strangers: no document types and so no entities, whoever parses it afterwards."""

from __future__ import annotations

import re
from xml.etree import ElementTree

from fields.errors import FieldError

_DOCTYPE = re.compile(rb"<!\s*(DOCTYPE|ENTITY)", re.IGNORECASE)
_ROOT = re.compile(rb"<[A-Za-z_]")


def refuse_entities(content: bytes, label: str) -> None:
    """Raise FieldError for XML that defines entities: no field file needs them, and small ones grow to gigabytes."""
    plain = content.replace(b"\x00", b"")
    root = _ROOT.search(plain)
    if _DOCTYPE.search(plain, 0, root.start() if root else len(plain)):
        raise FieldError(f"{label} defines a document type or entities, which no field file needs; save it again.")


def root_of(content: bytes, label: str) -> ElementTree.Element:
    """The root element of an XML text.

    Raises:
        FieldError: it defines entities or is not XML.
    """
    refuse_entities(content, label)
    try:
        return ElementTree.fromstring(content)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise FieldError(f"{label} is not XML that can be read ({error}); save it again.") from None
    except RecursionError:
        raise FieldError(f"{label} is XML nested too deep; save it again.") from None
