"""What is asked of a plan: the model from which the command line, the API and farm files take their options.

A new option of `headland plan` is one more parameter of `PlanRequest`, and the code that acts on it.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

from pydantic.dataclasses import dataclass

from fields.raw_document import name_field
from fields.units import DAY_S, MPS_PER_KMH
from planner.errors import RequestError, mark_parameter
from planner.request import option_checks
from planner.request.option_texts import (
    format_later_clock,
    parse_cell_bearings,
    parse_clock,
    parse_counts,
    parse_number_pair,
    parse_strategies,
    read_line_wishes,
)
from planner.request.options import NumberLimits, PlanOption, convert_options_to_parameters
from planner.request.recent_rain import MAX_ET0_MM
from planner.request.validation import (
    STRICT,
    CellBearings,
    ClockTime,
    Count,
    Counts,
    FieldText,
    Names,
    Number,
    Place,
    Text,
    TimeText,
    check_option_limits,
    format_given_values,
    raise_request_errors,
)
from strategies.names import STRATEGY_NAMES
from strategies.path_planning.turn_kinds import AUTO_CORNERS, CORNERS, HEADLAND_ORDERS, TURN_KINDS

if TYPE_CHECKING:
    from strategies.lines.line_wishes import LineWishes
    from vehicle.energy.draft import DraftRule

MIN_SPEED_KMH, MAX_SPEED_KMH = 0.5, 30.0
MAX_LENGTH_M = 1000.0  # wider, deeper and farther round than any machine that works a field
MAX_PRICE = 1e9  # in any currency
MIN_CLEARANCE_M = 0.05
MAX_HEADLAND_PASSES = 50
SOW = "sow"
HEADLAND_FIRST, HEADLAND_LAST = HEADLAND_ORDERS
HEADLAND_ORDERS_BY_OPERATION = {
    "till": HEADLAND_ORDERS,
    SOW: (HEADLAND_LAST,),
    "spray": HEADLAND_ORDERS,
    "harvest": (HEADLAND_FIRST,),
    "mow": (HEADLAND_FIRST,),
}
"""When the headland may be worked: a sown headland must not be driven over, nor a standing crop."""
OPERATION_WORDS = {  # how words begin that people use for an operation
    "plo": "till", "cultivat": "till", "harrow": "till", "dis": "till", "drill": "sow", "seed": "sow", "plant": "sow",
    "spread": "spray", "fertili": "spray", "combin": "harvest", "thresh": "harvest", "cut": "mow",
}  # fmt: skip
STANDING_CROP_OPERATIONS = ("harvest", "mow")  # the crop must not be driven over before it is worked
MAX_MARGIN_M = 100.0
MAX_DEPTH_CM = 100.0
STRAIGHT, CONTOUR = SWATH_FORMS = "straight", "contour"
FASTEST, CHEAPEST, SUREST, LEAST_FUEL = OBJECTIVES = "fastest", "cheapest", "surest", "fuel"
MAX_SEED = 2**53  # JavaScript has no larger whole numbers

FIELD, MACHINES, WORK, COSTS = "Field", "Machines", "Work", "Costs and deadline"
RISK, OUTPUT, COMPUTING = "Risk", "Output", "Computing"
"""The panels of options in `headland plan --help`."""
_STRATEGIES_HELP = f"Strategies to try, separated by commas: {', '.join(STRATEGY_NAMES)}; or all."
_DEADLINE_HELP = "Deadline, hh:mm; before the start: next day. Best is the cheapest plan in time (late ground counts)."
_RAIN_HELP = (
    "When it begins to rain: 17:00, 16:30=20,17:00=50 (in 20 and in 50 percent of cases, else it stays dry), 0.2/h (a "
    "rate) or a CSV of members (time, hours)."
)
_FOLD_HELP = "Width of the implement when folded, metres (3); its working width: it does not fold."
_ENTRANCE_HELP = "Where the tractors come in: LON,LAT, or x,y with {local}. By default that of the file."
_HEADLAND_FLAGS = {
    "headland_first": (HEADLAND_FIRST, "Work the headland before the tracks."),
    "headland_last": (HEADLAND_LAST, "Work the headland after the tracks."),
}
_TEXTS: dict[str, Any] = {"parse": tuple, "type": list[str]}  # an option that is repeated
_LENGTH = partial(NumberLimits, unit="m", above=True, high=MAX_LENGTH_M)
_SPEED = partial(NumberLimits, unit="km/h", low=MIN_SPEED_KMH, high=MAX_SPEED_KMH, scale=MPS_PER_KMH)
_WIDTH = NumberLimits("working width", "m", low=0.5, high=100.0)  # a single furrow, and more than any boom
_TRANSPORT = NumberLimits("transport width", "m", low=0.1, high=MAX_LENGTH_M)
_PRICE = NumberLimits(high=MAX_PRICE)
_SECTIONS = NumberLimits("number of sections", low=1, high=144)  # a boom of 36 m with valves 25 cm apart


@raise_request_errors
@dataclass(frozen=True, repr=False, config=STRICT)
class PlanRequest:
    """A field, a fleet and a question. Lengths in metres, speeds in m/s, clock times in seconds of the day.

    Clock times may be given as `datetime.time` or "13:00", and speeds in km/h: `speed_kmh` sets `speed_mps`, and so on.
    `field` and `tractor` are names or files; a field may be a GeoDataFrame, a shapely polygon or anything else with a
    `__geo_interface__`, kept as a text. Planning decides what is None: the headland by the turn that must fit it, the
    bearing by the least driving, the radius by full lock, the turn speed by `effective_turn_speed_mps`. A deadline that
    is earlier than the start is on the next day. The clearance is between machines with their implements; a
    formation keeps what neighbouring swaths leave. The margin is to obstacles and holes of the field. Machines may
    reach over its open edges by `overhang_m`, or by what an edge allows; with `open_edges` only the latter limits
    them. An implement folds to its `transport_width_m` where it has no room else; None: to that of the farm's
    implement, or what roads allow. The `sections` of an implement are equally wide; one is none. With `no_headland`
    the headland is left as room for turning, else it is worked in passes, `headland_passes` of them or as many as
    `headland_m` takes. `cell_bearings` are pairs of a cell's number and its bearing. `entrance` (longitude and
    latitude, or x and y of a field in local metres) replaces that of the field. `obstacles` are places "lon,lat" or
    "lon,lat,radius in metres" to avoid besides those of the field, `ignored` names or numbers of obstacles of the
    field that are left out.

    `elevation` holds heights of the field, `soil` is a name or file of vehicle.model.soil, and `moisture_pct` chooses
    between its rows; without them the ground is level and pulls at nothing. With `swaths` "contour" tracks follow
    contours of these heights. Without a moisture, `rain_mm` of the last days and their `et0_mm` estimate it. `draft`
    names the implement in the table of drafts (vehicle.energy.draft). `samples` is None for as many as usual where
    there is a deadline, rain, an objective or a budget, else for none; `rain` says when it begins (planner.risk.rain).
    `refill` is "headland", "tender", or a place in degrees "lon,lat" (metres "x,y" for a field in local metres); None:
    at the place of the field file, else on the headland. `leave_out`, `work_first` and `give` name tracks and headland
    passes of the layout (planner.request.option_texts).

    Raises RequestError for values and combinations that cannot be planned.
    """

    field: Annotated[
        FieldText,
        PlanOption(
            "A sample or a field file.",
            FIELD,
            api_help="A sample or an uploaded field; NAME#ID picks one of several parcels.",
        ),
    ] = "iwamizawa"
    local: Annotated[bool, PlanOption("The file holds local metres, not longitude and latitude.", FIELD)] = False
    width_m: Annotated[
        Number,
        PlanOption("Working width of the implement, metres.", MACHINES, from_farm=True),
        _WIDTH,
    ] = 3.0
    headland_m: Annotated[
        Number | None,
        PlanOption("Headland depth, metres. By default sized from the turn that must fit.", WORK),
        _LENGTH("headland"),
    ] = None
    headland_passes: Annotated[
        Count | None,
        PlanOption("Number of headland passes. By default as many as turns need, or more where that is quicker.", WORK),
        NumberLimits("number of headland passes", low=1, high=MAX_HEADLAND_PASSES),
    ] = None
    bearing_deg: Annotated[
        Number | None,
        PlanOption("Direction of the tracks, degrees clockwise from north. By default the best one.", FIELD),
        NumberLimits("bearing", "degrees", low=-option_checks.FULL_CIRCLE_DEG, high=option_checks.FULL_CIRCLE_DEG),
    ] = None
    radius_m: Annotated[
        Number | None,
        PlanOption("Turning radius to plan with, metres. By default that at full lock.", MACHINES),
        _LENGTH("turning radius"),
    ] = None
    clearance_m: Annotated[
        Number,
        PlanOption("Least distance between machines with implements, metres.", MACHINES),
        NumberLimits("clearance between tractors", "m", low=MIN_CLEARANCE_M, high=10.0),
    ] = 0.5
    margin_m: Annotated[
        Number,
        PlanOption("Distance kept to obstacles, holes and fences, metres.", FIELD),
        NumberLimits("margin to obstacles", "m", high=MAX_MARGIN_M),
    ] = 0.3
    tractor: Annotated[
        Text,
        PlanOption(
            "A tractor that comes with Headland (eg105, mr1000a) or a TOML file.",
            MACHINES,
            api_help="eg105, mr1000a, an uploaded tractor, or one of the farm.",
            from_farm=True,
        ),
    ] = "eg105"
    tractors: Annotated[
        Counts,
        PlanOption(
            "Tractor counts to try: 3, 1-6 or 1,3,5.", MACHINES, from_farm=True, parse=parse_counts, default="1-6"
        ),
    ] = (1, 2, 3, 4, 5, 6)
    strategies: Annotated[Names, PlanOption(_STRATEGIES_HELP, WORK, parse=parse_strategies, default="all")] = (
        STRATEGY_NAMES
    )
    turn: Annotated[
        str, PlanOption("Kind of turn: auto, u, omega or switch-back.", WORK, choices=("auto", *TURN_KINDS))
    ] = "auto"
    speed_mps: Annotated[
        Number, PlanOption("Working speed, km/h.", MACHINES, from_farm=True), _SPEED("working speed")
    ] = 5.0 * MPS_PER_KMH  # thesis, section 6.3.1
    turn_speed_mps: Annotated[
        Number | None,
        PlanOption("Largest speed in turns, km/h; less in bends. By default as at work.", MACHINES, from_farm=True),
        _SPEED("turn speed"),
    ] = None
    min_speed_mps: Annotated[
        Number | None,
        PlanOption("Least working speed, km/h; a remark tells where bends are slower.", MACHINES, from_farm=True),
        _SPEED("least working speed"),
    ] = None
    max_speed_mps: Annotated[
        Number | None,
        PlanOption("Greatest working speed of the implement, km/h.", MACHINES, from_farm=True),
        _SPEED("greatest working speed"),
    ] = None
    price_per_hour: Annotated[
        Number | None, PlanOption("Price of one tractor for one hour. By default 40.", COSTS, from_farm=True), _PRICE
    ] = None
    price_per_tractor: Annotated[
        Number, PlanOption("Price of bringing one tractor.", COSTS, from_farm=True), _PRICE
    ] = 0.0
    start_s: Annotated[
        ClockTime | None,
        PlanOption("Start of work, hh:mm.", COSTS, parse=partial(parse_clock, parameter="start_s")),
    ] = None
    deadline_s: Annotated[
        ClockTime | None, PlanOption(_DEADLINE_HELP, COSTS, parse=partial(parse_clock, parameter="deadline_s"))
    ] = None
    seed: Annotated[
        Count, PlanOption("Seed; the same seed gives the same bytes.", RISK), NumberLimits("seed", high=MAX_SEED)
    ] = 1
    gnss: Annotated[bool, PlanOption("Let positions err as those of an RTK receiver do.", RISK)] = False
    gnss_table: Annotated[
        Text | None,
        PlanOption(
            "The same by a table made with headland gnss fit.",
            RISK,
            api_help="The same by an uploaded table of headland gnss fit.",
        ),
    ] = None
    operation: Annotated[
        str,
        PlanOption(
            "till, sow, spray, harvest or mow: says whether the headland comes first or last.",
            WORK,
            choices=tuple(HEADLAND_ORDERS_BY_OPERATION),
            from_farm=True,
            other_words=OPERATION_WORDS,
        ),
    ] = "till"
    headland_order: Annotated[
        str | None,
        PlanOption("When the headland is worked.", WORK, choices=HEADLAND_ORDERS, flags=_HEADLAND_FLAGS),
    ] = None
    corners: Annotated[
        str,
        PlanOption(
            "Corners of the headland: square (worked whole, backing up), round, or auto (each as is quicker).",
            WORK,
            choices=CORNERS,
        ),
    ] = AUTO_CORNERS
    overhang_m: Annotated[
        Number,
        PlanOption("How far tractor and implement may reach over open edges of the field, metres.", FIELD),
        NumberLimits("overhang", "m", high=MAX_MARGIN_M),
    ] = 0.5
    no_headland: Annotated[
        bool,
        PlanOption("Leave the headland as room for turning instead of working it.", WORK, declaration="--no-headland"),
    ] = False
    samples: Annotated[
        Count | None,
        PlanOption("Samples of what varies from day to day; 10000 with {deadline} or {rain}.", RISK),
        NumberLimits(high=option_checks.MAX_SAMPLES),
    ] = None
    rain: Annotated[
        TimeText | None, PlanOption(_RAIN_HELP, RISK, api_help=f"{_RAIN_HELP[:-1]}; NAME.csv is an uploaded table.")
    ] = None
    objective: Annotated[
        str | None,
        PlanOption(
            "What the best plan is: fastest, cheapest, surest, or that of least fuel.", COSTS, choices=OBJECTIVES
        ),
    ] = None
    budget: Annotated[Number | None, PlanOption("Most that may be paid; dearer plans are left out.", COSTS), _PRICE] = (
        None
    )
    cell_bearings: Annotated[
        CellBearings,
        PlanOption(
            "Direction of the tracks in one cell: 2=45; once for every such cell.",
            FIELD,
            api_help="Direction of the tracks by cell, such as 2=45.",
            parse=parse_cell_bearings,
            type=list[str],
        ),
    ] = ()
    refill: Annotated[
        str | None,
        PlanOption(
            "Where a tank is filled or emptied, or a battery charged: headland, tender or a place LON,LAT (X,Y with "
            "{local}).",
            MACHINES,
        ),
    ] = None
    entrance: Annotated[
        Place | None,
        PlanOption(_ENTRANCE_HELP, FIELD, parse=partial(parse_number_pair, parameter="entrance")),
    ] = None
    obstacles: Annotated[
        Names,
        PlanOption(
            "One more obstacle to avoid: LON,LAT or LON,LAT,RADIUS (X,Y with {local}; 1 m round by default); once for "
            "every obstacle.",
            FIELD,
            api_help="More obstacles to avoid, each LON,LAT or LON,LAT,RADIUS (X,Y with {local}; 1 m by default).",
            **_TEXTS,
        ),
    ] = ()
    ignored: Annotated[
        Names,
        PlanOption(
            "Leave out an obstacle of the file, by its name or number (headland field lists them); once for every one.",
            FIELD,
            api_help="Obstacles of the file to leave out, by name or number.",
            **_TEXTS,
        ),
    ] = ()
    part: Annotated[
        Count | None,
        PlanOption("Plan only this part of a field that ditches or narrow necks divide; 1 is the largest.", FIELD),
        NumberLimits(low=1),
    ] = None
    crs: Annotated[
        Text | None, PlanOption("Coordinate system of a file that names none, such as EPSG:25832.", FIELD)
    ] = None
    swap_axes: Annotated[bool, PlanOption("The file has latitude or northing first: exchange the two.", FIELD)] = False
    guidance_line: Annotated[
        str | None, PlanOption("Lay the tracks along this guidance line of the file, by its name.", FIELD)
    ] = None
    elevation: Annotated[
        Text | None,
        PlanOption(
            "Heights of the field: a raster (GeoTIFF, ASCII grid) or points (CSV, GeoJSON, KML, GPX, Shapefile, "
            "Elevation.txt). By default the file that the field names.",
            FIELD,
            api_help="Heights of the field: an uploaded raster or uploaded points.",
        ),
    ] = None
    soil: Annotated[
        Text | None,
        PlanOption(
            "Soil by its name (loam, clay, soft) or a CSV table; it sets draft, slip and rolling resistance.",
            FIELD,
            api_help="Soil by its name (loam, clay, soft); it sets draft, slip and rolling resistance.",
        ),
    ] = None
    elevation_crs: Annotated[
        Text | None, PlanOption("Coordinate system of heights that name none, such as EPSG:25832.", FIELD)
    ] = None
    moisture_pct: Annotated[
        Number | None,
        PlanOption("Moisture of the soil, percent of its dry weight; by default at field capacity.", FIELD),
        NumberLimits("moisture of the soil", "percent", high=100.0),
    ] = None
    rain_mm: Annotated[
        Text | None,
        PlanOption(
            "Rain of the last days, mm by day up to yesterday (0,12,5), or a CSV file; says the moisture of {soil}.",
            FIELD,
            api_help="Rain of the last days, mm by day up to yesterday (0,12,5); says the moisture of {soil}.",
        ),
    ] = None
    et0_mm: Annotated[
        Number | None,
        PlanOption("Reference evapotranspiration of those days, mm a day. By default 3.", FIELD),
        NumberLimits("reference evapotranspiration", "mm a day", high=MAX_ET0_MM),
    ] = None
    draft: Annotated[
        Text | None,
        PlanOption(
            "Implement by its row in the table of drafts, such as plough (headland guide implements lists them). By "
            "default a cultivator or a drill, as {operation} has it.",
            MACHINES,
            from_farm=True,
        ),
    ] = None
    depth_cm: Annotated[
        Number | None,
        PlanOption("Working depth of {draft}, centimetres. By default its usual one.", MACHINES, from_farm=True),
        NumberLimits("working depth", "cm", above=True, high=MAX_DEPTH_CM),
    ] = None
    swaths: Annotated[
        str,
        PlanOption(
            "Tracks: straight, or contour (curved along the contours of {elevation}).", FIELD, choices=SWATH_FORMS
        ),
    ] = STRAIGHT
    open_edges: Annotated[bool, PlanOption("Let machines swing freely over edges that are not fenced.", FIELD)] = False
    transport_width_m: Annotated[Number | None, PlanOption(_FOLD_HELP, MACHINES), _TRANSPORT] = None
    sections: Annotated[Count, PlanOption("Sections that switch off over worked ground.", MACHINES), _SECTIONS] = 1
    leave_out: Annotated[
        Text | None,
        PlanOption("Tracks and headland passes to leave out, named as on the map: 3,7-9,5b,R1.", WORK),
    ] = None
    work_first: Annotated[
        Text | None,
        PlanOption("Tracks and headland passes to work before all others, in this order: 12,11.", WORK),
    ] = None
    give: Annotated[
        Names,
        PlanOption(
            "Tracks and headland passes that one tractor works: 2=5-8; once for every such tractor.",
            WORK,
            api_help="Tracks and headland passes that one tractor works, such as 2=5-8.",
            **_TEXTS,
        ),
    ] = ()

    def __post_init__(self) -> None:
        check_option_limits(self)
        option_checks.check_speeds(self.speed_mps, self.min_speed_mps, self.max_speed_mps)
        option_checks.check_fleet(self.tractors, self.strategies)
        option_checks.check_layout(self)
        option_checks.check_places(self.entrance, self.obstacles, self.ignored)
        option_checks.check_times(self.start_s, self.deadline_s)
        option_checks.check_samples(self)
        option_checks.check_ground(self.soil, self.moisture_pct, self.rain_mm, self.et0_mm)
        if self.draft is not None or self.depth_cm is not None:
            self.find_draft_rule()
        if self.gnss_table is not None and not self.gnss:
            raise RequestError(
                f"{mark_parameter('gnss_table')} is used with {mark_parameter('gnss')} alone; set that as well."
            )
        if self.leave_out is not None or self.work_first is not None or self.give:
            option_checks.check_first_lines(self.line_wishes, HEADLAND_ORDERS_BY_OPERATION[self.operation])

    def __repr__(self) -> str:
        """What differs from the defaults, as Python would write it."""
        return format_given_values(self)

    @classmethod
    def from_options(cls, values: Mapping[str, Any], *, shift_s: int | None = None) -> PlanRequest:
        """The request of options by their names, as on the command line; None is the same as not given.

        Without a start the work starts at `shift_s`, seconds of the day. A GNSS table implies `gnss`. Raises
        RequestError.
        """
        if values.get("headland_first") and values.get("headland_last"):
            raise RequestError(
                f"{mark_parameter('headland_first')} and {mark_parameter('headland_last')} exclude each other; leave "
                "out one of them."
            )
        parameters = {"start_s": shift_s} | convert_options_to_parameters(cls, values)
        return cls(**parameters | ({"gnss": True} if "gnss_table" in parameters else {}))

    @property
    def field_name(self) -> str:
        """The field as it was named; of a shape a short name."""
        return name_field(self.field)

    @property
    def effective_turn_speed_mps(self) -> float:
        """Largest speed in turns: the one asked for, else the working speed; bends are driven more slowly."""
        return self.speed_mps if self.turn_speed_mps is None else self.turn_speed_mps

    @property
    def requested_headland_m(self) -> float | None:
        """Depth of the headland as asked for, in metres or in passes; None where planning decides."""
        return self.headland_m if self.headland_passes is None else self.headland_passes * self.width_m

    def find_draft_rule(self) -> DraftRule | None:
        """Draft of the implement at its working depth; raises as `planner.request.implement_choice.choose_rule`."""
        from planner.request.implement_choice import choose_rule

        return choose_rule(self.operation, self.width_m, self.draft, self.depth_cm)

    @property
    def headland_orders(self) -> tuple[str, ...]:
        """When the headland may be worked, "first" or "last"; empty where it is not worked."""
        if self.no_headland:
            return ()
        return HEADLAND_ORDERS_BY_OPERATION[self.operation] if self.headland_order is None else (self.headland_order,)

    @property
    def line_wishes(self) -> LineWishes:
        """What is wanted of single tracks and headland passes; raises HeadlandError for what names none."""
        return read_line_wishes(self.leave_out, self.work_first, self.give)

    @property
    def time_limit_s(self) -> float | None:
        """Seconds from start to deadline, over midnight if need be; None without a deadline."""
        deadline_s, start_s = self.deadline_s, self.start_s
        return None if deadline_s is None or start_s is None else float((deadline_s - start_s) % DAY_S)

    def format_clock_after(self, elapsed_s: float | None) -> str:
        """The clock so many seconds after the start, with the day where that is another one; "" without a clock."""
        return "" if self.start_s is None or elapsed_s is None else format_later_clock(self.start_s, elapsed_s)
