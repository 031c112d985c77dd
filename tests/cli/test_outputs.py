"""What a command writes: never over what it reads, whole or not at all, and before it prints."""

import errno
import json
import os
import shutil
import subprocess
from importlib import resources
from pathlib import Path

import pytest

from planner.cli.common.outputs import _is_same_file, write_results
from tests.cli.conftest import Run
from tests.cli.refusals import assert_refused, contents

pytestmark = pytest.mark.usefixtures("first_layout")

POSIX = pytest.mark.skipif(os.name != "posix", reason="needs links and devices")
ONE = ("--local", "--tractors", "1", "--strategies", "split-field", "--no-headland", "--processes", "1")
DATASHEET = ("--name", "Own", "--wheelbase", "2.8", "--width", "2.5", "--turning-radius", "5.5")
REFUSED = [
    ("plan good.geojson --local --tractor my.toml --save my.toml", "my.toml would overwrite the tractor file"),
    ("plan good.geojson --local --gnss-table t.csv --save t.csv", "t.csv would overwrite the table of GNSS errors"),
    ("plan a#b.geojson --local --save a#b.geojson", "a#b.geojson would overwrite the field"),
    ("plan good.geojson#0 --local --save ./good.geojson", "would overwrite the field"),
    ("plan good.geojson --local --html new.html --save new.html", "new.html would overwrite another result"),
    ("field good.png --local --png good.png", "would overwrite the field"),
    ("plan good.geojson --local --elevation good.png --png good.png", "would overwrite the file of heights"),
    ("field good.geojson --local --tractor my.png --png my.png", "would overwrite the tractor file"),
    ("drive --steer 20 --tractor my.html --html my.html", "my.html would overwrite the tractor file"),
    ("design mass --tractor my.png --png my.png", "would overwrite the tractor file"),
    ("diagnose t.csv --tractor my.toml --save my.toml", "would overwrite the tractor file"),
    ("replay t.csv --tractor my.html --html my.html", "would overwrite the tractor file"),
    ("gnss fit t.csv -o t.csv", "t.csv would overwrite the fixes"),
]
REFUSED_ON_POSIX = [
    ("plan good.geojson --local --save hard.json", "hard.json would overwrite the field"),
    ("plan good.geojson --local --save soft.json", "soft.json would overwrite the field"),
    ("plan soft.json --local --save good.geojson", "good.geojson would overwrite the field"),
    ("plan good.geojson --local --html later.html --save later.json", "would overwrite another result"),
    ("replay loop.json", "loop.json does not exist"),
    ("plan good.geojson --local --save loop.json", "its symbolic links form a loop"),
    ("plan good.geojson --local --save pipe.json", "pipe.json is a device or a pipe"),
    ("plan good.geojson --local --save /dev/full", "/dev/full is a device or a pipe"),
    ("plan good.geojson --local --save /dev/null", "/dev/null is a device or a pipe"),
    ("gnss fit t.csv -o /dev/null", "/dev/null is a device or a pipe"),
    (f"plan good.geojson --local --save {'n' * 256}", "its name is too long"),
    (f"field good.geojson --local --png {'ä' * 126}.png", "its name is too long"),
]


