"""Every function of the compiled core with valid arguments, and possible replacements for them."""

import random
from collections.abc import Iterator
from types import SimpleNamespace as Record

import numpy as np

from stream_sfm.core import _core as core
from stream_sfm.frontend.learnt.rows import RowRules
from stream_sfm.frontend.new_points import PointRules
from stream_sfm.frontend.rules import ErrorRules
from stream_sfm.frontend.templates import TemplateRules
from stream_sfm.geometry.resection import Wanted
from stream_sfm.geometry.robust_rules import RobustRules
from stream_sfm.rig_model.terms import TERMS

RNG = np.random.default_rng(0)
IMAGE = RNG.uniform(0, 255, (60, 80)).astype(np.float32)
N, SIDE = 7, 27
PIXELS = RNG.integers(-20, 100, (N, 2))
STARTS = RNG.uniform(-20, 100, (N, 2))
INNER = np.stack([np.arange(20, 20 + 6 * N, 6), np.arange(20, 20 + 3 * N, 3)], axis=1)
STORED = RNG.uniform(0, 255, (N, SIDE, SIDE)).astype(np.float32)
SLOTS = np.arange(N)
WARPS = np.eye(3, 2) + 0.1 * RNG.normal(size=(N, 3, 2))
POINTS = np.concatenate([RNG.normal(size=(N, 3)), np.ones((N, 1))], axis=1)
VIEWS, COV = RNG.uniform(0, 60, (N, 4)), np.broadcast_to(np.eye(4), (N, 4, 4))
PINHOLES = Record(f_px=60.0, cx_left_px=40.0, cx_right_px=40.0, cy_px=30.0, baseline_m=0.1, width=80, height=60)
SHARED = RNG.normal(size=(N, 4, 2))
OF_VIEWS = Record(
    projection=PINHOLES, points=POINTS, cov_points=COV, z_px=VIEWS, cov_px=COV, shared=SHARED, gate=np.ones(N)
)
MOTIONS = np.broadcast_to(np.eye(4), (N, 4, 4))
FIELD, MOVES = RNG.normal(size=(N, 3)), RNG.normal(size=(4, 2))
GRID = Record(u_px=np.arange(3.0), v_px=np.arange(2.0), length_px=8.0, root=np.eye(6))
ROWS = Record(
    projection=PINHOLES,
    field=GRID,
    mean=np.ones(13),
    cov=np.eye(13),
    scatter_px=0.2,
    unexplained_px=0.2,
    max_px=2.0,
    rules=RowRules(),
)
EXPOSED = Record(size_px=(80.0, 60.0), coefficients=RNG.normal(size=(2, 3, 3)))
TURN_RULES = Record(std_rad=0.1, limit=27.0, steps=12, guess_frames=5)
USUAL = Record(rules=TURN_RULES, measured=np.eye(3), real=np.eye(3), frames=3, late=np.ones(2))
APPARENT = Record(cov_others=np.eye(3), per_s=np.ones(3), var_delay_s2=1.0, std_rad=0.1)
TURN = Record(rad=np.ones(3), cov=np.eye(3), chi2=1.0, apparent=APPARENT)
RIGHT_SIDES = Record(rows=ROWS, turn_rad=np.ones(3), twist=np.ones(6))
TIMING = Record(row_of=EXPOSED, mean=np.ones(2), cov=np.eye(2), twist=np.ones(6))
TEMPLATES = Record(
    scale=1, spacing_px=2, config=Record(window_radius_px=4, max_realignment_px=3.0, max_photometric_error=20.0),
    noise=Record(shared_pixels=4.0, factor=1.0), rules=TemplateRules(),
)  # fmt: skip
POINT_RULES = PointRules(std_grey=4.0, max_halves_apart_px=2.0)
RULES = RobustRules(second_views=4)
TRACKS = Record(
    points=POINTS, var_rho=np.ones(N), cov_left_px=COV[:, :2, :2], anchor_from_start=MOTIONS,
    anchor_velocity_px_s=STARTS, slopes=STARTS, exposures=1 + STARTS, scale=np.ones(N, int),
)  # fmt: skip
AXES = Record(rotation=np.eye(3), std_scale=0.1, std_axes_rad=0.1)
BYTES, BYTES_STORED = IMAGE.astype(np.uint8), STORED.astype(np.uint8)
STATE = Record(
    cams_from_ref=MOTIONS[:2], ids=SLOTS, ref_from_anchor=MOTIONS, q=POINTS[:, :3], rig_error=np.zeros(8),
    own=np.zeros((2, 1)),
)  # fmt: skip
SEEN = Record(
    frame=SLOTS % 2, ids=SLOTS, used=SLOTS > 0, z_px=VIEWS, weight=np.ones((N, 4)), root=COV, own=SHARED[..., :1],
    terms=SHARED, timing=np.zeros((N, 4, 0)), field=FIELD, moves=MOVES,
)  # fmt: skip


