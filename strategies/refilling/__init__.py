"""Refills: a tank that empties at work, or one that fills; a tractor goes before it cannot finish what comes next.

loads           an order of tracks in loads, exactly, by dynamic programming
search          orders searched with their loads
tracks          the tracks of one tractor in an order found so
cuts            where work that is given in order is left for the next load, exactly
berths          where a tractor stands to be served at a fixed place
stops           the missions of a plan with their stops
plan            the whole plan with them, and who is served first
onward          stops of work that is taken over while a plan is driven
"""
