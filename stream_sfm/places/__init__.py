"""Places: keyframes of a run, recognised places, and the corrected poses.

`PlaceMap` is a sink: the engine does not know it, and a run without it pays nothing. A keyframe goes through
`keyframes.py` (its content), `finding.py` (which older ones may show the same place), `verifying.py` (the motion
of the camera since, with covariance) and `graph.py` (all poses together); `place_map.py` connects these steps.

Odometry and the files of a run are elsewhere.
"""
