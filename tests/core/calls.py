"""Every function of the compiled core with arguments that it takes, and what may be put in their place."""

import random
from collections.abc import Iterator

import numpy as np

from stream_sfm import core

RNG = np.random.default_rng(0)
IMAGE = RNG.uniform(0, 255, (60, 80)).astype(np.float32)
N, SIDE, K2 = 7, 27, 25
PIXELS = RNG.integers(-20, 100, (N, 2))
STARTS = RNG.uniform(-20, 100, (N, 2))
INNER = np.stack([np.arange(20, 20 + 6 * N, 6), np.arange(20, 20 + 3 * N, 3)], axis=1)
STORED = RNG.uniform(0, 255, (N, SIDE, SIDE)).astype(np.float32)
SLOTS = np.arange(N)
WARPS = np.eye(3, 2) + 0.1 * RNG.normal(size=(N, 3, 2))
POINTS = np.concatenate([RNG.normal(size=(N, 3)), np.ones((N, 1))], axis=1)
VIEWS, COV = RNG.uniform(0, 60, (N, 4)), np.broadcast_to(np.eye(4), (N, 4, 4))
PINHOLES = (60.0, 40.0, 40.0, 30.0, 0.1)
SHARED = RNG.normal(size=(N, 4, 2))
OF_VIEWS = (PINHOLES, POINTS, COV, VIEWS, COV, SHARED, np.ones(N))
MOTIONS = np.broadcast_to(np.eye(4), (N, 4, 4))
FIELD, MOVES = RNG.normal(size=(N, 3)), RNG.normal(size=(4, 2))
GRID = (np.arange(3.0), np.arange(2.0), 8.0, np.eye(6))
ROWS = ((80.0, 60.0), GRID, np.ones(13), np.eye(13), 0.2, 2.0)
EXPOSED = ((80.0, 60.0), RNG.normal(size=(2, 3, 3)))
RIGHT_SIDES = (PINHOLES, ROWS, np.ones(3), np.ones(6))
TIMING = (EXPOSED, np.ones(2), np.eye(2), np.ones(6))
TEMPLATES = (1, 4, 2, 3.0, 20.0, 4.0, 1.0)
RULES = ((80.0, 60.0), 0.8, 2.0, 4, 0.1, False, False)
TRACKS = (POINTS, np.ones(N), COV[:, :2, :2], MOTIONS, STARTS, STARTS, np.ones(N, int))
BYTES, BYTES_STORED = IMAGE.astype(np.uint8), STORED.astype(np.uint8)
STATE = (MOTIONS[:2], SLOTS, MOTIONS, POINTS[:, :3], np.zeros(8), np.zeros((2, 1)))
SEEN = (
    SLOTS % 2,
    SLOTS,
    SLOTS > 0,
    VIEWS,
    np.ones((N, 4)),
    COV,
    SHARED[..., :1],
    SHARED,
    np.zeros((N, 4, 0)),
    FIELD,
    MOVES,
)
ONE = (MOTIONS[:1], *STATE[1:5], np.zeros((1, 1))), (SLOTS * 0, *SEEN[1:])
PRIOR = (SLOTS, POINTS[:, :3], COV[:, :3, :3], np.zeros((N, 3, 9)), np.eye(8), np.ones(8))
OF_BOTH = np.zeros((N, 3, 12))

INTERVALS = (
    *(np.tile(np.eye(3), (2, 1, 1)), np.zeros((2, 6)), np.zeros((2, 9, 6)), np.zeros((2, 9))),
    *(np.tile(np.eye(9), (2, 1, 1)), np.zeros((2, 6)), np.zeros(2), np.full(2, 0.1)),
)

