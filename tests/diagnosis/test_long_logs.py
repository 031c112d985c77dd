"""Logs longer than what causes are sought in: told from a part of them, with errors of all."""

import pytest

from tests.diagnosis.hiding import eg105
from tests.truth.drives import default_programme
from tests.truth.model import Truth
from vehicle.identification.diagnosis.diagnose import diagnose_logs
from vehicle.identification.logs.reader import build_log
from vehicle.identification.logs.schema import Log
from vehicle.identification.replay.data_subset import select_balanced_subset
from vehicle.identification.verdict import cross_fit as module

HIDDEN = {"steering_offset": {"angle_deg": 1.5}}


def made() -> list[Log]:
    """The sixteen runs of the first reference with an offset of the steering."""
    world = Truth(HIDDEN, 31, rate_hz=5.0)
    drives = list(enumerate(default_programme()))
    return [build_log(world.log(one, run), f"{run} {one.name}") for run, one in drives]


@pytest.mark.matrix
def test_a_cause_is_told_from_a_part_and_errors_of_all_logs(monkeypatch: pytest.MonkeyPatch) -> None:
    logs = made()
    whole = diagnose_logs(logs, eg105(), "soil")
    monkeypatch.setattr(
        module, "select_balanced_subset", lambda course, left_out: select_balanced_subset(course, 480.0, left_out)
    )
    found = diagnose_logs(logs, eg105(), "soil")
    assert found.named == whole.named == ("steering_offset",)
    spread = {}
    for told in (found, whole):
        (one,) = (each for each in told.findings if each.id == "steering_offset")
        assert one.interval is not None
        low, high = one.interval["angle_deg"]
        assert low <= 1.5 <= high
        spread[told is whole] = high - low
    assert spread[False] >= spread[True], "a part is no surer than the whole"
    assert (found.minutes, found.names, found.rows_used) == (whole.minutes, whole.names, whole.rows_used)
    assert found.before == whole.before, "errors are of all logs"
    for seconds, error in found.after.items():
        assert error.cross_cm == pytest.approx(whole.after[seconds].cross_cm, rel=0.05)
        # A floor is drawn: over 48 pieces of 10 s it scatters by a tenth.
        assert found.noise_floor[seconds].cross_cm == pytest.approx(whole.noise_floor[seconds].cross_cm, rel=0.25)
    assert found.unexplained_share == whole.unexplained_share == 0.0
    logs_told = found.tractor.effects["steering_offset"].logs
    assert set(logs_told) < set(whole.names), "the file has the logs that told it"
    assert any("minutes, sampled from all logs" in note for note in found.notes)
    assert not any("minutes, sampled" in note for note in whole.notes)
