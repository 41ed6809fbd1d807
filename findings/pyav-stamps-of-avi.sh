#!/bin/sh
# PyAV 18.1.0: frames of H.264 with B-frames in AVI come in order, with stamps that are not.
#
# AVI has no presentation stamps. FFmpeg gives each frame the stamp of the packet with which it came
# out of the decoder: of 20 frames at 240/s, written and read by PyAV, the order of stamps is 1, 4,
# 3, 5, 2 and so on. Frames themselves come in the right order, and of MP4 both do.
#
# What it means for a tracker: sorting frames of an AVI by their stamps shuffles them. Count them
# where stamps go back.
set -eu
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check numpy==2.4.6 av==18.1.0
cd "$work"
"$work/venv/bin/python" - <<'EOF'
import sys

import av
import numpy as np

COUNT = 20


def written(name):
    """Write frames with a bright column that moves to the right; read stamps and columns."""
    with av.open(name, "w") as container:
        stream = container.add_stream("libx264", rate=240)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for k in range(COUNT):
            picture = np.zeros((48, 64, 3), np.uint8)
            picture[:, 3 * k : 3 * k + 3] = 255
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, "rgb24")))
        container.mux(stream.encode())
    with av.open(name) as container:
        frames = [
            (frame.pts, int(np.argmax(frame.to_ndarray(format="gray").sum(axis=0))))
            for frame in container.decode(video=0)
        ]
    return frames


print(f"av {av.__version__}, FFmpeg libavcodec {av.library_versions['libavcodec']}")
ordered = {}
for name in ("film.mp4", "film.avi"):
    stamps, columns = zip(*written(name))
    ordered[name] = (sorted(stamps) == list(stamps), sorted(columns) == list(columns))
    print(f"{name}: stamps {stamps[:8]}, frames in order: {ordered[name][1]}")
found = ordered == {"film.mp4": (True, True), "film.avi": (False, True)}
print("as described" if found else "it is no longer so")
sys.exit(not found)
EOF
