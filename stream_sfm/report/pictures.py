"""The paper's pictures for this log: stereo frames (Figure 2), tracks (3), displacements (4); and the statuses."""

import base64
from collections.abc import Sequence

import numpy as np
from markupsafe import Markup, escape

from ..types import Status
from .front_record import FrontRecord, Snapshot
from .methods import label
from .records import RunRecord
from .svg import WIDTH, round_numbers

_MOST_LIVES = 1200  # lines; more cannot be told apart at the height of the figure
_MOST_NEEDLES = 220  # more would cover the image


def stereo_frames(front: FrontRecord) -> list[Markup]:
    """The rectified left and right image of a few frames."""
    return [
        Markup('<figure class="pair"><figcaption>Frame {}: left, right</figcaption>{}{}</figure>').format(
            s.frame_index, _image(s.left_jpeg, f"frame {s.frame_index}, left"),
            _image(s.right_jpeg, f"frame {s.frame_index}, right"),
        )
        for s in _few(front.snapshots, 3)
    ]  # fmt: skip


def needles(front: FrontRecord) -> list[Markup]:
    """Displacements of the points, from right to left image and since the previous frame, in a few frames."""
    out = []
    for s in _few([s for s in front.snapshots if len(s.temporal)] or front.snapshots, 2):
        stereo = np.column_stack([s.stereo[:, 2:], s.stereo[:, :2]])  # from the right position to the point
        for kind, lines in (
            ("stereo: displacement from the right image", stereo),
            ("temporal: displacement since the previous frame", s.temporal),
        ):
            if len(lines):
                out.append(_needles(s, kind, lines))
    return out


def _ordinal(n: int) -> str:
    return {2: "second", 3: "third"}.get(n, f"{n}th")


def _needles(s: Snapshot, kind: str, lines: np.ndarray) -> Markup:
    w, h = s.size
    every = max(1, -(-len(lines) // _MOST_NEEDLES))
    r = w / 220
    marks = "".join(
        f'<path d="M{a:.1f} {b:.1f}L{c:.1f} {d:.1f}"/><circle cx="{c:.1f}" cy="{d:.1f}" r="{r:.1f}"/>'
        for a, b, c, d in lines[::every]
    )
    return Markup(
        '<figure class="needles"><figcaption>Frame {} · {} · {} points</figcaption>'
        '<svg viewBox="0 0 {} {}" role="img"><image href="{}" width="{}" height="{}"/>'
        '<g class="needle" style="stroke-width:{}">{}</g></svg></figure>'
    ).format(s.frame_index, kind, len(lines), w, h, _uri(s.left_jpeg), w, h, f"{w / 400:.2f}", Markup(marks))


def lives(front: FrontRecord) -> Markup:
    """Figure 3: one line per point from its first to its last frame, in order of the first frame."""
    spans = list(front.lives.values())
    if not spans:
        return Markup('<p class="none">No point was tracked.</p>')
    every = max(1, -(-len(spans) // _MOST_LIVES))
    drawn = spans[::every]
    n, height = max(len(front) - 1, 1), 420
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
    note = f"{len(spans)} points" + (f", every {_ordinal(every)} drawn" if every > 1 else "")
    return Markup(
        '<figure class="wide"><figcaption><b>Track lifetimes</b> <span>{}; one line per point, from its first to '
        'its last frame</span></figcaption><svg viewBox="0 0 {} {}" role="img"><path class="lives" d="{}" '
        'style="stroke-width:{}"/>{}{}<text x="{}" y="{}" class="label mid">frame</text>'
        '<text x="13" y="{}" transform="rotate(-90 13 {})" class="label mid">points, by first frame</text></svg>'
        "</figure>"
    ).format(
        note, WIDTH * 2, height, path, f"{max(0.5, min(2.0, 0.8 * step)):.2f}", Markup(ticks), Markup(rows),
        left + w // 2, height - 5, top + h // 2, top + h // 2,
    )  # fmt: skip


def timeline(runs: Sequence[RunRecord], frames: int, gaps: Sequence[int]) -> Markup:
    """The status of every frame, one bar per method; time gaps are marked."""
    n, row, left, w = max(frames, 1), 22, 150, WIDTH * 2 - 162
    out = []
    for k, run in enumerate(runs):
        y = 4 + k * row
        out.append(f'<text x="{left - 8}" y="{y + 12}" class="tick end">{escape(label(run.name))}</text>')
        for status, first, last in _runs(run):
            x, width = left + first / n * w, max((last - first + 1) / n * w, 1.0)
            reason = run.reasons[first] if run.reasons else ""
            title = f"{status}, frames {first} to {last}" + (f": {reason}" if reason else "")
            out.append(
                f'<rect class="s-{status}" x="{x:.1f}" y="{y}" width="{width:.1f}" height="15">'
                f"<title>{escape(title)}</title></rect>"
            )
    height = 4 + len(runs) * row
    out += [f'<path class="mark" d="M{left + g / n * w:.1f} 0V{height}"/>' for g in gaps]
    for f in round_numbers(n - 1, 8):
        out.append(f'<text x="{left + f / n * w:.0f}" y="{height + 14}" class="tick mid">{f}</text>')
    out.append(f'<text x="{left + w // 2}" y="{height + 29}" class="label mid">frame</text>')
    keys = Markup("").join(
        Markup('<span class="key"><i class="s-{}"></i>{}</span>').format(s.value, s.value) for s in Status
    )
    return Markup(
        '<figure class="wide"><figcaption><b>Status per frame</b></figcaption><div class="legend">{}</div>'
        '<svg viewBox="0 0 {} {}" role="img">{}</svg></figure>'
    ).format(keys, WIDTH * 2, height + 34, Markup("".join(out)))


def _runs(run: RunRecord) -> list[tuple[str, int, int]]:
    result: list[tuple[str, int, int]] = []
    for i, status in enumerate(run.statuses):
        if result and result[-1][0] == status:
            result[-1] = (status, result[-1][1], i)
        else:
            result.append((status, i, i))
    return result


def _few(snapshots: Sequence[Snapshot], most: int) -> list[Snapshot]:
    if len(snapshots) <= most:
        return list(snapshots)
    return [snapshots[i] for i in np.linspace(0, len(snapshots) - 1, most).round().astype(int)]


def _image(data: bytes, alt: str) -> Markup:
    return Markup('<img src="{}" alt="{}">').format(_uri(data), alt)


def _uri(data: bytes) -> str:
    return "data:image/jpeg;base64," + base64.b64encode(data).decode()
