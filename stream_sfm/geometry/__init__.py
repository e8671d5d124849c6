"""Poses, the rectified camera pair, robust resection, χ² gates, evidence over frames and small linear algebra.

The conventions of the whole package (equations: docs/mathematics.md, section 1):

* A pose is a 4×4 float64 array named `target_from_source`; `target_from_source @ point_in_source`.
* A perturbation acts on the right, `T ⊞ ξ = T · Exp(ξ)`, with ξ = (translation, rotation); every 6×6
  covariance of a pose is the covariance of that ξ, in metres² and radians².
* A camera has x right, y down, z forward; pixel (0, 0) is the centre of the top-left pixel.
"""

from .se3 import Array as Array
