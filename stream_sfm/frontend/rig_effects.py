"""What an error of the calibration does to a view: a smooth field of disparity, and errors that both lenses share.

Relative rotation, principal points, focal lengths and distortion of the two cameras err together; what they do to the
disparity is a polynomial of the place in the image, eq. (70), and the difference of two radial distortions. What both
lenses have wrong alike moves both sides of a view. Rows are not told apart: whatever left and right row differ by has
been taken out of the right one as it was measured (`vertical_disparity.py`), so the right row errs with the left one.
A principal point that is off by δ moves all of the image, which is a rotation of the camera's axes by δ/f: no view
shows that (`camera/unseen_errors.py`). What is left of it, −δ (x, y) x of a ray's slopes x and y, is a term here.
The baseline is no part of it: if it is wrong, everything is too large or too small, and no view shows it.
"""

from dataclasses import replace

import numpy as np

from ..camera.refinement import TERMS, Refinement
from ..config import RigConfig
from ..geometry.se3 import Array
from ..geometry.stereo import StereoProjection
from ..types import RigEstimate
from .right_turn import RightTurn, effects_of_turn, far_right_px

_OF_DISPARITY = (*TERMS[:6], "radial difference")
# σ of a turn of the right camera by a knock, about each axis, beforehand: what it was measured to be is where the
# estimator starts, and is not used a second time.
_STD_TURN_RAD = 3e-3


class RigEffects:
    """Effects of the possible errors; none where the calibration is exact.

    A `refinement` of the calibration is taken out of the views; its covariance is then what is not known. A `turn` of
    the right camera during the run is out of them already, and part of the calibration's error.
    `of_disparity` (m,): which errors change the disparity only; None where σ is known.
    """

    def __init__(
        self,
        projection: StereoProjection,
        config: RigConfig,
        refinement: Refinement | None,
        turn: RightTurn | None = None,
    ) -> None:
        self._projection = p = projection
        self._error_px: Array | None = None if refinement is None else refinement.error_px
        self._root: Array = np.zeros((len(TERMS), 0))
        if not config.exact:
            cov_px2 = refinement.cov_px2 if refinement is not None else np.diag(prior_std_px(config) ** 2)
            self._root = np.asarray(np.linalg.cholesky(cov_px2), np.float64)
        self.of_disparity = None if refinement is not None or config.exact else np.isin(TERMS, _OF_DISPARITY)
        self._turn = RightTurn(projection) if turn is None else turn
        self._std_drift_rad = config.std_drift_rad
        self._centre = np.array([(p.width - 1) / 2, (p.height - 1) / 2])
        corner = np.hypot(max(p.cx_left_px, p.width - p.cx_left_px), max(p.cy_px, p.height - p.cy_px)) / p.f_px
        self._corner = float(corner)  # the one that is farthest from the lens's middle, as the slope of its ray

    def of(self, z_px: Array) -> Array:
        """(n, 4, m) px per σ of each error, for views (n, 4); zero for a side that was not found."""
        effects: Array = np.nan_to_num(self._per_pixel(z_px)) @ self._root
        return effects

    def corrected(self, z_px: Array) -> Array:
        """Views (n, 4) without the errors that are known."""
        return z_px if self._error_px is None else z_px - self._per_pixel(z_px) @ self._error_px

    def unknown_after_turn(self) -> Array:
        """What is not known about a turn, a root (m, 3) of its covariance in σ of each error."""
        return self._root_of_turn(_STD_TURN_RAD)

    def drift(self) -> Array | None:
        """What a frame may change, a root (m, 3) as above; None where the cameras do not drift."""
        return self._root_of_turn(self._std_drift_rad) if self._std_drift_rad and self._root.size else None

    def _root_of_turn(self, std_rad: float) -> Array:
        return np.asarray(np.linalg.solve(self._root, std_rad * self._terms_of_turn()))

    def in_px(self, estimate: RigEstimate) -> RigEstimate:
        """An estimate in units of σ as the whole error of the calibration, in pixels."""
        error_px = self._root @ estimate.mean
        if self._error_px is not None:
            error_px = error_px + self._error_px
        turned = bool(self._turn.rad.any())
        if turned:
            error_px = error_px + self._terms_of_turn() @ self._turn.rad
        prior_std = estimate.prior_std
        if prior_std is not None:
            prior_std = np.linalg.norm(self._root * prior_std, axis=1)
        return replace(
            estimate,
            mean=error_px,
            cov=self._root @ estimate.cov @ self._root.T,
            applied=estimate.applied or turned,
            prior_std=prior_std,
            refined=self._error_px,
        )

    def disparity(self, estimate: RigEstimate, left_px: Array) -> tuple[Array, Array]:
        """Error (n,) of far points' disparity at left positions (n, 2), by an estimate in pixels, and its σ; px."""
        p = self._projection
        far = np.tile(left_px, 2) + np.array([0.0, 0.0, p.cx_right_px - p.cx_left_px, 0.0])
        effects = self._per_pixel(far)
        by_term = effects[:, 0] - effects[:, 2]
        return by_term @ estimate.mean, np.sqrt(np.einsum("ni,ij,nj->n", by_term, estimate.cov, by_term))

    def on_views(self, estimate: RigEstimate, z_px: Array) -> tuple[Array, Array]:
        """Errors (n, 4) of views (n, 4) by an estimate in pixels, and what is unknown of them: (n, 4, m), σ 1 each.

        Zero for a side that was not found.
        """
        effects = np.nan_to_num(self._per_pixel(z_px))
        values, vectors = np.linalg.eigh(estimate.cov)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        return effects @ estimate.mean, np.asarray(effects @ root)

    def _terms_of_turn(self) -> Array:
        """(m, 3) px of each term per radian of a turn of the right camera: of far points it is just these."""
        places_px = np.stack(np.meshgrid(*(np.linspace(0, 2 * c, 5) for c in self._centre)), axis=2).reshape(-1, 2)
        by_turn = effects_of_turn(self._projection, far_right_px(self._projection, places_px))[:, 0]
        terms = np.zeros((len(TERMS), 3))
        per_pixel = self._per_pixel(np.tile(places_px, 2))[:, 2, :6]
        terms[:6] = np.linalg.lstsq(per_pixel, by_turn, rcond=None)[0]
        return terms

    def _per_pixel(self, z_px: Array) -> Array:
        """(n, 4, m) px per pixel of each term, for views (n, 4)."""
        p = self._projection
        x, y = ((z_px[:, :2] - self._centre) / self._centre).T
        effects = np.zeros((len(z_px), 4, len(TERMS)))
        effects[:, 2, :6] = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
        rays = (z_px - (p.cx_left_px, p.cy_px, p.cx_right_px, p.cy_px)) / p.f_px
        for side in (0, 2):
            ray = rays[:, side : side + 2]
            effects[:, side : side + 2, 6:12] = _of_lens(ray / self._corner)
            effects[:, side : side + 2, 8:10] = -ray[:, :, None] * rays[:, None, :2]
        effects[:, 2, 12] = effects[:, 2, 6]
        effects[:, 3] = effects[:, 1]
        return effects