@pytest.fixture
def folder(tmp_path: Path, small: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a field, a tractor and a table under several names, links and a pipe among them."""
    for name in ("good.geojson", "a#b.geojson", "good.png"):
        shutil.copy(small, tmp_path / name)
    tractor = (resources.files("vehicle") / "data" / "eg105.toml").read_text(encoding="utf-8")
    for name in ("my.toml", "my.html", "my.png"):
        (tmp_path / name).write_text(tractor, encoding="utf-8")
    (tmp_path / "t.csv").write_text("east_mm,north_mm,above,up_to\n0,0,0,100\n")
    if os.name == "posix":
        os.link(tmp_path / "good.geojson", tmp_path / "hard.json")
        (tmp_path / "soft.json").symlink_to("good.geojson")
        (tmp_path / "loop.json").symlink_to("loop.json")
        (tmp_path / "later.html").symlink_to("later.json")
        os.mkfifo(tmp_path / "pipe.json")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(("words", "sentence"), [
    *REFUSED, *(pytest.param(*one, marks=POSIX) for one in REFUSED_ON_POSIX),
])  # fmt: skip
def test_refused_in_one_sentence_and_nothing_touched(headland: Run, folder: Path, words: str, sentence: str) -> None:
    before = contents(folder)
    assert_refused(headland(*words.split(" ")), sentence)
    assert contents(folder) == before


@pytest.mark.slow
@POSIX
def test_what_goes_to_standard_output_is_no_place_for_a_file(command: list[str], folder: Path) -> None:
    with (folder / "out.json").open("w") as stream:
        done = subprocess.run(
            [*command, "plan", "good.geojson", *ONE, "--json", "--save", "out.json"],
            stdout=stream, stderr=subprocess.PIPE, text=True, timeout=240, check=False,
        )  # fmt: skip
    assert done.returncode == 2 and "out.json is where this command prints to" in done.stderr


def test_folders_that_do_not_tell_capitals_apart(folder: Path) -> None:
    one, other = folder / "Plan.html", folder / "pLAN.HTML"
    assert _is_same_file(one, other, ignores_case=True) and not _is_same_file(one, other, ignores_case=os.name == "nt")
    assert _is_same_file(folder / "a\u0308", folder / "\u00c4", ignores_case=True)


@POSIX
def test_a_link_stays_and_its_target_is_written(headland: Run, folder: Path) -> None:
    target = folder / "kept.json"
    target.write_text('{"format_version": 1}')
    target.chmod(0o640)
    (folder / "link.json").symlink_to("kept.json")
    assert headland("plan", "good.geojson", *ONE, "--save", "link.json").status == 0
    assert (folder / "link.json").is_symlink() and os.readlink(folder / "link.json") == "kept.json"
    assert json.loads(target.read_text(encoding="utf-8")) and target.stat().st_mode & 0o777 == 0o640


@POSIX
def test_names_of_255_bytes_are_written(headland: Run, folder: Path) -> None:
    name = "n" * 251 + ".png"
    assert headland("field", "good.geojson", "--local", "--png", name).status == 0
    assert (folder / name).read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_a_full_disk_leaves_every_earlier_file_whole(
    headland: Run, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder / "p.html").write_text("older page")
    (folder / "p.png").write_text("older picture")
    before, calls = contents(folder), []

    def full(number: int) -> None:
        calls.append(number)
        if len(calls) == 2:
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    outcome = headland(
        "plan", "good.geojson", *ONE, "--html", "p.html", "--png", "p.png", "--save", "p.json", "--force"
    )
    assert outcome.status == 1 and outcome.out == ""
    assert outcome.sentences == [
        "Error: p.png could not be written: the disk is full; nothing was written, make room or choose another place."
    ]
    assert contents(folder) == before


def test_what_was_written_is_named(headland: Run, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    replace = Path.replace

    def refuse(draft: Path, real: Path) -> Path:
        if real.name == "p.json":
            raise OSError(errno.EACCES, "Permission denied")
        return replace(draft, real)

    monkeypatch.setattr(Path, "replace", refuse)
    outcome = headland("plan", "good.geojson", *ONE, "--html", "p.html", "--save", "p.json")
    assert outcome.status == 1 and "p.json could not be written: no permission; p.html was written" in outcome.err
    assert (folder / "p.html").exists() and not list(folder.glob(".headland*")) and not (folder / "p.json").exists()


def test_nothing_is_drafted_where_a_draft_cannot_be_made(tmp_path: Path) -> None:
    from planner.cli.common.outputs import WriteError

    (tmp_path / "one").write_text("older")
    with pytest.raises(WriteError, match="nothing was written"):
        write_results([(tmp_path / "one", "newer"), (tmp_path / "gone" / "two", b"newer")])
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"one": "older"}


@pytest.mark.slow
@POSIX
@pytest.mark.parametrize("where", ["closed", "full"])
def test_files_are_written_whatever_becomes_of_standard_output(command: list[str], folder: Path, where: str) -> None:
    words = [*command, "field", "good.geojson", "--local", "--png", "map.png"]
    if where == "full":
        if not os.path.exists("/dev/full"):
            pytest.skip("needs a device that is always full")
        with open("/dev/full", "w") as stream:
            done = subprocess.run(words, stdout=stream, stderr=subprocess.PIPE, text=True, timeout=240, check=False)
        assert done.returncode == 1 and len(done.stderr.splitlines()) == 1, done.stderr
        assert "Standard output cannot be used: No space left on device; map.png was written" in done.stderr
    else:
        with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            process.stdout.close()
            said = process.stderr.read()
        assert process.returncode == 0 and said == ""
    assert (folder / "map.png").read_bytes().startswith(b"\x89PNG")


def test_an_interrupt_while_printing_names_what_was_written(
    headland: Run, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import planner.cli.common.terminal

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(planner.cli.common.terminal, "print_renderable", interrupt)
    outcome = headland("field", "good.geojson", "--local", "--png", "map.png")
    assert outcome.status == 130 and outcome.sentences == ["Error: Interrupted; map.png was written."]
    outcome = headland("field", "good.geojson", "--local")
    assert outcome.status == 130 and outcome.sentences == ["Error: Interrupted; nothing was written."]


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("p.html", "<!doctype html><title>a page of somebody</title>"),
        ("p.png", "\x89PNG"),
        ("p.json", '{"type": "FeatureCollection"}'),
        ("p.json", '<!doctype html>\n<meta name="generator" content="Headland">'),
    ],
)
def test_what_is_not_of_headland_is_overwritten_by_force_alone(
    headland: Run, folder: Path, name: str, content: str
) -> None:
    (folder / name).write_text(content)
    option = {"html": "--html", "png": "--png", "json": "--save"}[name[2:]]
    words = ("plan", "good.geojson", *ONE, option, name)
    assert_refused(headland(*words), f"{name} exists already, and not as a result of Headland", "--force")
    assert (folder / name).read_text() == content
    forced, again = headland(*words, "--force"), headland(*words)
    assert [one.sentences for one in (forced, again)] == [[f"Replaced {name}."]] * 2
    assert (forced.status, again.status) == (0, 0)


def test_what_is_written_is_said_once_in_the_same_words(headland: Run, folder: Path) -> None:
    (folder / "empty.png").touch()
    one, other = (headland("field", "good.geojson", "--local", "--png", name) for name in ("map.png", "empty.png"))
    assert (one.sentences, other.sentences) == (["Wrote map.png."], ["Replaced empty.png."])
    assert headland("tractor", "new", "mine.toml", *DATASHEET).sentences[0] == "Wrote mine.toml."
    refused = headland("tractor", "new", "mine.toml", *DATASHEET)
    assert_refused(refused, "mine.toml exists already")
    assert headland("farm", "new", "farm.toml").sentences == ["Wrote farm.toml."]
    many = headland("plan", "good.geojson", *ONE, "--html", "p.html", "--save", "p.json", "--csv")
    assert many.sentences == ["Wrote p.html, p.json."]


def test_what_is_written_anyhow_is_not_suggested(headland: Run, folder: Path) -> None:
    told = headland("plan", "good.geojson", *ONE, "--save", "p.json").out
    assert "Add --explain (why and how), --html plan.html (map)." in " ".join(told.split())
    assert "--save plan.json" in headland("plan", "good.geojson", *ONE).out
