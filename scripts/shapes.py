"""Films as the packages write them that people track with, read to the bounce that they show.

`shapes.py --write FOLDER` writes them, in an environment that has the packages of `PACKAGES`.
`shapes.py FOLDER` reads them by fitball, compares the impact with the truth and the header with
that of `SHAPES`, and prints a line for each. `docs/formats.md` has the list.
"""

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

# fitball is not there where films are written.
FloatArray: TypeAlias = NDArray[np.float64]
# The packages, in the versions that wrote the headers of `SHAPES`.
PACKAGES: Mapping[str, str] = {
    "ezc3d": "1.7.2",
    "motmetrics": "1.4.0",
    "movement": "0.15.0",
    "pandas": "3.1.1",
    "sleap-io": "0.9.5",
    "supervision": "0.31.2",
    "tables": "3.11.1",
    "trackpy": "0.7",
}
# Frames a second and millimetres a pixel of the film.
FPS = 240.0
MM_PER_PX = 2.0
# Frames of the film, and those in which the ball is lost.
COUNT = 76
LOST = (8, 9, 15, 40, 41, 52)
FRAME = np.delete(np.arange(COUNT), LOST)
# Speeds before and after the contact [m/s], and the time between both flights [s]; no air.
TRUTH = {"v_x1": 14.0, "v_y1": 6.0, "v_x2": 10.0, "v_y2": 4.8}
CONTACT_TIME = 4.7e-3
# Sd of a position [m], and the farthest that a speed [m/s] may be off the truth: five errors.
NOISE = 5e-4
MOST_OFF = 0.08
GRAVITY = 9.80665
# Half the side of the box around the ball [px].
HALF_BOX = 16.5


class Shape(NamedTuple):
    """A file that a package writes: its name, the package, the call that writes it, how its header
    is written, and what `fitball.track` is told besides the camera.
    """

    file: str
    package: str
    call: str
    header: str
    options: Mapping[str, Any] = {}


SHAPES = (
    Shape(
        "sleap.csv",
        "sleap-io",
        "save_csv",
        "track,frame_idx,instance.score,ball.score,ball.x,ball.y",
    ),
    Shape(
        "instances.csv",
        "sleap-io",
        "save_csv, instances",
        "frame_idx,track,track_score,score,ball.x,ball.y,ball.score",
    ),
    Shape(
        "points.csv",
        "sleap-io",
        "save_csv, points",
        "frame_idx,node,x,y,track,track_score,instance_score,score",
    ),
    Shape(
        "frames.csv",
        "sleap-io",
        "save_csv, frames",
        "frame_idx,inst0.track,inst0.track_score,inst0.score,inst0.ball.x,inst0.ball.y,"
        "inst0.ball.score",
    ),
    Shape("dlc.csv", "sleap-io", "save_csv, dlc", "scorer,sleap-io,sleap-io,sleap-io"),
    Shape("matlab.h5", "sleap-io", "save_analysis_h5", "tracks, track_names, node_names"),
    Shape("standard.h5", "sleap-io", "save_analysis_h5, standard", "tracks (its axes are stated)"),
    Shape(
        "movement.csv", "movement", "save_poses.to_dlc_file", "scorer,movement,movement,movement"
    ),
    Shape("movement.h5", "movement", "save_poses.to_dlc_file", "df_with_missing"),
    Shape("sleap.h5", "movement", "save_poses.to_sleap_analysis_file", "tracks"),
    Shape(
        "via.csv",
        "movement",
        "save_bboxes.to_via_tracks_file",
        "filename,file_size,file_attributes,region_count,region_id,region_shape_attributes,"
        "region_attributes",
    ),
    Shape("movement.nc", "movement", "Dataset.to_netcdf", "position, confidence (netCDF 4)"),
    Shape(
        "labelled.csv",
        "pandas",
        "to_csv of pictures labelled in DeepLabCut",
        "scorer,,,DLC,DLC,DLC",
    ),
    Shape(
        "dropped.csv", "pandas", "to_csv of a DeepLabCut table after dropna", "scorer,DLC,DLC,DLC"
    ),
    Shape("dropped.h5", "tables", "to_hdf of the same", "df_with_missing"),
    Shape("labelled.h5", "tables", "to_hdf of labelled pictures", "df_with_missing"),
    Shape("index.csv", "pandas", "to_csv after dropna", ",x,y"),
    Shape(
        "trackpy.csv",
        "trackpy",
        "link, to_csv",
        ",y,x,mass,frame,particle",
    ),
    Shape(
        "mot.csv",
        "motmetrics",
        "io.loadtxt of MOTChallenge, to_csv",
        "FrameId,Id,X,Y,Width,Height,Confidence,ClassId,Visibility",
    ),
    Shape(
        "boxes.csv",
        "supervision",
        "CSVSink",
        "x_min,y_min,x_max,y_max,class_id,confidence,tracker_id,class_name,frame_index",
    ),
    Shape("ball.c3d", "ezc3d", "c3d.write", "markers ball, racket in mm", {"y": "up"}),
)


