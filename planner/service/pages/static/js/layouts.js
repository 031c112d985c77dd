// What the forms of a day and of a farm ask, simple things first.
import { t } from "./language.js";
const WORK = ["till", "sow", "spray", "harvest", "mow"];
const num = (hint = "") => ({ number: true, hint });

export const DAY = {
  values: [
    ["farm", "Farm", { of: "farms", hint: "a farm of defaults" }], ["start", "Start of the day", { hint: "Such as 07:00; by default the shift of the farm." }],
    ["rain", "Rain", { hint: "17:00, or 16:30=20,17:00=50 in percent." }], ["light", "Daylight", { hint: "06:10-20:40 or sun; robots need none." }],
  ],
  moreTitle: "More about the day",
  more: [
    ["date", "Date", { hint: "Such as 2026-05-01; needed for light by the sun." }], ["utc_offset_h", "Hours that clocks are ahead of UTC", num("2 for summer in central Europe.")],
    ["certainty_pct", "Be sure to this percentage", num("50 to 99; by default by mean times.")], ["strategies", "Strategies", { list: true, hint: "With commas between them; by default all." }],
    ["yard.lon", "Yard: longitude, degrees", num("By default that of the farm.")], ["yard.lat", "Yard: latitude, degrees", num()],
  ],
  lists: [
    {
      key: "fields", title: "Fields", one: "Field", add: "Add a field", remove: "Remove this field", missing: "Add at least one field.", begin: () => ({ file: "" }),
      values: [
        ["file", "Field", { of: "fields", hint: "choose one" }], ["name", "What it is called", { hint: "By default the name in the file." }], ["windows", "When it may be worked", { list: true, hint: "08:00-12:00, 13:00-19:00; by default the whole day." }],
        ["loss_per_ha", "Loss per hectare done another day", num("By default by the prices of the farm.")], ["operation", "Work", { of: WORK, hint: "any" }], ["implement", "Implement", { of: "implement", hint: "any that fits" }],
      ],
      more: [
        ["value_per_ha", "Value of the work per hectare", num("Instead of the loss: what is not done is lost.")], ["lon", "Longitude, degrees", num("For a field in local metres.")], ["lat", "Latitude, degrees", num()],
        ["entrance", "Entrance", { hint: "LON,LAT; by default that of the file." }], ["obstacles", "More obstacles", { list: ";", hint: "LON,LAT,RADIUS; several with ; between" }], ["ignored", "Obstacles to be ignored", { list: true, hint: "Names or numbers with commas between them." }],
        ["crs", "Coordinate system", { hint: "Only for a file that names none." }], ["local", "The file is in local metres", { check: true }], ["swap_axes", "Latitude or northing comes first", { check: true }],
      ],
    },
    {
      key: "fleets", title: "Fleets", one: "Fleet", hint: "Tractors of one kind that work on one field at a time.", add: "Add a fleet", remove: "Remove this fleet", missing: "Add at least one fleet.",
      begin: (form) => ({ name: t`fleet ${(form.values.fleets?.length ?? 0) + 1}`, count: 1 }),
      values: [["name", "Name"], ["tractor", "Tractor", { of: "tractor", hint: "the first of the farm" }], ["count", "How many", num()], ["implement", "Implement", { of: "implement", hint: "the first that fits" }]],
    },
    {
      key: "roads", title: "Roads", one: "Road", hint: "Without them the way is the straight line times the road factor of the farm.", add: "Add a road", remove: "Remove this road", begin: () => ({ km: 1 }),
      values: [["between", "", { pair: ["From", "To"], of: "places" }], ["km", "Length, km", num()]],
    },
  ],
};

