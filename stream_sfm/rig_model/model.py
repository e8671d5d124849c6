"""The whole model of a rig's errors: physical terms and field, in units of the assumed σ of each."""

import numpy as np
from numpy.typing import NDArray

from .. import core
from ..camera.over_image import ExposedRows, FocalEffect
from ..camera.refinement import KnownTiming, Refinement
from ..config import RigConfig
from ..geometry import Array
from ..geometry.linear import LEAST_VARIANCE
from ..geometry.stereo import StereoProjection, places_over_image
from ..geometry.view_stages import RawViews
from ..record import changed, record
from .estimate import Amplitudes, RigEstimate
from .field import NO_FIELD, WORTH_ESTIMATING, Field, field_over
from .terms import AT_TIMING, DISPARITY, FOCAL, FOCUSING, TERMS, columns, growth, prior_std, terms_of_turn

_FOCAL, _FOCUSING = TERMS.index(FOCAL), TERMS.index(FOCUSING)
_LEAST_COV = LEAST_VARIANCE * np.eye(2)
# The coordinates of a view (u_left, v_left, u_right, v_right) that the three parts of the field shift: the disparity,
# and u and v of both sides alike. Without the last two, halves of the image differ by up to 2.4 σ on euroc_mh01, with
# them by 1.7.
FIELD_MOVES = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])