def but(record: Record, **others: object) -> Record:
    """The record with other values in some fields."""
    return Record(**{**vars(record), **others})


ONE = but(STATE, cams_from_ref=MOTIONS[:1], own=np.zeros((1, 1))), but(SEEN, frame=SLOTS * 0)
PRIOR = Record(
    ids=SLOTS,
    mean=POINTS[:, :3],
    cov=COV[:, :3, :3],
    modes=np.zeros((N, 3, 9)),
    world_modes=np.ones((23, 9)),
    rig=Record(mean=np.zeros(8), information=np.eye(8), weighted=np.ones(8), held=np.ones(8)),
)
PRIOR_OF_SOME = but(PRIOR, ids=SLOTS[3:], mean=POINTS[3:, :3], cov=COV[3:, :3, :3], modes=np.zeros((N - 3, 3, 9)))
SOLVED = core.window_step(PINHOLES, STATE, SEEN, PRIOR, np.zeros(9), True, np.zeros((0, 0)), np.zeros(0))[0]
SYSTEM = Record(prior=PRIOR, solved=SOLVED, rig_ids=SLOTS, rig=SOLVED, cov_rig=np.eye(8))
INTERVALS = Record(
    rotation=np.tile(np.eye(3), (2, 1, 1)), motion=np.zeros((2, 6)), by_bias=np.zeros((2, 9, 6)),
    by_clock=np.zeros((2, 9)), cov=np.tile(np.eye(9), (2, 1, 1)), biases=np.zeros((2, 6)), clock=np.zeros(2),
    seconds=np.full(2, 0.1),
)  # fmt: skip
ONE_INTERVAL = Record(**{name: array[:1] for name, array in vars(INTERVALS).items()})

