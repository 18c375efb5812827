"""The grammar of a search, generated from the lexicon and the phrases of a catalogue."""

import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from importlib.resources import files
from typing import cast

from lark import Lark, Token, Tree
from lark.exceptions import UnexpectedEOF, UnexpectedInput
from lark.grammar import Symbol
from lark.lexer import Lexer
from lark.load_grammar import Grammar as LarkGrammar
from lark.load_grammar import load_grammar

from scene4d.searching.activities.definition import Activity
from scene4d.searching.language._lexicon import base_forms, read_lexicon
from scene4d.searching.language._phrases import PhraseReader
from scene4d.searching.language._sentences import Spoken
from scene4d.searching.language._words import Vocabulary, Word

_OF_KIND = {
    "number": "NUMBER",
    "clock": "CLOCK",
    "zone": "ZONE",
    "line": "LINE",
    "comma": "COMMA",
    "whose": "WHOSE",
}
_SYMBOLS = {"object": "noun"}


@dataclass(frozen=True, eq=False)
class Grammar:
    """Rules, the words that they know with their tokens, and the activities that the rules
    ``activity_N`` and ``whole_N`` speak of.
    """

    rules: LarkGrammar
    terminals: Mapping[str, str]
    spoken: tuple[tuple[Spoken, ...], ...]
    _last: list[tuple[frozenset[str], Lark]] = field(default_factory=list)
    """The parser that was made last, and for which words: parts of a text are read with that of the
    whole."""

    def tokens(self, words: Sequence[Word]) -> list[Token]:
        """Words as tokens of the grammar, with their places in the text."""
        return [
            Token(
                _OF_KIND.get(word.kind) or self.terminals[word.value],
                word.value,
                start_pos=word.start,
                end_pos=word.end,
            )
            for word in words
        ]

    def parse(self, words: Sequence[Word], *, quick: bool = False) -> Tree:
        """All readings of the words. Raises Lark's :class:`UnexpectedInput` where there is none,
        with all words that could be said instead, unless it should be ``quick``.
        """
        tokens = self.tokens(words)
        try:
            return self._parser({token.type for token in tokens}).parse(tokens)
        except UnexpectedInput:
            if quick:
                raise
            return self._whole.parse(tokens)

    def _parser(self, terminals: Collection[str]) -> Lark:
        """A parser of the rules that these words can follow. There are hundreds of others, which
        Earley's algorithm would prepare, and then predict at every word.
        """
        if self._last and self._last[-1][0].issuperset(terminals):
            return self._last[-1][1]
        there = set(terminals)
        waiting, before = self.rules.rule_defs[::-1], -1  # what a rule is made of stands below it
        while len(there) > before:
            before = len(there)
            for name, _, tree, _ in waiting:
                if name not in there and _can_be_said(tree, there):
                    there.add(name)
        if "start" not in there:  # these words alone make no search
            raise UnexpectedEOF([])  # type: ignore[no-untyped-call]
        rules = [
            (name, templates, _pruned(tree, there), options)
            for name, templates, tree, options in self.rules.rule_defs
            if name in there
        ]
        parser = _parser_of(LarkGrammar(rules, self.rules.term_defs, self.rules.ignore))
        self._last[:] = [(frozenset(terminals), parser)]
        return parser

    @cached_property
    def _whole(self) -> Lark:
        return _parser_of(self.rules)

    def vocabulary(self, zones: Sequence[str], lines: Sequence[str]) -> Vocabulary:
        """The words of the grammar, with the names of places."""
        phrases = tuple(p for meant in self.spoken for one in meant for p in one.activity.phrases)
        places = {"zone": zones, "line": lines}
        return Vocabulary(self.terminals.keys(), tuple(dict.fromkeys(phrases)), places)


class _Ready(Lexer):
    """Passes on tokens that are ready."""

    def __init__(self, _conf: object) -> None:
        pass

    def lex(self, data: Iterable[Token]) -> Iterator[Token]:  # type: ignore[override]
        yield from data


def _parser_of(rules: LarkGrammar) -> Lark:
    return Lark(
        rules, parser="earley", lexer=_Ready, ambiguity="explicit", propagate_positions=True
    )


