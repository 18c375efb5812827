"""How searches in words are understood, against what each must mean.

    python -m benchmarks.language [--held-out] [--all]

``language.txt`` holds searches as analysts type them with the phases, predicates, roles, durations
and pauses that they must become; its head says how they are written. Every third is held out.
Printed: how many are read right, how many are refused although they need not be, and how many are
read as something else (silently wrong); with ``--all`` also which.
"""

import argparse
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import permutations
from pathlib import Path

from scene4d.core.errors import InputError
from scene4d.core.tracks import CLASSES
from scene4d.searching.activities._terms import parse_term
from scene4d.searching.activities.catalogue import load_catalogue
from scene4d.searching.activities.definition import Activity, Phase, Role, Term
from scene4d.searching.language import Query, parse_query
from scene4d.searching.predicates._registry import PREDICATES
from scene4d.searching.predicates._when import When, Window

ZONES, LINES = ("entrance", "car park", "road"), ("gate", "stop line")
RIGHT, REFUSED, WRONG = "right", "refused", "wrong"
HELD_OUT = 3
"""Every third phrasing is held out."""
_LEAST_TIMED_S = 1.0
"""A state of which nobody said how long it lasts may be asked for this long."""
_WHEN = {"yesterday": When(day=-1), "today": When(day=0)}
"""Of another one: what the file calls it."""
_NAMED = ("zone", "line", "side", "lag_s", "count")
"""Parameters that nobody assumes: they are as expected, or not there."""
_NOUNS = {
    "person": {"person"},
    "car": {"car", "vehicle"},
    "truck": {"truck", "vehicle"},
    "bus": {"bus", "vehicle"},
    "van": {"car", "truck", "bus", "vehicle"},
    "bicycle": {"bicycle", "vehicle"},
    "motorcycle": {"motorcycle", "vehicle"},
    "any": set(CLASSES),
}


@dataclass(frozen=True)
class Phrasing:
    """A search, and the ways in which it may be understood or refused."""

    text: str
    expected: str
    zones: tuple[str, ...] = ZONES
    lines: tuple[str, ...] = LINES

    def score(self) -> tuple[str, str]:
        """Right, refused or wrong, and what was made of it."""
        alternatives = [one.strip() for one in self.expected.split(" | ")]
        try:
            query = parse_query(self.text, _catalogue(), self.zones, self.lines)
        except InputError as error:
            reasons = [one[1:].split("/") for one in alternatives if one.startswith("!")]
            said = str(error).removeprefix(f'search "{self.text}"')
            fits = any(word.strip() in said for words in reasons for word in words)
            return RIGHT if fits else REFUSED, str(error)
        meant = any(_is(query, one) for one in alternatives if not one.startswith("!"))
        return RIGHT if meant else WRONG, _lines(query)


@cache
def _catalogue() -> Mapping[str, Activity]:
    return load_catalogue()


def phrasings(held_out: bool) -> list[Phrasing]:
    """Those of the first file, or those of it that are held out."""
    all_ = _read("language.txt")
    return [one for number, one in enumerate(all_, 1) if (number % HELD_OUT == 0) == held_out]


def analysts() -> list[Phrasing]:
    """Those of the second file, all of them held out."""
    return _read("language_analysts.txt")


def third() -> list[Phrasing]:
    """Those of the third file, all of them held out."""
    return _read("language_third.txt")


def _read(name: str) -> list[Phrasing]:
    text = Path(__file__).with_name(name).read_text("utf-8")
    named = dict(re.findall(r"^# (zones|lines): (.*)$", text, re.MULTILINE))
    places = {kind: tuple(names.split(", ")) for kind, names in named.items()}
    pairs = [line.split(" => ") for line in text.splitlines() if " => " in line and line[0] != "#"]
    return [Phrasing(said, expected, **places) for said, expected in pairs]


def _lines(query: Query) -> str:
    phases = [phase for one in query.activity.options for phase in one.phases]
    said = [
        f"{' & '.join(_term_text(t) for t in p.terms)} {p.min_s:g}..{p.max_s:g} <={p.gap_s:g}"
        for p in phases
    ]
    spots = [f"where {spot.name!r}: {spot.when}" for spot in query.activity.spots]
    return " ; ".join([*said, *spots])


def _term_text(term: Term) -> str:
    given = [f"{k}={v}" for k, v in term.parameters.items()]
    return f"{'not ' * term.negated}{term.predicate}({', '.join([*term.roles, *given])})"


# What is expected ---------------------------------------------------------------------------------


