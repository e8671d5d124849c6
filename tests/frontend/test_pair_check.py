"""When left and right count as consistent: problems begin, and end with old points or with a new start."""

from collections.abc import Callable

import numpy as np
import pytest

from stream_sfm.camera.models import Camera
from stream_sfm.camera.rig import StereoRig
from stream_sfm.config import Config
from stream_sfm.frontend.learnt.pair_check import (
    Found,
    PairCheck,
    PairFit,
    PairRules,
    problem_of,
    resolution_problem,
)
from stream_sfm.frontend.learnt.rows import Rows
from stream_sfm.geometry import se3
from stream_sfm.geometry.resection import Resection
from stream_sfm.geometry.stereo import StereoProjection
from stream_sfm.pictures.prepared import PreparedImages
from tests.helpers.tracks import tracks_at

PROJECTION = StereoProjection(300.0, 160.0, 160.0, 120.0, 0.1, 320, 240)


def images(seed: int) -> PreparedImages:
    rng = np.random.default_rng(seed)
    left, right = rng.integers(0, 255, (2, 60, 80), dtype=np.uint8)
    return PreparedImages.of(left, right, 0.0)


def fit(first_id: int, left: int, both: int, n: int = 100, has_samples: bool = False) -> PairFit:
    """The fit of n tracks, of which the first ones agree."""
    rows = np.arange(n)
    return PairFit(first_id + rows, rows < left, rows < both, has_samples)


class Run:
    """A check over several frames, each with images of its own."""

    def __init__(self) -> None:
        self.rows, self.factor = Rows.unknown(PROJECTION, Config()), 1.0
        self.check = PairCheck.of(PairRules())
        self.frame = 0

    @property
    def problem(self) -> str:
        return self.check.problem

    def show(self, fitting: PairFit | None, next_id: int = 1000, frozen: bool = False) -> bool:
        self.frame += 1
        now, before = images(self.frame), images(self.frame - (not frozen))
        problem = problem_of(now, before, fitting, self.rows, self.factor, PairRules())
        self.check, restarts = self.check.after(problem, fitting, next_id)
        return restarts


@pytest.mark.parametrize("seen", [[(95, 95), (95, 80), (95, 60)], [(11, 0)]], ids=["a good pair", "few points"])
def test_a_good_pair_is_no_problem_and_few_points_are_no_evidence(seen: list[tuple[int, int]]):
    run = Run()
    assert not any(run.show(fit(0, left, both)) for left, both in seen)
    assert run.problem == ""


@pytest.mark.parametrize(("left", "both"), [(40, 10), (95, 20)], ids=["bodies", "the right image"])
def test_samples_distinguish_bodies_that_hide_the_scene_from_an_inconsistent_pair(left: int, both: int):
    run = Run()
    run.show(fit(0, left, both, has_samples=True))
    assert bool(run.problem) == (left == 95)
    run.show(fit(0, left, both))
    assert run.problem


def test_missing_right_sides_are_a_problem_until_old_points_are_back():
    run = Run()
    run.show(fit(0, 95, 95))
    run.show(fit(0, 95, 20))
    assert "20 do in the right one" in run.problem
    run.show(None)
    run.show(fit(0, 15, 7))  # too few to confirm anything
    assert run.problem
    run.show(fit(1000, 95, 95))  # tracks that began during the problem do not end it
    assert run.problem
    assert not run.show(fit(0, 40, 35))
    assert run.problem == ""


def found(in_right: int, n: int = 100) -> Found:
    """Tracks at rest that all agree in the left image; the last `in_right` are also found in the right image."""
    tracks = tracks_at(np.full(n, 4.0))
    z_px = PROJECTION.project_homogeneous(tracks.points)
    z_px[: n - in_right, 2:] = np.nan
    motion = Resection(np.eye(4), np.eye(6), np.full(n, True), 0.0, 3 * n, 1.0, True, np.zeros(n), 1.0)
    return Found(tracks, z_px, np.tile(0.01 * np.eye(4), (n, 1, 1)), motion)


