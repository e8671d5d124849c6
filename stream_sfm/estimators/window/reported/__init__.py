"""What is reported of a frame, read from the joint minimum; nothing of it is fed back into the estimates.

* `equal_weights.py`: the minimum in which all views of a track count alike, from which everything here is read.
* `marginals.py`: the newest pose and the points, in the camera and in the world; `followed.py`: the pose that continues
  by the newest motion.
* `relative.py`: motions between frames of the window, and the errors that they share.
* `track_noise.py` and `halves.py`: how much tracks differ, and the factor on σ from their halves.
"""
