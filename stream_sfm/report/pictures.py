"""A picture of the view, the lives of the tracks (the paper's Figure 3), and the statuses of all frames."""

import base64
from collections.abc import Sequence

import cv2
import numpy as np
from markupsafe import Markup, escape
from numpy.typing import NDArray

from ..camera.lens import project_into_image
from ..camera.models import Camera
from ..geometry.se3 import Array
from ..types import Frame, FrameEstimate, Status
from .front_record import FrontRecord
from .methods import short
from .records import RunRecord
from .svg import WIDTH, round_numbers

_VIEW_WIDTH = 560  # pixels; a compromise between detail and the size of the page
_JPEG_QUALITY = 72
_MOST_LIVES = 1200  # lines; more cannot be told apart at the height of the figure
_LIVES_HEIGHT = 300


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
    """An image, reduced to at most `_VIEW_WIDTH` columns."""
    scale = min(1.0, _VIEW_WIDTH / image.shape[1])
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1 else image
    return bytes(cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])[1])


def _uri(jpeg: bytes) -> str:
    return "data:image/jpeg;base64," + base64.b64encode(jpeg).decode()


def lives(front: FrontRecord) -> Markup:
    """Figure 3: one line per point from its first to its last frame, in order of the first frame."""
    spans = list(front.lives.values())
    if not spans:
        return Markup('<p class="none">No point was tracked.</p>')
    every = max(1, -(-len(spans) // _MOST_LIVES))
    drawn = spans[::every]
    n, height = max(len(front) - 1, 1), _LIVES_HEIGHT
    left, top, w, h = 56, 8, WIDTH * 2 - 68, height - 48
    step = h / len(drawn)
    path = "".join(
        f"M{left + a / n * w:.1f} {top + (k + 0.5) * step:.1f}H{left + max(b, a + 0.15) / n * w:.1f}"
        for k, (a, b) in enumerate(drawn)
    )
    ticks = "".join(
        f'<text x="{left + f / n * w:.0f}" y="{height - 24}" class="tick mid">{f}</text>'
        for f in round_numbers(n, 8)
    )
    rows = "".join(
        f'<text x="{left - 6}" y="{top + h * k / len(spans) + 4:.0f}" class="tick end">{k}</text>'
        for k in round_numbers(len(spans), 4)
    )
    found = front.tracks()
    note = f"{len(spans)} points, one line each, seen in {found['mean_frames']:.1f} frames in the mean"
    return Markup(
        '<figure class="wide"><figcaption><b>Track lifetimes</b> <span>{}</span></figcaption>'
        '<svg viewBox="0 0 {} {}" role="img"><path class="lives" d="{}" style="stroke-width:{}"/>{}{}'
        '<text x="{}" y="{}" class="label mid">frame</text>'
        '<text x="13" y="{}" transform="rotate(-90 13 {})" class="label mid">points, by first frame</text></svg>'
        "</figure>"
    ).format(
        note, WIDTH * 2, height, path, f"{max(0.5, min(2.0, 0.8 * step)):.2f}", Markup(ticks), Markup(rows),
        left + w // 2, height - 5, top + h // 2, top + h // 2,
    )  # fmt: skip


def timeline(runs: Sequence[RunRecord], frames: int, gaps: Sequence[int]) -> Markup:
    """The status of every frame, one bar for all methods whose frames have the same; time gaps are marked."""
    groups: dict[tuple[Status, ...], list[RunRecord]] = {}
    for run in runs:
        groups.setdefault(tuple(run.statuses), []).append(run)
    n, row, left, w = max(frames, 1), 22, 150, WIDTH * 2 - 162
    out = []
    for k, (run, *others) in enumerate(groups.values()):
        name = short(run.name) + (f" and {len(others)} more" if others else "")
        y = 4 + k * row
        out.append(f'<text x="{left - 8}" y="{y + 12}" class="tick end">{escape(name)}</text>')
        for status, first, last in _same_status(run):
            x, width = left + first / n * w, max((last - first + 1) / n * w, 1.0)
            reason = f": {run.reasons[first]}" if run.reasons[first] else ""
            out.append(
                f'<rect class="s-{status}" x="{x:.1f}" y="{y}" width="{width:.1f}" height="15">'
                f"<title>{escape(f'{status}, frames {first} to {last}{reason}')}</title></rect>"
            )
    height = 4 + len(groups) * row
    out += [f'<path class="mark" d="M{left + g / n * w:.1f} 0V{height}"/>' for g in gaps]
    for f in round_numbers(n - 1, 8):
        out.append(f'<text x="{left + f / n * w:.0f}" y="{height + 14}" class="tick mid">{f}</text>')
    out.append(f'<text x="{left + w // 2}" y="{height + 29}" class="label mid">frame</text>')
    keys = Markup("").join(Markup('<span class="key"><i class="s-{}"></i>{}</span>').format(s, s) for s in Status)
    return Markup(
        '<figure class="wide"><figcaption><b>Status per frame</b></figcaption><div class="legend">{}</div>'
        '<svg viewBox="0 0 {} {}" role="img">{}</svg></figure>'
    ).format(keys, WIDTH * 2, height + 34, Markup("".join(out)))


def _same_status(run: RunRecord) -> list[tuple[str, int, int]]:
    """Runs of frames of one status: the status, the first and the last frame."""
    result: list[tuple[str, int, int]] = []
    for i, status in enumerate(run.statuses):
        if result and result[-1][0] == status:
            result[-1] = (status, result[-1][1], i)
        else:
            result.append((status, i, i))
    return result
