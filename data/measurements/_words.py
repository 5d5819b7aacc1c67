"""The words of instrument files in five languages: kinds of role, directions, runs.

All that reads names looks here: the readers take a name for a role where each of its words
is known (`kind_said`), `axcomp new` asks where one of them is (`kinds_in`).
"""

import functools
import re
from collections.abc import Iterable

WORDS: dict[str, frozenset[str]] = {
    kind: frozenset(words.split())
    for kind, words in {
        "lag": "following lag schlepp schleppfehler diff posdiff cont contour ffw",
        "correction": "correction corrections corr korr compensation compensations comp komp"
        " trim trims correzione corrección",
        "error": "error err deviation dev fehler abweichung abw messabweichung"
        " erreur écart ecart errore scostamento deviazione desviación desviacion"
        " positionsabweichung positionierabweichung positionsfehler straightness geradheit"
        " geradheitsabweichung displacement verlagerung errors deviations abweichungen"
        " messabweichungen positionsabweichungen erreurs écarts ecarts errori scostamenti"
        " deviazioni errores desviaciones",
        "current": "current strom iq torque moment drehmoment",
        "velocity": "velocity velo vel speed geschwindigkeit",
        "acceleration": "acceleration accel acc beschleunigung",
        "temperature": "temperature temp temperatur température temperatura",
        "direction": "direction dir richtung richt fahrtrichtung anfahrrichtung"
        " verfahrrichtung messrichtung approach sens direzione verso sentido dirección",
        "run": "run cycle lauf zyklus durchgang durchlauf messreihe messlauf ciclo passe"
        " passata pasada",
        "time": "time zeit timestamp elapsed laufzeit uhrzeit temps tempo tiempo",
        "actual": "laser interferometer reference measured tracker reading",
        "encoder": "encoder enc feedback geber drehgeber messsystem meßsystem wegmesssystem"
        " codeur encodeur codificatore",
        "shown": "actual act ist istposition istwert istpos",
        "position": "set soll command commanded cmd des target nominal position pos ziel"
        " setpoint sollposition sollwert sollpos zielposition messposition verfahrweg weg"
        " angle winkel drehwinkel cible consigne quota posizione posición posicion",
    }.items()
}
"""Words of each kind; an earlier kind goes before a later one in the same name.

``lag`` is what an axis lags behind, which is no error of its own; ``correction`` mostly is
the negative of an error, which nobody can tell but the user; ``shown`` is what an instrument
showed, or the machine itself.
"""
_TARGETS = frozenset(
    "set soll command commanded cmd des target nominal sollwert cible".split()
)
_SHOWN = WORDS["shown"] | WORDS["actual"]
CLOCKS = {
    "date": ("date", "datum", "day", "tag"),
    "time": ("time", "zeit", "uhrzeit", "clock", "elapsed", "elapsed time", "laufzeit"),
    "both": ("timestamp", "time stamp", "zeitstempel", "datetime", "date time"),
}
"""Names of columns of instants: the date, the time of day, and both together."""
_COUNTERS = frozenset("nr no nummer number num id".split())
_AXIS = frozenset("axis achse axe asse eje".split())
_MEAN = frozenset("mean mittel mittelwert average".split())
_SAY_NOTHING = (
    _AXIS
    | _COUNTERS
    | _MEAN
    | frozenset(
        "of travel linear positioning in der horizontal"
        " vertical lateral horizontale vertikal vertikale".split()
    )
)
_COUNTED = frozenset(
    "messung reihe pass series serie measurement fahrt".split()
)  # runs where they are counted: "Messung 3", "Nr. Messung"
RUNS = WORDS["run"] | _COUNTED
"""Words beside the number of a run."""
AXIS = r"[xyzabcuvw]\d?"
"""A name of an axis, in small letters."""

