"""Fields: boundaries, obstacles, ground zones, field files and the tracks laid on them.

field               a field in local metres
layout, lines, bearings   tracks on it: where they run, how they are trimmed, directions worth trying
cells               parts of the ground for tracks, each with its own bearing
cutting, options    regions cut into cells; layouts worth comparing
rounds              centre lines of the headland's rounds; spines of narrow strips
handedness          which hand an outline shows, so that mirrored fields get mirrored plans
filling             tracks that cover what the rounds leave
obstacles, obstacles_read   what is cut out of a field, and read from its file
fences              sides of the outline that nothing crosses
entrances           where tractors come in
free                where the guided point may be, and what of that lies beside the tracks
read, write         field files, in and out
guidance            lines of a file that tracks can be laid along
headlands           inner edges of headlands of a file, and their widths
telling             what a person says of a file that it does not say itself
whereabouts         whether longitude and latitude seem to be exchanged
source, samples_index   what a name stands for: a sample or a file
document            what a file holds, whatever its form, before its numbers are believed
formats             the forms that are read, one module each, and their registry
outline, frame, projection   its rings checked; from its numbers to local metres
plane               metres as AgOpenGPS counts them
reading             the text of any file that somebody named
errors              the base of all refusals
"""

from fields.cells import Cell
from fields.errors import FieldError
from fields.field import Field, GroundZone
from fields.layout import Layout, Track, lay_tracks
from fields.read import Listed, list_fields, read_field
from fields.samples_index import sample_names
from fields.write import write_field

__all__ = [
    "Cell",
    "Field",
    "FieldError",
    "GroundZone",
    "Layout",
    "Listed",
    "Track",
    "lay_tracks",
    "list_fields",
    "read_field",
    "sample_names",
    "write_field",
]