def _can_be_said(part: Tree, there: set[str]) -> bool:
    """Whether a part of a rule can be said with these symbols."""
    children = part.children
    match part.data:
        case "expansions":
            return any(_can_be_said(one, there) for one in children)
        case "expansion":
            return all(_can_be_said(one, there) for one in children)
        case "expr" if children[1] in ("?", "*"):
            return True
        case "value":
            return cast(Symbol, children[0]).name in there
    return _can_be_said(children[0], there)


def _pruned(part: Tree, there: set[str]) -> Tree:
    """A part of a rule that can be said, without what cannot."""
    children = part.children
    match part.data:
        case "expansions":
            kept = [_pruned(one, there) for one in children if _can_be_said(one, there)]
            return Tree("expansions", kept)
        case "expansion":
            return Tree("expansion", [_pruned(one, there) for one in children])
        case "value":
            return part
        case "expr" if not _can_be_said(children[0], there):
            return Tree("expansion", [])
    return Tree(part.data, [_pruned(children[0], there), *children[1:]])


def build_grammar(activities: Iterable[Activity]) -> Grammar:
    """The grammar for these activities.

    Raises :class:`InputError` for a phrase that has no verb, or speaks of somebody for whom its
    activity has no role.
    """
    return _written(_Named(tuple(activities)))


@dataclass(frozen=True)
class _Named:
    """Activities hold mappings and are not hashable; equal ones have the same grammar."""

    activities: tuple[Activity, ...]

    def __hash__(self) -> int:
        return hash(tuple((activity.name, activity.phrases) for activity in self.activities))


@lru_cache(maxsize=8)
def _written(named: _Named) -> Grammar:
    return _Writer().write(named.activities)


