#!/bin/sh
# Linux (6.x) with CPython's subprocess: the peak memory of a child, `ru_maxrss` of wait4, is that of
# the process that started it, even of memory that this one has freed.
#
# A process of 10 MB starts /bin/true: 10 MB. It fills 400 MB and starts /bin/true: 400 MB. It frees
# them and starts /bin/true: still 400 MB by subprocess and posix_spawn, 10 MB by fork and exec.
#
# Where it comes from: at exec the kernel takes the highest resident size of the old image over into
# the counts of the process. After vfork, which subprocess and posix_spawn use, the old image is that
# of the parent, with its own highest size; after fork it is a copy, with what is resident then. The
# manual pages of getrusage and of Python's `resource` do not say so.
#
# What it means for benchmarks: all children of a large process seem to need the same, and what a
# change saves does not show. Start them from a small process, which reads `ru_maxrss` (GNU time is
# one), or read VmHWM of /proc/PID/status before the end.
set -eu
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cat >"$work/parent.py" <<'PARENT'
import os
import platform
import subprocess
import sys

LARGE = 400
PROGRAM = "/bin/true"


def by_subprocess():
    process = subprocess.Popen([PROGRAM])
    process.returncode = 0
    return process.pid


def by_spawn():
    return os.posix_spawn(PROGRAM, [PROGRAM], {})


def by_fork():
    child = os.fork()
    if not child:
        os.execv(PROGRAM, [PROGRAM])
    return child


def in_between():
    """By a small process, which says what its child needed."""
    code = f"""import os
child = os.posix_spawn({PROGRAM!r}, [{PROGRAM!r}], {{}})
print(os.wait4(child, 0)[2].ru_maxrss)"""
    run = subprocess.run([sys.executable, "-S", "-c", code], capture_output=True, check=True)
    return int(run.stdout) / 1024


def peaks(state):
    """Peak memory [MB] of the program, as wait4 gives it, by how it was started."""
    found = {}
    for start in (by_subprocess, by_spawn, by_fork):
        found[start.__name__] = os.wait4(start(), 0)[2].ru_maxrss / 1024
    found["in_between"] = in_between()
    print(state, ", ".join(f"{name} {size:.0f}" for name, size in found.items()), "MB")
    return found


print(f"Python {platform.python_version()}, Linux {platform.release()}: {PROGRAM} seems to need")
small = peaks("of a small parent:")
filled = bytearray(b"x") * (LARGE * 2**20)
large = peaks("of a large parent:")
del filled
freed = peaks("of one that freed it:")
least = 0.9 * LARGE
if not (
    max(small.values()) < 60
    and min(large[name] for name in ("by_subprocess", "by_spawn", "by_fork")) > least
    and min(freed[name] for name in ("by_subprocess", "by_spawn")) > least
    and max(freed["by_fork"], large["in_between"], freed["in_between"]) < 60
):
    sys.exit("the behaviour has changed: look again at what is said above")
PARENT
python3 "$work/parent.py"