def _is(query: Query, expected: str) -> bool:
    """Whether a search was understood as expected, whatever its roles are called."""
    expected, _, window = expected.partition("[")
    if str(query.window or "").replace(" to ", "-") != window.strip("] "):
        return False
    expected, _, spot = expected.partition(" where ")
    if len(query.activity.spots) != bool(spot) or (spot and not _is_spot(query, spot)):
        return False
    expected = re.sub(r"empty\((\w+), ", r"inside(\1!, ", expected)
    several, parts = query.activity.options, expected.split(" or ")
    return len(several) == len(parts) and all(map(_is_activity, several, parts))


def _is_spot(query: Query, expected: str) -> bool:
    """Whether the one spot of a search is as expected: what another one did, and when."""
    (spot,) = query.activity.spots
    did, _, said = expected.partition("@ ")
    return spot.when == _when(said.strip()) and _is_activity(spot.activity, did.strip())


def _when(said: str) -> When:
    said, _, clock = said.partition("(")
    hours = [3600 * int(h) + 60 * int(m) for h, m in re.findall(r"(\d+):(\d+)", clock)]
    window = Window(*map(float, hours)) if hours else None
    said = said.strip()
    if said in ("earlier", "later"):
        return When(later=said == "later", is_over=True)
    if said in _WHEN:
        return replace(_WHEN[said], clock=window)
    if said.startswith("day"):
        return When(day=int(said[3:]))
    low, _, high = said.partition("..")
    return When(float(low or 0), float(high or math.inf), clock=window)


def _is_activity(activity: Activity, expected: str) -> bool:
    """Whether phases are as expected, whatever their roles are called."""
    try:
        phases = [phase for part in expected.split(";") for phase in _phases(part)]
    except (InputError, KeyError):
        return False  # an activity or predicate that does not exist yet
    names = list(dict.fromkeys(r for p in phases for t, _ in p.terms for r in t.roles))
    if len(names) != len(activity.roles) or len(phases) != len(activity.phases):
        return False
    for roles in permutations(activity.roles):
        if all(map(_plays, roles, names)):
            called = {role.name: name for role, name in zip(roles, names, strict=True)}
            if all(one.fits(p, called) for one, p in zip(phases, activity.phases, strict=True)):
                return True
    return False


def _plays(role: Role, name: str) -> bool:
    noun, sign, count = re.fullmatch(r"([^*=!]+)([*=!]?)(\d*)", name).groups()  # type: ignore[union-attr]
    if (role.count, role.exactly, role.absent) != (int(count or 1), sign == "=", sign == "!"):
        return False
    classes = set(role.classes)
    kinds = re.sub(r"\d", "", noun).split("+")
    if kinds == ["vehicle"]:
        return classes >= {"car", "truck", "bus", "vehicle"} and "person" not in classes
    return classes == set().union(*(_NOUNS[kind] for kind in kinds))


@dataclass(frozen=True)
class _Wanted:
    """A phase: terms, whether all their parameters are given, duration and pause if any."""

    terms: tuple[tuple[Term, bool], ...]
    least_s: float | None = None
    most_s: float | None = None
    gap_s: float | None = None

    def fits(self, phase: Phase, called: Mapping[str, str]) -> bool:
        actual = [
            _affirmed(replace(t, roles=tuple(called[r] for r in t.roles))) for t in phase.terms
        ]
        if len(actual) != len(self.terms) or not self._is_timed_as(phase):
            return False
        return all(any(_same(term, one, whole) for one in actual) for term, whole in self.terms)

    def _is_timed_as(self, phase: Phase) -> bool:
        if self.gap_s is not None and not math.isclose(phase.gap_s, self.gap_s):
            return False
        if self.least_s is None:
            return phase.min_s <= _LEAST_TIMED_S
        most = math.inf if self.most_s is None else self.most_s
        return math.isclose(phase.min_s, self.least_s) and phase.max_s == most


def _affirmed(term: Term) -> Term:
    """Who does not move stands: one statement, however it is said."""
    other = {"moving": "stationary", "stationary": "moving", "near": "far", "far": "near"}
    if not term.negated or term.predicate not in other:
        return term
    return replace(term, predicate=other[term.predicate], negated=False)


def _same(wanted: Term, found: Term, whole: bool) -> bool:
    wanted = _affirmed(wanted)
    roles = {wanted.roles, wanted.roles[::-1] if PREDICATES[wanted.predicate].symmetric else ()}
    if (wanted.predicate, wanted.negated) != (found.predicate, found.negated):
        return False
    if found.roles not in roles:
        return False
    keys = {*wanted.parameters, *(k for k in found.parameters if whole or k in _NAMED)}
    return all(_equal(wanted.parameters.get(k), found.parameters.get(k)) for k in keys)


def _equal(one: object, other: object) -> bool:
    if isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, rel_tol=1e-6)
    return one == other


