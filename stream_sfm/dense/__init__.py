"""Dense stereo and surfaces: disparity of each pixel with its σ, meshes of one frame, fusion of many, PLY, previews.

Works on rectified images and their `StereoProjection`. Not here: poses, which are given, and the way from a log to a
surface (`stream_sfm/dense/surface.py`).
"""
