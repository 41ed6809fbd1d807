"""One bounce without air as programs that track balls write it: columns and files in their shapes,
some frames lost.
"""

import csv
import io
import json
import pickle

import h5py
import numpy as np
import pandas as pd

FPS = 240.0
MM_PER_PX = 2.0
RNG = np.random.default_rng(5)
# Frames of the film, and those in which the ball is seen.
COUNT = 76
LOST = (8, 9, 15, 40, 41, 52)
FRAME = np.delete(np.arange(COUNT), LOST)
TIME = FRAME / FPS
# Speeds before and after the contact [m/s].
TRUTH = {"v_x1": 14.0, "v_y1": 6.0, "v_x2": 10.0, "v_y2": 4.8}
# The contact begins in this frame, and ends 4.7 ms later.
CONTACT = 26.3 / FPS
CONTACT_TIME = 4.7e-3
# What tables state besides: the camera's rate and scale, and that y grows downwards.
CAMERA = {"fps": FPS, "mm_per_px": MM_PER_PX, "y": "down"}


def _path():
    """Positions of the ball (frames, 2) [m], y upwards from the centre in contact."""
    before = np.minimum(TIME - CONTACT, 0.0)
    after = np.maximum(TIME - CONTACT - CONTACT_TIME, 0.0)
    x = 14.0 * before + 10.0 * after
    y = -6.0 * before - 4.903325 * before**2 + 4.8 * after - 4.903325 * after**2
    return np.column_stack([x, y]) + 5e-4 * RNG.standard_normal((TIME.size, 2))


METRES = _path()
X = 900.0 + 1e3 * METRES[:, 0] / MM_PER_PX
Y = 1000.0 - 1e3 * METRES[:, 1] / MM_PER_PX
# A racket that swings, in all frames.
SWING = np.linspace(0.0, 1.0, COUNT)[:, None] * np.array([90.0, -120.0])
RACKET = np.array([300.0, 400.0]) + SWING + 0.1 * RNG.standard_normal((COUNT, 2))


def clip(**columns):
    """A frame of the columns, or of x and y in pixels besides."""
    return pd.DataFrame({**columns, "x": X, "y": Y})


def deeplabcut(parts, animals=(), dropped=True, likelihood=0.98):
    """A DataFrame in DeepLabCut's layout. The ball is the part or animal of that name; the racket
    any other. In a lost frame its position is a guess of low likelihood, unless rows are dropped.
    """
    names = ["scorer", *["individuals"] * bool(animals), "bodyparts", "coords"]
    columns = {}
    for animal in animals or ("",):
        for part in parts:
            x = RACKET[:, 0].copy()
            y = RACKET[:, 1].copy()
            confidence = np.full(COUNT, 0.99)
            if "ball" in (animal, part):
                x[FRAME], y[FRAME], confidence[FRAME] = X, Y, likelihood
                confidence[[*LOST]] = 0.01
            levels = [level for level in ("DLC_resnet50", animal, part) if level]
            for axis, values in (("x", x), ("y", y), ("likelihood", confidence)):
                columns[(*levels, axis)] = values
    table = pd.DataFrame(columns)
    table.columns = pd.MultiIndex.from_tuples(columns, names=names)
    return table.iloc[FRAME] if dropped else table


def sleap(layout, nodes=("ball",), tracks=("ball",)):
    """The text of a CSV file of SLEAP, of one of its layouts: sleap, instances, points, frames."""
    rows = []
    for frame, x, y in zip(FRAME, X, Y, strict=True):
        of_frame = {"frame_idx": frame}
        for number, track in enumerate(tracks):
            row = {"track": track, "frame_idx": frame, "instance.score": 0.96}
            for node in nodes:
                place = (x, y) if "ball" in (node, track) else RACKET[frame]
                point = {"x": place[0], "y": place[1], "score": 0.97}
                row |= {f"{node}.{axis}": value for axis, value in point.items()}
                if layout == "points":
                    rows.append({"frame_idx": frame, "node": node, "track": track, **point})
            of_frame |= {
                f"inst{number}.{name}": value
                for name, value in row.items()
                if name not in ("frame_idx", "instance.score")
            }
            if layout in ("sleap", "instances"):
                rows.append(row)
        if layout == "frames":
            rows.append(of_frame)
    table = pd.DataFrame(rows)
    if layout == "instances":
        table = table.rename(columns={"instance.score": "score"})
    return table.to_csv(index=False)


