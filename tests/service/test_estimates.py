"""Estimates of plans: what they say, who may ask, how much, and in which process."""

import asyncio
import time
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import httpx2
import pytest
from starlette.requests import ClientDisconnect

from planner.evaluation.preparation import prepare_context
from planner.evaluation.site import get_site_moves
from planner.service.api.apps import ABANDONED_PATHS
from planner.service.gateway.back_office import OfficeForwarder
from planner.service.gateway.connection_limits import RateLimiter
from planner.service.gateway.responses import wait_while_connected
from planner.service.jobs import plan_estimates
from planner.service.jobs.plan_estimates import COMPUTING_SHARE, LONGEST_ESTIMATE_S
from planner.service.sandbox.readings import build_work_order
from planner.service.settings import ServiceSettings
from planner.service.store.token_table import hash_token
from planner.sweeps import estimates
from planner.sweeps.kept_grounds import BEARING_DECIMALS, KeptGrounds, OrderEstimate
from reports.common.plan_results import PlanResult
from strategies.lines.line_wishes import name_line
from tests.service.conftest import Shared, bearer, wait_until
from tests.service.one_process import create_app
from tests.service.watching import serve_app

VALUES = {"field": "iwamizawa", "width": 6.0, "tractors": "1-2"}


def ask(shared: Shared, **values: Any) -> tuple[int, dict[str, Any]]:
    """Status and answer of an estimate of VALUES with others."""
    client, headers = shared
    answer = client.post("/api/v1/estimates", json={**VALUES, **values}, headers=headers)
    return answer.status_code, answer.json()


@pytest.fixture(scope="module")
def grounds() -> KeptGrounds:
    return KeptGrounds()


def estimate(grounds: KeptGrounds, *, at_once: bool = False, **values: Any) -> OrderEstimate:
    return grounds.estimate(build_work_order({**VALUES, **values}), at_once=at_once)


def test_an_estimate_answers_every_number_and_follows_start_deadline_and_price(shared: Shared) -> None:
    status, plain = ask(shared)
    assert status == 200
    one, two = plain["plans"]
    assert (one["tractors"], two["tractors"]) == (1, 2) and one["done_s"] > two["done_s"] > 0.0
    assert one["end"] is None and one["in_time"] is None and plain["recommended"] in (1, 2)
    _, timed = ask(shared, start="08:00", deadline="08:25", price_per_hour=80)
    assert [plan["in_time"] for plan in timed["plans"]] == [False, True] and timed["recommended"] == 2
    assert timed["plans"][1]["end"] == "08:22"
    assert timed["plans"][0]["cost"] == pytest.approx(2.0 * one["cost"])
    client, headers = shared
    at_once = [
        client.post("/api/v1/estimates?at_once=true", json=VALUES | {"width": width}, headers=headers).json()
        for width in (6.0, 6.3)
    ]
    assert [answer["is_scaled"] for answer in (plain, *at_once)] == [False, False, True]


def test_an_estimate_says_what_its_tractor_cannot_pull(shared: Shared) -> None:
    _, possible = ask(shared, width=6, speed_kmh=8, operation="till")
    _, fast = ask(shared, width=6, speed_kmh=12, operation="till")
    assert possible["caution"] is None and "needs about 90 kW at the drawbar at 12 km/h" in fast["caution"]
    assert "--" not in fast["caution"], "a page has no options"
    _, questioned = ask(shared, width=6, speed_kmh=9, operation="till")
    assert questioned["caution"].endswith(": check it, or try 8.5 km/h or 5.5 m.")
    _, late = ask(shared, start="13:00", deadline="13:01")
    assert late["caution"] == "It is not done in time."


@pytest.mark.parametrize(
    ("bad", "parameter"),
    [({"width": -1.0}, "width"), ({"field": "nowhere"}, "field"), ({"wdth": 3.0}, "wdth"), ({"start": "x"}, "start")],
)
def test_bad_input_is_refused_in_one_sentence_with_its_parameter(
    shared: Shared, bad: dict[str, Any], parameter: str
) -> None:
    status, answer = ask(shared, **bad)
    assert (status, answer["parameter"]) == (422, parameter) and answer["error"].endswith(".")


