"""What the front-end learns in a run about cameras and patches.

Rows, timing, turns of the right camera, the disparity's error, the noise of views, and how long the errors of a track
last. `pair_check.py` judges by these whether left and right fit each other.
"""
