"""Dense stereo and surfaces: a disparity with its σ for every pixel, meshes of one frame, fusion of many frames.

`surface.py` turns a log into a `Surface`; everything else works on rectified images, their `StereoProjection` and
given poses. `mesh.py` writes meshes as PLY files.
"""