def test_who_may_not_plan_or_has_spent_its_computing_gets_no_estimate(shared: Shared) -> None:
    client, headers = shared
    assert client.post("/api/v1/estimates", json=VALUES).status_code == 401
    reader, spender = (bearer(client.app, scope) for scope in ("read", "planner"))  # type: ignore[arg-type]
    assert client.post("/api/v1/estimates", json=VALUES, headers=reader).status_code == 403
    budget = client.app.state.estimator.budget  # type: ignore[attr-defined]
    digest = hash_token(spender["Authorization"].removeprefix("Bearer "))
    budget.spend_tokens(digest, 10.0 * LONGEST_ESTIMATE_S)
    answer = client.post("/api/v1/estimates", json=VALUES, headers=spender)
    assert answer.status_code == 429 and "ask again in" in answer.json()["error"]
    assert client.post("/api/v1/estimates", json=VALUES, headers=headers).status_code == 200


def test_a_client_who_has_spent_all_computing_waits_and_others_do_not() -> None:
    now_s = 0.0
    budget = RateLimiter(COMPUTING_SHARE, LONGEST_ESTIMATE_S, lambda: now_s)
    budget.spend_tokens("a", LONGEST_ESTIMATE_S - 1.0)
    assert budget.measure_wait_s("a") == 0.0
    budget.spend_tokens("a", 5.0)
    assert budget.measure_wait_s("a") == 5.0 / COMPUTING_SHARE and budget.measure_wait_s("b") == 0.0
    now_s = 5.0 / COMPUTING_SHARE
    assert budget.measure_wait_s("a") == 0.0


