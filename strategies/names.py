"""Names of the strategies in the order in which they are offered; imports nothing, so that help texts stay quick."""

STRATEGY_NAMES = (
    "row-by-row",
    "row-by-row-optimised",
    "col-by-col",
    "split-field",
    "interleaved",
)

AUTO_CORNERS, SQUARE_CORNERS, ROUND_CORNERS = CORNERS = "auto", "square", "round"
"""How headland passes turn at corners: worked whole, in an arc, or each as is quicker."""
