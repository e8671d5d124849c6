"""How a map begins with one camera: points are followed from an opening frame until the motion shows their depths."""

from dataclasses import replace

import numpy as np

from ...geometry import se3
from ...geometry.se3 import Array
from ..alignment import TemplateAligner
from ..flow import exposure_hypotheses
from ..prepared import PreparedImages
from ..tracker import Followed, Tracker
from ..tracks import Tracks
from ..warps import anchor_from_now
from .two_view import TwoView, two_view_motion

# Followed since the opening frame, chosen by hand: so many, and at least this fraction of its points; what is
# left of fewer may be one object that moves by itself.
MIN_TRACKS = 30
_MIN_FOLLOWED_FRACTION = 0.5


class MapStartFinder:
    """Looks for the first motion that shows depths; `waiting` says for what, until there is one."""

    def __init__(self, tracker: Tracker, aligner: TemplateAligner) -> None:
        self.tracker = tracker
        self.aligner = aligner
        self.waiting = ""
        self.n_opened = 0  # points of the opening frame
        self.rho_scene = 0.0  # median inverse depth of what was last in view; 0 before the first map
        self.cov_start = np.zeros((6, 6))  # of first_from_now, when a map has begun

    def open(self, why: str) -> None:
        """Make this frame the opening one."""
        self.tracker.tracks, self.tracker.cam_from_start = Tracks.none(), np.eye(4)
        self.waiting = why

    def find(self, images: PreparedImages) -> Followed | None:
        """The motion since the opening frame, not since the previous one, as soon as it shows depths.

        Its length is the unit of the first map; after a loss the best guess of the unit is that the scene is as far
        away as it was.
        """
        tracker = self.tracker
        if not len(tracker.tracks):
            self.open("depths need a second view")
            return None
        cov_px = self._follow_directions(images)
        n = len(tracker.tracks)
        if n < max(MIN_TRACKS, _MIN_FOLLOWED_FRACTION * self.n_opened):
            self.open(f"{n} of {self.n_opened} points could be followed since the opening frame")
            return None
        std_px = float(np.sqrt(np.median(np.trace(cov_px[:, :2, :2], axis1=1, axis2=2)) / 2))
        std_ray = std_px / tracker.projection.f_px
        found = two_view_motion(tracker.tracks.anchor_rays, tracker.tracks.points[:, :2], std_ray)
        self.waiting = found.problem if found else "no rigid motion explains the points"
        if found is None:
            return None
        if self.waiting:  # the motion's direction may mean nothing yet, its rotation turns the templates
            rotation = found.now_from_first[:3, :3]
            tracker.cam_from_start = se3.from_rotation_translation(rotation, np.zeros(3))
            return None
        return self._begin(found, cov_px)

    def _follow_directions(self, images: PreparedImages) -> Array:
        """Follow the tracks, all taken for infinitely far; covariances (n, 4, 4) of what is left of them."""
        tracker, aligner = self.tracker, self.aligner
        tracks, p = tracker.tracks, tracker.projection
        if tracker.previous is None:
            return np.empty((0, 4, 4))
        expected_px = p.project_homogeneous(tracks.points)[:, :2]
        before_half = exposure_hypotheses(tracker.previous, images)[0]
        at_px, found = tracker.flow.track(before_half, images, tracks.left_px, expected_px)
        warps = anchor_from_now(tracks, tracker.cam_from_start, p)[0]
        found &= aligner.atlas.fits(warps)
        tracks = tracks.keep(found)
        left = aligner.align_left(images, tracks.slots, warps[found], at_px[found])
        tracks, left_px = tracks.keep(left.found), left.at_px[left.found]
        error_grey = left.error_grey[left.found]
        cov_px = aligner.noise.covariance(
            left.patches.gradients[left.found], error_grey, np.full(len(error_grey), np.nan)
        )
        rho, var_rho = tracks.points[:, 3], tracks.var_rho
        tracker.tracks = tracks.placed(p.rays(left_px), left_px, cov_px[:, :2, :2], rho, var_rho)
        return cov_px

    def _begin(self, found: TwoView, cov_px: Array) -> Followed:
        """Give the points that agree with the motion their depths, in the unit of the map."""
        tracker = self.tracker
        tracks, rho, var_rho = tracker.tracks.keep(found.agree), found.rho[found.agree], found.var_rho[found.agree]
        self.rho_scene = self.rho_scene or float(np.median(rho))
        unit = float(np.median(rho)) / self.rho_scene
        cam_from_start = found.now_from_first.copy()
        cam_from_start[:3, 3] *= unit
        tracker.cam_from_start, tracker.velocity = cam_from_start, np.zeros(6)
        self.cov_start = found.cov_first_from_now
        points = np.concatenate([tracks.anchor_rays, np.ones((len(rho), 1)), rho[:, None] / unit], axis=1)
        tracker.tracks = replace(tracks, points=points, var_rho=var_rho / unit**2).moved(cam_from_start)
        z_px = np.concatenate([tracks.left_px, np.full((len(rho), 2), np.nan)], axis=1)
        return Followed(cam_from_start, z_px, cov_px[found.agree])
