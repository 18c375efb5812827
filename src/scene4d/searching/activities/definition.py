"""What an activity is: roles, and phases of predicates in time."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

from scene4d.searching.predicates._when import When

ALLEN = (
    "before", "meets", "overlaps", "starts", "during", "finishes", "equals",
    "after", "met_by", "overlapped_by", "started_by", "contains", "finished_by",
)  # fmt: skip
"""Relations of two intervals (Allen 1983)."""


@dataclass(frozen=True)
class Role:
    """A part in an activity: who may play it. ``classes`` are those of :data:`tracks.CLASSES`.

    Where ``count`` is more than one, at least so many play it at the same time, and one of them
    throughout; where it is ``exactly`` so many, no more; where it is ``absent``, nobody does.
    """

    name: str
    classes: tuple[str, ...]
    count: int = 1
    exactly: bool = False
    absent: bool = False

    @property
    def is_counted(self) -> bool:
        """Whether it matters how many play it."""
        return self.count > 1 or self.exactly

    @property
    def how_many(self) -> str:
        """How many play it at the same time."""
        return f"{'exactly' if self.exactly else 'at least'} {self.count}"


@dataclass(frozen=True)
class Term:
    """A predicate of one to three roles, with its parameters; ``negated`` asks for its opposite."""

    predicate: str
    roles: tuple[str, ...]
    parameters: Mapping[str, float | str] = field(default_factory=dict)
    negated: bool = False


@dataclass(frozen=True)
class Phase:
    """An interval in which all terms hold, lasting from ``min_s`` to ``max_s``.

    ``gap_s`` is the longest pause between the phase before it and this one. ``unseen_s`` says how
    long it goes on before its first and after its last moment while nothing of it is seen (a door
    is opened from inside, and shut): an event that begins or ends with it is so much longer.
    """

    name: str
    terms: tuple[Term, ...]
    min_s: float = 0.0
    max_s: float = float("inf")
    gap_s: float = 0.0
    unseen_s: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Relation:
    """How two phases lie in time (:data:`ALLEN`), where that is not one after the other."""

    first: str
    relation: str
    second: str


@dataclass(frozen=True)
class Spot:
    """Where and when another one was: what the role ``doer`` of an ``activity`` did in one
    ``phase`` of it, or in all (None).
    """

    name: str
    activity: "Activity"
    doer: str
    when: When
    phase: str | None = None


@dataclass(frozen=True)
class Activity:
    """Roles, phases in their order, and what is said of it.

    A duration and a place ("stops for 10 s", "meet in zone yard") are said of the phase ``state``,
    or of what is so ``after`` the last phase.
    ``phrases`` are ways to ask for it in words; ``labels`` its names in other people's data (MEVA).
    ``spots`` are what ``near_spot`` names: where others were at other times. Of ``alternatives``
    any will do: roles and spots are then those of all of them, and there are no own phases.
    """

    name: str
    roles: tuple[Role, ...]
    phases: tuple[Phase, ...]
    relations: tuple[Relation, ...] = ()
    phrases: tuple[str, ...] = ()
    labels: tuple[str, ...] = ()
    description: str = ""
    state: str = ""
    after: tuple[Term, ...] = ()
    spots: tuple[Spot, ...] = ()
    alternatives: tuple["Activity", ...] = ()

    @property
    def options(self) -> tuple["Activity", ...]:
        """The alternatives; itself where there are none."""
        return self.alternatives or (self,)

    def option(self, name: str) -> "Activity":
        """The alternative of this name; itself where there are none."""
        return next(one for one in self.options if name == one.name or not self.alternatives)

    @property
    def is_of_nobody(self) -> bool:
        """Whether it is over as soon as somebody plays its role."""
        return any(role.absent for role in self.roles)

    def playable_by(self, classes: Collection[str]) -> bool:
        """Whether there is somebody for every role, of one alternative at least."""
        return any(
            all(role.absent or set(role.classes) & set(classes) for role in one.roles)
            for one in self.options
        )

    @property
    def terms(self) -> tuple[Term, ...]:
        """The terms of all phases."""
        phases = (phase for one in self.options for phase in one.phases)
        return tuple(term for phase in phases for term in phase.terms)

    @property
    def every_term(self) -> tuple[Term, ...]:
        """Those, and the terms of what others did at its spots."""
        return (*self.terms, *(term for spot in self.spots for term in spot.activity.terms))
