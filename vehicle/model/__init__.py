"""Parameters of a tractor and its ground, the effects that logs can add to them, and what its instruments show."""
