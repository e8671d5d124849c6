"""A picture of what a run saw, with where its points came from."""

import base64

import cv2
import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from ..camera.lens import project_into_image
from ..camera.models import Camera
from ..geometry.se3 import Array
from ..types import Frame, FrameEstimate

_WIDTH_PX = 560  # a compromise between detail and the size of the page
_JPEG_QUALITY = 72


class View:
    """A sink that keeps the left image of one frame of the second half, with where its points came from.

    It keeps frames 1, 2, 4, 8 …, each instead of the one before, so that it costs next to nothing.
    """

    def __init__(self, camera: Camera) -> None:
        self._camera = camera
        self._next = 1
        self._previous: FrameEstimate | None = None
        self._jpeg, self._frame_index = b"", 0
        self._tails: Array = np.empty((0, 4))

    def write(self, estimate: FrameEstimate, frame: Frame) -> None:
        """Take the next frame."""
        if estimate.frame_index >= self._next and self._previous is not None:
            self._next = 2 * estimate.frame_index
            self._frame_index, self._jpeg = estimate.frame_index, _jpeg(np.asarray(frame.images[0]))
            before, now = (self._pixels(e) for e in (self._previous, estimate))
            self._tails = np.array([[*before.get(track, place), *place] for track, place in now.items()])
        self._previous = estimate

    def close(self) -> None:
        """Nothing to finish."""

    def _pixels(self, estimate: FrameEstimate) -> dict[int, Array]:
        """Where the points of a frame are in its left image, by track."""
        front = estimate.points_in_cam[:, 2] > 0
        pixels = project_into_image(self._camera, estimate.points_in_cam[front])
        known = np.isfinite(pixels).all(axis=1)
        return dict(zip(estimate.track_ids[front][known].tolist(), pixels[known], strict=True))

    def figure(self) -> Markup:
        """The image with a line per point, from its place in the frame before; empty where none was kept."""
        if not self._jpeg:
            return Markup("")
        w, h = self._camera.width, self._camera.height
        r = w / 200
        marks = "".join(
            f'<path d="M{a:.1f} {b:.1f}L{c:.1f} {d:.1f}"/><circle cx="{c:.1f}" cy="{d:.1f}" r="{r:.1f}"/>'
            for a, b, c, d in self._tails.tolist()
        )
        return Markup(
            '<figure class="view"><figcaption><b>View</b> <span>left image of frame {}: {} points with their motion '
            'since the frame before</span></figcaption><svg viewBox="0 0 {} {}" role="img"><image href="{}" width="{}" '
            'height="{}"/><g class="needle" style="stroke-width:{}">{}</g></svg></figure>'
        ).format(self._frame_index, len(self._tails), w, h, _uri(self._jpeg), w, h, f"{w / 300:.2f}", Markup(marks))


def _jpeg(image: NDArray[np.uint8]) -> bytes:
    """An image, reduced to at most `_WIDTH_PX` columns."""
    scale = min(1.0, _WIDTH_PX / image.shape[1])
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1 else image
    return bytes(cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])[1])


def _uri(jpeg: bytes) -> str:
    return "data:image/jpeg;base64," + base64.b64encode(jpeg).decode()
