"""The drive that tells laws apart."""

from types import SimpleNamespace

from vehicle.identification.verdict.law_drives import choose_law_drive


def test_without_laws_there_is_no_drive() -> None:
    assert choose_law_drive(SimpleNamespace(laws=())) is None  # type: ignore[arg-type]
