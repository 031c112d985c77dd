"""Forms of files of driven work: one module each with the record FORM, and the line here that names it.

isoxml, tlg     ISOXML task data; the binary time logs in it
points          Shapefiles of points, as John Deere's Operations Center exports them
agopengps       AgOpenGPS folders: recorded paths
table           CSV files, with a mapping of their columns
form, rows      what a form is; which rows can be used
"""
