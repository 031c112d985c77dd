"""What terminals and maps are handed of a plan: boundary, headland and lines to drive, in longitude and latitude.

lines               the guidance of a plan, as the planner hands it over
forms               the registry: every form by its name, and what is written in it
form                what a form is
cutting             curves in straight stretches, for terminals that refuse them
isoxml, agopengps, kml, shapefile, geojson, gpx   one form each with the record FORM
names               names that terminals take: short, in plain letters, no two alike
markup              XML of elements, the same bytes for the same lines
packing             files put into one ZIP archive
told                what was written and what was left out: for the terminal and as JSON
"""
