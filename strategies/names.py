"""Names of the strategies in the order in which they are offered; imports nothing, so that help texts stay quick."""

STRATEGY_NAMES = (
    "row-by-row",
    "row-by-row-optimised",
    "col-by-col",
    "split-field",
    "interleaved",
)
