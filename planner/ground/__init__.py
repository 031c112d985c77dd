"""The ground itself: what was worked, missed, driven over and come near.

overlays  unions and differences of ground
inside    places that surely lie inside an area
swept     ground under the tool of a run
trampled  finished ground under wheels
unworked  what no track and no round covers, and why
touched   obstacles and fences a run touches
measure   all that a run is measured by
"""