export const FARM = {
  values: [],
  lists: [
    {
      key: "tractors", title: "Tractors", one: "Tractor", add: "Add a tractor", remove: "Remove this tractor", missing: "Add at least one tractor.", begin: (form) => ({ name: t`tractor ${(form.values.tractors?.length ?? 0) + 1}`, count: 1 }),
      values: [
        ["name", "Name"], ["count", "How many", num()], ["file", "Tractor file", { of: "tractorFiles", hint: "by the datasheet below" }], ["power_kw", "Power at the shaft, kW", num()], ["price", "List price of one", num()],
      ],
      more: [
        ["sheet.wheelbase_m", "Datasheet: wheelbase, m", num("Instead of a tractor file.")], ["sheet.width_m", "Datasheet: width, m", num()], ["sheet.turning_radius_m", "Datasheet: turning radius, m", num()],
        ["sheet.mass_kg", "Datasheet: mass, kg", num()], ["hours_per_year", "Hours of use per year", num()], ["years", "Years of use", num()],
      ],
    },
    {
      key: "implements", title: "Implements", one: "Implement", add: "Add an implement", remove: "Remove this implement", missing: "Add at least one implement.", begin: (form) => ({ name: t`implement ${(form.values.implements?.length ?? 0) + 1}`, width_m: 3 }),
      values: [
        ["name", "Name"], ["width_m", "Working width, m", num()], ["operation", "Work", { of: WORK, hint: "any" }], ["speed_kmh", "Working speed, km/h", num()],
        ["capacity", "Capacity, l or kg", num("Only if it carries something.")], ["rate_per_m2", "Rate per square metre, l or kg", num("0.02 is 200 l per hectare.")], ["tractors", "Fits the tractors", { list: true, hint: "Names with commas between them; by default all." }],
      ],
      more: [
        ["hitch_m", "From the rear axle to the tools, m", num("By default 1.2.")], ["length_m", "From the first tool to the last, m", num("By default 0.7.")], ["frame_width_m", "Overall width, m", num()], ["transport_width_m", "Width when folded, m", num("By default 3; its working width: it does not fold.")], ["fold_s", "Seconds to fold on the field", num("By default 30.")], ["min_speed_kmh", "Least working speed, km/h", num()],
        ["max_speed_kmh", "Greatest working speed, km/h", num()], ["turn_speed_kmh", "Speed in turns, km/h", num()], ["draft", "Implement of the table of drafts"], ["depth_cm", "Working depth, cm", num()], ["price", "List price", num()], ["hours_per_year", "Hours of use per year", num()], ["years", "Years of use", num()],
        ["headland", "Headland", { of: ["first", "last"], hint: "by the work" }], ["collects", "It fills up while working", { check: true }],
      ],
    },
  ],
  sections: [
    {
      key: "prices", title: "Prices",
      values: [["currency", "Currency", { hint: "By default EUR." }], ["fuel_per_l", "Fuel per litre", num("By default 1.2.")], ["supervision_per_hour", "A person per hour", num("By default 25.")], ["supervision_share", "Persons per tractor", num("By default 0.25: one looks after four.")], ["late_per_ha", "Loss per hectare not done before the rain", num("By default 80.")], ["transport_per_tractor", "Bringing a tractor to a field", num("By default 0.")]],
      more: [["per_hour", "Tractor and implement per hour, all in", num("By default from the values here.")], ["transport_per_km", "Transport per tractor and km", num("By default 0.")], ["seed_per_ha", "Seed lost per hectare not done", num("By default 0.")], ["tractor_price", "Usual price of a tractor", num("By default 100000.")], ["implement_price", "Usual price of an implement", num("By default 15000.")], ["hours_per_year", "Hours of a tractor per year", num("By default 600.")], ["implement_hours_per_year", "Hours of an implement per year", num("By default 200.")], ["interest_pct", "Interest, percent per year", num("By default 4.")], ["insurance_pct", "Insurance and housing, percent per year", num("By default 1.5.")]],
    },
    {
      key: "times", title: "Times",
      values: [["shift_start", "Shift begins", { hint: "Such as 07:00." }], ["shift_end", "Shift ends", { hint: "Such as 19:00; earlier is the next day." }], ["breaks", "Breaks", { list: true, hint: "12:00-12:45; robots need none." }], ["unfold_s", "Unfolding, seconds", num("By default 120.")], ["fold_s", "Folding, seconds", num("By default 120.")], ["refill_s", "Refilling, seconds", num("By default 300.")]],
      more: [["road_speed_kmh", "Speed on the road, km/h", num("By default 25.")], ["road_factor", "Road over straight line", num("By default 1.3.")]],
    },
    { key: "yard", title: "Yard", values: [["lon", "Longitude, degrees", num()], ["lat", "Latitude, degrees", num()]] },
    {
      key: "uncertainty", title: "What varies",
      values: [["start_delay_s", "Usual delay of the start, seconds", num()], ["stops_per_hour", "Stops per tractor and hour", num()], ["stop_s", "Length of a stop, seconds", num()]],
      more: [["breakdown_hours", "Hours between breakdowns", num("0 for none.")], ["repair_s", "Length of a repair, seconds", num()], ["speed_cv", "Variation of the speed of a pass", num()], ["turn_cv", "Variation of the time of a turn", num()]],
    },
  ],
};
