"""Files put into one ZIP archive: the same bytes for the same files."""

from __future__ import annotations

import io
import zipfile

from reports.guidance.form import Files

MEDIA = "application/zip"
FIRST_DAY = (1980, 1, 1, 0, 0, 0)
"""The earliest time a ZIP archive knows; stands where there is none."""


def zipped(files: Files) -> bytes:
    """The archive, in the order of the files."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            entry = zipfile.ZipInfo(name, FIRST_DAY)
            entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
            archive.writestr(entry, content)
    return buffer.getvalue()