def sleap_hdf5(path, axes, stated, nodes=("ball",), tracks=("ball",)):
    """Write an analysis file of SLEAP, its positions in this order of axes, which it states or
    not.
    """
    positions = np.full((len(tracks), 2, len(nodes), COUNT), np.nan)
    for k, track in enumerate(tracks):
        for j, node in enumerate(nodes):
            if "ball" in (node, track):
                positions[k][:, j][:, FRAME] = X, Y
            else:
                positions[k][:, j] = RACKET.T
    usual = ("track", "xy", "node", "frame")
    with h5py.File(path, "w") as file:
        order = [usual.index(axis) for axis in axes]
        dataset = file.create_dataset("tracks", data=np.transpose(positions, order))
        if stated:
            dataset.attrs["dims"] = "[" + ", ".join(f'"{axis}"' for axis in axes) + "]"
        file["track_names"] = [track.encode() for track in tracks]
        file["node_names"] = [node.encode() for node in nodes]


def deeplabcut_hdf5(path, table, names_of_columns=None):
    """Write a DataFrame as pandas does by PyTables: one table whose attributes are pickles."""
    values = table.to_numpy()
    rows = np.zeros(
        len(table), dtype=[("index", "<i8"), ("values_block_0", "<f8", values.shape[1:])]
    )
    rows["index"] = table.index
    rows["values_block_0"] = values
    names = pickle.dumps([*table.columns], protocol=0)
    with h5py.File(path, "w") as file:
        group = file.create_group("df_with_missing")
        group.attrs["pandas_type"] = np.bytes_(b"frame_table")
        dataset = group.create_dataset("table", data=rows)
        dataset.attrs["values_block_0_kind"] = np.bytes_(names_of_columns or names)


def labelled_hdf5(path, table):
    """Write a DataFrame whose index has several levels as pandas does, in its fixed format: levels
    of names and of rows have their texts, and labels by place.
    """
    with h5py.File(path, "w") as file:
        group = file.create_group("df_with_missing")
        group.attrs["pandas_type"] = np.bytes_(b"frame")
        group.attrs["nblocks"] = 1
        for name, index in (("axis1", table.index), ("block0_items", table.columns)):
            group.attrs[f"{name}_nlevels"] = index.nlevels
            for k in range(index.nlevels):
                labels, texts = pd.factorize(index.get_level_values(k))
                group[f"{name}_level{k}"] = [text.encode() for text in texts]
                group[f"{name}_label{k}"] = labels.astype(np.int8)
        group["block0_values"] = table.to_numpy()


def movement_dataset(path, animals=("ball",), parts=("centre",), in_frames=False, space="xy"):
    """Write a dataset of movement as xarray does in netCDF 4: axes have scales that name them.
    Without parts it is of boxes.
    """
    positions = np.zeros((COUNT, len(space), len(parts) or 1, len(animals)))
    for k, animal in enumerate(animals):
        for j, part in enumerate(parts or ("",)):
            positions[:, :2, j, k] = RACKET
            if "ball" in (animal, part):
                positions[:, :, j, k] = np.nan
                positions[FRAME, :2, j, k] = np.column_stack([X, Y])
                positions[FRAME, 2:, j, k] = 0.0
    order = ["xyz".index(name) for name in space if name in "xyz"]
    positions = positions[:, order or slice(None)]
    axes = {
        "time": COUNT,
        "space": len(space),
        "keypoints": len(parts),
        "individuals": len(animals),
    }
    if not parts:
        positions = positions[:, :, 0]
        del axes["keypoints"]
    names = {"space": [*space], "keypoints": [*parts], "individuals": [*animals]}
    with h5py.File(path, "w") as file:
        file.attrs["time_unit"] = np.bytes_("frames" if in_frames else "seconds")
        for axis in axes:
            number = np.arange(COUNT) / (1.0 if in_frames else FPS)
            file[axis] = number if axis == "time" else [name.encode() for name in names[axis]]
            file[axis].make_scale(axis)
        confidence = 0.97 * np.isfinite(positions[:, 0])
        for name, values in (("position", positions), ("confidence", confidence)):
            file[name] = values
            of_values = [axis for axis in axes if name == "position" or axis != "space"]
            for k, axis in enumerate(of_values):
                file[name].dims[k].attach_scale(file[axis])


