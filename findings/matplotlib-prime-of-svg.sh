#!/bin/sh
# matplotlib 3.11.2: with `svg.fonttype` "none" the prime of a formula is written as a raised 0.
#
# With the default fonts, and with `mathtext.fontset` "cm", the prime of "$f'(x)$" is taken from the font
# cmsy10, in which it has the place of the digit 0. The SVG has that digit as text in a font that hardly any
# browser or editor has: f to the power of zero is shown. With "stix" it is U+2032 as it should be.
#
# What it means for figures with derivatives or primed symbols: write the letter U+2032 in place of the
# apostrophe, or choose "stix".
set -eu
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check numpy==2.4.6 matplotlib==3.11.2
MPLBACKEND=svg MPLCONFIGDIR="$work" "$work/venv/bin/python" - <<'PYTHON'
import io
import sys
from importlib.metadata import version
from xml.etree import ElementTree

import matplotlib
from matplotlib.figure import Figure


def prime(text, fonts):
    """What stands for the prime in the SVG of a formula, and the style of its font."""
    matplotlib.rcParams.update({"svg.fonttype": "none", "mathtext.fontset": fonts})
    figure = Figure()
    figure.text(0.1, 0.5, text)
    file = io.StringIO()
    figure.savefig(file, format="svg")
    spans = [span for span in ElementTree.fromstring(file.getvalue()).iter() if "tspan" in span.tag]
    (found,) = (span for span in spans if span.text not in ("f", "x", "(", ")"))
    return found.text, "cmsy10" in found.get("style", "")


print(f"matplotlib {version('matplotlib')}")
found = {fonts: prime("$f'(x)$", fonts) for fonts in ("dejavusans", "cm", "stix")}
for fonts, (letter, cm) in found.items():
    print(f"{fonts}: the prime is U+{ord(letter):04X}" + (" in cmsy10" if cm else ""))
letter = prime("$f\N{PRIME}(x)$", "dejavusans")
print(f"written as U+2032: U+{ord(letter[0]):04X}")
wrong = found["dejavusans"] == found["cm"] == ("0", True)
if not (wrong and found["stix"] == ("\N{PRIME}", False) and letter == ("\N{PRIME}", False)):
    sys.exit("the behaviour has changed: look again at what is said above")
PYTHON
