"""Item 13: entities behind a comment, damaged backups, and a robot whose clock is wrong."""

from __future__ import annotations

import io
import tempfile
import time
import zipfile
from collections.abc import Mapping
from pathlib import Path

from tests.benchmarks.attack.plans import lay_lines, make_fleet
from tests.benchmarks.attack.rows import Row
from tests.benchmarks.attack.service import Service
from tests.benchmarks.attack.squad import Squad, wait_for
from tests.benchmarks.attack.web import pack_zip, square_field, upload

PAGE = 4096
HOUR_S, LOOKS_S = 3600.0, 8.0
COMMENT = "<!-- <kml> --><!DOCTYPE kml [<!ENTITY who 'expanded-canary'>]>"
DOCTYPES = {
    "": "", "comment": COMMENT, "instruction": COMMENT.replace("!-- <kml> --", "?x <kml>?"), "utf-16": COMMENT,
}  # fmt: skip
KML = """<?xml version="1.0"?>{doctype}<kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark>
<name>{name}</name><Polygon><outerBoundaryIs><LinearRing><coordinates>11,48 11.001,48 11.001,48.001 11,48.001 11,48
</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark></Document></kml>"""
TASKDATA = """<?xml version="1.0"?>{doctype}<ISO11783_TaskData VersionMajor="4" VersionMinor="0"
TaskControllerManufacturer="x" DataTransferOrigin="1"><PFD A="PFD1" C="{name}" D="8000"><PLN A="1"><LSG A="1">
<PNT A="2" C="48" D="11"/><PNT A="2" C="48" D="11.001"/><PNT A="2" C="48.001" D="11.001"/><PNT A="2" C="48.001" D="11"/>
</LSG></PLN></PFD></ISO11783_TaskData>"""


def attack_with_damage(service: Service, short: bool) -> list[Row]:
    """All of item 13."""
    return [_attack_xml(service), _attack_restore(service, short), _attack_clock(service, short)]


def _attack_xml(service: Service) -> Row:
    """XML with a document type behind a comment, beside the same without one, which is to be taken."""
    taken, refused, strange = list[str](), list[str](), list[str]()
    for kind, text in (("kml", KML), ("xml", TASKDATA)):
        for where, doctype in DOCTYPES.items():
            name = "&who;" if doctype else "plain"
            content = text.format(doctype=doctype, name=name).encode("utf-16" if where == "utf-16" else "utf-8")
            for filename, bytes_ in _name_forms(kind, where, content).items():
                status = upload(service.port, "fields", filename, bytes_, service.token("planner")).status
                wanted = (422,) if doctype else (201,)
                (refused if status == 422 else taken if status == 201 else strange).append(filename)
                if status not in wanted and filename not in strange and not doctype:
                    strange.append(filename)
    passed = [name for name in taken if not name.startswith("plain")]
    words = f"{len(passed)} of {len(passed) + len(refused)} taken" + (f": {', '.join(passed[:3])}" if passed else "")
    return Row("13a", "DOCTYPE behind a comment in KML, KMZ, TASKDATA.XML", words, "none taken, others are",
               not passed and not strange, {"taken": taken, "refused": refused, "strange": strange})  # fmt: skip


def _name_forms(kind: str, where: str, content: bytes) -> Mapping[str, bytes]:
    stem = where or "plain"
    if kind == "kml":
        return {f"{stem} kml.kml": content, f"{stem} kmz.kmz": pack_zip({"doc.kml": content})}
    return {f"{stem} xml.xml": content, f"{stem} task.zip": pack_zip({"TASKDATA/TASKDATA.XML": content})}


def _attack_restore(service: Service, short: bool) -> Row:
    """Backups with a file missing, and with pages of the database zeroed, brought back."""
    upload(service.port, "fields", "kept.geojson", square_field(), service.token("planner"), local="true")
    taken = list[str]()
    with tempfile.TemporaryDirectory(prefix="headland-restore-") as folder:
        whole = Path(folder) / "whole.zip"
        made = service.run("backup", str(whole), "--data", str(service.data))
        if made.returncode != 0:
            return Row("13b", "damaged backups", f"no backup: {made.stderr[:60]}", "refused", False)
        forms = _damage(whole.read_bytes(), 1 if short else 12)
        for name, content in forms.items():
            damaged = Path(folder) / f"{name.replace(' ', '-')}.zip"
            damaged.write_bytes(content)
            done = service.run("restore", str(damaged), "--data", str(Path(folder) / f"data-{len(taken)}-{name[:12]}"))
            if (done.returncode == 0) != (name == "whole"):
                taken.append(name)
    words = f"{len(taken)} of {len(forms)} judged wrongly" + (f": {', '.join(taken[:3])}" if taken else "")
    return Row("13b", "restore: blob missing, database page zeroed", words, "all refused but the whole one",
               not taken, {"wrong": taken, "tried": list(forms)})  # fmt: skip


def _damage(whole: bytes, pages: int) -> dict[str, bytes]:
    """The backup as it is, without one of its files, and with each of some pages of its database zeroed."""
    with zipfile.ZipFile(io.BytesIO(whole)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    blob = next(name for name in members if "/" in name)
    base = members["headland.db"]
    count = len(base) // PAGE
    forms = {"whole": pack_zip(members), "blob missing": pack_zip({k: v for k, v in members.items() if k != blob})}
    for place in range(pages):
        page = 2 + (place * 2 + 1) * (count - 1) // (2 * pages)
        zeroed = base[: (page - 1) * PAGE] + b"\0" * PAGE + base[page * PAGE :]
        forms[f"page {page} zeroed"] = pack_zip(members | {"headland.db": zeroed})
    return forms


def _attack_clock(service: Service, short: bool) -> Row:
    """Robots whose clocks are an hour behind and an hour ahead: their states are kept, and it is said once."""
    lines = lay_lines(2, 200.0)
    squad = Squad(service, make_fleet(service, "wrong clocks", lines), lines, 1.0)
    for robot, off_s in zip(squad.robots, (-HOUR_S, HOUR_S), strict=True):
        robot.clock_off_s = off_s
    try:
        squad.open(LOOKS_S / 2.0 if short else LOOKS_S)
        wait_for(lambda: all(robot.acknowledged >= 0 for robot in squad.robots), LOOKS_S)
        time.sleep(2.0)
    finally:
        squad.close()
    kept = [robot.acknowledged + 1 for robot in squad.robots]
    refused = [len(robot.sentences) for robot in squad.robots]
    said = {alarm["id"] for alarm in squad.alarms if alarm["code"] == "clock"}
    words = f"states kept {kept[0]} and {kept[1]}, refused {refused[0]} and {refused[1]}, alarms {len(said)}"
    held = min(kept) > 0 and max(refused) <= 1 and (bool(said) or max(refused) == 1)
    return Row("13c", "robots an hour behind and ahead", words, "states kept, said once", held,
               {"kept": kept, "refused": refused, "alarms": len(said)})  # fmt: skip