@record
class RigModel:
    """Errors of a rig as amplitudes (m,): those of the `TERMS` first, then those of the field's three parts, px.

    `root` (t, t): from amplitudes of σ = 1 to units of the terms; `known` (t,): errors already removed from all views;
    `refined`: σ of lenses and disparity is that of a refinement. `row_of`: the rows of the cameras'
    own images in which rectified views are exposed; if it is None, delay and readout have no effect. `known_timing`:
    prior knowledge of delay and readout; it is not removed from the views, as its effect depends on their velocities.
    `has_field`: if false, there are only the amplitudes of the terms.
    """

    projection: StereoProjection
    root: Array
    known: Array
    refined: bool
    row_of: ExposedRows | None = None
    known_timing: KnownTiming | None = None
    by_focal: FocalEffect | None = None
    zooms: bool = False
    has_field: bool = True

    @classmethod
    def of(
        cls,
        projection: StereoProjection,
        config: RigConfig,
        refinement: Refinement | None = None,
        row_of: ExposedRows | None = None,
        known_timing: KnownTiming | None = None,
        by_focal: FocalEffect | None = None,
    ) -> "RigModel":
        """Return the model of a rig with the σ of its settings, or of a refinement of its calibration."""
        std, known = prior_std(config), np.zeros(len(TERMS))
        root = np.diag(std)
        if refinement is not None:
            n = len(refinement.error_px)
            known[:n] = refinement.error_px
            root[:n, :n] = np.linalg.cholesky(refinement.cov_px2)
        return cls(projection, root, known, refinement is not None, row_of, known_timing, by_focal)

    def __len__(self) -> int:
        return len(TERMS) + FIELD_MOVES.shape[1] * self._field.size

    @property
    def _field(self) -> Field:
        p = self.projection
        return field_over(p.width, p.height, WORTH_ESTIMATING) if self.has_field else NO_FIELD

    @property
    def cameras(self) -> tuple[StereoProjection, ExposedRows]:
        """The pair, and the rows of the cameras' own images in which views are exposed."""
        return self.projection, ExposedRows.unknown() if self.row_of is None else self.row_of

    @property
    def units_of_timing(self) -> Array:
        """Seconds (2,) per amplitude of delay and of readout."""
        return self.root.diagonal()[AT_TIMING]

    def without_field(self) -> "RigModel":
        """Return the model with the terms alone."""
        return changed(self, has_field=False)

    def zooming(self) -> "RigModel":
        """Return the model of cameras whose focal length changes by itself.

        If a calibration has a wrong focal length, it was fitted to the disparity of far points together with it. A zoom
        also changes that disparity if the cameras converge.
        """
        return changed(self, zooms=True)

    def field_at(self, z_px: Array) -> Array:
        """Return the field's basis (n, K) at views (n, 4); K is 0 without a field."""
        return self._field.at(z_px[:, :2])

    def effects(self, z_px: Array, age_s: Array | float = 0.0) -> Array:
        """Return the effects (n, 4, m) px of amplitudes of 1 on views (n, 4) of cameras at rest; 0 for a missing side.

        `age_s`: the time for which errors have grown, one for all views or (n,).
        """
        terms, field = self.at_rest(z_px, age_s)
        effects = np.concatenate([terms, _of_field(FIELD_MOVES, field)], axis=2)
        effects[~np.isfinite(z_px)] = 0.0
        return effects

    def at_rest(self, z_px: Array, age_s: Array | float) -> tuple[Array, Array]:
        """Return the `effects` in parts: terms (n, 4, t), and the basis (n, K) that all parts of the field share.

        The effect of the field on a missing side is meaningless.
        """
        terms, field = core.rig_effects(self.projection, self.root, self._field, z_px, np.atleast_1d(age_s))
        if self.zooms and self.by_focal is not None:
            moved = np.where(np.isfinite(z_px), self.by_focal(z_px), 0.0)
            unit = np.diag(self.root)
            terms[..., _FOCAL] = moved * unit[_FOCAL]
            terms[..., _FOCUSING] = moved * (np.reshape(age_s, (-1, 1)) * unit[_FOCUSING])
        return terms, field

    def by_timing(self, points_in_cam: Array, motion: Array, timing_s: Array, z_px: Array) -> Array:
        """Return the effects (n, 4, 2) of amplitudes of 1 of delay and readout on views of homogeneous points (n, 4).

        `motion` (2, 6) of the points; the result is exact to second order near a delay and readout `timing_s` (2,).
        """
        if self.row_of is None:
            return self.without_timing(len(z_px))
        moved = core.timed_views(*self.cameras, points_in_cam, motion, timing_s, z_px)
        return moved * self.units_of_timing

    def late_s(self, z_px: Array, timing_s: Array) -> Array:
        """Return how much later (n, 4) than the left image's middle views are exposed, by delay and readout (2,), s."""
        rows = np.zeros_like(z_px) if self.row_of is None else self.row_of(z_px)
        return timing_s[1] * rows + timing_s[0] * np.array([0.0, 0.0, 1.0, 1.0])

    def without_timing(self, n: int) -> Array:
        """Return the effects (n, 4, 2) of delay and readout on n views that do not move: zeros."""
        return np.zeros((n, 4, len(self.units_of_timing)))

    def by_disparity(self, points: Array, cam_from_previous: Array, z_px: Array) -> Array:
        """Return the effects (n, 4, 6) px of the disparity's error, at amplitudes of 1, on views (n, 4) of points.

        The points (n, 4) are homogeneous, in the previous camera, and their depths contain the error.
        """
        by_term = core.disparity_effects(self.projection, points, cam_from_previous, z_px)
        return by_term @ self.root[DISPARITY, DISPARITY]

    def error_px(self, estimate: RigEstimate, z_px: Array) -> Array:
        """Return the current effects (n, 4) px of the errors of an estimate in amplitudes on views (n, 4) at rest."""
        return self.effects(z_px, age_s=estimate.age_s)[..., : len(estimate.mean)] @ estimate.mean

    def timing(self, known: Amplitudes | RigEstimate) -> tuple[Array, Array]:
        """Return mean (2,) and covariance (2, 2) of delay and readout, seconds, from those of all amplitudes."""
        at, unit = AT_TIMING, self.root[AT_TIMING, AT_TIMING]
        return unit @ known.mean[at], unit @ (known.cov[at, at] + _LEAST_COV) @ unit.T

    def disparity(self, estimate: RigEstimate) -> tuple[Array, Array]:
        """Return mean (6,) and covariance (6, 6) of the disparity's error, px, as in `in_units`."""
        t = len(TERMS)
        root = (growth(self.projection, estimate.age_s) @ self.root)[DISPARITY]
        return self.known[DISPARITY] + root @ estimate.mean[:t], root @ estimate.cov[:t, :t] @ root.T

    def before_views(self) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Return mean and σ of all amplitudes (m,) before any view, and whether each size (m,) is to be learnt."""
        mean, size, learnt = np.zeros(len(self)), np.ones(len(self)), np.ones(len(self), dtype=bool)
        if self.known_timing is not None:
            at, unit = AT_TIMING, self.units_of_timing
            mean[at], size[at], learnt[at] = self.known_timing.mean / unit, self.known_timing.std / unit, False
        return mean, size, learnt

    def amplitudes(self, term: str, information: float, weighted: float) -> Array:
        """Return information and weighted sum (2,) about a term with a σ of its own, in units of its amplitude."""
        at = TERMS.index(term)
        return np.array([information * self.root[at, at] ** 2, weighted * self.root[at, at]])

    def root_of_turn(self, std_rad: float) -> Array:
        """Return a root (m, 3) of the covariance of amplitudes by a rotation of the right camera, σ about each axis."""
        root = np.zeros((len(self), 3))
        root[: len(TERMS)] = np.linalg.solve(self.root, std_rad * terms_of_turn(self.projection))
        return root

    def as_refined(self, z_px: RawViews) -> RawViews:
        """Return views (n, 4) without the errors that the rig's refinement knows."""
        return RawViews(z_px - columns(self.projection, z_px) @ self.known) if self.known.any() else z_px

    def in_units(self, estimate: RigEstimate) -> RigEstimate:
        """Return an estimate of amplitudes as the current error of the calibration, in units of its terms and px."""
        t = len(TERMS)
        root = growth(self.projection, estimate.age_s) @ self.root
        known = np.concatenate([self.known, np.zeros(len(estimate.mean) - t)])
        contained, timing = known.copy(), self.known_timing
        if timing is not None:
            contained[AT_TIMING] = timing.mean

        def in_units(mean: Array, cov: Array) -> tuple[Array, Array]:
            mean, cov = mean.copy(), cov.copy()
            mean[:t], cov[:t] = root @ mean[:t], root @ cov[:t]
            cov[:, :t] = cov[:, :t] @ root.T
            return known + mean, cov

        mean, cov = in_units(estimate.mean, estimate.cov)
        mean_if_wrong, cov_if_wrong = in_units(estimate.mean_if_wrong, estimate.cov_if_wrong)
        return changed(
            estimate,
            mean=mean,
            cov=cov,
            mean_if_wrong=mean_if_wrong,
            cov_if_wrong=cov_if_wrong,
            prior_std=np.concatenate(
                [np.linalg.norm(self.root * estimate.prior_std[:t], axis=1), estimate.prior_std[t:]]
            ),
            refined=contained if self.refined or timing is not None else None,
            thirds=None if estimate.thirds is None else self._thirds_in_units(estimate.thirds),
        )

    def _thirds_in_units(self, thirds: Array) -> Array:
        """Return what thirds of a run say, (3, 2, t), with the known errors, in units of the terms."""
        mean = self.known + thirds[:, 0] @ self.root.T
        return np.stack([mean, np.sqrt(thirds[:, 1] ** 2 @ self.root.T**2)], axis=1)


