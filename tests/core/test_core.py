"""The compiled core as a whole: any array is harmless, and every thread gives the same bytes."""

import pickle
import re
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from stream_sfm.core import _core as core
from stream_sfm.frontend.templates import TemplateRules
from stream_sfm.geometry.stereo import information_of_views
from tests.core.calls import (
    CALLS,
    COV,
    GRID,
    IMAGE,
    INNER,
    OF_VIEWS,
    PINHOLES,
    PIXELS,
    POINT_RULES,
    POINTS,
    RIGHT_SIDES,
    RNG,
    ROWS,
    SIDE,
    SLOTS,
    STARTS,
    STORED,
    TEMPLATES,
    TIMING,
    TRACKS,
    VALUES,
    VIEWS,
    WARPS,
    N,
    Record,
    arrays_of,
    but,
    call,
    with_other,
)
from tests.helpers.places import ROOT


def test_every_function_is_called_here_and_the_public_ones_by_the_package() -> None:
    """A name with an underscore is part of a stage, bound for the tests of its law."""
    assert set(CALLS) == {
        name
        for name, function in vars(core).items()
        if callable(function) and name[:2] != "__" and not isinstance(function, type)
    }
    package = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "stream_sfm").rglob("*.py"))
    called = set(re.findall(r"\bcore\.(\w+)", package))
    called |= {name for names in re.findall(r"from \.+core import (.+)", package) for name in names.split(", ")}
    assert {name for name in CALLS if name[0] != "_"} <= called


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


def test_errors_about_invalid_arguments_name_them() -> None:
    with pytest.raises(ValueError, match=r"slots has shape \(3\) in place of \(7\)"):
        core.match_new_points(
            *(IMAGE, IMAGE, STORED, TEMPLATES, RIGHT_SIDES, PIXELS, SLOTS[:3], STARTS[:, 0], 3.0, POINT_RULES)
        )
    with pytest.raises(ValueError, match="slot"):
        core.warp_patches(STORED, SLOTS + 1, WARPS, 4, 2, TemplateRules())
    with pytest.raises(np.linalg.LinAlgError, match="definite"):
        core.linearise_views(but(OF_VIEWS, cov_px=-COV), np.eye(4))


def test_missing_and_too_large_arguments_are_refused() -> None:
    """Without this, reads out of bounds end the process."""
    of_tracks = list(CALLS["_predict_tracks"])
    of_tracks[1] = but(TIMING, mean=np.ones(1))
    with pytest.raises(ValueError, match=r"mean has shape \(1\) in place of \(2\)"):
        core._predict_tracks(*of_tracks)
    most = 2**31 - 1
    with pytest.raises(ValueError, match="spacing_px is not within 1 and 1000"):
        core.warp_patches(STORED, SLOTS, WARPS, 4, most, TemplateRules())
    with pytest.raises(ValueError, match="spacing_px is not within 1 and 1000"):
        core.match_new_points(*with_other(CALLS["match_new_points"], (3, "spacing_px"), most))
    wide = CALLS["align_tracks"][-1]
    for field in ("left", "stored", "area"):
        with pytest.raises(TypeError, match=rf"Templates\.{field} is NoneType in place of"):
            core.align_tracks(*CALLS["align_tracks"][:-1], but(wide, **{field: None}))
    for at in range(3):
        with pytest.raises(ValueError, match="an image is empty"):
            core.ghost_sums(*with_other(CALLS["ghost_sums"], (at,), np.zeros((0, 80), np.uint8)))
    with pytest.raises(ValueError, match="more than 1000 parts"):
        core.poses_by_parts(*CALLS["poses_by_parts"][:-1], most)


def test_errors_about_missing_or_wrong_fields_name_field_and_record() -> None:
    without = Record(**{name: value for name, value in vars(TRACKS).items() if name != "var_rho"})
    arguments = list(CALLS["update_depths"])
    for tracks, said in (
        (without, "Tracks.var_rho is missing in SimpleNamespace"),
        (but(TRACKS, points=POINTS[0]), r"Tracks.points is \S*ndarray \(4,\) float64 in place of Array of 2 axes"),
        (but(TRACKS, slopes="steep"), "Tracks.slopes is str in place of Array of 2 axes"),
        (7, "Tracks.points is missing in int"),
    ):
        with pytest.raises(TypeError, match=said):
            core.update_depths(arguments[0], tracks, *arguments[2:])
    rows = but(ROWS, field=but(GRID, length_px=None))
    with pytest.raises(TypeError, match=r"Field\.length_px is NoneType in place of float"):
        core._on_one_row(rows, STARTS, STARTS, np.ones(N), 1.0)


def test_only_visible_sides_count() -> None:
    views = VIEWS.copy()
    views[:, 2:] = np.nan
    root, jacobian = core.linearise_views(but(OF_VIEWS, cov_points=COV[:0], z_px=views), np.eye(4))
    assert (root[:, 2:] == 0).all() and (root[:, :, 2:] == 0).all() and (jacobian[:, 2:] == 0).all()


