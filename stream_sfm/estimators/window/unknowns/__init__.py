"""Unknowns that single frames of the window have beside their poses: one set of columns of `own` each.

* `columns.py`: begins, places and ends such unknowns.
* `focus.py`: the change of the focal length; `focal_change.py` has its evidence, `focus_watch.py` says when it began.
* `velocities.py`: the error of the velocity at exposure, with `exposures.py` (when frames were exposed).
* `turn.py`: the evidence of a turn of the right camera.
"""
