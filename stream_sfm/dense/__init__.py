"""Dense stereo and surfaces: disparity of each pixel with its σ, meshes of one frame, fusion of many, PLY, previews.

Works on rectified images and their `StereoProjection`; the way from a log to a surface is `stream_sfm/surface.py`.
"""
