"""How well activities are found on the two MEVA cameras that constants are chosen on.

    python -m benchmarks.meva_activities [--data DIR] [--activity NAME ...] [--ours]
                                         [--without PREDICATE ...] [--outline TAU]

DIR holds meva/. With --ours the baselines are left out, with --without what activities say by these
predicates, in phases that say more; with --outline whatever is near is within TAU metres of the
other's outline. The cameras that `scene4d evaluate meva`
reports are never looked at: this is what constants may be chosen by.
"""

import time
from dataclasses import replace

from benchmarks import options_of
from scene4d.core.progress import Silent
from scene4d.evaluation._options import TUNED
from scene4d.evaluation.datasets._meva import meva_clips
from scene4d.evaluation.trials._ways import METHODS, OURS, Seen, label_length_s, ranked
from scene4d.evaluation.trials.activities import FALSE_PER_MINUTE, labelled_activities


def main() -> None:
    parser = options_of(__doc__)
    parser.add_argument("--activity", nargs="*", default=None)
    parser.add_argument("--ours", action="store_true")
    parser.add_argument("--without", nargs="*", default=[])
    parser.add_argument("--outline", type=float, default=None)
    arguments = parser.parse_args()
    begun = time.perf_counter()
    clips = meva_clips(arguments.data / "meva", TUNED, Silent())
    print(f"cameras {' '.join(TUNED)}: {len(clips)} clips in {time.perf_counter() - begun:.1f} s")
    activities = {
        name: to_outline(without(one, arguments.without), arguments.outline)
        for name, one in labelled_activities().items()
        if arguments.activity is None or name in arguments.activity
    }
    show(clips, activities, (OURS,) if arguments.ours else METHODS)


def without(activity, predicates):
    """The activity without what it says by these predicates, where a phase says more."""
    phases = []
    for phase in activity.phases:
        left = tuple(term for term in phase.terms if term.predicate not in predicates)
        phases.append(replace(phase, terms=left or phase.terms))
    return replace(activity, phases=tuple(phases))


def to_outline(activity, tau_m):
    """The activity with distances to outlines for those between middles, as soft as these."""
    if tau_m is None:
        return activity
    phases = []
    for phase in activity.phases:
        terms = (
            replace(term, predicate="beside", parameters={"tau_m": tau_m, "sigma_m": 1.0})
            if term.predicate == "near"
            else term
            for term in phase.terms
        )
        phases.append(replace(phase, terms=tuple(terms)))
    return replace(activity, phases=tuple(phases))


def show(clips, activities, methods) -> None:
    """One line per activity: labels; average precision by NIST's rule and by half of the time in
    common, and misses at 0.15 and 0.02 a minute.
    """
    means = {}
    ways = {}
    for method in methods:
        for value in method.tried:
            title = f"{method.name} {value:g}" if method.setting else method.name
            ways[title] = Seen(method, value, clips)
    for name, activity in activities.items():
        cells = [str(sum(len(clip.label_s(activity.labels)) for clip in clips))]
        for title, seen in ways.items():
            events = seen.events(activity, label_length_s(clips, activity))
            found = None if events is None else ranked(events)
            if found is None or found.average_precision is None:
                cells.append(f"{title} -")
                continue
            half = ranked(events, "IoU 0.5").average_precision
            means.setdefault(title, []).append((found.average_precision, half))
            missed = [f"{found.det.missed_at(rate):.2f}" for rate in FALSE_PER_MINUTE]
            cells.append(f"{title} {found.average_precision:.2f} {half:.2f} ({' '.join(missed)})")
        print(f"{name:26s} {'  '.join(cells)}", flush=True)
    for title, values in means.items():
        nist, half = (sum(v) / len(v) for v in zip(*values, strict=True))
        print(f"mean {title} {nist:.3f}, at half of the time in common {half:.3f}")


if __name__ == "__main__":
    main()