@pytest.mark.parametrize(
    ("in_right", "is_problem"),
    [((95, 75, 55, 40, 30, 20), False), ((95, 20), True)],
    ids=["a few per frame", "at once"],
)
def test_points_that_a_near_object_hides_gradually_are_no_problem(in_right: tuple[int, ...], is_problem: bool):
    """The left camera still sees them; a camera that is knocked or stops loses nearly all points at once."""
    run = Run()
    for n in in_right:
        run.show(PairFit.of(found(n), PROJECTION, Config(), run.check.missing))
    assert bool(run.problem) == is_problem
    run.show(PairFit.of(found(20), PROJECTION, Config(), run.check.missing))
    assert bool(run.problem) == is_problem  # points that vanished with a problem do not end it
    run.show(PairFit.of(found(95), PROJECTION, Config(), run.check.missing))
    assert run.problem == ""


def test_a_problem_without_old_points_ends_with_a_new_start():
    run = Run()
    run.show(fit(0, 95, 0), next_id=100)
    frames = 1
    while not run.show(fit(100, 95, 90), next_id=300):
        frames += 1
    assert 8 <= frames <= 30
    assert run.problem == ""
    assert not run.show(fit(300, 95, 90))


def test_a_poor_fit_ends_no_problem():
    run = Run()
    run.show(fit(0, 95, 0), next_id=100)
    assert not any(run.show(fit(100, 60, 55)) for _ in range(40))
    assert run.problem


def test_a_poor_frame_takes_back_evidence_and_another_problem_all_of_it():
    run = Run()
    run.show(fit(0, 95, 0), next_id=100)
    changes = []
    for left, both in [(95, 90)] * 10 + [(60, 40)] + [(95, 90)] * 5 + [(95, 0)]:
        assert not run.show(fit(100, left, both), next_id=300)
        changes.append(run.check.evidence.change)
    assert 0 < changes[10] < changes[9] < changes[15] and changes[16] == 0
    assert run.check.first_id == 100


def far_apart(run: Run) -> None:
    """Row differences larger than those of any calibration."""
    x, y = np.meshgrid(np.linspace(0, 319, 12), np.linspace(0, 239, 12))
    at = np.stack([x.ravel(), y.ravel()], axis=1)
    for _ in range(10):
        run.rows = run.rows.learnt(at, 0.02 * (at[:, 0] - 160), np.zeros(len(at)))
    assert 3.0 < run.rows.largest_px < 3.4


def scattered(run: Run) -> None:
    at = np.random.default_rng(0).uniform((0, 0), (319, 239), (200, 2))
    for seed in range(40):
        run.rows = run.rows.learnt(at, np.random.default_rng(seed).normal(scale=0.8, size=200), np.zeros(200))


def noisy(run: Run) -> None:
    run.factor = 9.0


@pytest.mark.parametrize(
    ("before", "frozen", "problem"),
    [
        (lambda run: None, False, ""),
        (lambda run: run.show(fit(0, 95, 95)), True, "are the cameras frozen"),
        (far_apart, False, "the rows of left and right differ"),
        (scattered, False, "not of one moment"),
        (noisy, False, "3.0 times as large as the images explain"),
    ],
)
def test_inconsistent_images_are_a_problem(before: Callable[[Run], object], frozen: bool, problem: str) -> None:
    run = Run()
    before(run)
    run.show(fit(0, 95, 95), frozen=frozen)
    assert problem in run.problem and bool(run.problem) == bool(problem)


@pytest.mark.parametrize(("factor", "name"), [(0.5, "half"), (2.0, "twice")])
def test_a_calibration_of_another_resolution_is_a_problem_from_the_first_frame(factor: float, name: str):
    def problem(scale: float) -> str:
        camera = Camera(512, 384, np.diag([scale, scale, 1]) @ [[400.0, 0, 256], [0, 400, 192], [0, 0, 1]])
        return resolution_problem(StereoRig(camera, camera, se3.exp([-0.1, 0, 0, 0, 0.1, 0])), PairRules())

    assert f"images of {name} the size" in problem(factor)
    assert problem(1.0) == ""
