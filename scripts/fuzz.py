"""Spoilt files and odd searches for as long as there is time: python scripts/fuzz.py [--minutes 10]

Every reader gets its good file, spoilt anew each time (tests/fuzzing.py), and the search language
gets sentences made of its words and of pieces of its phrases. Each kind runs in a process of its
own with 6 GB of memory, so a crash, a hang (20 s for a file of kilobytes) and a flood of memory are
seen too. What went wrong is kept below --keep, with the traceback; the exit status is 1 then.
"""

import argparse
import multiprocessing
import os
import random
import resource
import shutil
import sys
import tempfile
import time
import traceback
import warnings
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "src")]

from fuzzing import SAMPLES, misread, spoilt  # noqa: E402
from scene4d.core.errors import InputError  # noqa: E402

HANGS_S = 20.0
MEMORY = 6 << 30
WORDS = "search words"
MOST_FAULTS = 5
"""Of one kind, after which it is left."""


def read_spoilt(name: str, folder: Path, seed: int, until_s: float, news) -> None:
    sample, rng = SAMPLES[name], random.Random(f"{name} {seed}")
    path = sample.make(folder)
    good = path.read_bytes()
    kept = folder / "case"
    while time.monotonic() < until_s:
        content = spoilt(good, rng)
        if rng.random() < 0.2:
            content = spoilt(content, rng)
        kept.write_bytes(content)
        path.write_bytes(content)
        news.send(misread(sample.read, path))


def ask_oddly(_: str, folder: Path, seed: int, until_s: float, news) -> None:
    from scene4d.searching.activities.catalogue import load_catalogue
    from scene4d.searching.language import explain, parse_query
    from scene4d.searching.language._grammar import build_grammar

    known = load_catalogue()
    phrases = [phrase.split() for one in known.values() for phrase in one.phrases]
    lines = (ROOT / "benchmarks" / "language.txt").read_text().splitlines()
    phrases += [line.split() for line in lines if line and line[0] not in "#[="]
    words = sorted(build_grammar(known.values()).terminals)
    words += ["10 s", "3 m", "9 pm", "30 km/h", ",", "'s", "gate", "zone gate", '"gate"', "²", "٣"]
    rng = random.Random(seed)
    while time.monotonic() < until_s:
        said = [word for _ in range(rng.randint(1, 3)) for word in rng.choice(phrases)]
        for _ in range(rng.randint(0, 5)):
            at = rng.randrange(len(said) + 1)
            said[at : at + rng.randint(0, 2)] = rng.choices(words, k=rng.randint(0, 2))
        text = " ".join(said)
        (folder / "case").write_text(text)
        try:
            query = parse_query(text, known, zones=["gate"], lines=["kerb"])
            explain(query.activity, query.window, ())
        except InputError as error:
            fits = len(str(error)) < 800 and str(error).startswith(("search", "activity"))
            news.send(None if fits else f"an unreadable message: {error}")
        except Exception as error:  # whatever it is
            news.send(error)
        else:
            news.send(None)


def work(task, name: str, folder: str, seed: int, until_s: float, news) -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    warnings.simplefilter("error", RuntimeWarning)
    with (Path(folder) / "stderr").open("w") as quiet:
        os.dup2(quiet.fileno(), 2)  # decoders in C write there, and so would a crash
    told = _Told(news)
    try:
        task(name, Path(folder), seed, until_s, told)
    except BaseException:  # the script's own fault
        news.send(("broken", traceback.format_exc()))
    news.send(("done", told.cases))


class _Told:
    """Sends faults at once, and that all is well once a second."""

    def __init__(self, news) -> None:
        self.cases, self._news, self._said_s = 0, news, 0.0

    def send(self, fault: Exception | str | None) -> None:
        self.cases += 1
        if isinstance(fault, Exception):
            fault = "".join(traceback.format_exception(fault))
        if fault is not None or time.monotonic() - self._said_s > 1:
            self._said_s = time.monotonic()
            self._news.send(("fault" if fault else "fine", fault))


def watch_over(name: str, seconds: float, seed: int, keep: Path) -> tuple[int, list[str]]:
    """Run one kind; its number of cases and its faults."""
    task = ask_oddly if name == WORDS else read_spoilt
    faults: list[str] = []
    cases = 0
    with tempfile.TemporaryDirectory(prefix="scene4d-fuzz-") as folder:
        mine, theirs = multiprocessing.Pipe(duplex=False)
        until_s = time.monotonic() + seconds
        words = (task, name, folder, seed, until_s, theirs)
        child = multiprocessing.get_context("fork").Process(target=work, args=words)
        child.start()
        theirs.close()
        while len(faults) < MOST_FAULTS:
            try:
                if not mine.poll(HANGS_S):
                    faults.append(f"hangs for {HANGS_S:.0f} s")
                    save(keep, name, folder, faults)
                    break
                kind, what = mine.recv()
            except EOFError:
                child.join()
                faults.append(f"the process died: {child.exitcode}")
                save(keep, name, folder, faults)
                break
            if kind == "done":
                cases = what
                break
            if kind != "fine":
                faults.append(what)
                save(keep, name, folder, faults)
        child.kill()
        child.join()
    return cases, faults


def save(keep: Path, name: str, folder: str, faults: list[str]) -> None:
    """The case and what happened."""
    keep.mkdir(parents=True, exist_ok=True)
    base = keep / f"{name.replace('/', '_').replace(' ', '-').replace('*', '')}-{len(faults)}"
    base.with_suffix(".txt").write_text(faults[-1])
    if (Path(folder) / "case").exists():
        shutil.copy(Path(folder) / "case", base.with_suffix(".case"))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="kinds whose name begins so")
    parser.add_argument("--keep", type=Path, default=Path("out") / "fuzz")
    given = parser.parse_args()
    names = [name for name in [*SAMPLES, WORDS] if name.startswith(given.only)]
    seconds = given.minutes * 60 / len(names)
    total = wrong = 0
    for name in names:
        cases, faults = watch_over(name, seconds, given.seed, given.keep)
        total, wrong = total + cases, wrong + len(faults)
        last = f": {faults[-1].strip().splitlines()[-1][:150]}" if faults else ""
        print(f"{name:36}{cases:8} cases{len(faults):4} faults{last}", flush=True)
    print(f"{total} cases, {wrong} faults{f', kept in {given.keep}' if wrong else ''}")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