# Each function with valid arguments
CALLS = {
    "preintegrate": (
        *(np.arange(4) / 200, np.ones((4, 3)), np.ones((4, 3))),
        *(np.ones(3), np.zeros(6), np.full(2, 1e-3)),
    ),
    "slide_leads": (np.tile(np.eye(4), (2, 1, 1)), np.zeros((2, 3))),
    "inertial_rows": (
        *(INTERVALS, np.tile(np.eye(4), (2, 1, 1)), np.zeros((12, 6)), np.zeros((2, 3))),
        *(np.ones(17), np.eye(4)),
    ),
    "inertial_information": (
        *(INTERVALS, np.tile(np.eye(4), (2, 1, 1)), np.zeros((2, 3)), np.ones(2), np.zeros((2, 3))),
        *(np.ones(17), np.eye(4)),
    ),
    "inertial_motion": (ONE_INTERVAL, np.ones(17), np.eye(4), np.ones(6)),
    "encoded": (
        [(("text", "s", None, 0), ("numbers", "d", -1, 8), ("parts", (("is", "?", None, 0),), -1, 0))],
        [Record(text="σ", numbers=np.arange(3.0), parts=[Record(**{"is": True})])],
    ),
    "innovation": (np.eye(4), np.eye(6), np.eye(4), np.eye(6), 0.1),
    "weigh_innovation": (np.ones(6), np.eye(6), np.ones(6)),
    "match_along_rows": (IMAGE, IMAGE, PIXELS, -5, 40, POINT_RULES),
    "unfilter_png": (IMAGE.astype(np.uint8) % 5, 1),
    "store_patches": (STORED.copy(), IMAGE, PIXELS, SLOTS),
    "corner_strength": (IMAGE,),
    "new_corners": (IMAGE, IMAGE > 9, STARTS, 20, 4.0, 80.0, POINT_RULES),
    "ghost_sums": (BYTES, BYTES, BYTES, STARTS, STARTS + 2.0, STARTS + 5.0, 1.0, 1e-3),
    "among": (SLOTS, SLOTS[2:]),
    "union_of": (SLOTS % 3,),
    "row_errors_of_tracks": (SLOTS, SLOTS, np.ones((N, 5)), SLOTS, VIEWS, COV, ErrorRules()),
    "view_inflation": (SLOTS, 0.5, 1.0, 0.92, ErrorRules()),
    "warp_patches": (STORED, SLOTS, WARPS, 4, 2, TemplateRules()),
    "align_patches": (
        IMAGE, STARTS, *core.warp_patches(STORED, SLOTS, WARPS, 4, 2, TemplateRules()), np.tile([1.0, 0.0], (N, 1)),
        4, 2, TemplateRules(),
    ),
    "_predict_tracks": (PINHOLES, TIMING, np.ones(6), TRACKS, np.eye(4), np.eye(4), STARTS, np.ones(N, bool)),
    "update_depths": (PINHOLES, TRACKS, np.eye(4), VIEWS, COV, 1.1),
    "templates_fit": (WARPS, 4.0, 10.0, 0.2),
    "inside_area": (IMAGE > 100, STARTS),
    "_view_covariances": (COV[:, :2, :2], np.ones(N), np.ones(N), 4.0, 1.0, 1.0, TemplateRules()),
    "template_drift": (POINTS, np.eye(4), np.ones(N, int), 10.0),
    "match_new_points": (
        IMAGE, IMAGE, STORED, TEMPLATES, RIGHT_SIDES, PIXELS, SLOTS, STARTS[:, 0], 3.0, POINT_RULES,
    ),
    "linearise_views": (OF_VIEWS, np.eye(4)),
    "view_residuals": (OF_VIEWS, COV, np.ones(2), np.eye(4)[None]),
    "fit_motion": (OF_VIEWS, np.eye(4), np.zeros(2), np.ones(N), RULES, True),
    "project_points": (PINHOLES, POINTS),
    "seen_points": (PINHOLES, VIEWS),
    "resect": (OF_VIEWS, np.eye(4), np.zeros(2), np.ones(N), RULES, Wanted(True, False, False, False), np.eye(4)),
    "motion_of_flow": (PINHOLES, TRACKS, np.ones(N), STARTS, np.ones(N, bool), np.eye(4), 0.5, 9.0, RULES),
    "fit_turn": (but(OF_VIEWS, shared=SHARED[..., :0]), np.eye(4), np.eye(3), TURN_RULES),
    "rig_effects": (PINHOLES, np.eye(len(TERMS)), GRID, VIEWS, np.ones(N)),
    "expected_views": (PINHOLES, STATE, SEEN, SLOTS > 2, VIEWS),
    "timing_of_views": (PINHOLES, EXPOSED, STATE, SEEN, VIEWS, np.ones((2, 2, 6)), np.ones(2)),
    "field_basis": (GRID, STARTS),
    "rig_mixture": (
        np.ones(9), np.eye(9), np.full(9, 2.0), 3, np.eye(2, 4) > 0, np.log([0.5, 0.5]), 0.5, 0.25, 0.05, False,
    ),
    "row_terms": (PINHOLES, GRID, STARTS, np.ones(N)),
    "_on_one_row": (ROWS, STARTS, STARTS, np.ones(N), 1.0),
    "_gradient_matrices": (COV[:, :3, :3], 2),
    "align_tracks": (
        *(
            RIGHT_SIDES, TIMING, but(TRACKS, scale=1 + 3 * (SLOTS % 2)), SLOTS, *2 * (np.eye(4),), INNER / 1.0,
            SLOTS < 9,
        ),
        Record(left=BYTES, right=BYTES, stored=BYTES_STORED, area=BYTES > 0, kind=TEMPLATES),
        Record(left=IMAGE, right=None, stored=STORED, area=IMAGE > 0, kind=but(TEMPLATES, scale=4)),
    ),
    "place_new_points": (RIGHT_SIDES, TIMING, VIEWS, COV, 1.0, -2.0, 9.0),
    "weigh_turn": (USUAL, TURN, np.ones(4)),
    "learn_turn": (USUAL, TURN, 3),
    "effects_of_turn": (PINHOLES, STARTS),
    "fit_rows": (ROWS, STARTS, np.ones(N), np.ones(N), np.ones((N, 2)), 1e-3, 2.4, 2),
    "views_by_turn": (PINHOLES, VIEWS, np.eye(3)),
    "with_turn": (PINHOLES, VIEWS, COV, np.eye(3)),
    "point_motions": (MOTIONS, np.arange(N) / 10),
    "errors_of_motions": (np.arange(N) / 10, 0.1),
    "velocities": (PINHOLES, POINTS, RNG.normal(size=(N, 6))),
    "timed_views": (PINHOLES, EXPOSED, POINTS, np.ones((2, 6)), np.ones(2), VIEWS),
    "timing_unknowns": (PINHOLES, EXPOSED, *2 * (POINTS, np.ones(6)), np.ones(2), np.eye(2), np.ones(6)),
    "unknown_errors": (TIMING, ROWS, POINTS, POINTS, VIEWS, np.ones(6), np.ones(6)),
    "shifts_by_timing": (PINHOLES, EXPOSED, POINTS, np.ones(6), np.ones(2)),
    "reported_motions": (AXES, MOTIONS, np.ones((N, 6, 6)), np.ones((N, 6, 2))),
    "reported_points": (AXES, POINTS[:, :3], COV[:, :3, :3], np.ones(N), np.eye(4)),
    "track_covariances": (COV[:, :2, :2], np.ones(N), np.ones(N), 60.0, 0.1),
    "whitening_of_views": (VIEWS, COV),
    "_whiten_blocks": (COV[:, :3, :3], SHARED[:, :3]),
    "gates_of_views": (VIEWS, 5.0, 9.0),
    "log_evidence": (np.ones(N), np.ones(N), np.ones(3)),
    "polynomial_rows": (EXPOSED, VIEWS),
    "pose_exp": (RNG.normal(size=(N, 6)),),
    "pose_log": (MOTIONS,),
    "pose_inverse": (MOTIONS,),
    "pose_adjoint": (MOTIONS,),
    "rotation_vectors": (COV[:, :3, :3],),
    "quaternions": (COV[:, :3, :3],),
    "orthonormalise": (MOTIONS,),
    "inverse_root": (np.eye(6), True),
    "_large_product": (SHARED[:, :, 0], SHARED[0]),
    "_large_gram": (SHARED[:, :, 0],),
    "solved_by_size": (np.eye(3), np.ones((3, 2)), np.ones((4, 3))),
    "_reflections": (POINTS[:, :3],),
    "_minor_directions": (np.eye(6), 0.5),
    "newest_pose_covariance": (STATE, SYSTEM),
    "window_marginals": (STATE, SYSTEM, np.eye(4), np.eye(6), 3.0),
    "points_of_views": (STATE, SEEN),
    "views_within_gates": (PINHOLES, STATE, SEEN, np.ones((N, 3)), 5.0, 9.0),
    "_slides_of_views": (SLOTS, SLOTS % 4, np.ones((N, 3)), 60.0),
    "window_motions": (
        *(MOTIONS[:2], MOTIONS[:2], np.ones((12, 20)), np.ones((12, 3)), np.eye(3), np.ones(4), np.array([12, 18])),
        *(np.ones(2), 0.25),
    ),
    "followed_pose": (*3 * (np.eye(4),), np.eye(6), POINTS[:, :3], COV[:, :3, :3], 0.8, 0.5),
    "squares_of_tracks": (PINHOLES, STATE, SEEN),
    "points_seen_again": (SLOTS, np.ones((N, 3)), SLOTS, POINTS[:, :3], COV[:, :3, :3]),
    "_drift_covariances": (SLOTS, MOTIONS, POINTS[:, :3], SLOTS[1:], np.ones((N - 1, 3))),
    "determined_points": (SLOTS, SLOTS[3:], SLOTS, SLOTS > 0, SLOTS > 2, 4),
    "widened_points": (POINTS[:, :3], COV[:, :3, :3], np.eye(4), np.eye(6)),
    "normal_blocks": (PINHOLES, STATE, SEEN, True),
    "poses_by_parts": (PINHOLES, STATE, SEEN, np.ones((N, 3, 6 * N)), np.ones((N, 3)), SLOTS % 3, 3),
    "times_among": (SLOTS, SLOTS % 3, SLOTS > 1),
    "eliminate_points": (COV[:, :3, :3], np.zeros((N, 3, 12))),
    "window_step": (PINHOLES, STATE, SEEN, PRIOR, np.zeros(9), True, np.eye(29), np.ones(29)),
    "window_with_rig_moved": (STATE, np.zeros(9), SOLVED, np.ones(8)),
    "points_alone": (COV[:, :3, :3], np.zeros((N, 3, 7)), POINTS[:, :3], SHARED[:, :3], POINTS[:, :3], np.ones(2)),
    "disparity_effects": (PINHOLES, POINTS, np.eye(4), VIEWS),
    "absorb_frame": (
        *(PINHOLES, *ONE, SLOTS > 2, np.ones((N, 3)), SLOTS > 1, PRIOR_OF_SOME),
        *(np.zeros(9), np.ones((6, 16)), np.eye(16), np.ones(16), 0.5),
    ),
    "_truncate_modes": (COV[:, :3, :3], RNG.normal(size=(N, 3, 9)), RNG.normal(size=(2, 9)), 3, 0.5),
}  # fmt: skip
VALUES = (np.nan, np.inf, -np.inf, 1e300, -1e300)