# Each function with arguments that it takes
CALLS = {
    "preintegrate": (
        *(np.arange(4) / 200, np.ones((4, 3)), np.ones((4, 3))),
        *(np.ones(3), np.zeros(6), np.full(2, 1e-3)),
    ),
    "inertial_rows": (INTERVALS, np.tile(np.eye(4), (3, 1, 1)), np.zeros((3, 3)), np.ones(17), np.eye(4)),
    "inertial_motion": (tuple(a[:1] for a in INTERVALS), np.ones(17), np.eye(4)),
    "match_along_rows": (IMAGE, IMAGE, PIXELS, -5, 40),
    "unfilter_png": (IMAGE.astype(np.uint8) % 5, 1),
    "store_patches": (STORED.copy(), IMAGE, PIXELS, SLOTS),
    "corner_strength": (IMAGE,),
    "new_corners": (IMAGE, IMAGE > 9, STARTS, 20, 4.0, 80.0),
    "among": (SLOTS, SLOTS[2:]),
    "union_of": (SLOTS % 3,),
    "row_errors_of_tracks": (SLOTS, SLOTS, np.ones((N, 5)), SLOTS, VIEWS, COV),
    "view_inflation": (SLOTS, 0.5, 1.0, 0.92),
    "warp_patches": (STORED, SLOTS, WARPS, 4, 2),
    "align_patches": (IMAGE, STARTS, *core.warp_patches(STORED, SLOTS, WARPS, 4, 2), 4, 2),
    "predict_tracks": (PINHOLES, TIMING, np.ones(6), TRACKS, np.eye(4), np.eye(4), STARTS, np.ones(N, bool)),
    "update_depths": (PINHOLES, TRACKS, np.eye(4), VIEWS, COV, 1.1),
    "templates_fit": (WARPS, 4.0, 10.0),
    "inside_area": (IMAGE > 100, STARTS),
    "view_covariances": (COV[:, :2, :2], np.ones(N), np.ones(N), 4.0, 1.0, 1.0),
    "template_drift": (POINTS, np.eye(4), np.ones(N, int), 10.0),
    "match_new_points": (IMAGE, IMAGE, STORED, TEMPLATES, RIGHT_SIDES, PIXELS, SLOTS, STARTS[:, 0], 3.0, 4.0, 2.0),
    "linearise_views": (OF_VIEWS, np.eye(4)),
    "view_residuals": (OF_VIEWS, COV, np.ones(2), np.eye(4)[None]),
    "fit_motion": (OF_VIEWS, np.eye(4), np.zeros(2), np.ones(N), True),
    "project_points": (PINHOLES, POINTS),
    "seen_points": (PINHOLES, VIEWS),
    "resect": (OF_VIEWS, np.eye(4), np.ones(N), RULES, np.eye(4)),
    "motion_of_flow": (PINHOLES, TRACKS, np.ones(N), STARTS, np.ones(N, bool), np.eye(4), 0.5, 9.0, RULES),
    "fit_turn": ((*OF_VIEWS[:5], SHARED[..., :0], np.ones(N)), np.eye(4), np.eye(3), 0.1),
    "rig_effects": ((PINHOLES, (80.0, 60.0), np.eye(20), GRID), VIEWS, np.ones(N)),
    "expected_views": (PINHOLES, STATE, SEEN, SLOTS > 2, VIEWS),
    "timing_of_views": (PINHOLES, EXPOSED, STATE, SEEN, VIEWS, np.ones((2, 2, 6)), np.ones(2)),
    "field_basis": (GRID, STARTS),
    "rig_mixture": (np.ones(9), np.eye(9), np.full(9, 2.0), 3, np.eye(2, 4) > 0, np.log([0.5, 0.5]), 0.5, False),
    "row_terms": ((80.0, 60.0), GRID, STARTS, np.ones(N)),
    "row_offsets": (ROWS, STARTS, np.ones(N)),
    "on_one_row": (ROWS, STARTS, STARTS, np.ones(N), 1.0),
    "gradient_matrices": (COV[:, :3, :3], 2),
    "align_tracks": (
        *(
            RIGHT_SIDES,
            TIMING,
            (*TRACKS[:6], 1 + 3 * (SLOTS % 2)),
            SLOTS,
            *2 * (np.eye(4),),
            INNER / 1.0,
            SLOTS < 9,
        ),
        (BYTES, BYTES, BYTES_STORED, BYTES > 0, TEMPLATES),
        (IMAGE, None, STORED, IMAGE > 0, (4, *TEMPLATES[1:])),
    ),
    "place_new_points": (RIGHT_SIDES, TIMING, VIEWS, COV, 1.0, -2.0, 9.0),
    "effects_of_turn": (PINHOLES, STARTS),
    "point_motions": (MOTIONS, np.arange(N) / 10),
    "velocities": (PINHOLES, POINTS, RNG.normal(size=(N, 6))),
    "timed_views": (PINHOLES, EXPOSED, POINTS, np.ones((2, 6)), np.ones(2), VIEWS),
    "timing_unknowns": (PINHOLES, EXPOSED, *2 * ((POINTS, np.ones(6)),), np.ones(2), np.eye(2), np.ones(6)),
    "unknown_errors": (PINHOLES, TIMING, ROWS, POINTS, POINTS, VIEWS, np.ones(6), np.ones(6)),
    "shifts_by_timing": (PINHOLES, EXPOSED, POINTS, np.ones(6), np.ones(2)),
    "cov_of_timed_pose": (PINHOLES, EXPOSED, POINTS, np.ones(2), np.eye(6)),
    "reported_motions": ((np.eye(3), 0.1, 0.1), MOTIONS, np.ones((N, 6, 6)), np.ones((N, 6, 2))),
    "reported_points": ((np.eye(3), 0.1, 0.1), POINTS[:, :3], COV[:, :3, :3], np.ones(N), np.eye(4)),
    "track_covariances": (COV[:, :2, :2], np.ones(N), np.ones(N), 60.0, 0.1),
    "whitening_of_views": (VIEWS, COV),
    "whiten_blocks": (COV[:, :3, :3], SHARED[:, :3]),
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
    "invert_triangle": (np.eye(6), np.ones(6)),
    "scaled_by_diagonal": (np.eye(6),),
    "point_marginals": (
        *(MOTIONS, POINTS[:, :3], COV[:, :3, :3], *2 * ((SHARED[:, :3], SHARED[:, :3], OF_BOTH, np.eye(12)),)),
        *(np.eye(4), np.eye(4), 3.0),
    ),
    "points_of_views": (STATE, SEEN),
    "views_within_gates": (PINHOLES, STATE, SEEN, 5.0, 9.0),
    "points_seen_again": (SLOTS, SLOTS > 0, np.ones((N, 3)), SLOTS, POINTS[:, :3], COV[:, :3, :3]),
    "drift_covariances": (SLOTS, MOTIONS, POINTS[:, :3], SLOTS[1:], np.ones((N - 1, 3))),
    "normal_blocks": (PINHOLES, STATE, SEEN),
    "q_by_reference": (MOTIONS, POINTS[:, :3]),
    "times_among": (SLOTS, SLOTS % 3, SLOTS > 1),
    "eliminate_points": (COV[:, :3, :3], np.zeros((N, 3, 12))),
    "window_system": (core.normal_blocks(PINHOLES, STATE, SEEN), PRIOR, POINTS[:, :3], np.zeros(9)),
    "points_alone": (COV[:, :3, :3], np.zeros((N, 3, 7)), POINTS[:, :3], SHARED[:, :3], POINTS[:, :3], np.ones(2)),
    "disparity_effects": (PINHOLES, (80.0, 60.0), POINTS, np.eye(4), VIEWS),
    "leaving_views": (
        *(PINHOLES, *ONE, SLOTS > 2),
        *(np.ones((N, 3)), SLOTS > 1, SLOTS[3:], COV[3:, :3, :3]),
    ),
    "absorbing_system": (core.normal_blocks(PINHOLES, *ONE), PRIOR, MOTIONS, POINTS[:, :3], np.zeros(9)),
    "absorbed_points": (
        *(SLOTS, COV[:, :3, :3], FIELD[:, None] * np.ones((N, 3, 3)), POINTS[:, :3], POINTS[:, :3], SLOTS > 2),
        (SLOTS[:2], POINTS[:2, :3], COV[:2, :3, :3], np.ones((2, 3, 2))),
    ),
}
VALUES = (np.nan, np.inf, -np.inf, 1e300, -1e300)


