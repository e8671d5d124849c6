"""The layout of the viewer: entity paths, blueprint and colours."""

from collections.abc import Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from ..geometry import Array

CAMERA = "world/camera"
SIDES = (f"{CAMERA}/left", f"{CAMERA}/right")
TRAJECTORY, TRUTH, POINTS = "world/trajectory", "world/ground_truth", f"{CAMERA}/local_structure"
ELLIPSOID = f"{CAMERA}/position_3_sigma"
GRAVITY, VELOCITY = f"{CAMERA}/gravity", f"{CAMERA}/velocity"
LOOPS_BEFORE, LOOPS_AFTER = "world/places/before", "world/places/after"
TIMELINES = ("frame", "time")
DRIFT, TRACKS, TIMING, STATUS = "drift", "tracks", "timing", "status"
TRACK_SERIES = ("tracked", "new", "used", "rejected")
ESTIMATE_COLOUR, TRUTH_COLOUR, ELLIPSOID_COLOUR = (255, 170, 60), (110, 200, 120), (255, 90, 160)
GRAVITY_COLOUR, VELOCITY_COLOUR = (230, 230, 230), (60, 200, 230)
MAP_COLOUR = (90, 160, 255)
SERIES_COLOURS = [(90, 160, 255), (120, 220, 120), (255, 190, 80), (240, 90, 90)]

# σ of a point relative to its distance: from blue through green to yellow, on a logarithmic scale.
_RELATIVE_SIGMA = (1e-3, 1e-1)
_STOPS = np.array([(90, 90, 255), (70, 120, 255), (50, 150, 240), (40, 170, 200), (31, 158, 137), (53, 183, 121),
                   (110, 206, 88), (181, 222, 43), (253, 231, 37)], dtype=float)  # fmt: skip
_RGB = [np.interp(np.linspace(0, len(_STOPS) - 1, 256), range(len(_STOPS)), c).astype(np.uint32) for c in _STOPS.T]
# (256,) as 0xRRGGBBAA, from the first stop to the last: Rerun logs packed colours three times faster.
_COLOURS = _RGB[0] << 24 | _RGB[1] << 16 | _RGB[2] << 8 | np.uint32(255)


def colours_of(points_in_cam: Array, cov_points: Array) -> NDArray[np.uint32]:
    """Return colours (n,) as 0xRRGGBBAA for the relative σ of points (n, 3) with covariances (n, 3, 3)."""
    sigma = np.sqrt(np.maximum(np.trace(cov_points, axis1=1, axis2=2), 0))
    relative = sigma / np.maximum(np.linalg.norm(points_in_cam, axis=1), 1e-9)
    low, high = np.log(_RELATIVE_SIGMA)
    place = (np.log(np.clip(relative, *_RELATIVE_SIGMA)) - low) / (high - low)
    return _COLOURS[(place * (len(_COLOURS) - 1)).astype(int)]


def blueprint(sides: Sequence[str] = SIDES, unit: str = "metres") -> rrb.Blueprint:
    """Return a 3-D view, the images with tracks of the cameras `sides`, plots over time, and the status log.

    `unit` is the unit of length in the labels. On both timelines, the path is shown up to the selected time.
    """
    first, now = rrb.TimeRangeBoundary.infinite(), rrb.TimeRangeBoundary.cursor_relative()
    whole_past = [rrb.VisibleTimeRange(timeline, start=first, end=now) for timeline in TIMELINES]
    space = rrb.Spatial3DView(
        name="estimate orange, ground truth green; points by σ: 0.1 % blue, 10 % yellow",
        origin="world",
        contents=["$origin/**", f"- /{SIDES[0]}/tracks/**", f"- /{SIDES[1]}/**"],
        overrides={TRAJECTORY: rrb.VisibleTimeRanges(whole_past)},
        line_grid=False,
    )
    images = [rrb.Spatial2DView(name=f"{s.rsplit('/', 1)[1]} image with tracks", origin=s) for s in sides]
    legend = rrb.PlotLegend(rrb.Corner2D.LeftTop)
    series = [
        rrb.TimeSeriesView(name=name, origin=origin, plot_legend=legend)
        for name, origin in (
            (f"position, {unit}: error and estimated σ", DRIFT),
            ("tracks", TRACKS),
            ("time per frame, ms", TIMING),
        )
    ]
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(space, rrb.TextLogView(name="status", origin=STATUS), row_shares=[5, 1]),
            rrb.Vertical(rrb.Horizontal(*images), *series, row_shares=[3, 2, 2, 2]),
            column_shares=[5, 4],
        ),
        rrb.TimePanel(state="collapsed", timeline="frame", play_state="following"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
    )


MASKED = rr.AnnotationContext([(0, "scene", (0, 0, 0, 0)), (1, "masked", (200, 60, 60, 255))])


def styles() -> dict[str, rr.AsComponents]:
    """Return colours and sizes per entity path, which are the same for every frame and sent once."""
    ui = rr.Radius.ui_points
    return {
        TRAJECTORY: rr.LineStrips3D.from_fields(colors=ESTIMATE_COLOUR, radii=ui(1.5)),
        **{
            f"{path}/{name}": rr.LineStrips3D.from_fields(colors=colour, radii=ui(width))
            for path, colour in ((LOOPS_BEFORE, ESTIMATE_COLOUR), (LOOPS_AFTER, MAP_COLOUR))
            for name, width in (("way", 1.5), ("loops", 0.7))
        },
        POINTS: rr.Points3D.from_fields(radii=ui(3.0)),
        ELLIPSOID: rr.Ellipsoids3D.from_fields(
            colors=ELLIPSOID_COLOUR, fill_mode=rr.components.FillMode.MajorWireframe
        ),
        GRAVITY: rr.Arrows3D.from_fields(colors=GRAVITY_COLOUR, radii=ui(2.0), labels="gravity"),
        VELOCITY: rr.Arrows3D.from_fields(colors=VELOCITY_COLOUR, radii=ui(2.0), labels="velocity"),
        **{f"{side}/tracks": rr.Points2D.from_fields(radii=ui(2.5)) for side in SIDES},
    }
