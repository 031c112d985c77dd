"""Field files to read."""

import json
from pathlib import Path
from typing import Any

import pytest


@pytest.fixture
def saved(tmp_path: Path):  # type: ignore[no-untyped-def]
    def save(content: Any, name: str = "plot.geojson") -> Path:
        path = tmp_path / name
        path.write_text(content if isinstance(content, str) else json.dumps(content), encoding="utf-8")
        return path

    return save
