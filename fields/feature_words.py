"""What the name or kind of a feature says it is, in the main languages of Europe.

Farmers name what they draw in their own words: "Strommast 12", "étang", "Einfahrt Nord", "Bodenprobe 3". Words for
obstacles are found within compounds and with endings, as a wrong one costs only a wrong word in a remark. Words for
anything else are compared whole, as a wrong one would let machines drive into an obstacle.
"""

from __future__ import annotations

import itertools
import re
import unicodedata
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any

OBSTACLE, ENTRANCE, REFILL, GUIDANCE = "obstacle", "entrance", "refill", "guidance"
NOTE, OVERHEAD_LINE = "note", "overhead line"
GENERAL_KIND = "obstacle"

OBSTACLE_WORDS: dict[str, str] = {
    "pylon": "pylon tower strommast hochspannungsmast gittermast freileitungsmast leitungsmast hochspannung "
    "umspannmast pylone torre traliccio apoyo hoogspanningsmast hojspaendingsmast kraftledningsstolpe "
    "hogspanningsstolpe suurjannitepylvas slupwysokiegonapiecia stozar oszlopvezetek stalp",
    "wind turbine": "turbine turbina windrad windkraftanlage windkraft windmuhle windmolen vindmolle "
    "vindkraftverk eolienne eolica aerogenerador aerogeneratore tuulivoimala wiatrak",
    "mast": "mast antenna antenne antena antenn sendemast funkmast wetterstation weatherstation maszt antenni",
    "pole": "pole pfahl pfosten laterne lampe poteau poste palo pali poly paal lantaarnpaal stolpe stolper "
    "paele pylvas tolppa slup sloup telegraph lamppost utilitypole oszlop stulp",
    "post": "post pieu pflock piquet bollard poller estaca picchetto staak pael kolek karo",
    "tree": "tree baum baume eiche buche linde weide pappel birke kiefer obstbaum oak poplar willow pine "
    "arbre chene peuplier saule arbol encina olivo roble albero quercia pioppo ulivo arvore oliveira sobreiro "
    "boom eik bomen trae trad tre puu drzewo dab strom stromy copac drzewa",
    "bush": "bush shrub busch gebusch strauch feldgeholz geholz buisson arbusto cespuglio struik bosje busk "
    "buskads buske pensas krzak krzewy ker bokor tufis",
    "pond": "pond teich weiher tumpel see lake etang mare estanque charca laguna stagno laghetto lagoa vijver "
    "poel vandhul vandhuller dam sjo lampi staw oczko rybnik tavacska iaz wasserloch biotop soll "
    "feuchtbiotop wetland",
    "well": "well brunnen puits pozo pozzo poco bronn brond brunn kaivo studnia studna kut fantana "
    "borehole bohrloch forage bohrbrunnen",
    "hydrant": "hydrant hydrante idrante hidrante brandkraan brandpost vandpost brandhane palovesi tuzcsap "
    "unterflurhydrant standrohr",
    "manhole": "manhole schacht gully kanaldeckel regard arqueta tombino pozzetto caixa brunnsring mangat "
    "rioolput kontrollschacht studzienka sachta akna camin inspection drainageschacht draenageschacht dranschacht",
    "valve": "valve schieber ventil vanne valvula valvola afsluiter venttiili zawor zasuvka szelep",
    "pump": "pump pumpe pompe bomba pompa pomp pumppu cerpadlo szivattyu",
    "stone": "stone rock boulder stein felsen fels findling steinhaufen feldstein grenzstein lesesteinhaufen "
    "pierre rocher caillou piedra roca pietra roccia sasso pedra rocha steen kei sten klippa kivi kamien glaz "
    "kamen balvan szikla piatra bolovan",
    "boundary marker": "boundarystone landmark grenzpunkt vermessungspunkt borne mojon cippo marco grenspaal "
    "skelsten",
    "building": "building house shed barn hut cabin gebaude haus hutte scheune stall schuppen halle stadel "
    "feldscheune huette batiment maison hangar grange cabane edificio casa nave caseta fabbricato capannone "
    "stalla galpao armazem gebouw schuur loods bygning hus lade byggnad lada rakennus lato budynek stodola dom "
    "budova dum epulet haz cladire ruin ruine kapelle chapel wegkreuz bildstock",
    "hide": "hide hochsitz jagdkanzel kanzel ansitz mirador altana hojsaede jagttarn jakttorn ambona posed "
    "magasles huntingstand deerstand",
    "silo": "silo gulletank mist misthaufen miete futtermiete strohballen ballen dungheap heap haystack stack "
    "meule fumier monton mucchio hoop mestvaalt",
    "beehive": "beehive hive bienen bienenstand bienenstock bienenkasten ruche colmena alveare bijenkast "
    "bistade bikupa ul",
    "trough": "trough tranke viehtranke abreuvoir bebedero abbeveratoio drinkbak",
    "sign": "sign schild tafel panneau letrero cartel cartello bord skilt skylt znak cedule tabla wegweiser",
    "wet ground": "wet nass nassstelle vernassung moor sumpf humide zonehumide swamp marsh marais pantano "
    "palude moeras mose suo bagno mokradlo",
    "solar panel": "solar photovoltaik solaranlage pv fotovoltaica fotovoltaico",
    "hole": "hole pit loch grube senke doline sinkhole trou hoyo agujero buca buraco kuil gat hul grop "
    "kuoppa dol jama godor groapa",
    "ditch": "ditch graben strassengraben fosse zanja acequia cuneta fosso sloot greppel groft dike oja "
    "prikop arok sant kanal canal",
    "stream": "stream creek brook river bach fluss ruisseau riviere arroyo rio ruscello torrente ribeiro beek "
    "beck puro joki potok strumien patak parau",
    "hedge": "hedge hecke knick haie seto siepe sebe haag heg haeck hack laegte hakki zywoplot sovenynek "
    "viu hedgerow treerow baumreihe allee windbreak windschutz laehegn",
    "wall": "wall mauer mur muret muro muur muri steinmauer stonewall mure zid zed kofal zidina",
    "fence": "fence zaun weidezaun wildzaun elektrozaun cloture valla cerca recinto recinzione vedacao "
    "afrastering hegn stangsel aita ogrodzenie plot keritesek gard",
    "bank": "bank embankment boschung damm talus terraplen scarpata talud skraent slant penger skarpa "
    "nasyp",
    "rail": "rail railway bahn gleis bahngleis feldbahn voieferree ferrocarril ferrovia spoor jernbane "
    "jarnvag",
    "wood": "wood forest wald waldchen bosquet bosque bosco mata bos skov skog metsa erdo padure",
    "road": "road track path strasse weg feldweg route chemin camino strada sentiero estrada pad vej vag "
    "droga cesta",
    GENERAL_KIND: "obstacle hindernis storstelle sperrflache obstaculo ostacolo hindernisse obstakel hindring "
    "forhindring hinder este przeszkoda prekazka akadaly obstacol",
}  # fmt: skip
"""Kinds of obstacles, and words for them without accents in English, German, French, Spanish, Italian, Portuguese,
Dutch, Danish, Swedish, Finnish, Polish, Czech, Hungarian and Romanian."""