def metres() -> FloatArray:
    """Positions of the ball (frames, 2) [m], y upwards from the centre in contact."""
    rng = np.random.default_rng(5)
    before = np.minimum(FRAME / FPS - 26.3 / FPS, 0.0)
    after = np.maximum(FRAME / FPS - 26.3 / FPS - CONTACT_TIME, 0.0)
    x = TRUTH["v_x1"] * before + TRUTH["v_x2"] * after
    fall = -TRUTH["v_y1"] * before - 0.5 * GRAVITY * before**2
    rise = TRUTH["v_y2"] * after - 0.5 * GRAVITY * after**2
    return np.column_stack([x, fall + rise]) + NOISE * rng.standard_normal((FRAME.size, 2))


def pixels() -> FloatArray:
    """Positions of the ball (frames, 2) [px], y downwards."""
    return np.asarray([900.0, 1000.0] + metres() * [1e3, -1e3] / MM_PER_PX)


def racket() -> FloatArray:
    """Positions of a racket that swings (all frames, 2) [px]."""
    return np.asarray([300.0, 400.0] + np.linspace(0.0, 1.0, COUNT)[:, None] * [90.0, -120.0])


# ---- writing


def write_all(folder: Path) -> None:
    """Write all shapes into a folder."""
    for write in (write_sleap, write_deeplabcut, write_others, write_boxes, write_c3d):
        write(folder)


def write_sleap(folder: Path) -> None:
    """Write what sleap-io writes, of a ball that is one node of one track."""
    import sleap_io

    # It puts nodes into the list that it is given.
    skeleton = sleap_io.Skeleton(["ball"])
    track = sleap_io.Track("ball")
    video = sleap_io.Video(filename="film.mp4", open_backend=False)
    frames = []
    for frame, place in zip(FRAME.tolist(), pixels(), strict=True):
        instance = sleap_io.PredictedInstance.from_numpy(
            points_data=place[None],
            skeleton=skeleton,
            point_scores=np.array([0.97]),
            score=0.96,
            track=track,
        )
        frames.append(sleap_io.LabeledFrame(video=video, frame_idx=frame, instances=[instance]))
    labels = sleap_io.Labels(frames)
    for layout in ("sleap", "instances", "points", "frames", "dlc"):
        sleap_io.save_csv(labels, str(folder / f"{layout}.csv"), format=layout)
    sleap_io.save_analysis_h5(labels, str(folder / "matlab.h5"))
    sleap_io.save_analysis_h5(labels, str(folder / "standard.h5"), preset="standard")


def write_deeplabcut(folder: Path) -> None:
    """Write DeepLabCut's layout: all frames by movement, those of high likelihood by pandas."""
    import pandas as pd
    from movement.io import load_bboxes, load_poses, save_bboxes, save_poses

    positions = np.full((COUNT, 2, 1, 1), np.nan)
    positions[FRAME, :, 0, 0] = pixels()
    confidence = np.isfinite(positions[:, 0]).astype(float)
    film = load_poses.from_numpy(
        positions,
        confidence,
        ["ball"],
        ["centre"],
        fps=FPS,
        # Without a name of it, a dataset cannot be saved in netCDF.
        source_software="fitball",
    )
    film.to_netcdf(folder / "movement.nc")
    sizes = np.full((COUNT, 2, 1), 2.0 * HALF_BOX)
    boxes = load_bboxes.from_numpy(positions[:, :, 0], sizes, confidence[:, 0], ["id_1"], fps=FPS)
    save_bboxes.to_via_tracks_file(boxes, folder / "via.csv")
    for ending in ("csv", "h5"):
        save_poses.to_dlc_file(film, folder / f"movement.{ending}")
    save_poses.to_sleap_analysis_file(film, folder / "sleap.h5")
    # movement puts the name of the only animal behind that of the file.
    for ending in ("csv", "h5"):
        for path in folder.glob(f"movement_*.{ending}"):
            path.rename(folder / f"movement.{ending}")
    columns = pd.MultiIndex.from_product(
        [["DLC"], ["ball"], ["x", "y", "likelihood"]], names=["scorer", "bodyparts", "coords"]
    )
    table = pd.DataFrame(np.nan, range(COUNT), columns)
    table.loc[FRAME] = np.column_stack([pixels(), np.full(FRAME.size, 0.98)])
    dropped = table.dropna()
    dropped.to_csv(folder / "dropped.csv")
    pictures = [("labeled-data", "film", f"img{frame:04d}.png") for frame in FRAME.tolist()]
    labelled = dropped.set_axis(pd.MultiIndex.from_tuples(pictures))
    labelled.to_csv(folder / "labelled.csv")
    labelled.to_hdf(folder / "labelled.h5", key="df_with_missing", mode="w")
    dropped.to_hdf(folder / "dropped.h5", key="df_with_missing", format="table", mode="w")