def trackmate():
    """The text of a table of spots of TrackMate: four header rows, a number of each spot."""
    lines = [
        "LABEL,ID,TRACK_ID,QUALITY,POSITION_X,POSITION_Y,POSITION_Z,POSITION_T,FRAME,RADIUS",
        "Label,Spot ID,Track ID,Quality,X,Y,Z,T,Frame,Radius",
        "Label,Spot ID,Track ID,Quality,X,Y,Z,T,Frame,R",
        ",,,(quality),(pixel),(pixel),(pixel),(sec),,(pixel)",
    ]
    for frame, x, y in zip(FRAME, X, Y, strict=True):
        spot = f"ID{900 + frame},{900 + frame},0,12.0"
        lines.append(f"{spot},{x:.3f},{y:.3f},0.0,{frame / FPS:.3f},{frame},16.5")
    return "\n".join(lines) + "\n"


def labels_of_frames():
    """The text of a file of labels in the columns of TrackNet: a file for each frame, also where
    no ball is visible.
    """
    lines = ["file name,visibility,x-coordinate,y-coordinate,status"]
    seen = dict(zip(FRAME.tolist(), zip(X, Y, strict=True), strict=True))
    for frame in range(COUNT):
        if frame in seen:
            x, y = seen[frame]
            lines.append(f"{frame:04d}.jpg,1,{x:.0f},{y:.0f},0")
        else:
            lines.append(f"{frame:04d}.jpg,0,,,0")
    return "\n".join(lines) + "\n"


def csv_text(table, **options):
    """The text that pandas writes."""
    file = io.StringIO()
    table.to_csv(file, **options)
    return file.getvalue()


def mtrack2(tracks, summary=True, most=75):
    """The text of results of MTrack2 in ImageJ: tracks, places by frame, side by side in blocks of
    at most so many, with flags where another object is near, and a summary below them.
    """
    names = "".join(f"\tX{k}\tY{k}\tFlag{k}" for k in range(1, min(len(tracks), most) + 1))
    lines = [f"Frame{names}"]
    for first in range(0, len(tracks), most):
        block = tracks[first : first + most]
        lines.append(f"Tracks {first + 1} to {first + len(block)}")
        for frame in range(COUNT):
            flag = "*" if frame % 9 == 0 else " "
            cells = [str(frame + 1)]
            for places in block:
                x, y = places.get(frame, (None, None))
                cells += [" "] * 3 if x is None else [f"{x:.5f}", f"{y:.5f}", flag]
            lines.append("\t".join(cells))
    if summary:
        lines += ["", "Track \tLength\tDistance traveled\tNr of Frames"]
        for number, places in enumerate(tracks, 1):
            lines.append(f"{number}\t512.25\t490.5\t{len(places)}")
    return "\n".join(lines) + "\n"


def mot_boxes(objects, behind=("0.97", "-1", "-1", "-1")):
    """The text of boxes in MOTChallenge, which has no header: frames of objects, places by frame;
    their ids count from 1. `behind` stands behind each box.
    """
    lines = []
    for frame in range(COUNT):
        for number, places in enumerate(objects, 1):
            if frame in places:
                x, y = places[frame]
                box = [f"{x - 16.5:.5f}", f"{y - 16.5:.5f}", "33", "33"]
                lines.append(",".join([str(frame + 1), str(number), *box, *behind]))
    return "\n".join(lines) + "\n"


def via_regions(objects, kind="rect"):
    """The text of regions of the VGG Image Annotator: frames of objects, places by frame, as
    rectangles, circles or points; their tracks count from 1.
    """
    lines = [["filename", "file_size", "file_attributes", "region_count", "region_id"]]
    lines[0] += ["region_shape_attributes", "region_attributes"]
    for frame in range(COUNT):
        seen = [k for k, places in enumerate(objects) if frame in places]
        for number, k in enumerate(seen):
            x, y = objects[k][frame]
            shape = {"name": kind, "cx": x, "cy": y}
            if kind == "rect":
                shape = {"name": kind, "x": x - 16.5, "y": y - 16.0, "width": 33.0, "height": 32.0}
            texts = [json.dumps(shape), json.dumps({"track": k + 1, "confidence": 0.97})]
            lines.append([f"{frame:03d}.png", 0, "{}", len(seen), number, *texts])
        if not seen:
            lines.append([f"{frame:03d}.png", 0, "{}", 0, 0, "{}", "{}"])
    file = io.StringIO()
    csv.writer(file).writerows(lines)
    return file.getvalue()


BALL_BY_FRAME = {int(frame): (x, y) for frame, x, y in zip(FRAME, X, Y, strict=True)}
RACKET_BY_FRAME = {frame: (x, y) for frame, (x, y) in enumerate(RACKET)}
