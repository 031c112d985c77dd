"""Finders of ways: remembered searches, and finders that layouts have in common."""

import pickle
from itertools import product

import pytest
import shapely

from strategies.path_planning.connector import Connector, ConnectorCache, TurnCosts
from strategies.path_planning.paths import Pose
from strategies.path_planning.turn_kinds import TURN_KINDS

R = 4.0
COSTS = TurnCosts(speed_mps=2.0, reverse_speed_mps=1.0, cusp_s=5.0)
# A lane too narrow to turn in, with a yard to the north of its west end.
BLIND = shapely.Polygon([(0, 0), (80, 0), (80, 6), (40, 6), (40, 40), (0, 40)])
POSES: tuple[Pose, ...] = ((75.0, 3.0, 0.0), (60.0, 3.0, 3.0), (20.0, 20.0, 1.5), (41.0, 39.0, 0.5), (10.0, 3.0, 0.0))


@pytest.mark.parametrize("kinds", [TURN_KINDS, ("u", "omega")])
def test_a_remembered_search_gives_the_same_answer(kinds: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> None:
    connector = Connector(BLIND, R, COSTS, kinds)
    pairs = list(product(POSES, POSES))
    found = {pair: connector.connect(*pair) for pair in pairs}
    assert any(path is None for path in found.values()) and any(path is not None for path in found.values())
    for pair in pairs:
        assert Connector(BLIND, R, COSTS, kinds).connect(*pair) == found[pair]

    def searched(*_: Pose) -> None:
        raise AssertionError("searched again")

    monkeypatch.setattr(connector, "_search", searched)
    assert all(connector.connect(*pair) is found[pair] for pair in pairs)


def test_one_finder_serves_all_that_ask_the_same() -> None:
    connectors = ConnectorCache()
    one = connectors.get_connector(BLIND, R, COSTS, TURN_KINDS)
    assert connectors.get_connector(shapely.Polygon(BLIND), R, COSTS, TURN_KINDS) is one
    others = [
        connectors.get_connector(shapely.affinity.translate(BLIND, 1.0), R, COSTS, TURN_KINDS),
        connectors.get_connector(BLIND, 1.1 * R, COSTS, TURN_KINDS),
        connectors.get_connector(BLIND, R, TurnCosts(2.0, 1.0, 6.0), TURN_KINDS),
        connectors.get_connector(BLIND, R, COSTS, ("u",)),
    ]
    assert len({id(each) for each in (one, *others)}) == 5
    assert pickle.loads(pickle.dumps(connectors)).connectors == {}