def test_what_changes_no_layout_is_answered_from_the_ground_that_is_there(
    grounds: KeptGrounds, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = estimate(grounds)
    monkeypatch.setattr("planner.sweeps.kept_grounds.prepare_context", pytest.fail)
    dearer = estimate(grounds, tractors="1-3", price_per_hour=80.0, start="09:00", deadline="12:00")
    assert len(dearer.plans) == 3
    assert (dearer.plans[0].cost or 0.0) > (first.plans[0].cost or 0.0)
    again = estimate(grounds)
    assert replace(again, order=first.order) == first


@pytest.mark.slow
@pytest.mark.parametrize("speed_kmh", [pytest.param(5.0, marks=pytest.mark.matrix), 12.0])
def test_lines_are_those_of_the_plan_that_is_driven(speed_kmh: float) -> None:
    order = build_work_order({"field": "denmark", "width": 6.0, "tractors": "1", "speed_kmh": speed_kmh})
    shown = KeptGrounds().estimate(order)
    lines = get_site_moves(prepare_context(order)).lines
    assert [one.name for one in shown.lines] == [name_line(line.task) for line in lines]
    for one, line in zip(shown.lines, lines, strict=True):
        assert [one.points[0], one.points[-1]] in [[tuple(path[0]), tuple(path[-1])] for path in line.paths]


@pytest.mark.slow
def test_a_new_width_borrows_the_layout_unless_it_asks_for_its_own_and_may_pin_it(
    grounds: KeptGrounds, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = estimate(grounds)
    borrowed = estimate(grounds, width=6.2)
    assert not first.is_layout_borrowed and borrowed.is_layout_borrowed
    assert borrowed.headland_passes == first.headland_passes
    assert borrowed.bearing_deg == pytest.approx(first.bearing_deg)
    own = estimate(grounds, width=6.2, bearing=30.0)
    assert not own.is_layout_borrowed and own.bearing_deg == pytest.approx(30.0)
    layout = {"bearing": round(borrowed.bearing_deg, BEARING_DECIMALS), "headland_passes": borrowed.headland_passes}
    monkeypatch.setattr("planner.sweeps.kept_grounds.prepare_context", pytest.fail)
    pinned = estimate(grounds, width=6.2, **layout, work_first="3")
    assert not pinned.is_layout_borrowed
    assert [one.name for one in pinned.lines] == [one.name for one in borrowed.lines]
    assert estimate(grounds, at_once=True, width=6.2, **layout, leave_out="2").is_scaled


@pytest.mark.slow
def test_an_answer_at_once_is_scaled_from_the_nearest_width(
    grounds: KeptGrounds, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, laid_out = estimate(grounds), estimate(grounds, width=6.4)
    own = KeptGrounds()
    assert not estimate(own, at_once=True).is_scaled, "without a ground one is laid out"
    monkeypatch.setattr("planner.sweeps.kept_grounds.prepare_context", pytest.fail)
    monkeypatch.setattr("planner.sweeps.estimates.sketch_plans", pytest.fail)
    assert not estimate(own, at_once=True, start="08:00", price_per_hour=30.0).is_scaled
    scaled = estimate(own, at_once=True, width=6.4)
    assert scaled.is_scaled and not first.is_scaled
    for plan, before, exact in zip(scaled.plans, first.plans, laid_out.plans, strict=True):
        assert plan.time_s == pytest.approx((before.time_s or 0.0) * 6.0 / 6.4)
        assert plan.time_s == pytest.approx(exact.time_s, rel=0.1)


@pytest.mark.slow
def test_an_answer_at_once_leaves_out_what_is_left_out(grounds: KeptGrounds) -> None:
    own = KeptGrounds()
    estimate(own, at_once=True)
    scaled = estimate(own, at_once=True, leave_out="4,5")
    laid_out = estimate(grounds, leave_out="4,5")
    assert scaled.is_scaled and not laid_out.is_scaled
    for plan, exact in zip(scaled.plans, laid_out.plans, strict=True):
        assert plan.worked_pct == pytest.approx(exact.worked_pct, abs=0.5) and plan.worked_pct < 90.0
        assert plan.time_s == pytest.approx(exact.time_s, rel=0.2), "who works what is dealt anew"
    everything = "R1-2,1-8"
    assert not estimate(own, at_once=True, leave_out=everything).best


@pytest.mark.slow
def test_an_answer_at_once_works_what_the_one_before_left_out(grounds: KeptGrounds) -> None:
    own = KeptGrounds()
    estimate(own, at_once=True, leave_out="4,5")
    whole = estimate(own, at_once=True)
    for plan, exact in zip(whole.plans, estimate(grounds).plans, strict=True):
        assert plan.worked_pct == pytest.approx(exact.worked_pct, abs=0.1)
        assert plan.time_s == pytest.approx(exact.time_s, rel=0.1)


def test_an_answer_at_once_for_another_number_deals_out_the_same_work(grounds: KeptGrounds) -> None:
    two = estimate(grounds).plans[1]
    own = KeptGrounds()
    estimate(own)
    (four,) = estimate(own, at_once=True, tractors="4").plans
    assert four.tractors == 4 and four.tractor_time_s == pytest.approx(two.tractor_time_s)
    assert (two.time_s or 0.0) / 2.0 == pytest.approx(four.time_s)


@pytest.mark.slow
def test_tours_of_other_numbers_are_sought_between_orders() -> None:
    own = KeptGrounds()
    assert not own.prepare()
    estimate(own, at_once=True)
    assert estimate(own, at_once=True, tractors="3").is_scaled
    while own.prepare():
        pass
    assert estimate(own, at_once=True, tractors="3", work_first="8").is_scaled, "nothing is sought for a new wish"
    prepared = estimate(own, at_once=True, tractors="3")
    assert not prepared.is_scaled and prepared.plans == estimate(KeptGrounds(), tractors="3").plans


@pytest.mark.slow
def test_what_a_ground_keeps_is_bounded_and_answers_stay_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(estimates, "MOST_SKETCHES", 4)
    monkeypatch.setattr(estimates, "MOST_SPEEDS", 2)
    order = build_work_order(VALUES)
    ground = estimates.GroundEstimates(prepare_context(order), drives=False)

    def ask_for(speed_mps: float, leave_out: str) -> PlanResult:
        asked = replace(order.request, tractors=(1,), speed_mps=speed_mps, leave_out=leave_out)
        return ground.estimate(replace(order, request=asked))

    first, *_ = [ask_for(1.0 + 0.2 * place, str(1 + place)) for place in range(4)]
    assert (len(ground._sketches), len(ground._moves)) == (4, 2)
    assert ask_for(1.0, "1") == first


@pytest.mark.slow
def test_the_confined_process_estimates_refuses_and_cannot_leave_its_folder(tmp_path: Path) -> None:
    (tmp_path / "one").mkdir()
    secret = tmp_path.parent / "secret.geojson"
    secret.write_text("{}")
    process = plan_estimates._EstimatingProcess(tmp_path, 2**30)
    try:
        until_s = time.monotonic() + 600.0
        while not process.wait_until_ready():
            assert time.monotonic() < until_s
        order = {"folder": str(tmp_path / "one"), "files": "", "values": VALUES, "at_once": True}
        answer = process.ask(order)
        assert answer is not None and b'"recommended"' in answer
        refused = process.ask(order | {"values": VALUES | {"field": str(secret)}})
        assert refused is not None and b'"refused"' in refused and b"ermission" in refused
    finally:
        process.end()


def test_lines_say_who_works_them_and_follow_what_is_wanted(shared: Shared) -> None:
    status, plain = ask(shared, tractors="2")
    assert status == 200
    assert {line["tractor"] for line in plain["lines"] if line["tractor"]} == {1, 2}
    for tractor in (1, 2):
        places = sorted(line["place"] for line in plain["lines"] if line["tractor"] == tractor)
        assert places == list(range(1, len(places) + 1))
    west, east = (pick(point[0] for point in plain["outlines"][0]) for pick in (min, max))
    assert all(west - 1.0 <= x <= east + 1.0 for line in plain["lines"] for x, _ in line["points"])
    tracks = [line["name"] for line in plain["lines"] if line["name"].isdecimal() and line["tractor"]]
    out, first, given = tracks[0], tracks[len(tracks) // 2], tracks[-1]
    status, other = ask(shared, tractors="2", leave_out=out, work_first=first, give=[f"1={given}"])
    assert status == 200
    by_name = {line["name"]: line for line in other["lines"]}
    assert by_name[out]["tractor"] is None
    assert by_name[first]["place"] == 1
    assert by_name[given]["tractor"] == 1
    assert other["plans"][0]["worked_pct"] < plain["plans"][0]["worked_pct"]
    assert ask(shared, leave_out="999")[0] == 422


class SlowEstimator:
    """Answers nobody while the test lasts, and counts what it begins and what ends."""

    def __init__(self) -> None:
        self.begun = self.ended = 0

    async def estimate(self, *_arguments: Any, **_options: Any) -> dict[str, Any]:
        self.begun += 1
        try:
            await asyncio.sleep(300.0)
        finally:
            self.ended += 1
        return {}

    def close(self) -> None:
        pass


def test_work_for_who_has_gone_has_ended_before_that_is_said_and_what_fails_is_not_hidden() -> None:
    ended = list[str]()

    async def work() -> str:
        try:
            await asyncio.sleep(60.0)
        finally:
            await asyncio.sleep(0.01)
            ended.append("work")
        return "done"

    async def go(error: Exception | None = None) -> None:
        await asyncio.sleep(0.01)
        if error is not None:
            raise error

    with pytest.raises(ClientDisconnect):
        asyncio.run(wait_while_connected(go(), work()))
    assert ended == ["work"]
    with pytest.raises(OSError, match="no line"):
        asyncio.run(wait_while_connected(go(OSError("no line")), work()))
    assert asyncio.run(wait_while_connected(asyncio.sleep(60.0), asyncio.sleep(0.0, "answer"))) == "answer"


@pytest.mark.slow
@pytest.mark.parametrize("is_forwarded", [False, True])
def test_an_estimate_of_who_has_gone_ends(tmp_path: Path, is_forwarded: bool) -> None:
    app = create_app(ServiceSettings(data=tmp_path, workers=0), reads_inline=True)
    estimator = app.state.estimator = SlowEstimator()
    token = app.state.store.create_token_text("ann", "planner")

    async def pass_by(_path: str) -> None:
        pass

    with serve_app(app) as base:
        office = SimpleNamespace(url=base.rstrip("/"), secret="")
        forward: Any = OfficeForwarder(office, pass_by, pass_by, ABANDONED_PATHS)  # type: ignore[arg-type]
        with serve_app(forward) if is_forwarded else nullcontext(base) as asked:
            with pytest.raises(httpx2.ReadTimeout):
                httpx2.post(
                    f"{asked}api/v1/estimates", json=VALUES, headers={"authorization": f"Bearer {token}"}, timeout=1.0
                )
            wait_until(lambda: estimator.ended == 1)
    assert estimator.begun == 1
