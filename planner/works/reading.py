"""Driven work from any file: the door of this package."""

from __future__ import annotations

from pathlib import Path

from fields.formats.archive import names_in
from fields.reading import shown
from planner.works.forms import agopengps, isoxml, points, table
from planner.works.forms.form import Form
from planner.works.record import Found
from vehicle.measured.errors import LogError

FORMS: tuple[Form, ...] = (isoxml.FORM, points.FORM, agopengps.FORM, table.FORM)


def form_of(path: str) -> Form:
    """The form of a file, folder or archive, by what is in it, else by its ending; raises FieldError, LogError."""
    place = Path(path)
    names = names_in(path)
    if names:
        found = next((form for form in FORMS if form.holds(names)), None)
    else:
        ending = place.suffix.lower()
        found = next((form for form in FORMS if ending in form.endings), None)
        if not place.exists():
            raise LogError(f"There is no file or folder {shown(path)}; check its name.")
    if found is None:
        raise LogError(
            f"{shown(path)} holds no log of driven work; give an ISOXML folder (TASKDATA), a Shapefile of points, an "
            "AgOpenGPS folder or a CSV file."
        )
    return found


def read_runs(path: str, mapping: str | None = None) -> Found:
    """The runs of a file, folder or archive, in its order; `mapping` names a file that says what CSV columns hold.

    Raises FieldError, LogError: nothing can be read of it, or the mapping is of no use.
    """
    form = form_of(path)
    if mapping is not None and form is not table.FORM:
        raise LogError(f"A mapping is for CSV files and {shown(path)} is {form.name}; leave it out.")
    found = table.read_mapped(path, mapping) if form is table.FORM else form.read(path, shown(path))
    if not found.runs:
        why = f" ({found.notes[0].rstrip('.')})" if found.notes else ""
        raise LogError(f"{shown(path)} has no run that can be read{why}; copy the folder again.")
    return found
