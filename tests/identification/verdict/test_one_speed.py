"""At one speed, the place of an antenna and a delay of the positions are alternatives; at several, they are not."""

import pytest

from tests.identification.residual_models import build_programme_model
from vehicle.identification.verdict.findings import ONE_SPEED_EFFECTS, list_delay_like_effects


@pytest.mark.parametrize(("programme", "effects"), [("circles", ONE_SPEED_EFFECTS), ("bends-at-speeds", ())])
def test_only_one_speed_leaves_them_open(programme: str, effects: tuple[str, ...]) -> None:
    assert list_delay_like_effects(build_programme_model(programme, {})) == effects
