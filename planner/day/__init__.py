"""A day of several fields and fleets: who works which field, in what order, how sure each is, what stays undone.

    from planner.day import load_day, plan_day, prepare_day

file        the day file: fields, fleets, roads, light, rain; read and checked
example     (TOML) the day file that comes with Headland
places      where fields and yard are, and how far apart
cache       simulated field times kept by content
times       how long every fleet takes for every field: simulated plans
light       when the sun is up
problem     the day as numbers; what an order of fields costs a fleet
insertion   a field put where it costs least
search      large neighbourhood search, for many fields
exact       the constraint model: the proof for few fields
sets        every route that may be part of a better day, and the best choice of them: the proof for many fields
relaxed     what no day costs less than, where routes are too many: prices on fields
solve       the best day and its proven gap
build       from file, places and times to the problem
odds        draws of the plans chained along every fleet's day
words       advice, and why a field is not done
planning    plan_day: all of it
"""

from planner.day.file import DayFile, load_day
from planner.day.planning import Ready, plan_day, prepare_day

__all__ = ["DayFile", "Ready", "load_day", "plan_day", "prepare_day"]