_THERE = (
    "fwd forward forwards vor vorwärts vorwaerts hin hinweg hinfahrt hinlauf"
    " hingang vorlauf there out outward outbound aller avant andata avanti ida"
)
_BACK = (
    "bwd backward backwards back rev reverse rück rueck zurück zurueck rückwärts"
    " rueckwaerts her rückweg rueckweg rückfahrt rueckfahrt rücklauf ruecklauf"
    " rückgang rueckgang herweg return inward inbound retour arrière ritorno"
    " indietro vuelta"
)
"""Words for the way there and the way back, whichever way that goes."""
_UP = (
    "+ up pos positive positiv auf aufwärts aufwaerts steigend plus ascending"
    " increasing ↑ → ⇧ ⇑ ⇒ ▲ ► ->"
)
_DOWN = (
    "- − – down dn dwn neg negative negativ ab abwärts abwaerts fallend descending"
    " decreasing minus ↓ ← ⇩ ⇓ ⇐ ▼ ◄ <-"
)
DIRECTIONS = {
    **dict.fromkeys(f"{_UP} {_THERE}".split(), 1),
    **dict.fromkeys(f"{_DOWN} {_BACK}".split(), -1),
}
"""Direction of approach, +1 or −1, by the words and signs of files."""
_LEGS = frozenset(f"{_THERE} {_BACK}".split())
_ORIGIN = frozenset("from coming aus von kommend depuis desde".split())
_CORRECTS = re.compile(r"\w*(?:korrektur|kompensation)\w*")
"""Words such as Fehlerkorrektur and Kompensationswert."""
_OFFSET = frozenset(("offset", "offsets"))
_VALUE = frozenset("value values wert werte table tabelle".split())
_MINUS = re.compile(r"[-−–]|minus")
_PIECE = re.compile(r"[A-Za-z0-9À-ÿ]+")
_CAMEL = re.compile(r"[A-ZÄÖÜ]+(?![a-zäöüß])|[A-ZÄÖÜ]?[a-zäöüß]+")
_KIND = {word: kind for kind in reversed(WORDS) for word in WORDS[kind]}
_ROLES = frozenset(("position", "actual", "error", "run", "direction", "time"))


def pieces(text: str) -> list[str]:
    """Return the words of a name, without the signs between them."""
    return _PIECE.findall(text)


def words_in(texts: Iterable[str]) -> set[str]:
    """Return the words of names in small letters, also those of ``ActPos``."""
    found = [piece for text in texts for piece in pieces(text)]
    found += [word for piece in found for word in _CAMEL.findall(piece)]
    return {word.casefold() for word in found}


def kinds_in(words: set[str]) -> list[str]:
    """Return the kinds that any of some words names, the first one going before."""
    return [kind for kind, names in WORDS.items() if words & names]


def is_warm(text: str) -> bool:
    """Whether a name says that it is of a temperature, as ``T_spindle`` does."""
    words = words_in([text])
    return "t" in words or bool(words & WORDS["temperature"])


def direction_of(text: str) -> int | None:
    """Return the direction that a cell names, or None."""
    return DIRECTIONS.get(text.strip(" .").casefold())


def is_leg(text: str) -> bool:
    """Whether a cell names the way there or back, whichever way that goes."""
    return any(piece.casefold() in _LEGS for piece in pieces(text))


def says_origin(name: str) -> bool:
    """Whether a name says where an axis came from: + is then motion in −."""
    return any(piece.casefold() in _ORIGIN for piece in pieces(name))


def is_mean(name: str) -> bool:
    """Whether a name says that it is of a mean: ``Mittel auf``, ``mean up``."""
    return any(piece.casefold() in _MEAN for piece in pieces(name))


def is_own_reading(name: str) -> bool:
    """Whether a controller calls so what it reads itself: ``ActPos``, ``X_EncPos``."""
    words = words_in([name])
    return "pos" in words and bool(words & {"act", "enc"})


