"""Unknowns that single frames of the window have beside their poses: one set of columns of `own` each.

* `columns.py`: begins, places and ends such unknowns.
* `weighing.py`: how large those of the newest frame are, by one likelihood.
* `focus.py`: the change of the focal length; `focal_change.py` has its evidence, `focus_watch.py` says when it began.
* `twist.py`: the errors of the velocities at exposure; `velocities.py`: the shifts by these velocities, and
  `exposures.py`: when frames were exposed.
"""
