"""Who waits for whom, so that no two tractors of a plan meet.

courses       what each tractor drives, alone on the field
crossings     where two courses come too near one another
homeward      whether a fleet that stands like this can still come home
right_of_way  who goes first at each crossing, in time
giving_way    the gates of a plan that say so
deconflict    a plan without conflicts: with gates where they do, mended where they do not
"""
