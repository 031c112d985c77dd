"""What tests of refusals share: files that are no fields, and what a refusal looks like."""

import json
from pathlib import Path
from typing import Any

from tests.drawn_fields import feature, rectangle, ring

SQUARE = rectangle(0, 0, 100, 60)
FILES: dict[str, Any] = {
    "good": SQUARE,
    "text": "this is no field",
    "bow": ring((0, 0), (100, 100), (100, 0), (0, 100)),
    "flat": ring((0, 0), (50, 0), (100, 0)),
    "degrees": ring((10, 50), (10.002, 50), (10.002, 50.001), (10, 50.001)),
    "narrow": rectangle(0, 0, 200, 2),
    "several": {"type": "FeatureCollection", "features": [feature(SQUARE), feature(SQUARE)]},
    "ground": feature(SQUARE, default_ground="lava"),
}


def contents(folder: Path) -> dict[str, tuple[bytes, int]]:
    return {
        str(path.relative_to(folder)): (path.read_bytes(), path.stat().st_mtime_ns)
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def assert_refused(outcome: Any, *words: str) -> None:
    assert outcome.status == 2, outcome
    assert outcome.out == ""
    assert len(outcome.sentences) == 1, outcome.err
    (sentence,) = outcome.sentences
    assert sentence.startswith("Error: ") and "Traceback" not in sentence
    assert sentence.endswith(".") and (len(sentence) < 500 or "9" * 300 in sentence)
    for word in words:
        assert word in sentence, sentence


def lay_out(folder: Path) -> None:
    """Write the files that the tests of refusals name, bad ones, good ones and an earlier result."""
    for name, content in FILES.items():
        text = content if isinstance(content, str) else json.dumps(content)
        (folder / f"{name}.geojson").write_text(text)
    (folder / "broken.toml").write_text("nonsense = [")
    (folder / "partial.toml").write_text('name = "half a tractor"')
    (folder / "old.html").write_text("an earlier result")
    (folder / "inner").mkdir()
