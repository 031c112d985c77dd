"""A whole tractor file from the few numbers of a maker's datasheet."""
