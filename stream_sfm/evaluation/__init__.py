"""Accuracy and consistency of a trajectory against ground truth: pure functions of `Trajectory`.

The definitions are in docs/mathematics.md, section 10. Not here: files and plots (`report/`), simulated scenes,
whose truth is known by track id (`simulation/measure.py`).
"""

from .association import matched
from .ate import ate_rmse_aligned_m, ate_rmse_m, ate_rmse_sim3_m
from .consistency import nees_pose, nees_pose_mean
from .drift import final_drift_percent, path_length_m, scale_error_percent
from .segments import SegmentErrors, segment_errors
from .structure import StructureComparison, StructureErrors
from .summary import evaluate, evaluate_unscaled

__all__ = [
    "SegmentErrors",
    "StructureComparison",
    "StructureErrors",
    "ate_rmse_aligned_m",
    "ate_rmse_m",
    "ate_rmse_sim3_m",
    "evaluate",
    "evaluate_unscaled",
    "final_drift_percent",
    "matched",
    "nees_pose",
    "nees_pose_mean",
    "path_length_m",
    "scale_error_percent",
    "segment_errors",
]
