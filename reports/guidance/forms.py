"""The registry: every form by its name, and what is written of a guidance in one."""

from __future__ import annotations

from dataclasses import dataclass

from fields.errors import named
from reports.errors import ReportError
from reports.guidance import agopengps, geojson, gpx, isoxml, kml, shapefile
from reports.guidance.cutting import straight_alone
from reports.guidance.form import Files, Form
from reports.guidance.lines import Guidance, Line

FORMS: tuple[Form, ...] = (
    isoxml.FORM_4, isoxml.FORM_3, agopengps.FORM, kml.FORM, shapefile.FORM, geojson.FORM, gpx.FORM,
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Written:
    """Files of a guidance in a form; `lines` are those in them, `left` the curves that are not, `cut` those cut up."""

    form: Form
    files: Files
    lines: tuple[Line, ...]
    left: tuple[Line, ...]
    cut: tuple[Line, ...] = ()

    @property
    def curves(self) -> int:
        """Curves that were written."""
        return sum(not line.straight for line in self.lines)

    @property
    def single(self) -> bool:
        """Whether it is one file of a form that is one."""
        return bool(self.form.ending) and len(self.files) == 1


def form_named(name: str) -> Form | None:
    """The form of this name, whatever its case."""
    return next((form for form in FORMS if form.name == name.strip().lower()), None)


def written(guidance: Guidance, form: Form, curves: bool | None = None) -> Written:
    """The files of a guidance in a form; `curves` says whether to write them, None as the form has it by default.

    Raises:
        ReportError: nothing is left to be written.
    """
    told = guidance if (form.curves if curves is None else curves) else straight_alone(guidance)
    if not told.lines:
        why = f"all of them are curves; add {named('curves')}" if guidance.lines else "the plan has none"
        raise ReportError(f"There is no line to write as {form.words}: {why}.")
    kept, whole = {line.place for line in told.lines}, {line.place for line in told.lines if not line.straight}
    left = tuple(line for line in guidance.lines if line.place not in kept)
    cut = tuple(line for line in guidance.lines if not line.straight and line.place in kept - whole)
    return Written(form, _files(told, form), told.lines, left, cut)


def _files(guidance: Guidance, form: Form) -> Files:
    """The files; where a form knows no tractors, those of each one in a place of its own."""
    if not form.apart or len(guidance.tractors) == 1:
        return form.write(guidance)
    found: dict[str, bytes] = {}
    for one in (each for each in guidance.alone() if each.lines):
        tractor = f"T{one.tractors[0].number}"
        for path, content in form.write(one).items():
            own = f"{tractor}{form.ending}" if form.ending else f"{tractor}/{path}"
            found[path if form.named else own] = content
    return found
