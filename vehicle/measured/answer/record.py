"""How often what is called likely was right, as the matrix last measured it (tests/diagnosis/test_matrix.py).

Counted over logs of the independent references; right is an effect that was hidden. 0 of 0 until it is measured.
"""

from __future__ import annotations

LIKELY_RIGHT, LIKELY_OF = 0, 0
