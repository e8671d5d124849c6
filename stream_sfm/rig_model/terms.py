"""The physical terms of a rig's errors: their names, the assumed σ of each, and its effect on a view, eq. (70).

There are no terms for image rows: the difference of left and right row is measured directly
(`frontend/learnt/rows.py`), including the effect of a delay of the right camera, and subtracted from the right row,
which then has the error of the left one. An error δ of a principal point turns the camera's axes by δ/f, which no view
shows (`camera/unseen_errors.py`); the rest of its effect, −δ (x, y) x for a ray with slopes x and y, is a term here.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from .. import core
from ..camera.refinement import LENS_TERMS, LENSES
from ..config import RigConfig
from ..geometry import Array
from ..geometry.stereo import StereoProjection, places_over_image
from .field import NO_FIELD

FOCAL, DELAY, READOUT = "focal length", "delay", "readout"
TURNING, FOCUSING = ("turning x", "turning y", "turning z"), "focusing"


class Group(NamedTuple):
    """Terms of one cause, which are either all zero or all unknown.

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


# All terms in their order; the enum in `core/rig.cpp` repeats it for the formulas.
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
CAUSES = tuple(group for group in GROUPS if group.key)  # all groups except those of the lenses
TERMS = tuple(term for group in GROUPS for term in group.terms)


def at(terms: tuple[str, ...]) -> slice:
    return slice(TERMS.index(terms[0]), TERMS.index(terms[-1]) + 1)


AT_TIMING, AT_TURNING = at((DELAY, READOUT)), at(TURNING)
DISPARITY = at(GROUPS[0].terms)  # the polynomial of the disparity


def prior_std(config: RigConfig) -> Array:
    """Return σ (t,) of each term before any view, in the term's unit."""
    return np.array([getattr(config, group.std) for group in GROUPS for _ in group.terms])


def columns(projection: StereoProjection, z_px: Array, age_s: Array | float = 0.0) -> Array:
    """Return the effects (n, 4, t) of one unit of each term on views (n, 4) of cameras at rest, eq. (70).

    `age_s`: the time for which errors have grown, one for all views or (n,). A missing side has no effects. A unit of a
    lens term is an error of one pixel at the ray to the corner farthest from the lens's centre.
    """
    ages_s = np.atleast_1d(np.asarray(age_s, np.float64))
    return core.rig_effects(projection, np.eye(len(TERMS)), NO_FIELD, z_px, ages_s)[0]


def effects_of_turn(projection: StereoProjection, left_px: Array) -> Array:
    """Return the shifts (n, 2, 3) in the right image by its camera's rotation, px per radian, eq. (72d).

    They are those of points at infinity, seen at left positions (n, 2).
    """
    right_px = left_px + np.array([projection.cx_right_px - projection.cx_left_px, 0.0])
    return core.effects_of_turn(projection, right_px)


def lens_shift_rms_px(projection: StereoProjection, errors: Array) -> float:
    """Return the RMS shift over the image by lens errors (t,) that both cameras share, beyond a turn of both."""
    places_px = places_over_image(projection, 9, 9)
    shift = (columns(projection, np.tile(places_px, 2))[:, :2, LENSES] @ errors[LENSES]).ravel()
    turns = effects_of_turn(projection, places_px).reshape(-1, 3)  # those of the left camera as well
    left = shift - turns @ np.linalg.lstsq(turns, shift, rcond=None)[0]
    return float(np.sqrt(2 * (left**2).mean()))


def by_turn(projection: StereoProjection, z_px: Array, root: Array) -> Array:
    """Return the effects (n, 4, e) px of a rotation of the right camera on views (n, 4), eq. (36b).

    `root` (3, e) rad: a root of the covariance of the rotation. The effects on a missing side are 0.
    """
    return core.views_by_turn(projection, z_px, root)


@lru_cache(maxsize=8)
def terms_of_turn(projection: StereoProjection) -> Array:
    """Return the units (t, 3) of each term per radian of a rotation of the right camera, exact for far points."""
    places_px = places_over_image(projection, 5, 5)
    by_turn = effects_of_turn(projection, places_px)[:, 0]
    by_term = columns(projection, np.tile(places_px, 2))[:, 2, DISPARITY]
    terms = np.zeros((len(TERMS), 3))
    terms[DISPARITY] = np.linalg.lstsq(by_term, by_turn, rcond=None)[0]
    terms.flags.writeable = False  # all callers get the same array
    return terms


def growth(projection: StereoProjection, age_s: float) -> Array:
    """Return the matrix (t, t) from errors at the start, with their rates, to errors after `age_s`."""
    grown = np.eye(len(TERMS))
    grown[:, AT_TURNING] += age_s * terms_of_turn(projection)
    grown[TERMS.index(FOCAL), TERMS.index(FOCUSING)] = age_s
    return grown
