"""From camera to impact: positions of a ball in the frames of a film, and the impacts they determine.

`frames` has what is read and what is found, `read` the files of tracking programs, `flight` the air, `estimate` one
impact and `session` all of them. It imports `data` and the values below it.
"""
