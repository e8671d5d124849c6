"""Unknowns of a frame have their sizes before views are gated. They end no second motion: others have its views."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from stream_sfm import core
from stream_sfm.config import RigConfig
from stream_sfm.estimators.window.inverse_depth import WhitenedViews
from stream_sfm.estimators.window.unknowns import weighing
from stream_sfm.estimators.window.unknowns.focal_change import Calm
from stream_sfm.estimators.window.unknowns.focus_watch import FocusWatch
from stream_sfm.geometry import se3
from stream_sfm.geometry.point_views import PointViews
from stream_sfm.geometry.resection import Resection, SecondMotion, resect
from stream_sfm.geometry.robust_rules import RobustRules
from stream_sfm.geometry.sizes import Sizes
from stream_sfm.geometry.stereo import StereoProjection
from stream_sfm.record import changed, record
from stream_sfm.rig_model.terms import FOCAL, TERMS, by_turn
from tests.helpers.rectified import scattered_points

P = StereoProjection(420.0, 255.0, 257.0, 190.0, 0.16, 512, 384)
N, STD_PX, STD_RAD, STD_TWIST, READOUT_S = 120, 0.1, 1e-4, 0.01, 0.02
MOTION = se3.exp(np.array([0.02, 0.01, -0.2, 0.001, 0.01, 0.0]))
SECOND = SecondMotion(np.eye(4), np.eye(6), np.zeros(N, bool), 1.0)
RULES = RigConfig()


@record
class Map:
    """What weighing takes from a map."""

    focus: FocusWatch
    exposures: Any
    prior: Any


class Frame:
    """A frame with a turn about y of so many `STD_RAD`, a twist that nods by so many `STD_TWIST`, and a longer focal
    length.

    A further error that the views share moves all right sides by half a pixel, so many times (`of_delay`).
    """

    def __init__(self, turn: float = 0.3, nod: float = 0.0, longer: float = 0.0, of_delay: float = 0.0) -> None:
        rng = np.random.default_rng(0)
        points = scattered_points(rng, N)
        in_cam = points @ MOTION.T
        z_px = P.project_homogeneous(in_cam)
        middle = np.array([P.cx_left_px, P.cy_px, P.cx_right_px, P.cy_px])
        late_s = READOUT_S * np.tile((z_px[:, 1:2] - P.cy_px) / P.height, 4)
        by_twist = np.stack([core.velocities(P, in_cam, e[None]) for e in np.eye(6)], axis=2)
        self.turns = by_turn(P, z_px, STD_RAD * np.eye(3))
        self.twists = STD_TWIST * late_s[..., None] * by_twist
        self.others = np.zeros((N, 4, 1))
        self.others[:, 2, 0] = 0.5 + 0.01 * rng.normal(size=N)
        shift = self.turns @ np.array([0.3, turn, 0.3]) + self.twists @ (nod * np.eye(6)[3]) + longer * (z_px - middle)
        z_px = z_px + shift + of_delay * self.others[..., 0] + STD_PX * rng.normal(size=(N, 4))
        terms = np.zeros((N, 4, len(TERMS)))
        terms[..., TERMS.index(FOCAL)] = RULES.std_focal * (z_px - middle)
        own = np.concatenate([self.turns, self.twists], axis=2)
        none: Any = np.zeros((N, 0))
        self.views = WhitenedViews(*[none] * 9, own, terms, none, none)
        cov_px, shared = np.tile(STD_PX**2 * np.eye(4), (N, 1, 1)), np.concatenate([own, self.others], axis=2)
        self.seen = PointViews(P, points, None, z_px, cov_px, RobustRules(), shared)
        self.found = changed(resect(self.seen, MOTION, np.ones(N)), second=SECOND)
        focus = changed(FocusWatch.begun(RULES), calm=Calm(10.0))
        self.map: Any = Map(
            focus=focus,
            exposures=SimpleNamespace(has_twist=True),
            prior=SimpleNamespace(rig=SimpleNamespace(rules=RULES)),
        )

    def weighed(self) -> tuple[list[Sizes], WhitenedViews, Resection]:
        of = self.views, np.arange(N), self.seen, np.ones(N), self.found
        self.map, *found = weighing.weigh_unknowns(self.map, [Sizes(), Sizes()], *of)
        sizes, views, motion = found
        return sizes, views, motion


@pytest.fixture(autouse=True)
def no_window(monkeypatch: pytest.MonkeyPatch) -> None:
    """The map has no window in which a focal length would begin."""
    monkeypatch.setattr(weighing, "with_focus", lambda current, views, effects: (current, views))


def near(motion: Resection) -> bool:
    """Whether a motion is the true one, by its covariance: 6 expected, 0.1 %."""
    apart = se3.log(motion.cam_from_ref @ se3.inverse(MOTION))
    return bool(apart @ np.linalg.solve(motion.cov_pose, apart) < 22)


def test_what_is_usual_changes_nothing() -> None:
    frame = Frame(nod=0.5)
    sizes, views, motion = frame.weighed()
    assert [s.probable for s in sizes] == [1, 1] and not frame.map.focus.moves
    assert np.array_equal(motion.cam_from_ref, frame.found.cam_from_ref) and motion.second is frame.found.second
    assert np.array_equal(views.own, frame.views.own)


@pytest.mark.parametrize("turn", [15.0, 60.0])
def test_a_large_turn_is_found_and_explains_all_views(turn: float) -> None:
    """It moves all right views by up to 2.5 px at once, 25 σ of each."""
    frame = Frame(turn)
    sizes, views, motion = frame.weighed()
    of_turns, of_twists = (s.probable for s in sizes)
    assert of_turns in (4, 16, 64) and of_turns > turn / 8 and of_twists == 1 and not frame.map.focus.moves
    assert motion.accepted.mean() > 0.97 and motion.second is SECOND and near(motion)
    std = of_turns * np.sqrt(motion.cov_amplitudes[1, 1])
    assert abs(motion.amplitudes[1] * of_turns - turn) < 3.5 * std < 0.5 * turn
    assert np.array_equal(views.own[..., :3], of_turns * frame.turns)


@pytest.mark.parametrize("nod", [-15.0, 30.0])
def test_a_large_error_of_the_twist_is_no_zoom_and_no_turn(nod: float) -> None:
    """Through the readout a camera that nods sees its image stretched."""
    frame = Frame(nod=nod)
    sizes, _, motion = frame.weighed()
    assert sizes[0].probable == 1 and sizes[1].probable > 1 and not frame.map.focus.moves
    assert motion.accepted.mean() > 0.97 and motion.second is SECOND and near(motion)


@pytest.mark.parametrize("longer", [-0.005, 0.01])
def test_a_zoom_is_no_error_of_the_twist_and_no_turn(longer: float) -> None:
    frame = Frame(longer=longer)
    sizes, _, motion = frame.weighed()
    assert [s.probable for s in sizes] == [1, 1] and frame.map.focus.moves
    assert motion.accepted.mean() > 0.97 and motion.second is SECOND and near(motion)
    assert RULES.std_refocused * motion.amplitudes[-1] == pytest.approx(longer, abs=0.002)


def test_what_another_error_explains_is_no_larger_turn() -> None:
    """An offset of all right views by 2 σ of an error that looks like the turn about y."""
    assert [s.probable for s in Frame(of_delay=2.0).weighed()[0]] == [1, 1]
