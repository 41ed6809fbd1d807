#!/bin/sh
# opencv-python-headless 5.0.0.93: CAP_PROP_FPS is frames over duration, not one over a step.
#
# Of a film whose camera took 240 frames a second and dropped every fourth, stamps are 1/240 s and
# 2/240 s apart. CAP_PROP_FPS says about 180 frames a second, CAP_PROP_POS_MSEC has the stamps.
# Android's tag with the rate of the camera cannot be asked for at all.
#
# What it means for a tracker: frames divided by CAP_PROP_FPS are times that are wrong between the
# first and the last frame, here by up to 4 ms, and speeds are three quarters of what they were over
# single steps. Take the stamps.
set -eu
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check \
    numpy==2.4.6 av==18.1.0 opencv-python-headless==5.0.0.93
cd "$work"
"$work/venv/bin/python" - <<'EOF'
import sys
from fractions import Fraction

import av
import cv2
import numpy as np

TICKS = [k for k in range(120) if k % 4 != 3]
with av.open("film.mp4", "w") as container:
    stream = container.add_stream("libx264", rate=240)
    stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
    stream.codec_context.time_base = Fraction(1, 240)
    for k in TICKS:
        frame = av.VideoFrame.from_ndarray(np.full((48, 64, 3), k, np.uint8), "rgb24")
        frame.pts, frame.time_base = k, Fraction(1, 240)
        container.mux(stream.encode(frame))
    container.mux(stream.encode())
film = cv2.VideoCapture("film.mp4")
rate = film.get(cv2.CAP_PROP_FPS)
stamps = []
while film.grab():
    stamps.append(film.get(cv2.CAP_PROP_POS_MSEC))
step = float(np.median(np.diff(stamps)))
print(f"opencv {cv2.__version__}, {len(stamps)} frames")
print(f"CAP_PROP_FPS {rate:.1f}/s, one over the median step of stamps {1e3 / step:.1f}/s")
found = abs(rate - 180.0) < 4.0 and abs(1e3 / step - 240.0) < 1.0
print("as described" if found else "it is no longer so")
sys.exit(not found)
EOF