def disparity_error(projection: StereoProjection, estimate: RigEstimate, left_px: Array) -> tuple[Array, Array]:
    """Error (n,) of far points' disparity at left positions (n, 2), by an estimate in pixels, and its σ; px."""
    return RigEffects(projection, RigConfig(), None).disparity(estimate, left_px)


def disparity_over_image(
    projection: StereoProjection, estimate: RigEstimate, shape: tuple[int, int]
) -> tuple[Array, Array]:
    """Error of the disparity at (rows, columns) = `shape` places spread evenly over the left image, and its σ; px."""
    u, v = np.linspace(0, projection.width - 1, shape[1]), np.linspace(0, projection.height - 1, shape[0])
    places_px = np.stack(np.meshgrid(u, v), axis=2).reshape(-1, 2)
    error_px, std_px = disparity_error(projection, estimate, places_px)
    return error_px.reshape(shape), std_px.reshape(shape)


def _of_lens(rays: Array) -> Array:
    """(n, 2, 6) px per pixel of each error of a lens, for rays (n, 2) in units of the corner's slope.

    Those of the principal point are left 0: they depend on the other side, too.
    """
    x, y = rays.T
    squared = x * x + y * y
    effects = np.zeros((len(rays), 2, 6))
    effects[..., 0] = rays * squared[:, None]
    effects[..., 1] = effects[..., 0] * squared[:, None]
    effects[:, 0, 4], effects[:, 1, 4] = (squared + 2 * x * x) / 3, 2 * x * y / 3  # 1 px in the corner's direction
    effects[:, 0, 5], effects[:, 1, 5] = 2 * x * y / 3, (squared + 2 * y * y) / 3
    return effects


def prior_std_px(config: RigConfig) -> Array:
    """σ (m,) of each term of a calibration that nothing more is known about."""
    std_px = {"radial difference": config.std_lens_difference_px} | dict.fromkeys(
        TERMS[:6], config.std_disparity_px
    )
    return np.array([std_px.get(term, config.std_lens_px) for term in TERMS])
