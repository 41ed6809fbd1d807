#!/bin/sh
# sleap-io 0.9.5: `Skeleton(nodes)` takes over the list of names that it is given and puts nodes
# into it. Two skeletons of one list are one.
#
# Of `names = ["ball", "racket"]`, a list of texts, `Skeleton(names)` leaves a list of `Node`. A
# second skeleton of the same list has the same nodes: one that is renamed or added in the first is
# renamed or added in the second.
#
# What it means for films of a ball: skeletons of several films, made from one list of parts, change
# together. Pass a list of their own: `Skeleton([*names])`.
set -eu
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check \
    numpy==2.4.6 pandas==3.1.1 sleap-io==0.9.5
"$work/venv/bin/python" -W ignore - <<'EOF'
import sys
from importlib.metadata import version

import sleap_io


def second_after_changes(of_second):
    """Names of a skeleton after the first one of the same names is changed, and of the list."""
    names = ["ball", "racket"]
    first = sleap_io.Skeleton(names)
    second = sleap_io.Skeleton(of_second(names))
    first.rename_node("ball", "shuttle")
    first.add_node("net")
    return second.node_names, [type(name).__name__ for name in names]


print(f"sleap-io {version('sleap-io')}; in the first skeleton ball becomes shuttle, net is added")
shared, kinds = second_after_changes(lambda names: names)
print(f"second of the same list: {shared}; the list of texts now holds {kinds}")
apart, _ = second_after_changes(lambda names: ["ball", "racket"])
print(f"second of a list of its own: {apart}")
is_right = apart == ["ball", "racket"]
if not (is_right and shared == ["shuttle", "racket", "net"] and "str" not in kinds):
    sys.exit("the behaviour has changed: look again at what is said above")
EOF
