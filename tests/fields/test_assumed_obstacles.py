"""Features without a role: obstacles by default, unless words, number or place say otherwise; added and left out."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from fields import Field, FieldError, read_field
from fields.documents.reader import list_fields, list_fields_with_notes
from fields.feature_words import (
    ENTRANCE,
    GUIDANCE,
    NOTE,
    OBSTACLE,
    OBSTACLE_WORDS,
    OTHER_WORDS,
    OVERHEAD_LINE,
    REFILL,
    find_meaning,
    find_word_meaning,
    is_label,
)
from fields.formats.features import build_document
from fields.geometry.assumed_obstacles import MAX_UNKNOWN_FEATURES, assume_roles
from fields.geometry.chosen_places import add_obstacles, leave_out_obstacles, parse_obstacle_place
from fields.geometry.coordinates import FieldFrame
from fields.geometry.geodesy import LocalPlane
from tests.drawn_fields import feature, line, point, write_features
from tests.fields.geojson import SQUARE_M, moved, polygon
from tests.fields.test_obstacles import read

POND: list[list[float]] = [[0, 0], [20, 0], [20, 10], [0, 10], [0, 0]]
OUTLINE: list[list[float]] = [[float(x), float(y)] for x, y in SQUARE_M]
PLANE = LocalPlane(11.5, 48.5)


def with_field(tmp_path: Path, *features: Any, name: str = "Acker 7") -> Field:
    return read(tmp_path, feature(polygon(SQUARE_M), name=name), *features)


def summarise(field: Field) -> list[tuple[str, str, float]]:
    return [(one.kind, one.name, one.half_width_m) for one in field.obstacles]


class TestWords:
    @pytest.mark.parametrize(("text", "kind"), [
        ("Strommast 12", "pylon"), ("Hochspannungsmasten", "pylon"), ("Telegrafenmast", "mast"), ("pylône", "pylon"),
        ("Streuobstbäume", "tree"), ("chêne", "tree"), ("árbol", "tree"), ("trær", "tree"), ("étang du bas", "pond"),
        ("vandhul", "pond"), ("rybník", "pond"), ("pozzo", "well"), ("Brunnen", "well"), ("hydrant no 3", "hydrant"),
        ("słup", "pole"), ("poste eléctrico", "pole"), ("lantaarnpaal", "pole"), ("Findling", "stone"),
        ("gate post", "post"), ("Feldscheune", "building"), ("sloot", "ditch"), ("Hochsitz", "hide"), ("kivi", "stone"),
        ("zone humide", "wet ground"), ("boundary stone", "boundary marker"), ("OBSTACLE", "obstacle"),
    ])  # fmt: skip
    def test_obstacles_in_many_languages(self, text: str, kind: str) -> None:
        meaning = find_word_meaning(text)
        assert (meaning.use, meaning.kind) == (OBSTACLE, kind)

    @pytest.mark.parametrize(("text", "use"), [
        ("Einfahrt Nord", ENTRANCE), ("Einfahrt Mühlbach", ENTRANCE), ("Tor", ENTRANCE), ("field gate", ENTRANCE),
        ("indkørsel", ENTRANCE), ("entrée", ENTRANCE), ("Tankstelle", REFILL), ("remplissage", REFILL),
        ("Bodenprobe 3", NOTE), ("échantillon", NOTE), ("soil sample", NOTE), ("Zone 2", NOTE), ("AB 1", GUIDANCE),
        ("A", GUIDANCE), ("Punkt B", GUIDANCE), ("power line", OVERHEAD_LINE), ("Stromleitung", OVERHEAD_LINE),
        ("P12", ""), ("Schlag Nord", ""), ("", ""), ("Peligro a evitar", ""),
    ])  # fmt: skip
    def test_other_uses_are_no_obstacles(self, text: str, use: str) -> None:
        assert find_word_meaning(text).use == use

    def test_every_word_means_what_its_table_says(self) -> None:
        others = {word for words in OTHER_WORDS.values() for word in words.split()}
        for kind, words in OBSTACLE_WORDS.items():
            for word in words.split():
                assert find_word_meaning(word).kind == kind, word
                assert word not in others, "an obstacle that is read as something else is driven over"

    def test_kind_layer_and_tags_say_it_as_well(self) -> None:
        assert find_meaning({"name": "K7", "layer": "Bäume"}).kind == "tree"
        assert find_meaning({"power": "tower"}).kind == "pylon"
        assert find_meaning({"building": "yes"}).kind == "building" and find_meaning({"building": "no"}).use == ""
        assert find_meaning({"barrier": "gate"}).use == ENTRANCE
        assert find_meaning({"name": "XY", "description": "photo taken at the gate"}).use == "", (
            "remarks say many things"
        )
        assert find_meaning({"name": "XY", "description": "old oak"}).kind == "tree"
        assert find_meaning({"name": "Probe 3", "description": "beside the oak"}).use == NOTE
        assert find_meaning({"name": "Start", "type": "tree"}).kind == "tree"

    @pytest.mark.slow
    @given(st.text(max_size=40))
    def test_any_text_means_something_or_nothing(self, text: str) -> None:
        assert find_word_meaning(text).use in ("", OBSTACLE, ENTRANCE, REFILL, GUIDANCE, NOTE, OVERHEAD_LINE)
        assert is_label(text, [text]) == bool(text.strip())

    def test_labels(self) -> None:
        labels = ("12", "Acker 7", "acker 7 (3,2 ha)", "DEBYLI1234567890", "3.2 ha")
        assert all(is_label(name, ["Acker 7"]) for name in labels)
        assert not any(is_label(name, ["Acker 7", ""]) for name in ("", "Acker 7 Nord", "P3", "Mast 7"))


class TestPoints:
    def test_what_has_no_role_is_an_obstacle_and_told(self, tmp_path: Path) -> None:
        field = with_field(
            tmp_path, feature(point(60, 50), name="Strommast"), feature(point(90, 50)),
            feature(point(120, 50), name="Eiche", radius_m=4), feature(point(150, 50), role="tree"),
        )  # fmt: skip
        assert summarise(field) == [("pylon", "Strommast", 3.0), ("tree", "Eiche", 4.0), ("tree", "", 1.5),
                                    ("point", "", 1.0)]  # fmt: skip
        (remark,) = field.remarks
        assert remark == (
            "4 features without a role lie in the field and are avoided as obstacles: (1) pylon 'Strommast', radius 3 "
            "m; (2) tree 'Eiche', radius 4 m; (3) tree, radius 1.5 m; (4) point, radius 1 m. To leave one out, give "
            "its name or number: --ignore Strommast."
        )
        assert field.compute_ground_with_margin(0.0).area_m2 < 20_000 - np.pi * (9 + 16 + 1.5**2 + 1) + 3

    def test_labels_samples_and_marks_are_none(self, tmp_path: Path) -> None:
        names = ("Acker 7", "14", "Bodenprobe 1", "A")
        field = with_field(tmp_path, *(feature(point(40 + 10 * at, 50), name=name) for at, name in enumerate(names)))
        assert field.obstacles == ()
        (remark,) = field.remarks
        assert "2 labels ('Acker 7', '14'), 1 note ('Bodenprobe 1'), 1 guidance point ('A')" in remark

    def test_a_field_named_after_its_well_has_a_label_unless_the_kind_says_more(self, tmp_path: Path) -> None:
        assert with_field(tmp_path, feature(point(60, 50), name="Brunnen"), name="Brunnen").obstacles == ()
        well = feature(point(60, 50), name="Brunnen", kind="well")
        assert summarise(with_field(tmp_path, well, name="Brunnen")) == [("well", "Brunnen", 1.0)]

    def test_hundreds_of_points_are_measurements_but_a_mast_among_them_is_not(self, tmp_path: Path) -> None:
        points = [feature(point(5 + 9 * (at % 20), 5 + 9 * (at // 20)), name=f"P{at}") for at in range(200)]
        field = with_field(tmp_path, *points, feature(point(100, 50), name="Mast"))
        assert summarise(field) == [("mast", "Mast", 1.0)]
        assert any("200 measurements ('P0', 'P1', 'P2', 'P3', 'P4' and 195 more)" in remark for remark in field.remarks)
        assert len(with_field(tmp_path, *points[:MAX_UNKNOWN_FEATURES]).obstacles) == MAX_UNKNOWN_FEATURES
        assert len(with_field(tmp_path, *points[: MAX_UNKNOWN_FEATURES + 1]).obstacles) == 0

    def test_points_outside_or_in_a_hole_are_none(self, tmp_path: Path) -> None:
        hole = [[50, 40], [60, 40], [60, 60], [50, 60], [50, 40]]
        features = [feature(polygon(SQUARE_M, hole), name="N"), feature(point(55, 50), name="Teich"),
                    feature(point(500, 50), name="Mast"), feature(point(-30, 50), name="X")]  # fmt: skip
        field = read(tmp_path, *features)
        assert field.obstacles == () and any("not used: 2 Point." in remark for remark in field.remarks)

    def test_a_mast_on_the_edge_counts_and_an_unknown_point_beyond_it_does_not(self, tmp_path: Path) -> None:
        assert summarise(with_field(tmp_path, feature(point(100, -0.5), name="Mast"))) == [("mast", "Mast", 1.0)]
        assert with_field(tmp_path, feature(point(100, -0.5), name="X")).obstacles == ()

    def test_entrance_and_refill_by_their_words(self, tmp_path: Path) -> None:
        field = with_field(tmp_path, feature(point(0, 20), name="Einfahrt"), feature(point(-5, 40), name="Tank"))
        assert (field.entrance, field.service_point, field.obstacles) == ((0.0, 20.0), (-5.0, 40.0), ())
        assert field.remarks == ("Taken as the entrance by its name: 'Einfahrt'.",
                                 "Taken as the refill by its name: 'Tank'.")  # fmt: skip
        two = with_field(tmp_path, feature(point(0, 20), name="Tor Nord"), feature(point(200, 20), name="Tor Süd"))
        assert two.entrance is None and "choose one with --entrance LON,LAT" in two.remarks[0]
        given = with_field(tmp_path, feature(point(0, 9), role="entrance"), feature(point(200, 20), name="Tor"))
        assert given.entrance == (0.0, 9.0) and given.remarks == ("Not used as entrance, as the file has one: 'Tor'.",)
        inner = with_field(tmp_path, feature(point(100, 50), name="Tor"))
        assert inner.entrance is None and inner.obstacles == ()

    @given(st.lists(st.tuples(st.floats(-50, 250), st.floats(-50, 150)), max_size=MAX_UNKNOWN_FEATURES))
    def test_every_point_in_a_field_is_an_obstacle(self, places: list[tuple[float, float]]) -> None:
        shape = shapely.box(0, 0, 200, 100)
        document = build_document([feature(polygon(SQUARE_M)), *(feature(point(*place)) for place in places)], "'f'")
        roles = assume_roles(document.unassigned, (), FieldFrame(None, None, (0.0, 0.0)), shape, [], [])
        inside = [place for place in places if shape.covers(shapely.Point(place))]
        assert [tuple(one.geometry.coords[0]) for one in roles.obstacles] == inside
        assert len(roles.unused) == len(places) - len(inside)


class TestLines:
    def test_hedges_and_ditches_by_their_words(self, tmp_path: Path) -> None:
        field = with_field(
            tmp_path, feature(line([20, 20], [20, 80]), name="Hecke"), feature(line([50, 20], [50, 80]), kind="fossé"),
            feature(line([80, 10], [80, 90]), name="AB 1"), feature(line([100, 10], [100, 90]), name="Weg"),
            feature(line([0, 50], [200, 50]), name="Stromleitung"),
        )  # fmt: skip
        assert summarise(field) == [("hedge", "Hecke", 1.0), ("ditch", "", 0.75)]
        assert [one.name for one in field.guidance_lines] == ["AB 1", "Weg"]
        assert any("1 overhead or buried line ('Stromleitung')" in remark for remark in field.remarks)

    def test_a_short_line_is_an_obstacle_and_a_long_one_a_guidance_line(self, tmp_path: Path) -> None:
        short, named = feature(line([50, 50], [54, 50])), feature(line([80, 50], [84, 50]), name="K")
        field = with_field(tmp_path, short, named, feature(line([20, 10], [20, 90]), name="L"))
        assert summarise(field) == [("line", "", 0.5), ("line", "K", 0.5)]
        assert [one.name for one in field.guidance_lines] == ["L"]

    def test_a_fence_along_the_boundary_is_a_fence(self, tmp_path: Path) -> None:
        field = with_field(tmp_path, feature(line([0, 0], [200, 0]), name="Weidezaun"))
        assert field.obstacles == () and [one.length for one in field.fences] == [pytest.approx(203, abs=4)]
        inside = with_field(tmp_path, feature(line([50, 20], [50, 80]), name="Weidezaun"))
        assert summarise(inside) == [("fence", "Weidezaun", 0.1)] and inside.fences == ()
        closed = with_field(tmp_path, feature(line(*SQUARE_M, SQUARE_M[0]), name="Zaun"))
        assert closed.fences == () and closed.obstacles == (), "nobody could get in"


class TestPolygons:
    def farm(self, tmp_path: Path, *features: Any) -> Path:
        return write_features(tmp_path / "farm.geojson", *features)

    def test_a_pond_is_no_field_of_its_own_unless_named(self, tmp_path: Path) -> None:
        farm = self.farm(
            tmp_path, feature(polygon(SQUARE_M), name="Acker"), feature(polygon(moved(POND, 100, 30)), name="Teich"),
            feature(polygon(moved(OUTLINE, 300)), name="Wiese"),
        )  # fmt: skip
        assert [one.inside for one in list_fields(farm, local=True)] == [None, "Acker", None]
        assert "'Teich' (in 'Acker')" in list_fields_with_notes(farm, local=True)[1][0]
        assert summarise(read_field(f"{farm}#Acker", local=True)) == [("pond", "Teich", 0.0)]
        assert read_field(f"{farm}#Teich", local=True).area_m2 == pytest.approx(200)
        with pytest.raises(FieldError, match=r"holds 2 fields; choose .*: Acker \(2.00 ha\), Wiese \(2.00 ha\)\."):
            read_field(farm, local=True)
        assert leave_out_obstacles(read_field(f"{farm}#Acker", local=True), ["Teich"]).area_m2 == 20_000

    def test_a_second_outline_and_zones_are_no_obstacles(self, tmp_path: Path) -> None:
        inner = [[5, 5], [195, 5], [195, 95], [5, 95], [5, 5]]
        field = with_field(tmp_path, feature(polygon(inner), name="inner"))
        assert (field.name, field.obstacles) == ("Acker 7", ()) and "inner outline or zone ('inner')" in field.remarks[
            0
        ]
        zone = with_field(tmp_path, feature(polygon(moved(POND, 100, 30)), name="Zone 1"))
        assert zone.obstacles == ()

    def test_fields_in_the_outline_of_a_farm_are_fields(self, tmp_path: Path) -> None:
        outline = [[-10, -10], [420, -10], [420, 110], [-10, 110], [-10, -10]]
        farm = self.farm(
            tmp_path, feature(polygon(outline), name="Hof"), feature(polygon(SQUARE_M), name="West"),
            feature(polygon(moved(OUTLINE, 205)), name="Ost"),
        )  # fmt: skip
        assert [one.inside for one in list_fields(farm, local=True)] == [None, None, None]
        assert read_field(f"{farm}#Hof", local=True).obstacles == ()


class TestChosen:
    def field(self, tmp_path: Path) -> Field:
        return with_field(tmp_path, feature(point(60, 50), name="Mast"), feature(point(90, 50), name="Eiche"),
                          feature(point(120, 50), name="eiche"))  # fmt: skip

    def test_left_out_by_name_or_number_and_told(self, tmp_path: Path) -> None:
        field = self.field(tmp_path)
        assert [one.name for one in leave_out_obstacles(field, ["EICHE"]).obstacles] == ["Mast"]
        left = leave_out_obstacles(field, ["2"])
        assert [one.name for one in left.obstacles] == ["Mast", "eiche"] and "(3) tree 'eiche'" in left.remarks[0]
        assert left.remarks[1] == "Left out as asked, so machines drive there: Obstacle 'Eiche' (tree)."
        assert [one.name for one in leave_out_obstacles(left, ["3"]).obstacles] == ["Mast"], "numbers stay"
        assert leave_out_obstacles(field, []) is field
        none = leave_out_obstacles(field, ["1", "eiche"])
        assert none.obstacles == () and len(none.remarks) == 1

    @pytest.mark.parametrize("name", ["Teich", "4", "0", "-1", "9" * 30])
    def test_what_is_not_there_cannot_be_left_out(self, tmp_path: Path, name: str) -> None:
        with pytest.raises(FieldError, match=r"no obstacle of field 'Acker 7'.*; give a name or number out of: 1 M"):
            leave_out_obstacles(self.field(tmp_path), [name])
        with pytest.raises(FieldError, match=r"did you mean 'Mast'\?"):
            leave_out_obstacles(self.field(tmp_path), ["Masd"])

    def test_added_in_metres_and_in_degrees(self) -> None:
        local = add_obstacles(Field("f", shapely.box(0, 0, 200, 100)), ["50,50", " 80, 20 , 2.5"])
        assert [(one.geometry.coords[0], one.half_width_m) for one in local.obstacles] == [
            ((50.0, 50.0), 1.0), ((80.0, 20.0), 2.5),
        ]  # fmt: skip
        denmark = read_field("denmark")
        lon, lat = denmark.to_wgs84([(10.0, -20.0)])[0]
        (added,) = add_obstacles(denmark, [f"{lon},{lat},3"]).obstacles
        assert added.geometry.distance(shapely.Point(10, -20)) < 1e-6 and added.half_width_m == 3.0

    @pytest.mark.parametrize(("text", "words"), [
        ("a,b", "is not a place; write longitude,latitude"), ("1", "is not a place"), ("1,2,3,4", "is not a place"),
        ("nan,2", "is not a place"), ("50,50,0", "has a radius of 0 m"), ("50,50,9999", "at most 1000 m"),
        ("500,50", r"The obstacle 500,50 \(obstacles\) lies 300 m outside field 'f'; give a place in the field\."),
    ])  # fmt: skip
    def test_what_cannot_be_added(self, text: str, words: str) -> None:
        with pytest.raises(FieldError, match=words) as refusal:
            add_obstacles(Field("f", shapely.box(0, 0, 200, 100)), [text])
        assert refusal.value.parameter == "obstacles" and "\n" not in str(refusal.value)

    def test_degrees_beyond_the_earth(self) -> None:
        with pytest.raises(FieldError, match="is not on the earth"):
            add_obstacles(read_field("denmark"), ["500,50"])
        assert parse_obstacle_place("500,50") == (500.0, 50.0, 1.0)


class TestFormats:
    def to_degrees(self, x: float, y: float) -> str:
        lon, lat = PLANE.to_degrees(x, y)
        return f"{lon:.9f},{lat:.9f}"

    def test_waypoints_of_a_track(self, tmp_path: Path) -> None:
        def spell(tag: str, place: tuple[float, float], inner: str = "") -> str:
            lon, lat = PLANE.to_degrees(*place)
            return f'<{tag} lat="{lat:.9f}" lon="{lon:.9f}">{inner}</{tag}>'

        track = "".join(spell("trkpt", (x, y)) for x, y in [*SQUARE_M, SQUARE_M[0]])
        points = spell("wpt", (60, 50), "<name>poteau</name>") + spell("wpt", (90, 50), "<name>012</name>")
        place = tmp_path / "walk.gpx"
        place.write_text(f'<gpx version="1.1" creator="t" xmlns="http://www.topografix.com/GPX/1/1">{points}'
                         f"<trk><name>Walk</name><trkseg>{track}</trkseg></trk></gpx>")  # fmt: skip
        assert summarise(read_field(place)) == [("pole", "poteau", 1.0)]
