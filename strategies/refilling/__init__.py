"""Refills: a tank that empties at work, or one that fills; a tractor goes before it cannot finish what comes next.

supply          what a tractor carries, how fast that is used, and where it is made good
loads           an order of tracks in loads, exactly, by dynamic programming
search          orders searched with their loads
"""
