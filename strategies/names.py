"""The names of the strategies, in the order they are offered in; light, so that help texts need nothing else."""

NAMES = (
    "row-by-row",
    "row-by-row-optimised",
    "col-by-col",
    "split-field",
    "interleaved",
)
