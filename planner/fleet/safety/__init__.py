"""Safety of a fleet: base release, predicted motion, distances, and checks of reports."""