def call(name: str, arguments: list) -> object:
    """The answer, or None if the arguments were refused."""
    try:
        return getattr(core, name)(*arguments)
    except (ValueError, TypeError, np.linalg.LinAlgError):
        return None


Place = tuple[int | str, ...]  # numbers of arguments, names of fields


def fields_of(record: object) -> dict[str, object]:
    """The fields of a record; nothing else has any."""
    if isinstance(record, Record):
        return vars(record)
    names = getattr(type(record), "__match_args__", getattr(record, "_fields", ()))
    return {name: getattr(record, name) for name in names}


def places_of(arguments: tuple) -> Iterator[tuple[Place, object]]:
    """All arguments and fields of records, with their places."""
    rest = [((at,), argument) for at, argument in enumerate(arguments)]
    while rest:
        place, argument = rest.pop(0)
        yield place, argument
        rest += [((*place, name), value) for name, value in fields_of(argument).items()]


def arrays_of(arguments: tuple) -> list[tuple[Place, np.ndarray]]:
    """All arrays among arguments and fields of records, with their places."""
    return [(place, value) for place, value in places_of(arguments) if isinstance(value, np.ndarray)]


def with_other(arguments: tuple, place: Place, other: object) -> tuple:
    """The arguments with another one, or another field, at that place."""
    changed, (at, *within) = list(arguments), place
    changed[at] = _with_field(arguments[at], within, other)
    return tuple(changed)


