"""From camera to impact: positions of a ball in the frames of a film, and the impacts they determine.

`frames` has what is read and what is found, `read` the files of tracking programs, `flight` the air, `estimate` one
impact and `session` all of them, `simulate` tracks with a known truth, `precision` the errors that a film leaves,
`impacts` the rows of files.

Offers: `read_tracks`, `estimate`, `Tracks`, `Track`, `simulated_tracks`, `nine_covariance`.
May import: data, models.
"""
