"""Who waits for whom, so that no two tractors of a plan meet.

courses       what each tractor drives, alone on the field
crossings     where two courses come too near one another
spans         with what head start they do, and who passes a hold point when, compiled
homeward      whether a fleet that stands like this can still come home
ways_home     the search for that, compiled
right_of_way  who goes first at each crossing, in time
turns_taken   when each tractor begins each of its stretches, compiled
giving_way    the gates of a plan that say so
deconflict    a plan without conflicts: with gates where they do, mended where they do not
"""
