"""Tables of positions are sent to `fitball track`; tables of impacts, whose names lack, are not."""

import pytest
from made_tables import written

import fitball
from fitball.base.errors import InputError

POSITIONS = [
    "t [s],y [m]",
    "Time (s),Z (m)",
    "Latest: Time (s),Latest: Position (m),Latest: Velocity (m/s)",
    "X_Value,x [m],y [m],Comment",
    "file name,visibility,x-coordinate,y-coordinate,status",
    "Latest: Time (s),Latest: X (m),Latest: Y (m)",
    "LABEL,ID,TRACK_ID,POSITION_X,POSITION_Y,POSITION_Z,POSITION_T,FRAME",
    "track,frame_idx,instance.score,ball.score,ball.x,ball.y",
    "scorer,D,D,D\nbodyparts,ball,ball,ball\ncoords,x,y,likelihood",
    "Frame #,ball_x_px,ball_y_px",
]
IMPACTS = [
    "h0,h1",
    "interval [s],bounce",
    "time,v_y",
    "frame,v.x,v.y",
    "shot,in x [m/s],in y [m/s],out x [m/s],out y [m/s]",
    "t [s],force [N]",
    "shot,speed,angle",
]


def sent_to_track(text, tmp_path):
    """Whether a table with this header is refused with `fitball track` and its file."""
    cells = text.rpartition("\n")[2].split(",")
    row = ",".join("1" for _ in cells)
    path = written(tmp_path, "\n".join([text, *[row] * 9]))
    with pytest.raises(InputError) as refused:
        fitball.load_table(path)
    faults = [fault for fault in refused.value.faults if fault.code == "no-incident"]
    return f"fitball track {path}" in faults[0].message


@pytest.mark.parametrize("text", POSITIONS)
def test_tables_of_positions_are_sent_to_the_verb_that_reads_them(text, tmp_path):
    assert sent_to_track(text, tmp_path)


@pytest.mark.parametrize("text", IMPACTS)
def test_other_tables_are_not(text, tmp_path):
    assert not sent_to_track(text, tmp_path)
