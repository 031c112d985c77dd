"""Requests for jobs as the API takes them, and a job as the function that runs it takes it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, create_model

from planner.errors import mark_parameter, strip_unit
from planner.request.farm_choice import FarmChoice
from planner.request.option_checks import check_day_options, check_demo_options
from planner.request.options import RequestOption, list_options
from planner.request.plan_request import MAX_SEED, PlanRequest
from planner.service.settings import LIMITS
from planner.service.store.job_queue import ResultFile

ShortText = Annotated[str, Field(max_length=LIMITS.longest_text_chars)]
ShortTexts = Annotated[list[ShortText], Field(max_length=LIMITS.most_list_entries)]
JobTitle = Annotated[
    str | None, Field(max_length=100, description="What the job is called; by default after its input.")
]
PLAN_OPTIONS = {option.name: option for option in (*list_options(PlanRequest), *list_options(FarmChoice))}
Seed = Annotated[int, Field(ge=0, le=MAX_SEED, description=PLAN_OPTIONS["seed"].help)]
ReportProgress = Callable[[int, int, str], None]


class JobRequest(BaseModel):
    """A request for a job. Unknown names, infinity and NaN are refused."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)
    name: JobTitle = None


class PlanJobRequest(JobRequest):
    """`headland plan`: simulate every combination of tractor count and strategy on a field and rank them.

    Files are named as they were uploaded; `field` may end in #ID.
    """


def _build_api_field(option: RequestOption) -> tuple[Any, Any]:
    """Type and description of an option of a plan for pydantic.

    Limits and choices are shown only; the plan request itself refuses, in the sentences of the command line.
    """
    kind = {str: ShortText, list[str]: ShortTexts}.get(option.type, option.type)
    shown: dict[str, Any] = {}
    if option.limits is not None and isfinite(option.limits.high):
        shown = {
            "exclusiveMinimum" if option.limits.above else "minimum": option.limits.low,
            "maximum": option.limits.high,
        }
    elif option.rules.choices and option.type is str:
        shown = {"enum": [*option.rules.choices, *([None] if option.default is None else [])]}
    description = option.format_help(strip_unit, for_api=True)
    annotation = kind | None if option.default is None else kind
    return annotation, Field(option.default, description=description, json_schema_extra=shown or None)


_API_FIELDS: dict[str, Any] = {name: _build_api_field(option) for name, option in PLAN_OPTIONS.items()}
PLAN_JOB_MODEL = create_model(
    PlanJobRequest.__name__, __base__=PlanJobRequest, __doc__=PlanJobRequest.__doc__, **_API_FIELDS
)
"""A plan request with the options of `headland plan`."""


class DayJobRequest(JobRequest):
    """`headland day`: several fields and fleets on one day; `day` is the text of a day file.

    Fields, farm, tractors and rain that it names are uploaded files, by their names with or without their endings.
    """

    day: Annotated[str, Field(max_length=LIMITS.most_toml_chars, description="The text of a day file (TOML).")]
    farm: ShortText | None = Field(None, description="An uploaded farm instead of the one that the day names.")
    rain: ShortText | None = Field(None, description="Rain instead of the day's; NAME.csv is an uploaded table.")
    certainty: float | None = Field(
        None, description="Plan by times that this percentage of the samples keeps, 50 to 99."
    )
    samples: Annotated[int, Field(description="Samples of what varies from day to day.")] = 10_000
    seed: Seed = 1

    def check_options(self) -> None:
        """Raise RequestError as the command does."""
        check_day_options(self.samples, self.certainty)


class DiagnosisJobRequest(JobRequest):
    """`headland diagnose`: what the simulation gets wrong in measured logs, why, and what correcting it gains."""

    logs: Annotated[ShortTexts, Field(description="Uploaded logs, one run each.")] = []
    tractor: ShortText = Field("eg105", description="eg105, mr1000a or an uploaded tractor.")
    ground: ShortText = Field("soil", description="Ground the logs were made on: soil or asphalt.")
    fix: Annotated[ShortTexts, Field(description="Conventions to convert from.")] = []
    mapping: Annotated[ShortTexts, Field(description="Columns of all logs by ours, such as time_s=Zeit.")] = []
    as_driven: bool = Field(False, description="Where the file is of another vehicle, take its size from the logs.")
    holdout: Annotated[
        ShortTexts,
        Field(
            description="Logs to keep out of everything, for the error before and after on them: names or patterns, "
            "#2 for the second log, how many, or auto."
        ),
    ] = []
    demo: bool = Field(False, description="Hide an effect in made logs and find it.")
    hide: ShortText | None = Field(None, description="Effect to hide in the demonstration; by default drawn.")
    seed: Annotated[int | None, Field(ge=0, le=MAX_SEED, description="Seed of the demonstration.")] = None

    def check_options(self) -> None:
        """Raise RequestError for both or neither of logs and demonstration, as the command does."""
        conversions = {mark_parameter("fixes"): self.fix, mark_parameter("mapping"): self.mapping}
        own = {"seed": self.seed, "hide": self.hide}
        check_demo_options(self.demo, self.logs, conversions, own, self.as_driven)


REQUEST_MODELS: dict[str, type[JobRequest]] = {
    "plan": PLAN_JOB_MODEL,
    "day": DayJobRequest,
    "diagnosis": DiagnosisJobRequest,
}
"""The request of every kind of job."""


@dataclass(frozen=True)
class JobContext:
    """One job as its function takes it: the request, processes it may use, and where to report progress.

    Progress is steps done, all steps, and a text. The function is called in the folder of its input files, and gives
    the same bytes whenever it is called.
    """

    request: Mapping[str, Any]
    processes: int
    report_progress: ReportProgress
    cache_folder: str


JobFunction = Callable[[JobContext], Sequence[ResultFile]]
"""Runs a job and returns its results; raises HeadlandError."""