@pytest.mark.parametrize("name", [name for name in CALLS if name != "store_patches"])
def test_threads_give_the_same_bytes(name: str) -> None:
    def run(_: int) -> bytes:
        return pickle.dumps(getattr(core, name)(*CALLS[name]))

    with ThreadPoolExecutor(4) as pool:
        answers = list(pool.map(run, range(16)))
    assert all(answer == answers[0] for answer in answers)


def test_byte_images_give_the_same_results_as_float_images_of_the_same_values() -> None:
    grey = RNG.integers(0, 256, (60, 80)).astype(np.uint8)
    found = []
    for image in (grey, grey.astype(np.float32)):
        stored = np.zeros((N, SIDE, SIDE), image.dtype)
        core.store_patches(stored, image, PIXELS, SLOTS)
        patches = core.warp_patches(stored, SLOTS, WARPS, 4, 2, TemplateRules())
        aligned = core.align_patches(image, STARTS, *patches, np.tile([1.0, 0.0], (N, 1)), 4, 2, TemplateRules())
        core.store_patches(stored, image, INNER, SLOTS)
        right_sides = Record(rows=but(ROWS, mean=np.zeros(13)), turn_rad=np.zeros(3), twist=np.zeros(6))
        near = right_sides, INNER, SLOTS, np.full(N, 0.2)
        matched = core.match_new_points(image, image, stored, TEMPLATES, *near, 3.0, POINT_RULES)
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


def test_whitened_blocks_have_unit_covariance() -> None:
    factor, blocks = RNG.normal(size=(N, 3, 5)), RNG.normal(size=(N, 3, 4))
    cov = factor @ np.swapaxes(factor, 1, 2)
    whitened = core._whiten_blocks(cov, blocks)
    squares = np.swapaxes(blocks, 1, 2) @ np.linalg.solve(cov, blocks)
    assert np.swapaxes(whitened, 1, 2) @ whitened == pytest.approx(squares, rel=1e-9)


@pytest.mark.parametrize(("p", "n", "q"), [(1, 1, 1), (3, 5, 9), (131, 129, 23), (40, 300, 139), (2, 0, 3)])
def test_large_products_are_those_of_numpy(p: int, n: int, q: int) -> None:
    """Sums of n terms in another order: each rounding is at most 10⁻¹⁶ of the sum of absolute terms."""
    rng = np.random.default_rng(n)
    a, b = rng.normal(size=(p, n)) * (rng.uniform(size=n) < 0.7), np.triu(rng.normal(size=(n, q)), -2)
    a[: p // 2, : n // 2] = 0  # zeros are left out
    bound = 1e-16 * (n + 1) * (np.abs(a) @ np.abs(b))
    assert (np.abs(core._large_product(a, b) - a @ b) <= bound).all()
    bound = 1e-16 * (n + 1) * (np.abs(b).T @ np.abs(b))
    assert (np.abs(core._large_gram(b) - np.tril(b.T @ b)) <= bound).all()


@pytest.mark.parametrize("columns", [RNG.normal(size=(N, 3)), np.eye(N)[:, :2], np.zeros((N, 1)), np.zeros((N, 0))])
def test_reflections_turn_the_first_axes_into_the_columns(columns) -> None:
    along, axes = core._reflections(columns)
    q = np.eye(N) - along @ axes.T
    assert q @ q.T == pytest.approx(np.eye(N), abs=1e-14)
    assert q[:, columns.shape[1] :].T @ columns == pytest.approx(0.0, abs=1e-14)


def test_minor_directions_have_what_other_variables_do_not_explain() -> None:
    """Of a covariance of rank four, and of less than 0.01 beside it."""
    large, small = RNG.normal(size=(9, 4)), 0.03 * RNG.normal(size=(9, 2))
    cov = large @ large.T + small @ small.T
    minor = core._minor_directions(cov, 0.01)
    assert minor.shape == (9, 5)
    assert np.linalg.matrix_rank(minor) == 5
    assert np.diag(minor.T @ cov @ minor).max() < 0.01
    chosen = np.sort(np.abs(minor), axis=1)[:, -2] > 0  # rows of the others are those of a unit matrix
    assert np.abs(cov[chosen] @ minor).max() < 1e-12  # nothing in common with the others
    assert core._minor_directions(cov, 1e3) == pytest.approx(np.eye(9))  # all of them
    assert core._minor_directions(np.eye(3), 0.5).shape == (3, 0)  # none


def test_points_are_determined_by_the_prior_or_by_stereo_views_of_tracks_that_live_or_were_seen_twice() -> None:
    ids, known = np.arange(10, 17), np.array([16])
    seen, newest = np.array([10, 11, 12, 13, 16, 11, 12, 14, 15]), 5
    used = np.array([1, 1, 1, 0, 1, 1, 1, 1, 1], bool)
    stereo = np.array([1, 1, 0, 1, 0, 0, 0, 1, 0], bool)
    # 10 ended after one view; 11 was seen twice, in stereo once; 12 never in stereo; of 13 no view counts; 14 has begun
    # in stereo, 15 by one side alone; 16 is in the prior
    expected = [False, True, False, False, True, False, True]
    assert core.determined_points(ids, known, seen, used, stereo, newest).tolist() == expected
    with pytest.raises(ValueError, match="the newest views begin where there are none"):
        core.determined_points(ids, known, seen, used, stereo, len(seen) + 1)
