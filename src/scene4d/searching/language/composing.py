"""Sentences as activities: roles for nouns, terms for states, phases for what comes in order."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from scene4d.core.errors import InputError
from scene4d.searching.language.doing import Doing
from scene4d.searching.language.pieces import Piece, during, in_order, state, throughout
from scene4d.searching.language.reading import options_of
from scene4d.searching.language.referents import Discourse
from scene4d.searching.language.saying import Saying
from scene4d.searching.language.sentences import Chain, Choice, Clause, Done, Joined, Said, Span
from scene4d.searching.language.words import refuse


@dataclass(frozen=True)
class Composer:
    """Puts a search together; of several readings the likeliest that makes sense is taken, and
    the reader is told of the others.
    """

    text: str
    assumed: Mapping[str, float]

    def compose(self, order: Chain | Choice, discourse: Discourse) -> tuple[Piece, Discourse]:
        """The search as one piece. Raises :class:`InputError` where no reading makes sense."""
        return self._chosen(order, discourse, self._chain)

    def _chain(self, chain: Chain, discourse: Discourse) -> tuple[Piece, Discourse]:
        whole, discourse = self._step(chain.steps[0], discourse)
        for step, pause, word in zip(chain.steps[1:], chain.pauses, chain.words, strict=True):
            piece, discourse = self._step(step, discourse)
            if pause is None:
                pause = self.assumed["then_s" if word == "then" else "before_s"]
                discourse = discourse.noted(
                    f'"{word}" is taken as at most {pause:g} s later; say for example '
                    f'"{_with_pause(word)}" for another pause'
                )
            whole = in_order(whole, piece, pause)
        return whole, discourse

    def _step(self, step: Joined | Chain | Choice, discourse: Discourse) -> tuple[Piece, Discourse]:
        def either(node: Joined | Chain, known: Discourse) -> tuple[Piece, Discourse]:
            return (
                self._chain(node, known) if isinstance(node, Chain) else self._joined(node, known)
            )

        return self._chosen(step, discourse, either)

    def _joined(self, joined: Joined, discourse: Discourse) -> tuple[Piece, Discourse]:
        whole, discourse = self._clause(joined.clauses[0], discourse)
        begin = _span(joined.clauses[0])[0]
        for clause, link in zip(joined.clauses[1:], joined.links, strict=True):
            piece, discourse = self._clause(clause, discourse)
            whole, note = self._together(whole, piece, link, (begin, _span(clause)[1]))
            discourse = discourse.noted(note) if note else discourse
        return whole, discourse

    def _together(self, first: Piece, second: Piece, link: str, span: Span) -> tuple[Piece, str]:
        """Two pieces at the same time, or in order where "and" cannot mean that."""
        if link == "while":
            return self._while(first, second, span), ""
        if first.is_event and second.is_event:
            return self._and_then(first, second)
        if first.is_event or second.is_event:
            event, other = (first, second) if first.is_event else (second, first)
            if other.is_instant or other.is_timed:
                return self._and_then(first, second)
            return throughout(event, other.terms), ""
        if self._is_moment_in(first, second) or self._is_moment_in(second, first):
            return self._and_then(first, second)
        return self._merged(first, second, span), ""

    def _while(self, first: Piece, second: Piece, span: Span) -> Piece:
        """Two pieces at the same time: the shorter within the longer where they cannot be one."""
        for inner, outer in ((first, second), (second, first)):
            if self._is_moment_in(inner, outer):
                return during(inner, outer)
            if inner.is_event and not outer.is_event and not outer.is_instant:
                return during(inner, outer) if outer.is_timed else throughout(inner, outer.terms)
            if inner.is_instant and outer.is_event and len(outer.phases) == 1:
                return during(inner, outer)
        if first.is_event or second.is_event:
            raise refuse(
                self.text,
                span[0],
                '"while" needs a state that lasts at one of its sides, such as "is near a vehicle"',
            )
        return self._merged(first, second, span)

    def _is_moment_in(self, inner: Piece, outer: Piece) -> bool:
        """Whether one is a moment, and the other a state that is said to last longer."""
        longer = outer.least_s is not None and outer.least_s > self.assumed["instant_max_s"]
        return inner.is_instant and not outer.is_instant and not outer.is_event and longer

    def _and_then(self, first: Piece, second: Piece) -> tuple[Piece, str]:
        pause = self.assumed["then_s"]
        note = (
            f'"and" between "{first.label}" and "{second.label}" is taken as "then", at most '
            f'{pause:g} s later; say "then", or "is ..." for what is so at the same time'
        )
        return in_order(first, second, pause), note

    def _merged(self, first: Piece, second: Piece, span: Span) -> Piece:
        """Two states that hold together, as long as both may."""
        least = [s for s in (first.least_s, second.least_s) if s is not None]
        most = [s for s in (first.most_s, second.most_s) if s is not None]
        if least and most and max(least) > min(most):
            raise refuse(
                self.text,
                span[0],
                f"impossible duration: at least {max(least):g} s and at most {min(most):g} s",
            )
        return state(
            (*first.terms, *second.terms),
            self.assumed,
            least_s=max(least, default=None),
            most_s=min(most, default=None),
            is_instant=first.is_instant or second.is_instant,
        )

    # Clauses --------------------------------------------------------------------------------------

    def _clause(self, clause: Clause | Choice, discourse: Discourse) -> tuple[Piece, Discourse]:
        """The reading that is meant: an activity, unless "is" or "not" ask for a state."""
        tried: list[tuple[tuple[int, int], Piece, Discourse]] = []
        failed: list[InputError] = []
        for option in options_of(clause):
            for core in options_of(option.core):
                reading = replace(option, core=core)
                try:
                    piece, known = self._read(reading, discourse)
                except InputError as error:
                    failed.append(error)
                else:
                    tried.append((_rank(reading), piece, known))
        if not tried:
            raise failed[0]
        tried.sort(key=lambda item: item[0])
        _, piece, known = tried[0]
        others = {other.label for _, other, _ in tried[1:]} - {piece.label}
        if others:
            said = self.text[slice(*_span(clause))]
            listed = ", ".join(f'"{name}"' for name in sorted(others))
            known = known.noted(f'"{said}" is taken as "{piece.label}"; it could be {listed}')
        return piece, known

    def _read(self, clause: Clause, discourse: Discourse) -> tuple[Piece, Discourse]:
        if isinstance(clause.core, Done):
            return Doing(self.text, self.assumed).read(clause, clause.core, discourse)
        assert isinstance(clause.core, Said)
        return Saying(self.text, self.assumed).read(clause, clause.core, discourse)

    def _chosen(
        self,
        node: Chain | Joined | Choice,
        discourse: Discourse,
        read: Callable[[Any, Discourse], tuple[Piece, Discourse]],
    ) -> tuple[Piece, Discourse]:
        """The first reading that makes sense; a note where another means something else."""
        found: list[tuple[Piece, Discourse]] = []
        failed: list[InputError] = []
        for option in options_of(node):
            try:
                found.append(read(option, discourse))
            except InputError as error:
                failed.append(error)
        if not found:
            raise failed[0]
        piece, known = min(found, key=lambda item: len(item[1].people))
        others = {other.label for other, _ in found} - {piece.label}
        if others:
            listed = ", ".join(f'"{name}"' for name in sorted(others))
            known = known.noted(f'it is taken as "{piece.label}"; it could be {listed}')
        return piece, known


def _rank(clause: Clause) -> tuple[int, int]:
    """Smaller is likelier: what is preferred here, then the reading with fewer loose parts."""
    wants_state = clause.polarity.is_denied or clause.polarity.is_state
    return (int(isinstance(clause.core, Done) == wants_state), len(clause.modifiers))


def _span(clause: Clause | Choice) -> Span:
    return options_of(clause)[0].span


def _with_pause(word: str) -> str:
    return "then within 10 seconds" if word == "then" else f"within 10 seconds {word}"
