"""The headland in rounds: how many, who drives them, and when.

corners  how a round goes round a corner of the field, and what it misses there
shifts   rounds dealt out to the fleet
laps     how a tractor drives its share of a round
rounds   plans with their rounds, before the tracks or after them
"""