def _with_field(record: object, within: list[str], other: object) -> object:
    if not within:
        return other
    fields = fields_of(record)
    return Record(**{**fields, within[0]: _with_field(fields[within[0]], within[1:], other)})


def _other(rng: random.Random, argument: object) -> object:
    """A replacement for an argument."""
    if isinstance(argument, np.ndarray) and rng.random() < 0.8:
        other = argument.copy()
        match rng.randrange(5):
            case 0:
                return np.resize(other, [max(0, n + rng.choice((-n, -1, 0, 0, 1, 3))) for n in other.shape])
            case 1:
                return np.full(rng.choice([(0,), (1, 1), (2, 3, 4), (5,) * 4, ()]), rng.choice(_NUMBERS), float)
            case 2:
                return other.astype(rng.choice((np.uint8, np.int64, np.float32, np.float64, bool)), copy=False)
            case 3:
                return other[tuple(slice(None, None, rng.choice((1, 1, -1, 2))) for _ in other.shape)]
        with np.errstate(all="ignore"):
            numbers = np.array(rng.choices(_NUMBERS, k=max(1, other.size // 3))).astype(other.dtype)
        if other.size:
            other.flat[[rng.randrange(other.size) for _ in numbers]] = numbers
        return other
    if (fields := list(fields_of(argument).items())) and rng.random() < 0.5:
        return Record(**dict(rng.sample(fields, len(fields) - 1)))
    return rng.choice(
        (None, "text", (), True, np.zeros(0), *_NUMBERS, *_NUMBERS, *(int(n) for n in _NUMBERS if abs(n) < 1e300))
    )


_NUMBERS = (
    np.nan, np.inf, -np.inf, 1e300, -1e300, 0, 1, -1, 2, 3, 1001, 2**31 - 1, -(2**31), 2**62, -(2**62), 1e-300,
)  # fmt: skip


def attack(rng: random.Random) -> None:
    """Call a function with up to three arguments or fields replaced; it returns, or refuses them."""
    name = rng.choice(sorted(CALLS))
    arguments = CALLS[name]
    for _ in range(rng.randint(1, 3)):
        at, argument = rng.choice(list(places_of(arguments)))
        arguments = with_other(arguments, at, _other(rng, argument))
    with np.errstate(all="ignore"):
        call(name, list(arguments))