OTHER_WORDS: dict[str, str] = {
    ENTRANCE: "entrance gate gateway entry access fieldaccess einfahrt feldeinfahrt ausfahrt feldausfahrt "
    "zufahrt feldzufahrt auffahrt tor feldtor hoftor weidetor gatter eingang entree acces portail portillon "
    "entrada acceso puerta porton ingresso accesso cancello portao porteira ingang inrit oprit toegang poort "
    "indkorsel overkorsel led infart grind port sisaankaynti portti wjazd brama vjezd brana bejarat kapu intrare "
    "poarta",
    REFILL: "refill refilling filling fillpoint fillstation fuelling refuelling tank tankstelle depot tender "
    "befullung befullen befullpunkt befullstation fullstelle fullplatz nachfullen nachfullstelle betankung "
    "abtankplatz uberladen uberladeplatz ladeplatz remplissage ravitaillement recharge rellenado llenado "
    "repostaje recarga rifornimento abastecimento vulpunt vulplaats tankplaats pafyldning fyldeplads pafyllning "
    "fyllplats tankplats tayttopaikka tankowanie napelnianie plneni feltoltes",
    GUIDANCE: "ab guidance guideline aline bline abline swath tramline leitlinie spurlinie spur fahrgasse "
    "leitspur guidage traza guia guida geleiding spoorlijn korespor styrelinje korspar sciezka vodici",
    NOTE: "sample samples sampling soilsample sampler probe proben bodenprobe bodenproben probenahme "
    "probenahmepunkt einstich einstichpunkt messpunkt messung beprobung echantillon echantillons prelevement "
    "muestra muestras muestreo campione campioni amostra amostras monster monsters bodemmonster jordprove "
    "jordprover jordprov prov provpunkt maanayte nayte probka probki vzorek vzorky minta mintak proba label "
    "labels beschriftung etikett etiquette etiqueta etichetta centroid centre center centro mittelpunkt zentrum "
    "schwerpunkt centrum keskipiste start ziel depart arrivee inicio photo photos foto fotos bild image img dsc "
    "picture kuva zdjecie note notiz notizen bemerkung kommentar comment remarque nota anmerkung marker "
    "markierung bonitur scouting observation beobachtung weed weeds unkraut distel disteln thistle ampfer quecke "
    "schadling pest aphids yield ertrag rendement rendimiento resa zone zonen teilflache managementzone parkplatz "
    "parking",
    OVERHEAD_LINE: "powerline overheadline stromleitung freileitung hochspannungsleitung leitung elektroleitung "
    "cable kabel stromkabel erdkabel gasleitung wasserleitung pipeline ligneelectrique cavo lineaelettrica "
    "lineaelectrica hoogspanning hoogspanningslijn leiding kraftledning luftledning hojspaending ledning "
    "sahkolinja drain drainage dranage drainageleitung draenage dran drenaje drenaggio sauger sammler",
}  # fmt: skip
"""Uses other than obstacles, and their words. OVERHEAD_LINE are lines above or below machines."""

