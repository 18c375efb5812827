"""Run a command: python -S benchmarks/launch.py FILE COMMAND ...

Writes [seconds, seconds of all its threads, most memory in MB] into FILE. In a process of its own:
on Linux a process inherits the peak of memory of the one that starts it, and this one is small.
"""

import os
import sys
import time

if __name__ == "__main__":
    file, *command = sys.argv[1:]
    begun = time.perf_counter()
    pid = os.posix_spawn(command[0], command, os.environ)
    _, status, used = os.wait4(pid, 0)
    taken = time.perf_counter() - begun
    with open(file, "w") as out:  # noqa: PTH123  (pathlib takes a while to import)
        out.write(f"[{taken}, {used.ru_utime + used.ru_stime}, {used.ru_maxrss / 1024}]")
    sys.exit(os.waitstatus_to_exitcode(status))