def _phases(part: str) -> Iterator[_Wanted]:
    """The phases of one part, of several where it is an activity of the catalogue."""
    part = part.strip()
    gap = re.search(r"<=([\d.]+)", part)
    gap_s = float(gap[1]) if gap else None
    part = re.sub(r"<=[\d.]+", "", part).strip()
    if part.startswith("@"):
        phases = list(_known(part))
        yield replace(phases[0], gap_s=gap_s)
        yield from phases[1:]
        return
    lasts = re.search(r" ([\d.]+)\.\.([\d.]*)$", part)
    terms = part[: lasts.start()] if lasts else part
    least, most = (float(lasts[1].rstrip(".")), lasts[2]) if lasts else (None, "")
    told = tuple((_term(term), False) for term in terms.split(" & "))
    yield _Wanted(told, least, float(most) if most else None, gap_s)


def _term(text: str) -> Term:
    """A term; roles such as person*3 are no names of the catalogue's own."""
    found = re.findall(r"(?<=[(,])\s*([a-z]+\d*(?:[*+][a-z\d]+|=\d+|!))", text)
    term = parse_term(re.sub(r"[*+]\w+|(?<=person)=\d+|!", "", text))
    whole = {re.sub(r"[*+=!].*", "", name): name for name in found}
    return replace(term, roles=tuple(whole.get(role, role) for role in term.roles))


def _known(part: str) -> Iterator[_Wanted]:
    """``@name(role, ..., zone=name) phase:LEAST.. phase+term``."""
    match = re.match(r"@(\w+)\(([^)]*)\)(.*)", part)
    assert match is not None, part
    activity = _catalogue()[match[1]]
    said = [piece.strip() for piece in match[2].split(",")]
    places = dict(piece.split("=") for piece in said if "=" in piece)
    names = [piece for piece in said if "=" not in piece]
    called = {role.name: name for role, name in zip(activity.roles, names, strict=True)}
    changes = re.findall(r"(\w+)([:+])((?:not )?[\d.]+|\w+\([^)]*\))", match[3])
    for number, phase in enumerate(activity.phases):
        keys = {phase.name.split()[0], "all"}
        keys |= {"first"} if number == 0 else set()
        keys |= {"last"} if number == len(activity.phases) - 1 else set()
        terms = [(_called(term, called, places), True) for term in phase.terms]
        least_s = most_s = None
        for key, sign, value in changes:
            if key in keys and sign == "+":
                terms.append((_term(value), False))
            elif key in keys:
                low, _, high = value.partition("..")
                least_s, most_s = float(low), float(high) if high else None
        timed = (least_s, most_s) if least_s is not None else (None, None)
        wanted = _Wanted(tuple(terms), *timed)
        yield wanted if timed[0] is not None else _as_known(wanted, phase)


def _as_known(wanted: _Wanted, phase: Phase) -> _Wanted:
    """With the catalogue's own duration."""
    most = None if math.isinf(phase.max_s) else phase.max_s
    return replace(wanted, least_s=phase.min_s, most_s=most)


def _called(term: Term, names: Mapping[str, str], places: Mapping[str, str]) -> Term:
    given = {k: places.get(k, v) for k, v in term.parameters.items()}
    return replace(term, roles=tuple(names[role] for role in term.roles), parameters=given)


def tally(those: Sequence[Phrasing]) -> dict[str, list[tuple[Phrasing, str]]]:
    """The phrasings by how they were read, with what was made of them."""
    found: dict[str, list[tuple[Phrasing, str]]] = {RIGHT: [], REFUSED: [], WRONG: []}
    for one in those:
        how, said = one.score()
        found[how].append((one, said))
    return found


def _print(name: str, found: Mapping[str, Sequence[tuple[Phrasing, str]]], each: bool) -> None:
    total = sum(map(len, found.values()))
    share = len(found[RIGHT]) / total
    counts = ", ".join(f"{how} {len(those)}" for how, those in found.items())
    print(f"{name}: {total} phrasings; {counts} ({100 * share:.0f} % right)")
    for how in (REFUSED, WRONG) if each else ():
        for one, said in found[how]:
            print(f"  {how}: {one.text}\n      want {one.expected}\n      read {said}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--held-out", action="store_true", help="also those held out")
    parser.add_argument("--all", action="store_true", help="print what is not right")
    arguments = parser.parse_args()
    _print("written for", tally(phrasings(False)), arguments.all)
    if arguments.held_out:
        _print("held out", tally(phrasings(True)), False)
        _print("of analysts", tally(analysts()), arguments.all)
        _print("third", tally(third()), arguments.all)


if __name__ == "__main__":
    main()
