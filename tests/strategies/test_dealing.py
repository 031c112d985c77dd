"""Who drives which share of the rounds: the pairs nearest to each other first."""

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from strategies.headland.plan_passes import _assign_shares
from tests.examples import count_examples

Places = list[tuple[float, float] | None]
PLACE = st.tuples(*[st.integers(-20, 20).map(lambda n: 0.0005 * n + 3.0)] * 2)  # many as far apart to the millimetre


def by_sorting(places: Places, ends: list[tuple[float, float, float]]) -> list[int]:
    """The same from all pairs in the order of their distances to the millimetre, tractors and shares."""
    pairs = sorted(
        (math.inf if place is None else round(1000.0 * float(np.hypot(*np.subtract(end[:2], place)))), tractor, share)
        for share, place in enumerate(places)
        for tractor, end in enumerate(ends)
    )
    own: dict[int, int] = {}
    for _, tractor, share in pairs:
        if tractor not in own and share not in own.values():
            own[tractor] = share
    return [own[tractor] for tractor in range(len(ends))]


@given(st.lists(st.tuples(st.none() | PLACE, PLACE), min_size=1, max_size=9))
@settings(max_examples=count_examples(200))
def test_the_nearest_pairs_are_dealt_first(pairs: list[tuple[tuple[float, float] | None, tuple[float, float]]]) -> None:
    places, ends = [place for place, _ in pairs], [(*end, 0.0) for _, end in pairs]
    assert _assign_shares(places, ends) == by_sorting(places, ends)
    assert sorted(_assign_shares(places, ends)) == list(range(len(ends)))
