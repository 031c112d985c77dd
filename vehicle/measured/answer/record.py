"""How often what is called likely was right, as the matrix last measured it (tests.benchmarks.diagnosis).

Counted over two fifths of the sets of seeds 930 to 939, logs of the second reference; right is an effect that was
hidden. 0 of 0 until it is measured.
"""

from __future__ import annotations

LIKELY_RIGHT, LIKELY_OF = 10, 10
