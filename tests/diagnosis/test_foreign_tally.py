"""How answers to the references of others are counted, by hand; and how logs are varied."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tests.benchmarks import foreign_diagnosis
from tests.diagnosis import foreign_sets
from tests.diagnosis.foreign_sets import describe_case, name_case
from tests.diagnosis.foreign_tally import print_tables, tally_records
from tests.diagnosis.rerecording import VARIATIONS, Record, list_flips, list_losses, vary_logs
from tests.truth.cases import ColumnClock, Fault, Law, TruthCase


def say(name: str, status: str, low: float = 0.9, high: float = 1.1, **more: object) -> Record:
    """A finding with one value."""
    middle = 0.5 * (low + high)
    return {"id": name, "status": status, "value": {"angle_deg": middle}, "interval": {"angle_deg": [low, high]},
            "visible": 0.1, "equivalent_to": [], "law": None, **more}  # fmt: skip


def build(case: TruthCase, *said: Record, **more: object) -> Record:
    """A record as a diagnosis would leave it."""
    named = [one["id"] for one in said if one["status"] == "named"]
    return {
        **describe_case("fourth", case),
        "named": named,
        "said": list(said),
        "unexplained": 0.0,
        "cpu_s": 1.0,
        **more,
    }


def hide(kind: str, size: float = 1.0, **more: object) -> TruthCase:
    ids = frozenset({"steering_offset"})
    return TruthCase(kind, 1, {"steering_offset": {"angle_deg": size}}, allowed=ids, wanted=ids, **more)  # type: ignore[arg-type]


def count(record: Record, what: str) -> str:
    return str(tally_records([record]).counts.get(what))


def test_a_name_is_right_wrong_or_missing() -> None:
    right, wrong = say("steering_offset", "named"), say("wheel_slip", "named")
    assert count(build(hide("effect"), right), "clear effects named") == "1/1"
    assert count(build(hide("effect")), "clear effects named") == "0/1"
    assert count(build(hide("effect"), right, wrong), "sets with a wrong name") == "1/1"
    assert count(build(hide("effect"), right), "sets with a wrong name") == "0/1"
    assert "WRONG NAME wheel_slip 1 [0.9, 1.1]" in tally_records([build(hide("effect"), wrong)]).complaints[-1]


def test_an_equivalent_set_will_do_only_where_drives_are_narrow() -> None:
    said = say("heading_bias", "equivalent", equivalent_to=["steering_offset"])
    assert tally_records([build(hide("one_sided"), said)]).kinds["one_sided"]["named"].right == 1
    assert tally_records([build(hide("effect"), said)]).kinds["effect"]["named"].right == 0
    assert count(build(hide("one_sided"), said), "equivalent sets without a right one") == "0/1"
    other = say("heading_bias", "equivalent", equivalent_to=["antenna_right"])
    assert count(build(hide("one_sided"), other), "equivalent sets without a right one") == "1/1"


@pytest.mark.parametrize(("size", "holds"), [(1.0, "1/1"), (1.3, "0/1")])
def test_intervals_are_counted_where_they_are_said(size: float, holds: str) -> None:
    what = "intervals that hold (named and likely)"
    assert count(build(hide("effect", size), say("steering_offset", "named")), what) == holds
    assert count(build(hide("effect", size), say("steering_offset", "likely")), what) == holds
    assert count(build(hide("effect", size), say("steering_offset", "equivalent")), what) == "None"


def test_a_fault_has_its_run_and_its_time() -> None:
    case = TruthCase("fault", 1, faults=(Fault("position_frozen", 1, 20.0),), allowed=frozenset({"position_frozen"}))
    hidden = [{"id": "position_frozen", "run": "two", "from_s": 120.0, "to_s": None}]

    def find(run: str, from_s: float, name: str = "position_frozen") -> Record:
        return build(case, faults=hidden, faults_said=[{"id": name, "run": run, "from_s": from_s, "to_s": None}])

    assert count(find("two", 124.0), "faults found within 5 s") == "1/1"
    assert count(find("two", 124.0, "position_lost"), "faults found within 5 s") == "1/1"
    late = find("two", 130.0)
    assert count(late, "faults found") == "1/1" and count(late, "faults found within 5 s") == "0/1"
    assert count(find("one", 120.0), "faults found") == "0/1"
    assert count(find("one", 120.0), "faults said that are not there") == "1/1"
    assert count(build(hide("effect"), faults_said=[{"id": "steering_loose", "run": "two", "from_s": 3.0}]),
                 "faults said that are not there") == "1/1"  # fmt: skip


def test_a_column_is_found_with_its_size() -> None:
    case = TruthCase("column", 1, columns={"heading": ColumnClock(delay_s=0.4)}, allowed=frozenset({"heading_delay"}))
    empty = {
        "column": "heading",
        "delay_s": None,
        "hold_s": None,
        "filter_s": None,
        "clock_offset_s": None,
        "words": "",
    }
    what = "columns with a clock of their own found"
    assert count(build(case, columns=[{**empty, "delay_s": 0.45}]), what) == "1/1"
    assert count(build(case, columns=[{**empty, "delay_s": 0.1}]), what) == "0/1"
    assert count(build(case, say("heading_delay", "named")), what) == "1/1"
    wrong = build(case, columns=[{**empty, "column": "speed", "delay_s": 0.4}])
    assert count(wrong, "columns said late that are not") == "1/1" and count(wrong, what) == "0/1"


def test_a_law_is_right_by_its_kind() -> None:
    law = Law("steering_offset", "over_minutes", {"start": 0.0, "per_minute": 2.0})
    case = TruthCase("law", 1, laws=(law,), allowed=frozenset({"steering_offset"}))
    for kind, right in (("over_minutes", "1/1"), ("by_speed", "0/1")):
        said = say("steering_offset", "named", law={"kind": kind, "values": {}})
        assert count(build(case, said), "laws right") == right
    assert count(build(case, say("steering_offset", "named")), "laws right") == "0/1"


def test_clean_sets_and_causes_outside() -> None:
    clean = TruthCase("clean", 1)
    assert count(build(clean), "clean sets silent") == "1/1"
    assert count(build(clean, say("wheel_slip", "named")), "clean sets silent") == "0/1"
    assert count(build(clean, error="LogError: no"), "clean sets silent") == "0/1"
    assert count(build(hide("effect")), "clean sets silent") == "None"
    outside = TruthCase("outside", 1, outside={"gyro_walk": {"size_deg": 2.0}}, hint_words=("heading",))
    hint = {"depends_on": None, "instrument": "heading", "block": None, "words": ""}
    assert count(build(outside, hints=[hint]), "outside: a useful hint") == "1/1"
    assert count(build(outside, depends_on=["Heading error over time"]), "outside: a useful hint") == "1/1"
    assert count(build(outside, depends_on=["speed"]), "outside: a useful hint") == "0/1"
    assert count(build(outside, say("heading_bias", "named")), "outside: a wrong name") == "1/1"


def test_a_tractor_that_is_worse_on_unseen_runs() -> None:
    def drive(after: float) -> Record:
        errors = [{"5": {"both": 2.0}, "20": {"both": number}} for number in (8.0, after)]
        return {"before": errors[0], "after": errors[1]}

    worse = build(hide("effect"), unseen=drive(9.0), savable=True)
    assert count(worse, "saved, and worse on unseen runs") == "1/1"
    assert count({**worse, "savable": False}, "saved, and worse on unseen runs") == "0/1"
    assert count({**worse, "savable": False}, "worse on unseen runs") == "1/1"
    assert count(build(hide("effect"), unseen=drive(8.05)), "worse on unseen runs") == "0/1"


def test_names_that_flip() -> None:
    base = build(hide("effect"), say("steering_offset", "named"))

    def vary(*said: Record) -> tuple[list[str], list[str]]:
        named = [one["id"] for one in said if one["status"] == "named"]
        varied = {"named": named, "said": list(said)}
        return list_flips(base, varied), list_losses(base, varied)

    assert vary(say("steering_offset", "named", 1.0, 1.2)) == ([], [])  # each value is near enough by one interval
    assert vary(say("steering_offset", "likely")) == ([], ["steering_offset likely"])
    assert vary() == ([], ["steering_offset not said"])
    assert vary(say("steering_offset", "named", 1.05, 1.3)) == (
        ["steering_offset 1 [0.9, 1.1] -> 1.18 [1.05, 1.3]"],
        [],
    )
    assert vary(say("wheel_slip", "named"))[0] == ["wheel_slip 1 [0.9, 1.1] was not said"]
    assert vary(say("steering_offset", "refuted")) == (["steering_offset refuted"], [])
    assert list_flips(base, {"error": "LogError: no rows", "named": [], "said": []}) == ["LogError: no rows"]


def test_tables_have_all_that_is_asked() -> None:
    lines = "\n".join(print_tables(tally_records([build(hide("effect"), say("steering_offset", "named"))])))
    assert "at least 98.0%: holds" in lines and "at most 0.5%: holds" in lines
    assert "steering_offset" in lines


def make_frame(rows: int = 101) -> pd.DataFrame:
    time_s = 50.0 + 0.1 * np.arange(rows)
    frame = pd.DataFrame({"time_s": time_s, "steering_deg": np.sin(time_s), "speed_mps": np.cos(time_s)})
    frame.attrs["name"] = "run"
    return frame


@pytest.mark.parametrize("how", VARIATIONS)
def test_a_varied_log_is_the_same_drive(how: str) -> None:
    (out,) = vary_logs([make_frame()], how)
    assert out.attrs["name"] == "run" and (np.diff(out["time_s"]) > 0.0).all()
    steps = np.diff(out["time_s"])
    if how.endswith("Hz"):
        assert np.median(steps) == pytest.approx(1.0 / float(how.split()[0]))
        assert np.allclose(out["steering_deg"], np.sin(out["time_s"]))
    elif how == "jitter":
        assert 0.02 < np.std(steps - 0.1) < 0.08
        assert np.array_equal(out["steering_deg"], make_frame()["steering_deg"])
    else:
        assert np.array_equal(out["speed_mps"], make_frame()["speed_mps"])
        same = np.mean(np.diff(out["steering_deg"]) == 0.0)
        assert 0.9 < same < 0.96 if how == "held" else same < 0.05
        refreshed = np.flatnonzero(np.diff(out["steering_deg"]) != 0.0) + 1
        if how == "held":
            assert np.diff(out["time_s"].to_numpy()[refreshed]).min() > 0.99 and len(refreshed) in (5, 6, 7, 8, 9)
            assert np.array_equal(out["steering_deg"][refreshed], make_frame()["steering_deg"][refreshed])
        assert np.abs(out["steering_deg"] - np.sin(out["time_s"])).max() < (2.0 if how == "held" else 0.5)


def test_logs_vary_in_known_ways_only() -> None:
    with pytest.raises(ValueError, match="use one of: 10 Hz"):
        vary_logs([make_frame()], "3 Hz")


def test_a_case_that_breaks_is_a_record(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(reference: str, case: TruthCase) -> list[pd.DataFrame]:
        raise ValueError("no logs today")

    monkeypatch.setattr(foreign_sets, "make_logs", fail)
    record = foreign_sets.build_record("fourth", hide("effect"))
    assert record["error"] == "ValueError: no logs today" and record["said"] == []
    assert count(record, "sets that ended in an error") == "1/1" and count(record, "clear effects named") == "0/1"
    json.dumps(record)


def test_a_run_goes_on_where_it_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out, seen = tmp_path / "answers.jsonl", []

    def answer(reference: str, case: TruthCase, vary: bool) -> Record:
        seen.append(case.seed)
        return build(case)

    monkeypatch.setattr(foreign_diagnosis, "build_record", answer)
    works = [("fourth", TruthCase("clean", seed), False) for seed in range(4)]
    foreign_diagnosis.run_cases(works[:2], 1, out, "one")
    out.write_text(out.read_text(encoding="utf-8") + '{"key": "cut o', encoding="utf-8")
    foreign_diagnosis.run_cases(works, 1, out, "one")
    assert seen == [0, 1, 2, 3]
    assert [record["key"] for record in foreign_diagnosis.read_last(out)] == [name_case(*work[:2]) for work in works]


def test_a_lawn_tractor_has_a_file_of_its_own() -> None:
    lawn = foreign_sets.load_case_tractor("fourth", TruthCase("mixed", 1, programme="lawn"))
    assert lawn.wheelbase_m == pytest.approx(1.2)
    assert foreign_sets.load_case_tractor("fourth", TruthCase("clean", 1)).wheelbase_m == pytest.approx(2.4)
