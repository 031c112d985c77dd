"""Formations: tractors that work abreast and turn one after the other.

grouping, leftover    tracks in rounds of a formation; what one of the tractors works alone
abreast, clearing     places of one round; where a tractor stands clear of ways past it
clear_rounds          rounds clear of each other's ways
queueing              legs and gates of rounds and queues
formation             rounds, places, the queue and the rest in one plan
promise               the corners a formation may begin at, in order
care                  a formation driven, and mended where two of its tractors meet
passages, releases    passing the headland, measured; when to leave the queue, optimised
"""
