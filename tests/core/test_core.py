"""The compiled core as a whole: it takes any array without harm, and gives the same bytes in every thread."""

import pickle
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from stream_sfm import core
from stream_sfm.geometry.stereo import information_of_views

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

# Each function with arguments that it takes
INTERVALS = (
    *(np.tile(np.eye(3), (2, 1, 1)), np.zeros((2, 6)), np.zeros((2, 9, 6)), np.zeros((2, 9))),
    *(np.tile(np.eye(9), (2, 1, 1)), np.zeros((2, 6)), np.zeros(2), np.full(2, 0.1)),
)
CALLS = {
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
    "preintegrate": (
        np.arange(4) / 200,
        np.ones((4, 3)),
        np.ones((4, 3)),
        np.ones(3),
        np.zeros(6),
        np.full(2, 1e-3),
    ),
    "inertial_rows": (INTERVALS, np.tile(np.eye(4), (3, 1, 1)), np.zeros((3, 3)), np.ones(17), np.eye(4)),
    "inertial_motion": (tuple(a[:1] for a in INTERVALS), np.ones(17), np.eye(4)),
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


def test_every_function_is_called() -> None:
    assert set(CALLS) == {name for name, function in vars(core).items() if callable(function) and name[0] != "_"}


@pytest.mark.parametrize("name", CALLS)
def test_arrays_of_any_shape_and_content_are_taken_or_refused(name: str) -> None:
    assert call(name, list(CALLS[name])) is not None or name == "store_patches"
    for at, argument in arrays_of(CALLS[name]):
        others = [argument[:0], argument[:1], argument[..., :1], argument[..., None], argument.ravel(), argument.T]
        others += [np.zeros((0,) * argument.ndim, argument.dtype), np.asfortranarray(argument)]
        if argument.dtype.kind == "f":
            for value in VALUES:
                with np.errstate(over="ignore"):
                    others.append(np.full_like(argument, value))
                    some = argument.copy()
                    some.flat[::3] = value
                others.append(some)
        else:
            numbers = (-1, 10**6, 2**62, -(2**62))
            others += [np.full(argument.shape, value).astype(argument.dtype) for value in numbers]
        for other in others:
            call(name, list(with_other(CALLS[name], at, other.copy())))


def test_arguments_that_do_not_fit_are_value_errors_that_say_which() -> None:
    with pytest.raises(ValueError, match=r"slots has shape \(3\) in place of \(7\)"):
        core.match_new_points(
            *(IMAGE, IMAGE, STORED, TEMPLATES, RIGHT_SIDES, PIXELS, SLOTS[:3], STARTS[:, 0], 3.0, 4.0, 2.0)
        )
    with pytest.raises(ValueError, match="slot"):
        core.warp_patches(STORED, SLOTS + 1, WARPS, 4, 2)
    with pytest.raises(np.linalg.LinAlgError, match="definite"):
        core.linearise_views((*OF_VIEWS[:4], -COV, *OF_VIEWS[5:]), np.eye(4))


def test_only_the_sides_that_are_there_count() -> None:
    views = VIEWS.copy()
    views[:, 2:] = np.nan
    root, jacobian = core.linearise_views((PINHOLES, POINTS, COV[:0], views, *OF_VIEWS[4:]), np.eye(4))
    assert (root[:, 2:] == 0).all() and (root[:, :, 2:] == 0).all() and (jacobian[:, 2:] == 0).all()


@pytest.mark.parametrize("name", [name for name in CALLS if name != "store_patches"])
def test_threads_give_the_same_bytes(name: str) -> None:
    def run(_: int) -> bytes:
        return pickle.dumps(getattr(core, name)(*CALLS[name]))

    with ThreadPoolExecutor(4) as pool:
        answers = list(pool.map(run, range(16)))
    assert all(answer == answers[0] for answer in answers)


def test_images_of_bytes_are_taken_as_images_of_floats_with_their_values() -> None:
    grey = RNG.integers(0, 256, (60, 80)).astype(np.uint8)
    found = []
    for image in (grey, grey.astype(np.float32)):
        stored = np.zeros((N, SIDE, SIDE), image.dtype)
        core.store_patches(stored, image, PIXELS, SLOTS)
        patches = core.warp_patches(stored, SLOTS, WARPS, 4, 2)
        aligned = core.align_patches(image, STARTS, *patches, 4, 2)
        core.store_patches(stored, image, INNER, SLOTS)
        right_sides = (PINHOLES, (*ROWS[:2], np.zeros(13), *ROWS[3:]), np.zeros(3), np.zeros(6))
        near = right_sides, INNER, SLOTS, np.full(N, 0.2)
        matched = core.match_new_points(image, image, stored, TEMPLATES, *near, 3.0, 4.0, 2.0)
        assert len(matched[0])
        found.append(b"".join(array.tobytes() for array in (*patches, *aligned, *matched)))
    assert found[0] == found[1]


def test_points_project_where_they_were_seen_on_the_left_row() -> None:
    seen = core.project_points(PINHOLES, core.seen_points(PINHOLES, VIEWS))
    assert seen == pytest.approx(VIEWS[:, [0, 1, 2, 1]])


def test_whitened_views_have_their_information() -> None:
    z_px, factor = VIEWS.copy(), RNG.normal(size=(N, 4, 6))
    z_px[::2, 2:] = np.nan
    cov_px = factor @ np.swapaxes(factor, 1, 2)
    root = core.whitening_of_views(z_px, cov_px)
    expected = information_of_views(z_px, cov_px)
    assert np.swapaxes(root, 1, 2) @ root == pytest.approx(expected, rel=1e-9, abs=1e-9 * np.abs(expected).max())


def test_whitened_blocks_have_the_covariance_taken_out() -> None:
    factor, blocks = RNG.normal(size=(N, 3, 5)), RNG.normal(size=(N, 3, 4))
    cov = factor @ np.swapaxes(factor, 1, 2)
    whitened = core.whiten_blocks(cov, blocks)
    squares = np.swapaxes(blocks, 1, 2) @ np.linalg.solve(cov, blocks)
    assert np.swapaxes(whitened, 1, 2) @ whitened == pytest.approx(squares, rel=1e-9)
