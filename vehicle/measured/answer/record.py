"""How often what is called likely was right, as the matrix last measured it (tests/diagnosis/test_matrix.py).

Counted over logs of the independent truth with effects hidden at a clear size, at a third and at a sixth of it, and
with nothing hidden; right is an effect that was hidden.
"""

from __future__ import annotations

LIKELY_RIGHT, LIKELY_OF = 0, 0
