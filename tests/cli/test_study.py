"""`headland study` from the outside."""

import json
from collections.abc import Callable
from typing import Any


def test_json_keeps_its_contract(headland: Callable[..., Any]) -> None:
    outcome = headland("study", "--json")
    assert outcome.status == 0 and outcome.err == ""
    answer = json.loads(outcome.out)
    assert list(answer) == ["tables", "claims", "assumptions"]
    assert {name: len(rows) for name, rows in answer["tables"].items()} == {"6.1": 6, "6.2": 2, "6.3": 3}
    for rows in answer["tables"].values():
        for row in rows:
            assert {"tractors", "thesis_s", "time_s", "difference_pct"} <= set(row)
            assert row["time_s"] > 0 and abs(row["difference_pct"]) < 100
    for claim in answer["claims"]:
        assert set(claim) == {"claim", "holds", "why"}
        assert type(claim["holds"]) is bool and claim["why"]
