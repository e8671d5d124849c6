"""A negative control: the world-centred iterated Kalman filter (b = 1, joint prior, relinearised each frame).

Iterating drives the linearisation point of every point to the estimate that the newest views prefer, while the
prior keeps the Jacobians of earlier estimates: the directions that views cannot see (where the world is) gain
information that nobody measured. Its pose is biased; it is here to be seen failing, not to be used.
"""

import numpy as np
from numpy.typing import NDArray

from stream_sfm.estimators.baselines.ekf import Ekf
from stream_sfm.geometry import se3
from stream_sfm.geometry.se3 import Array

_ITERATIONS = 6


class IteratedEkf(Ekf):
    """Gauss-Newton over the newest views and the joint world-centred prior; see the module."""

    name = "iekf-wc"

    def _update(self, z_px: Array, cov_px: Array, accepted: NDArray[np.bool_], cov_free: Array) -> None:
        used = np.flatnonzero(accepted)
        seen = np.isfinite(z_px[used]).ravel()
        n, d = len(used), len(self._cov)
        noise = np.zeros((n, 4, n, 4))
        noise[np.arange(n), :, np.arange(n), :] = cov_px[used]
        noise = noise.reshape(4 * n, -1)[seen][:, seen]
        prior_points, start = self._points, self._world_from_cam
        prior = self._cov.copy()
        prior[:6] = prior[:, :6] = 0
        prior[:6, :6] = cov_free
        for _ in range(_ITERATIONS):
            predicted_views, h = self._measurement(used)
            h = h[seen]
            from_prior = np.concatenate(
                [se3.log(se3.inverse(start) @ self._world_from_cam), (self._points - prior_points).ravel()]
            )
            residual = (z_px[used] - predicted_views).ravel()[seen] + h @ from_prior
            s = h @ prior @ h.T + noise
            gain = np.linalg.solve(s, h @ prior).T
            state = gain @ residual
            self._world_from_cam = se3.orthonormalise(start @ se3.exp(state[:6]))
            self._points = prior_points + state[6:].reshape(-1, 3)
        keep = np.eye(d) - gain @ h
        cov = keep @ prior @ keep.T + gain @ noise @ gain.T
        self._cov = (cov + cov.T) / 2