class _Writer:
    """Collects words and rules, then hands them to the parser library.

    While rules are collected a word stands in them as ``<word>``; at the end it becomes its token,
    together with those of listed forms: "leave" is also "left", "stop" also "stopped".
    """

    def __init__(self) -> None:
        self._words: dict[str, str] = {}
        self._rules: list[str] = []
        self._either: dict[str, str] = {}

    def write(self, activities: tuple[Activity, ...]) -> Grammar:
        """The grammar."""
        self._write_lexicon()
        spoken = self._write_phrases(activities)
        frame = files(__package__).joinpath("grammar.lark").read_text(encoding="utf-8")
        rules = self._with_tokens()
        tokens = dict.fromkeys([*_OF_KIND.values(), *self._words.values(), "NOTHING"])
        text = "\n".join([frame, *rules, "%declare " + " ".join(tokens)])
        read, _ = load_grammar(text, "grammar.lark", [], False)  # type: ignore[no-untyped-call]
        return Grammar(read, self._words, spoken)

    def _rule(self, name: str, rights: Iterable[str]) -> None:
        """A rule with these right sides as alternatives; their words become known."""
        right = " | ".join(dict.fromkeys(rights)) or "NOTHING"
        for word in re.findall(r"<([^>]+)>", right):
            self._words.setdefault(word, f"W{len(self._words)}")
        self._rules.append(f"{name}: {right}")

    # The lexicon -------------------------------------------------------------------------------

    def _write_lexicon(self) -> None:
        lexicon = read_lexicon()
        for name, words in lexicon.sets.items():
            self._rule(f"s_{name}", map(self._pattern, words))
        for name, entry in lexicon.verbs.items():
            self._rule(f"v_{name}", map(self._pattern, entry.words))
        for name, words in lexicon.things.items():
            said = f"word_{name}"
            self._rule(said, map(self._pattern, words))
            self._rule(f"t_{name}", [f"article? {said} (<of> noun)?", f"noun WHOSE {said}"])
        nouns = [word for entry in lexicon.nouns for word in entry.words]
        self._rule("noun_word", map(self._pattern, nouns))
        self._keyed("article", lexicon.articles)
        self._keyed("pronoun", lexicon.pronouns)
        adjectives = [word for entry in lexicon.adjectives for word in entry.words]
        self._rule("adjective", map(self._pattern, adjectives))
        colours = [word for words in lexicon.colours.values() for word in words]
        self._rule("colour_word", map(self._pattern, colours))
        numbers = [word for _, words in lexicon.numbers for word in words]
        self._rule("number_word", map(self._pattern, numbers))
        whole = [w for n, words in lexicon.numbers for w in words if n >= 2 and n.denominator == 1]
        self._rule("count_word", map(self._pattern, whole))
        for kind, table in lexicon.units.items():
            self._counted(f"unit_{kind}", [words for _, words in table])
        self._rule("day_word", map(self._pattern, lexicon.day))
        self._rule("clock_word", map(self._pattern, lexicon.clock))
        self._counted("state", [entry.verb for entry in lexicon.states], "relation")
        self._counted("relation", [entry.relation for entry in lexicon.states])

    def _keyed(self, name: str, table: Mapping[str, Sequence[str]]) -> None:
        for key, words in table.items():
            self._rule(f"{name}_{key}", map(self._pattern, words))
        self._rule(name, [f"{name}_{key}" for key in table])

    def _counted(self, name: str, entries: Sequence[Sequence[str]], *others: str) -> None:
        """One rule for each entry that has words, by its number, and one for any of them, or of
        other rules.
        """
        there = [number for number, words in enumerate(entries) if words]
        for number in there:
            self._rule(f"{name}_{number}", map(self._pattern, entries[number]))
        self._rule(name, [*(f"{name}_{number}" for number in there), *others])

    def _pattern(self, text: str) -> str:
        """A pattern of the lexicon as the right side of a rule."""
        return " ".join(self._symbol(piece) for piece in text.split())

    def _symbol(self, piece: str) -> str:
        optional = "?" if piece.endswith("?") else ""
        piece = piece.removesuffix("?")
        if piece.startswith("{"):
            name = piece.strip("{}")
            return _SYMBOLS.get(name, name) + optional
        if piece.startswith("$"):
            prefix = "v_" if piece[1:] in read_lexicon().verbs else "s_"
            return prefix + piece[1:] + optional
        words = piece.split("|")
        if len(words) == 1:
            return f"<{piece}>{optional}"
        # A separate rule, because the parser library would expand the brackets.
        if piece not in self._either:
            self._either[piece] = f"either_{len(self._either)}"
            self._rule(self._either[piece], [f"<{word}>" for word in words])
        return self._either[piece] + optional

    # Phrases -----------------------------------------------------------------------------------

    def _write_phrases(self, activities: Iterable[Activity]) -> tuple[tuple[Spoken, ...], ...]:
        """Rules for the phrases after their subject, and the meaning of each rule."""
        reader = PhraseReader(dict(self._words))
        tables: dict[str, dict[str, list[Spoken]]] = {"activity": {}, "whole": {}}
        for activity in activities:
            for phrase in activity.phrases:
                for spoken, rest in reader.read(activity, phrase):
                    for symbols in reader.ways(rest, spoken.is_short):
                        name = "activity" if spoken.has_subject else "whole"
                        head = "" if spoken.has_subject else f"{symbols[0]} polarity? "
                        right = head + " ".join(symbols[0 if spoken.has_subject else 1 :])
                        meant = tables[name].setdefault(right, [])
                        if spoken not in meant:
                            meant.append(spoken)
        found: list[tuple[Spoken, ...]] = []
        for name, table in tables.items():
            first = len(found)
            for number, right in enumerate(table, first):
                self._rule(f"{name}_{number}", [right])
            found += [tuple(meant) for meant in table.values()]
            self._rule(name, [f"{name}_{number}" for number in range(first, len(found))])
        return tuple(found)

    def _with_tokens(self) -> list[str]:
        """The rules with tokens for words."""
        forms: dict[str, list[str]] = {}
        for word in self._words:
            for base in base_forms(word):
                if base in self._words:
                    forms.setdefault(base, []).append(word)

        def token(found: re.Match) -> str:
            name = self._words[found[1]]
            return f"form_{name.lower()}" if found[1] in forms else name

        rules = [re.sub(r"<([^>]+)>", token, rule) for rule in self._rules]
        for word, others in forms.items():
            names = " | ".join(self._words[form] for form in (word, *others))
            rules.append(f"form_{self._words[word].lower()}: {names}")
        return [_without_repeats(rule) for rule in rules]


def _without_repeats(rule: str) -> str:
    """A rule with distinct alternatives; those in brackets are left unchanged."""
    name, right = rule.split(": ", 1)
    return rule if "(" in right else f"{name}: {' | '.join(dict.fromkeys(right.split(' | ')))}"
