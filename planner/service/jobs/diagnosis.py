"""A diagnosis: the report, and the tractor file with what was found."""

from __future__ import annotations

from collections.abc import Iterator

from planner.diagnosis import demonstrate, diagnose
from planner.service.jobs.made import html_of, json_of, toml_of
from planner.service.jobs.requests import DiagnosisRequest
from planner.service.jobs.work import Work
from planner.service.store.jobs import Made
from reports.diagnosis_export import diagnosis_json
from reports.diagnosis_page import diagnosis_page
from vehicle.measured.answer.demo import Hidden
from vehicle.measured.answer.save import tractor_toml
from vehicle.measured.answer.verdict import Diagnosis


def run_diagnosis(work: Work) -> list[Made]:
    """Diagnose logs, or a demonstration; raises HeadlandError for logs that cannot be used."""
    request = DiagnosisRequest.model_validate(work.request)

    def progress(done: int, all: int) -> None:
        work.progress(done, all, "Diagnosing")

    progress(0, 0)
    hidden: Hidden | None = None
    if request.demo:
        found, hidden = demonstrate(
            tractor=request.tractor, ground=request.ground, seed=request.seed if request.seed is not None else 1,
            hide=request.hide, progress=progress,
        )  # fmt: skip
    else:
        found = diagnose(
            request.logs, tractor=request.tractor, ground=request.ground, fixes=request.fix,
            as_driven=request.as_driven, progress=progress,
        )  # fmt: skip
    return list(_results(found, hidden))


def _results(found: Diagnosis, hidden: Hidden | None) -> Iterator[Made]:
    yield json_of("result.json", diagnosis_json(found, hidden))
    yield html_of("page.html", diagnosis_page(found, None if hidden is None else hidden.words))
    yield toml_of("tractor.toml", tractor_toml(found.tractor))