def _of_field(moves: Array, field: Array) -> Array:
    """Return the effects (n, k, 3K) of amplitudes of the parts, from `moves` (k, 3) of each and a field (n, K)."""
    n, parts = field.shape
    return (moves[:, :, None] * field[:, None, None]).reshape(n, len(moves), parts * moves.shape[1])


def disparity_error(projection: StereoProjection, estimate: RigEstimate, left_px: Array) -> tuple[Array, Array]:
    """Return the error (n,) of the disparity of far points at left positions (n, 2), and its σ; estimate in px."""
    p = projection
    far = np.tile(left_px, 2) + np.array([0.0, 0.0, p.cx_right_px - p.cx_left_px, 0.0])
    effects = columns(p, far)
    by_term = effects[:, 0] - effects[:, 2]
    if len(estimate.mean) > len(TERMS):  # files of a run do not contain the field
        moves = FIELD_MOVES[:1] - FIELD_MOVES[2:3]
        by_field = _of_field(moves, field_over(p.width, p.height, WORTH_ESTIMATING).at(left_px))[:, 0]
        by_term = np.concatenate([by_term, by_field], axis=1)
    return by_term @ estimate.mean, np.sqrt(np.einsum("ni,ij,nj->n", by_term, estimate.cov, by_term))


def disparity_over_image(
    projection: StereoProjection, estimate: RigEstimate, shape: tuple[int, int]
) -> tuple[Array, Array]:
    """Return the error of the disparity at (rows, columns) = `shape` positions over the left image, and its σ; px."""
    error_px, std_px = disparity_error(projection, estimate, places_over_image(projection, *shape))
    return error_px.reshape(shape), std_px.reshape(shape)
