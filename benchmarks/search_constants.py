"""How much the constants of a search matter, on the two MEVA cameras that they were chosen on.

    python -m benchmarks.search_constants [--data DIR]

DIR holds meva/. Each constant is halved and doubled (shares: moved by 0.1), alone; printed is the
mean over the labelled activities of the average precision. What hardly moves it needs no other
provenance than "chosen by hand".
"""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from unittest.mock import patch

from benchmarks import options_of
from scene4d.core.progress import Silent
from scene4d.evaluation._options import TUNED
from scene4d.evaluation.datasets import _meva as meva
from scene4d.evaluation.trials._ways import OURS, Seen, ranked
from scene4d.evaluation.trials.activities import labelled_activities
from scene4d.searching.activities import _compose as compose
from scene4d.searching.activities import _evidence as evidence
from scene4d.searching.activities import identity

CONSTANTS = (
    (compose, "STRETCH", (0.02, 0.08)),
    (compose, "MOST_GAIN", (0.25, 1.0)),
    (evidence, "FLOOR", (0.005, 0.02)),
    (evidence, "_UNJUDGED", (0.25, 1.0)),
    (identity, "_SAME_BOX", (0.5, 0.7)),
    (identity, "_SAME_SHARE", (0.6, 0.8)),
    (identity, "_RESUMED_S", (0.5, 2.0)),
)


def precision(clips: Sequence[meva.Clip]) -> float:
    """Mean average precision over the activities, of the clips' tracks as they are united now."""
    united = [replace(clip, stage=identity.unite_tracks(clip.stage)) for clip in clips]
    seen = Seen(OURS, 1.0, united)
    found = [ranked(seen.events(one)).average_precision for one in labelled_activities().values()]
    known = [value for value in found if value is not None]
    return sum(known) / len(known)


def main() -> None:
    parser = options_of(__doc__)
    arguments = parser.parse_args()
    with patch.object(meva, "unite_tracks", lambda stage, _: stage):
        clips = meva.meva_clips(arguments.data / "meva", TUNED, Silent())
    print(f"as it is: {precision(clips):.3f}", flush=True)
    for module, name, values in CONSTANTS:
        for value in values:
            with ExitStack() as changed:
                for place in (module, compose):  # compose looks at FLOOR, too
                    if hasattr(place, name):
                        changed.enter_context(patch.object(place, name, value))
                print(f"{name} {value:g}: {precision(clips):.3f}", flush=True)


if __name__ == "__main__":
    main()
