"""Colours that people with any colour vision tell apart (Okabe and Ito, Color Universal Design, 2008)."""

from __future__ import annotations

TRACTOR_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#8A6D3B")
DARK_TRACTOR_COLOURS = ("#4FA8DE", "#F08A4B", "#2FC79A", "#DE9DC2", "#8FD0F5", "#F2BE4A", "#C4A671")
STATE_COLOURS = {"working": "#009E73", "turning": "#56B4E9", "waiting": "#E69F00", "reversing": "#CC79A7"}
RARE_STATE_COLOURS = {"refilling": "#0072B2", "folding": "#8A6D3B"}
FIELD_COLOUR = "#EEF2E2"
SWATH_COLOUR = "#C3CCAA"
HEADLAND_PASS_COLOURS = ("#DDE7F0", "#EFE3C8")  # of even and odd headland passes
OBSTACLE_COLOUR = "#9A9A8E"
EDGE_COLOUR = "#4F5B39"
UNWORKED_COLOUR = "#B00020"
DONE_COLOUR = "#C9BFA5"  # earth
CONTOUR_COLOUR = "#8A7A5C"
INK_COLOUR = "#2B2B2B"
SHADE_OPACITY = 0.45  # of the shading of heights over the ground


def get_tractor_colour(number: int) -> str:
    """Colour of tractor `number`, from 0; colours repeat after seven, so print the number too."""
    return TRACTOR_COLOURS[number % len(TRACTOR_COLOURS)]
