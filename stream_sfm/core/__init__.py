"""The compiled core: stages of the front-end and the estimators as functions of arrays, in C++.

One file per stage, whose head says what it does; `_core.pyi` has the functions as Python calls them. The stages know
nothing of Python: `module.cpp` checks their arrays, and they run without Python's lock. The same arrays give the same
bytes on every machine of one kind, in one thread or in several.
"""

import os
import sys
import sysconfig


def _build_if_older(folder: str) -> None:
    """Build the module of a checkout, in place, where a source is newer."""
    suffix = ".abi3.so" if sys.version_info >= (3, 12) else sysconfig.get_config_var("EXT_SUFFIX")
    changed = {entry.name: entry.stat().st_mtime for entry in os.scandir(folder)}
    module = changed.get(f"_core{suffix}", 0.0)
    if all(at <= module for name, at in changed.items() if name.endswith((".cpp", ".hpp", ".txt"))):
        return
    import subprocess

    tool = os.path.join(folder, "..", "..", "tools", "build", "in_place.py")
    if subprocess.run([sys.executable, tool], stdin=subprocess.DEVNULL).returncode:
        raise ImportError(
            f"{folder}: the compiled core is older than its sources and could not be built, for the reason above: "
            'python -m pip install -e ".[test]"'
        )


if os.path.exists(os.path.join(os.path.dirname(__file__), "CMakeLists.txt")):  # a wheel has no sources
    _build_if_older(os.path.dirname(__file__))

from ._core import align_patches as align_patches
from ._core import disparity_slopes as disparity_slopes
from ._core import eliminate_points as eliminate_points
from ._core import field_basis as field_basis
from ._core import fit_motion as fit_motion
from ._core import fit_turn as fit_turn
from ._core import invert_triangle as invert_triangle
from ._core import linearise_views as linearise_views
from ._core import match_along_rows as match_along_rows
from ._core import motions_of_halves as motions_of_halves
from ._core import moving_views as moving_views
from ._core import multiply_blocks as multiply_blocks
from ._core import normal_blocks as normal_blocks
from ._core import orthonormalise as orthonormalise
from ._core import point_marginals as point_marginals
from ._core import polynomial_rows as polynomial_rows
from ._core import pose_exp as pose_exp
from ._core import pose_log as pose_log
from ._core import principal_errors as principal_errors
from ._core import quaternions as quaternions
from ._core import rig_columns as rig_columns
from ._core import rig_mixture as rig_mixture
from ._core import rotation_vectors as rotation_vectors
from ._core import sample_weights as sample_weights
from ._core import store_patches as store_patches
from ._core import unfilter_png as unfilter_png
from ._core import velocities_by_twist as velocities_by_twist
from ._core import view_residuals as view_residuals
from ._core import warp_patches as warp_patches
from ._core import window_points as window_points
from ._core import window_residuals as window_residuals
