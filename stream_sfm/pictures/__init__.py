"""Images as the front-end takes them, and whether they are proper pictures of a scene.

`checks.py` has the list of what may be wrong with a recorder or its cameras; each check is a file of its own. Faults of
single frames, such as black or repeated images, are in `content.py`. Whether left and right fit each other is a
question of points and calibration, and belongs to the front-end.
"""