NAME_KEYS = ("kind", "role", "name", "layer")
"""Properties that say what a feature is."""
TYPE_KEYS = ("type", "typ", "tipo", "soort", "art", "category", "kategorie", "class", "sym")
REMARK_KEYS = ("desc", "description")
"""Properties that may only name an obstacle; remarks mention many things, so they count where nothing else says one."""
OSM_KEYS = ("power", "natural", "barrier", "man_made", "building", "historic", "waterway", "highway", "landuse")
"""Tags of OpenStreetMap, of which the key is a word as well: building=yes."""
LINE_ENDS = ("a", "b", "punkta", "punktb", "pointa", "pointb", "apunkt", "bpunkt", "apoint", "bpoint")
"""Names of the ends of a guidance line."""
LINE_KINDS = ("ditch", "stream", "hedge", "wall", "fence", "bank", "rail", GENERAL_KIND)
"""Kinds of obstacles that a line is; guidance lines may be named after anything else."""
MIN_COMPOUND_LETTERS, MAX_ENDING_LETTERS = 4, 2
_PLAIN_LETTERS = str.maketrans({"ø": "o", "æ": "ae", "ł": "l", "đ": "d", "œ": "oe"})
_WORD = re.compile(r"[^\W\d_]+")
_NUMBER_NAME = re.compile(r"[\W\d_]*\d[\W\d_]*(ha|ac|acres|m2|m²)?|[a-z]{0,6}\d{6,}", re.IGNORECASE)
_AREA_TAIL = re.compile(r"[\W\d_]*(\d[\W\d_]*(ha|ac|acres|m2|m²)\W*)?", re.IGNORECASE)


@dataclass(frozen=True)
class Meaning:
    """What a feature is by its words: its use, "" if they say nothing; and the kind of an obstacle, "" if unknown."""

    use: str = ""
    kind: str = ""


