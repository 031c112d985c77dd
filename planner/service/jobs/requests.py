"""What is asked for, under the names and with the defaults of the command line."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

TEXT, LIST = 400, 64
MOST_TOML = 400_000
LARGEST_SEED = 2**53

Text = Annotated[str, Field(max_length=TEXT)]
Title = Annotated[str | None, Field(max_length=100, description="What the job is called; by default after its input.")]
Seed = Annotated[int, Field(ge=0, le=LARGEST_SEED, description="Seed; the same seed gives the same bytes.")]


class Request(BaseModel):
    """A request: unknown names are refused, and so are numbers that are none."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)
    name: Title = None


class PlanRequest(Request):
    """`headland plan`: simulate every combination of tractor count and strategy on a field and rank them.

    Files are named as they were uploaded; `field` may end in #ID.
    """

    field: Text = Field("iwamizawa", description="A sample or an uploaded field; NAME#ID picks one of several parcels.")
    local: bool = Field(False, description="The file holds local metres, not longitude and latitude.")
    crs: Text | None = Field(None, description="Coordinate system of a file that names none, such as EPSG:25832.")
    swap: bool = Field(False, description="The file has latitude or northing first: exchange the two.")
    along: Text | None = Field(None, description="Lay the tracks along this guidance line of the file, by its name.")
    width: float = Field(3.0, description="Working width of the implement, metres.")
    tractors: Text = Field("1-6", description="Tractor counts to try: 3, 1-6 or 1,3,5.")
    strategies: Text = Field("all", description="Strategies to try, separated by commas; or all.")
    turn: Text = Field("auto", description="auto, u, omega or switch-back.")
    start: Text | None = Field(None, description="Start of work, hh:mm.")
    before: Text | None = Field(None, description="Deadline, hh:mm; not after the start: next day.")
    price_per_hour: float = Field(40.0, description="Price of one tractor for one hour.")
    price_per_tractor: float = Field(0.0, description="Price of bringing one tractor.")
    speed_kmh: float = Field(5.0, description="Working speed, km/h.")
    turn_speed_kmh: float | None = Field(None, description="Turn speed, km/h; that of work, at most 5.")
    headland: float | None = Field(None, description="Headland depth, metres.")
    operation: Text = Field("till", description="till, sow, spray, harvest or mow.")
    headland_first: bool = Field(False, description="Work the headland before the tracks.")
    headland_last: bool = Field(False, description="Work the headland after the tracks.")
    corners: Text = Field("square", description="Corners of the headland: square or round.")
    tracks_only: bool = Field(False, description="Leave the headland as room for turning.")
    bearing: float | None = Field(None, description="Direction of the tracks, degrees clockwise from north.")
    cell_bearing: Annotated[list[Text], Field(max_length=LIST)] = Field([], description="Such as 2=45, per cell.")
    radius: float | None = Field(None, description="Turning radius to plan with, metres.")
    clearance: float = Field(0.5, description="Least distance between machines with implements, metres.")
    margin: float = Field(0.3, description="Distance kept to obstacles, holes and fences, metres.")
    entrance: Text | None = Field(None, description="Where the tractors come in: LON,LAT, or x,y with local.")
    tractor: Text = Field("eg105", description="eg105, mr1000a, an uploaded tractor, or one of the farm.")
    draws: int | None = Field(None, description="Draws of what varies; with a deadline or rain 10000.")
    rain: Text | None = Field(None, description="When rain begins: 17:00, 16:30=20,17:00=50 (percent), 0.2/h; NAME.csv")
    refill: Text | None = Field(None, description="Where a tank is filled: headland, tender or a place LON,LAT.")
    prefer: Text | None = Field(None, description="fastest, cheapest or surest.")
    budget: float | None = Field(None, description="Most that may be paid.")
    farm: Text | None = Field(None, description="An uploaded farm; what the request gives wins over it.")
    implement: Text | None = Field(None, description="The implement of the farm, by name.")
    gnss: bool = Field(False, description="Let positions err as an RTK receiver's do.")
    gnss_table: Text | None = Field(None, description="The same by an uploaded table of headland gnss fit.")
    seed: Seed = 1
    all: bool = Field(False, description="Simulate every plan, however slow.")


class DayRequest(Request):
    """`headland day`: several fields and fleets on one day; `day` is the text of a day file.

    Fields, farm, tractors and rain that it names are uploaded files, by their names with or without their endings.
    """

    day: Annotated[str, Field(max_length=MOST_TOML, description="The text of a day file (TOML).")]
    farm: Text | None = Field(None, description="An uploaded farm instead of the one that the day names.")
    rain: Text | None = Field(None, description="Rain instead of the day's; NAME.csv is an uploaded table.")
    certainty: float | None = Field(None, description="Plan by times that so many percent of the draws keep, 50 to 99.")
    draws: Annotated[int, Field(description="Draws of what varies.")] = 10_000
    seed: Seed = 1

    def check(self) -> None:
        """Raise ScenarioError as the command does."""
        from planner.errors import ScenarioError, named
        from planner.scenario import MOST_DRAWS

        if self.certainty is not None and not 50.0 <= self.certainty <= 99.0:
            raise ScenarioError(f"{named('certainty')} is {self.certainty:g}; use 50 to 99 percent.")
        if not 1 <= self.draws <= MOST_DRAWS:
            raise ScenarioError(f"{named('draws')} is {self.draws}; use 1 to {MOST_DRAWS}.")


class DiagnosisRequest(Request):
    """`headland diagnose`: what the simulation gets wrong in measured logs, why, and what mending it gains."""

    logs: Annotated[list[Text], Field(max_length=LIST, description="Uploaded logs, one run each.")] = []
    tractor: Text = Field("eg105", description="eg105, mr1000a or an uploaded tractor.")
    ground: Text = Field("soil", description="Ground the logs were made on: soil or asphalt.")
    fix: Annotated[list[Text], Field(max_length=LIST, description="Conventions to convert from.")] = []
    as_driven: bool = Field(False, description="Where the file is of another vehicle, take its size from the logs.")
    demo: bool = Field(False, description="Hide an effect in made logs and find it.")
    hide: Text | None = Field(None, description="Effect to hide in the demonstration; by default drawn.")
    seed: Annotated[int | None, Field(ge=0, le=LARGEST_SEED, description="Seed of the demonstration.")] = None

    def check(self) -> None:
        """Raise ScenarioError for both or neither of logs and demonstration, as the command does."""
        from planner.errors import ScenarioError, named

        if self.demo == bool(self.logs):
            raise ScenarioError(f"Give {named('logs')}, or {named('demo')} for a demonstration; not both, not neither.")
        if self.demo and self.fix:
            raise ScenarioError(f"{named('fixes')} converts log files; leave it out with {named('demo')}.")
        if self.demo and self.as_driven:
            raise ScenarioError(f"{named('as_driven')} takes a size from logs; leave it out with {named('demo')}.")
        given: dict[str, Any] = {"seed": self.seed, "hide": self.hide}
        for name, value in given.items():
            if value is not None and not self.demo:
                raise ScenarioError(
                    f"{named(name)} {value} belongs to the demonstration; add {named('demo')} or leave it out."
                )


MODELS: dict[str, type[Request]] = {"plan": PlanRequest, "day": DayRequest, "diagnosis": DiagnosisRequest}
"""The request of every kind of job."""
