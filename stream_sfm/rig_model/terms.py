"""The physical terms of a rig's errors: their names, the σ that is assumed for each, and what each does to a view.

Relative rotation, principal points, focal lengths and distortion of the two cameras err together; what they do to the
disparity is a polynomial of the place in the image, and the difference of two radial distortions. What both lenses have
wrong alike moves both sides of a view. Rows are not among them: what left and right row differ by is measured directly
(`frontend/rows.py`), with what a delay of the right camera does there, and taken out of the right row, which then
errs with the left one. A principal point that is off by δ moves all of the image, which is a rotation of the camera's
axes by δ/f: no view shows that (`camera/unseen_errors.py`). What is left of it, −δ (x, y) x of a ray's slopes x and y,
is a term here.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from .. import core
from ..camera.refinement import LENS_TERMS
from ..config import RigConfig
from ..geometry import Array
from ..geometry.stereo import StereoProjection, places_over_image
from .field import NO_FIELD

FOCAL, DELAY, READOUT = "focal length", "delay", "readout"
TURNING, FOCUSING = ("turning x", "turning y", "turning z"), "focusing"


class Group(NamedTuple):
    """Terms of one cause, which are zero together or not at all.

    `std`: the setting of `RigConfig` with σ of each, in the unit of the term. `key` is their name in files, and
    `meaning` explains it; the terms of lenses have neither, as they are written together. `sentence` reports a certain
    error: its size and σ, both multiplied by `per_unit`, and one of `words`, for a positive and for a negative error.
    """

    terms: tuple[str, ...]
    std: str
    key: str = ""
    meaning: str = ""
    per_unit: float = 1.0
    sentence: str = ""
    words: tuple[str, str] = ("", "")


# All terms in their order, which the enum of `core/rig.cpp` repeats for the formulas.
GROUPS = (
    Group(LENS_TERMS[:6], "std_disparity_px"),
    Group(LENS_TERMS[6:12], "std_lens_px"),
    Group(LENS_TERMS[12:], "std_lens_difference_px"),
    Group(
        terms=(FOCAL,),
        std="std_focal",
        key="focal_length",
        meaning="error of the common focal length as a share of it",
        per_unit=100,
        sentence="the focal length is {:.2f} ± {:.2f} % {}",
        words=("longer", "shorter"),
    ),
    Group(
        terms=(DELAY,),
        std="std_delay_s",
        key="delay_s",
        meaning="delay of the right camera, seconds",
        per_unit=1e3,
        sentence="the right camera is {:.2f} ± {:.2f} ms {}",
        words=("late", "early"),
    ),
    Group(
        terms=(READOUT,),
        std="std_readout_s",
        key="readout_s",
        meaning="readout time of the shutters, from the top down, seconds",
        per_unit=1e3,
        sentence="the shutters read out in {:.2f} ± {:.2f} ms{}",
        words=("", ", from the bottom up"),
    ),
    Group(
        terms=TURNING,
        std="std_turning_rad_s",
        key="turning_rad_s",
        meaning="turn of the right camera about x, y and z, radians per second",
        per_unit=6e4,
        sentence="the right camera turns against the left one by {:.2f} ± {:.2f} mrad per minute",
    ),
    Group(
        terms=(FOCUSING,),
        std="std_focusing_per_s",
        key="focusing_per_s",
        meaning="change of the focal length per second as a share of it",
        per_unit=100,
        sentence="the focal length {2} by {0:.3f} ± {1:.3f} % per second",
        words=("grows", "shrinks"),
    ),
)
CAUSES = tuple(group for group in GROUPS if group.key)  # those beside the lenses
TERMS = tuple(term for group in GROUPS for term in group.terms)


def at(terms: tuple[str, ...]) -> slice:
    """Return where some terms are that follow each other."""
    return slice(TERMS.index(terms[0]), TERMS.index(terms[-1]) + 1)


AT_TIMING, AT_TURNING = at((DELAY, READOUT)), at(TURNING)
DISPARITY = at(GROUPS[0].terms)  # the polynomial of the disparity


def prior_std(config: RigConfig) -> Array:
    """Return σ (t,) of each term before any view, in the term's unit."""
    return np.array([getattr(config, group.std) for group in GROUPS for _ in group.terms])


def columns(projection: StereoProjection, z_px: Array, age_s: Array | float = 0.0) -> Array:
    """Return what one unit of each term does to views (n, 4) of cameras that stand still: (n, 4, t), eq. (70).

    `age_s`, or one (n,) each: for how long errors have grown, if they do. A missing side has no columns. Those of a
    lens are px per pixel of each error, at the ray to the corner that is farthest from the lens's middle.
    """
    ages_s = np.atleast_1d(np.asarray(age_s, np.float64))
    return core.rig_effects(projection, np.eye(len(TERMS)), NO_FIELD, z_px, ages_s)[0]


def effects_of_turn(projection: StereoProjection, left_px: Array) -> Array:
    """What a turn of the right camera does there to points at infinity, seen at left positions (n, 2), eq. (72d).

    (n, 2, 3) px per radian.
    """
    right_px = left_px + np.array([projection.cx_right_px - projection.cx_left_px, 0.0])
    return core.effects_of_turn(projection, right_px)


def by_turn(projection: StereoProjection, z_px: Array, root: Array) -> Array:
    """Return what amplitudes of a turn of the right camera do, of covariance `root` (3, e) times its transpose, rad.

    Eq. (36b), to views (n, 4): (n, 4, e) px; 0 for a missing side.
    """
    return core.views_by_turn(projection, z_px, root)


@lru_cache(maxsize=8)
def terms_of_turn(projection: StereoProjection) -> Array:
    """(t, 3) units of each term per radian of a turn of the right camera: of far points it is just these."""
    places_px = places_over_image(projection, 5, 5)
    by_turn = effects_of_turn(projection, places_px)[:, 0]
    by_term = columns(projection, np.tile(places_px, 2))[:, 2, DISPARITY]
    terms = np.zeros((len(TERMS), 3))
    terms[DISPARITY] = np.linalg.lstsq(by_term, by_turn, rcond=None)[0]
    terms.flags.writeable = False  # all who ask get the same
    return terms


def growth(projection: StereoProjection, age_s: float) -> Array:
    """Return the matrix (t, t) that makes errors at the start, with their rates, those of a time later."""
    grown = np.eye(len(TERMS))
    grown[:, AT_TURNING] += age_s * terms_of_turn(projection)
    grown[TERMS.index(FOCAL), TERMS.index(FOCUSING)] = age_s
    return grown