def find_meaning(properties: Mapping[str, Any]) -> Meaning:
    """The meaning of a feature by its kind, role, name or layer, or by other properties if they name an obstacle."""
    texts = {
        key.casefold(): text for key, value in properties.items() if isinstance(value, str) and (text := value.strip())
    }
    tags = [f"{key} {texts[key]}" for key in OSM_KEYS if texts.get(key, "no") != "no"]
    meanings = [find_word_meaning(text) for text in (*_pick(texts, NAME_KEYS), *tags)]
    types, remarks = ([find_word_meaning(text) for text in _pick(texts, keys)] for keys in (TYPE_KEYS, REMARK_KEYS))
    choices = (
        *(one for one in (*meanings, *types) if one.use == OBSTACLE),
        *(one for one in meanings if one.use),
        *(one for one in remarks if one.use == OBSTACLE),
    )
    return next(iter(choices), Meaning())


def _pick(texts: Mapping[str, str], keys: Iterable[str]) -> list[str]:
    return [texts[key] for key in keys if key in texts]


def find_name(properties: Mapping[str, Any]) -> str:
    """The name of a feature, "" without one."""
    names = (str(properties[key]).strip() for key in ("name", "Name") if isinstance(properties.get(key), str | int))
    return next((name for name in names if name), "")


@lru_cache(maxsize=10_000)
def find_word_meaning(text: str) -> Meaning:
    """The meaning of a name or kind.

    The first word that says something counts, but an obstacle that is a word of its own always does: "gate post" is no
    gate, while "Einfahrt Mühlbach" is no brook.
    """
    words = _split_words(text)
    if "".join(words) in LINE_ENDS:
        return Meaning(GUIDANCE)
    pairs = ["".join(pair) for pair in itertools.pairwise(words)]  # "power line" is found as "powerline"
    obstacle_words, other_words = _load_words()
    kind = next((obstacle_words[word] for word in (*pairs, *words) if word in obstacle_words), "")
    if kind:
        return Meaning(OBSTACLE, kind)
    use = next((other_words[pair] for pair in pairs if pair in other_words), "")
    for word in () if use else words:
        if word in other_words:
            return Meaning(other_words[word])
        kind = _find_compound_kind(word)
        if kind:
            return Meaning(OBSTACLE, kind)
    return Meaning(use)


def is_label(name: str, field_names: Iterable[str]) -> bool:
    """Whether a name is that of a field, perhaps with its area, or only a number."""
    plain = name.strip().casefold()
    if not plain:
        return False
    if _NUMBER_NAME.fullmatch(plain):
        return True
    starts = [one.strip().casefold() for one in field_names if one.strip()]
    return any(plain.startswith(start) and _AREA_TAIL.fullmatch(plain[len(start) :]) for start in starts)


def _split_words(text: str) -> list[str]:
    """Words in small letters without accents."""
    plain = text.casefold()
    if not plain.isascii():
        plain = unicodedata.normalize("NFKD", plain.translate(_PLAIN_LETTERS))
        plain = "".join(one for one in plain if not unicodedata.combining(one))
    return _WORD.findall(plain)


@cache
def _load_words() -> tuple[dict[str, str], dict[str, str]]:
    """Kinds of obstacles, and other uses, by word; the first of several counts."""
    tables: tuple[dict[str, str], dict[str, str]] = ({}, {})
    for words, table in zip((OBSTACLE_WORDS, OTHER_WORDS), tables, strict=True):
        for meaning, text in words.items():
            for word in text.split():
                table.setdefault(word, meaning)
    return tables


@lru_cache(maxsize=10_000)
def _find_compound_kind(word: str) -> str:
    """The kind of a compound or of a word with an ending: "hochsitzen", "streuobstbaum"; the longest match counts."""
    matches = [
        known
        for known in _load_words()[0]
        if len(known) >= MIN_COMPOUND_LETTERS
        and 0 <= len(word) - word.rfind(known) - len(known) <= MAX_ENDING_LETTERS
        and known in word
    ]
    return _load_words()[0][max(matches, key=len)] if matches else ""
