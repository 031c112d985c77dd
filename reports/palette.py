"""Colours that people with any colour vision tell apart (Okabe and Ito, Color Universal Design, 2008)."""

from __future__ import annotations

TRACTORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#8A6D3B")
TRACTORS_ON_DARK = ("#4FA8DE", "#F08A4B", "#2FC79A", "#DE9DC2", "#8FD0F5", "#F2BE4A", "#C4A671")
STATES = {"working": "#009E73", "turning": "#56B4E9", "waiting": "#E69F00", "reversing": "#CC79A7"}
REFILLING = "#0072B2"  # beside the states, where there is any
FIELD = "#EEF2E2"
SWATH = "#C3CCAA"
ROUNDS = ("#DDE7F0", "#EFE3C8")  # of even and odd rounds of the headland
OBSTACLE = "#9A9A8E"
EDGE = "#4F5B39"
MISSED = "#B00020"


def tractor_colour(number: int) -> str:
    """Colour of tractor `number`, from 0; after seven the colours come round again, so print the number too."""
    return TRACTORS[number % len(TRACTORS)]
