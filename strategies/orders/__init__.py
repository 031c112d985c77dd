"""Orders: which track next, and which tractor takes it.

table, tours     seconds between passes by the ways driven; orders searched over them
bounds, exact    what no order can undercut; few tracks in the best order, proven
sequence         the order in which one tractor takes its tracks
shares           blocks of lines for a fleet, balanced
"""
