"""The lives of the tracks (the paper's Figure 3), and the statuses of all frames."""

from collections.abc import Sequence

from markupsafe import Markup, escape

from ..types import Status
from .front_record import FrontRecord
from .methods import short
from .records import RunRecord
from .svg import WIDTH, round_numbers

_MOST_LIVES = 1200  # lines; more cannot be told apart at the height of the figure
_LIVES_HEIGHT = 300


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