def is_axis_column(name: str) -> bool:
    """Whether the cells of a column say which axis their row is of: ``Axis``, ``Achse Nr``."""
    words = {piece.casefold() for piece in pieces(name)}
    return bool(words & _AXIS) and words <= _AXIS | _COUNTERS


def says_nothing(words: Iterable[str]) -> bool:
    """Whether words of a name tell nothing of what is measured, as in "Axis No."."""
    return all(word.casefold() in _SAY_NOTHING for word in words)


@functools.lru_cache(maxsize=1024)
def kind_said(text: str) -> str | None:
    """Return the kind of role that a name without an axis says with all its words, or None.

    A position, an actual position, an error, a run, a direction or a time.
    """
    if LESS.search(text) or _REVERSED.search(text):
        return None
    kinds = set()
    words = [piece.casefold() for piece in pieces(text)]
    if is_difference(words):
        start = min(words.index(word) for word in words if word in _SHOWN)
        first = not any(word in _TARGETS for word in words[:start])
        return "error" if first and _MINUS.search(text) else None
    counted = bool(_COUNTERS & {*words})
    for piece, word in zip(pieces(text), words, strict=True):
        if word in _SAY_NOTHING:
            continue
        if counted and word in _COUNTED:
            kinds.add("run")
            continue
        parts = (
            [word] if word in _KIND else [p.casefold() for p in _CAMEL.findall(piece)]
        )
        if not parts or not all(part in _KIND for part in parts):
            return "time" if words == ["t"] else None
        kinds |= {_KIND[part] for part in parts}
    kind = next((name for name in WORDS if name in kinds), None)
    kind = "actual" if kind == "shown" else kind
    if kind not in _ROLES or (counted and kind == "position"):
        return None  # "Pos. No." counts the positions
    return kind


def is_difference(words: Iterable[str]) -> bool:
    """Whether words in small letters name both a target and what was reached."""
    names = {*words}
    return bool(names & _TARGETS and names & _SHOWN)


LESS = re.compile(
    r"(?i)\b(?:soll\w*|ziel\w*|target|nominal|command(?:ed)?|cmd|set\s?points?|programm\w*|theor\w*"
    r"|ref|encoder|cnc)(?:\s+(?:pos\w*\.?|value|wert))?\s*(?:[-−–]|minus|less|abzüglich|weniger)\s*"
    r"(?:ist\w*|act(?:ual)?|meas\w*|gemess\w*|mess\w*|laser|real|interferometer)\b"
    r"(?!\W*(?:vergleich|comparison))"
)
_REVERSED = re.compile(
    r"(?i)^\s*\(?\s*[-−]\s*\)?\s*[^\W\d_]{3}|[*×x]\s*\(?\s*[-−]\s*1\b|\binvert|\bnegated|\bnegiert"
    r"|\bsign\W+reversed|\breversed\W+sign|\bumgekehrte\w*\W+vorzeichen"
    r"|\bvorzeichen\W+(?:umgekehrt|gedreht|wie)"
)
"""Targets less what was reached, and names that say themselves that they are a negative."""


def says_correction(name: str) -> bool:
    """Whether a name is that of corrections, of offsets, or of targets less what was reached."""
    words = words_in([name])
    if LESS.search(name) or _REVERSED.search(name):
        return True
    return (
        bool(words & WORDS["correction"])
        or any(map(_CORRECTS.fullmatch, words))
        or bool(words & _OFFSET and words <= _OFFSET | _VALUE)
        or (is_difference(words) and kind_said(name) is None)
    )


def all_position(texts: Iterable[str]) -> bool:
    """Whether names consist of nothing but words for a position."""
    names = WORDS["position"] | WORDS["encoder"] | WORDS["shown"]
    return all(
        piece.casefold() in names
        or all(w.casefold() in names for w in _CAMEL.findall(piece))
        for text in texts
        for piece in pieces(text)
        if _CAMEL.findall(piece)
    )
