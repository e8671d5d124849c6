"""Test points of a run: checked against its rig before it begins, compared with its trajectory at the end."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ..camera.models import Camera
from ..config import Config
from ..errors import ConfigError
from ..evaluation.survey_errors import SurveyErrors, SurveyViews, survey_errors
from ..evaluation.surveyed_points import SurveyedPoints, read_surveyed_points
from ..frontend.rig_effects import RigEffects
from ..geometry.se3 import Array
from ..observer import Observer
from ..types import RigEstimate, Trajectory


class SurveyCheck:
    """Test points as the rig of a run sees them. Raises ConfigError for what cannot be seen by it."""

    def __init__(self, given: str | Path | SurveyedPoints, observer: Observer, config: Config) -> None:
        config.needs_scale("a comparison with test points")
        self._points = given if isinstance(given, SurveyedPoints) else read_surveyed_points(given)
        cameras, projection = list(observer.rig.cameras.values()), observer.projection
        for camera, side, pixels in zip(
            cameras, ("left", "right"), (self._points.left_px, self._points.right_px), strict=True
        ):
            _check_inside(self._points, camera, side, pixels)
        rectifier = observer.rectifier
        left, right = self._points.left_px, self._points.right_px
        z_px = np.concatenate([rectifier.rectify_points(left, 0), rectifier.rectify_points(right, 1)], axis=1)
        behind = projection.inverse_depth(z_px) <= 0
        if behind.any():
            row = int(np.flatnonzero(behind)[0])
            raise ConfigError(
                f"test points: {_of(self._points, row)}: left and right pixel meet behind the cameras; are they "
                "exchanged, or of different points?"
            )
        self._z_px = z_px
        self._effects = RigEffects(projection, config.rig, getattr(observer.rig, "refinement", None))
        self._observer = observer

    def compare(
        self, trajectories: Mapping[str, Trajectory], truth: Trajectory | None, rig: RigEstimate | None
    ) -> tuple[dict[str, SurveyErrors], list[str]]:
        """The errors of each trajectory at the points, and warnings; empty where nothing can be compared.

        `rig`: what is known at the end about the errors of the calibration; None: it is exact.
        """
        observer, found = self._observer, {}
        axes = observer.rectifier.rect_from_cam
        views = SurveyViews(self._points, *self._corrected(rig), observer.projection, axes, observer.unseen)
        try:
            for name, trajectory in trajectories.items():
                found[name] = survey_errors(views, trajectory, truth)
        except ConfigError as error:
            return {}, [f"not compared: {error}"]
        return found, next((errors.warnings() for errors in found.values()), [])

    def _corrected(self, rig: RigEstimate | None) -> tuple[Array, Array]:
        """The views without the errors of the calibration that are known, and what is unknown of them."""
        if rig is None:
            return self._z_px, np.zeros((len(self._z_px), 4, 0))
        error_px, unknown_px = self._effects.on_views(rig, self._z_px)
        return self._z_px - error_px, unknown_px


def _check_inside(points: SurveyedPoints, camera: Camera, side: str, pixels: Array) -> None:
    """Raise ConfigError where a pixel is outside of its image."""
    with np.errstate(invalid="ignore"):
        outside = ((pixels < -0.5) | (pixels > np.array([camera.width, camera.height]) - 0.5)).any(axis=1)
    if outside.any():
        row = int(np.flatnonzero(outside)[0])
        u, v = pixels[row].tolist()
        raise ConfigError(
            f"test points: {_of(points, row)}: the {side} pixel ({u:g}, {v:g}) is outside of the image, which is "
            f"{camera.width}×{camera.height}: give pixels of the image as recorded, u to the right first"
        )


def _of(points: SurveyedPoints, row: int) -> str:
    return f"sighting {row} of {points.names[points.point_rows[row]]!r}"