def call(name: str, arguments: list) -> object:
    """The answer, or None where the arguments were refused."""
    try:
        return getattr(core, name)(*arguments)
    except (ValueError, TypeError, np.linalg.LinAlgError):
        return None


def arrays_of(arguments: tuple, within: tuple[int, ...] = ()) -> Iterator[tuple[tuple[int, ...], np.ndarray]]:
    """All arrays among arguments and the members of records, with their places."""
    for at, argument in enumerate(arguments):
        if isinstance(argument, tuple):
            yield from arrays_of(argument, (*within, at))
        elif isinstance(argument, np.ndarray):
            yield (*within, at), argument


def with_other(arguments: tuple, at: tuple[int, ...], other: object) -> tuple:
    """The arguments with another one in that place."""
    changed = list(arguments)
    changed[at[0]] = with_other(arguments[at[0]], at[1:], other) if at[1:] else other
    return tuple(changed)


def places_of(arguments: tuple, within: tuple[int, ...] = ()) -> Iterator[tuple[tuple[int, ...], object]]:
    """All arguments and members of records, with their places."""
    for at, argument in enumerate(arguments):
        yield (*within, at), argument
        if isinstance(argument, tuple):
            yield from places_of(argument, (*within, at))


def _other(rng: random.Random, argument: object) -> object:
    """Something in the place of an argument."""
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
    if isinstance(argument, tuple) and rng.random() < 0.5:
        return rng.choice((argument[:-1], (*argument, 1), argument[::-1]))
    return rng.choice(
        (None, "text", (), True, np.zeros(0), *_NUMBERS, *_NUMBERS, *(int(n) for n in _NUMBERS if abs(n) < 1e300))
    )


_NUMBERS = (
    np.nan,
    np.inf,
    -np.inf,
    1e300,
    -1e300,
    0,
    1,
    -1,
    2,
    3,
    1001,
    2**31 - 1,
    -(2**31),
    2**62,
    -(2**62),
    1e-300,
)


def attack(rng: random.Random) -> None:
    """Call a function with up to three arguments or members exchanged; it answers, or refuses them."""
    name = rng.choice(sorted(CALLS))
    arguments = CALLS[name]
    for _ in range(rng.randint(1, 3)):
        at, argument = rng.choice(list(places_of(arguments)))
        arguments = with_other(arguments, at, _other(rng, argument))
    with np.errstate(all="ignore"):
        call(name, list(arguments))
