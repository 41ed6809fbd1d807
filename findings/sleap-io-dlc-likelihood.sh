#!/bin/sh
# sleap-io 0.9.5: `save_csv(labels, file, format="dlc")` leaves all likelihoods empty, and calls
# every video that is not at hand `video`.
#
# The table has a column `likelihood` (`include_score` is on), but points are taken without their
# scores. Pictures are named after the video if it is true, which it is not where the film is on
# another disk, since it then has no frames. Labels of two such films become rows of the same names.
# Other layouts of `save_csv` have scores and paths.
#
# What it means for films of a ball: frames that were guessed are not left out, and films that were
# labelled together cannot be told apart. Use `format="instances"`.
set -eu
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check \
    numpy==2.4.6 pandas==3.1.1 sleap-io==0.9.5
cd "$work"
"$work/venv/bin/python" -W ignore - <<'EOF'
import sys
from importlib.metadata import version

import numpy as np
import pandas as pd
import sleap_io

SCORE = 0.25
skeleton = sleap_io.Skeleton(["ball"])
track = sleap_io.Track("ball")
frames = []
for film in ("clay.mp4", "grass.mp4"):
    video = sleap_io.Video(filename=film, open_backend=False)
    instance = sleap_io.PredictedInstance.from_numpy(
        points_data=np.array([[10.0, 20.0]]),
        skeleton=skeleton,
        point_scores=np.array([SCORE]),
        score=SCORE,
        track=track,
    )
    frames.append(sleap_io.LabeledFrame(video=video, frame_idx=3, instances=[instance]))
labels = sleap_io.Labels(frames)
sleap_io.save_csv(labels, "dlc.csv", format="dlc", include_score=True)
sleap_io.save_csv(labels, "instances.csv", format="instances", include_score=True)
dlc = pd.read_csv("dlc.csv", header=[0, 1, 2], index_col=0)
instances = pd.read_csv("instances.csv")
likelihood = dlc.xs("likelihood", axis=1, level=2).to_numpy().ravel()
print(f"sleap-io {version('sleap-io')}; a score of {SCORE} in a frame of each of two films")
print(f"dlc: likelihoods {likelihood}, rows {[*dlc.index]}")
print(f"instances: scores {[*instances['ball.score']]}, films {[*instances['video_path']]}")
is_right = (instances["ball.score"] == SCORE).all() and instances["video_path"].nunique() == 2
if not (is_right and np.isnan(likelihood).all() and dlc.index.nunique() == 1):
    sys.exit("the behaviour has changed: look again at what is said above")
EOF