def write_others(folder: Path) -> None:
    """Write tables of pandas, trackpy and motmetrics."""
    import motmetrics
    import pandas as pd
    import trackpy

    table = pd.DataFrame(np.nan, range(COUNT), ["x", "y"])
    table.loc[FRAME] = pixels()
    table.dropna().to_csv(folder / "index.csv")
    x, y = pixels().T
    found = pd.DataFrame({"y": y, "x": x, "mass": 5e4, "frame": FRAME})
    trackpy.quiet()
    # The reach counts for all frames of a gap together.
    trackpy.link(found, 150, memory=3).to_csv(folder / "trackpy.csv")
    lines = [
        f"{frame + 1},1,{x - HALF_BOX:.3f},{y - HALF_BOX:.3f},33,33,0.97,-1,-1,-1"
        for frame, (x, y) in zip(FRAME.tolist(), pixels(), strict=True)
    ]
    text = folder / "mot.txt"
    text.write_text("\n".join(lines) + "\n", encoding="utf-8")
    motmetrics.io.loadtxt(text, fmt="mot15-2D").to_csv(folder / "mot.csv")


def write_boxes(folder: Path) -> None:
    """Write boxes of a ball and a racket, as supervision does."""
    import supervision

    rackets = racket()
    with supervision.CSVSink(str(folder / "boxes.csv")) as sink:
        for frame, place in zip(FRAME.tolist(), pixels(), strict=True):
            boxes = [[*(place - HALF_BOX), *(place + HALF_BOX)]]
            boxes.append([*rackets[frame], *(rackets[frame] + 90.0)])
            detections = supervision.Detections(
                xyxy=np.array(boxes),
                confidence=np.array([0.97, 0.95]),
                class_id=np.array([32, 38]),
                tracker_id=np.array([1, 2]),
                data={"class_name": np.array(["sports ball", "tennis racket"])},
            )
            sink.append(detections, custom_data={"frame_index": frame})


def write_c3d(folder: Path) -> None:
    """Write markers in three coordinates, z upwards, of a flight at 30 degrees to the x axis."""
    import ezc3d

    file = ezc3d.c3d()
    of_points = file["parameters"]["POINT"]
    of_points["RATE"]["value"] = [FPS]
    of_points["LABELS"]["value"] = ["ball", "racket"]
    of_points["UNITS"]["value"] = ["mm"]
    points = np.full((4, 2, COUNT), np.nan)
    points[3] = 1.0
    along, up = 1e3 * metres().T
    points[:3, 0, FRAME] = [np.cos(np.pi / 6) * along, np.sin(np.pi / 6) * along, up]
    points[:3, 1] = 500.0
    file["data"]["points"] = points
    file.write(str(folder / "ball.c3d"))


# ---- reading


def fault_of(folder: Path, shape: Shape) -> str:
    """What is wrong with a shape as fitball reads it, "" if all is right."""
    import fitball
    from fitball.data.scene import CameraSection

    path = folder / shape.file
    if path.suffix == ".csv":
        with path.open(encoding="utf-8") as file:
            header = file.readline().rstrip("\r\n")
        if header != shape.header:
            return f"the header is {header}"
    camera = {"fps": FPS, "mm_per_px": MM_PER_PX, "y": "down", **shape.options}
    scene = fitball.Scene(camera=CameraSection(**camera), flight={"drag": 0.01, "lift": 0.0})
    try:
        impacts = fitball.track(path, scene=scene).impacts
    except fitball.FitballError as error:
        return str(error)
    if len(impacts) != 1:
        return f"{len(impacts)} impacts"
    for name, truth in TRUTH.items():
        value = float(impacts[f"{name} [m/s]"].iloc[0])
        if abs(value - truth) > MOST_OFF:
            return f"{name} is {value:.2f} for {truth}"
    return ""


def main() -> int:
    """Write or read the shapes; 1 where one is wrong."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    parser.add_argument("--write", action="store_true")
    arguments = parser.parse_args()
    if arguments.write:
        write_all(arguments.folder)
        return 0
    faults = [(shape, fault_of(arguments.folder, shape)) for shape in SHAPES]
    for shape, fault in faults:
        print(f"{shape.file}, {shape.package} {PACKAGES[shape.package]}: {fault or 'read'}")
    return int(any(fault for _, fault in faults))


if __name__ == "__main__":
    sys.exit(main())
