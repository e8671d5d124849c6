"""Places: keyframes of a run, what is seen again in them, and the poses that follow from it.

`PlaceMap` is a sink: the engine does not know it, and who does not use it pays nothing. A keyframe goes through
`keyframes.py` (what is kept of it), `finding.py` (which older ones may show the same place), `verifying.py` (how the
camera has moved since, with covariance) and `graph.py` (all poses together); `place_map.py` is the way through these.

Not here: odometry, and the files of a run.
"""
