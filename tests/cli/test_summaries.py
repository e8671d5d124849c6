"""What the table of a replay says about the inertial unit."""

import pytest

from stream_sfm.cli.summaries import print_summary

_TIMES = dict.fromkeys(("p50", "p95", "max"), 1.0)
_SUMMARY = {
    "log": "a.mcap", "method": "cross-frame", "complete": True, "unscaled": False,
    "frames": dict.fromkeys(("estimated", "paired", "degraded", "lost", "dropped"), 1), "path_length_m": 1.0,
    "duration_s": 1.0, "timing_ms": dict.fromkeys(("total", "decode", "frontend", "estimator"), _TIMES),
    "peak_rss_mib": 100.0, "frames_per_s": 20.0, "cpu_s": 1.0,
}  # fmt: skip
_IMU = {
    "frames": 90, "dead_reckoned": 20, "std_tilt_rad": 0.002, "scale_percent": -1.14, "std_scale_percent": 0.08,
    "axes_rad": [-0.017, 0.001, 0.0], "std_axes_rad": [0.0005, 0.0004, 0.0003], "time_offset_s": -0.005,
    "std_time_offset_s": 2e-5, "gyro_bias_rad_s": [-0.025, 0.003, 0.0], "accel_bias_m_s2": [0.03, 0.0, -0.06],
    "densities_over_data_sheet": [1.7, 8.0],
}  # fmt: skip


def test_table_shows_axes_clock_scale_and_noise_of_an_inertial_unit(capsys: pytest.CaptureFixture[str]) -> None:
    print_summary(_SUMMARY | {"imu": _IMU}, None, stages=False)
    shown = capsys.readouterr().out
    assert "90 frames, 20 of them by the IMU alone" in shown
    assert "lengths -1.14 %, σ 0.08 %" in shown
    assert "its clock -5.00 ms, σ 0.02 ms" in shown
    assert "its axes (-17.00, +1.00, +0.00) mrad, σ 0.5 mrad" in shown
    assert "biases (-25.00, +3.00, +0.00) mrad/s, (+30.00, +0.00, -60.00) mm/s²" in shown
    assert "its noise × 1.7 (gyroscope) and × 8 (accelerometer) of the data sheet" in shown


def test_table_has_no_rows_of_an_inertial_unit_without_one(capsys: pytest.CaptureFixture[str]) -> None:
    print_summary(_SUMMARY | {"imu": None}, None, stages=False)
    assert "inertia" not in capsys.readouterr().out


def test_sigma_of_motions_is_shown_in_two_figures(capsys: pytest.CaptureFixture[str]) -> None:
    """Own errors of the motions for the spans that have them, and those of the rig; only one for an exact rig."""
    spans = [
        {"frames": 1, "factor": 0.56, "factor_own": 0.76, "factor_common": 0.34},
        {"frames": 50, "factor": 0.32, "factor_own": None, "factor_common": None},
    ]
    known = ("ate_rmse_aligned_m", "ate_rmse_m", "final_drift_percent", "t_rel_percent", "r_rel_deg_per_100m")
    truth = dict.fromkeys((*known, "scale_error_percent", "nees_pose_mean"), 1.0) | {"local_structure_rms_m": None}
    truth |= {"segment_lengths_m": [], "std_truth": [0, 0], "relative_consistency": spans}
    print_summary(_SUMMARY | {"ground_truth": truth | {"rig_over_sigma": 0.34}}, None, stages=False)
    shown = capsys.readouterr().out
    assert "error of 0.56, 0.32 × the estimated σ over 1, 50 frames" in shown
    assert "0.76 × the estimated σ over 1 frames, given the rig" in shown
    assert "0.34 × their estimated σ, once per run" in shown
    print_summary(_SUMMARY | {"ground_truth": truth | {"rig_over_sigma": None}}, None, stages=False)
    assert "given the rig" not in capsys.readouterr().out


def test_a_place_less_certain_than_the_path_is_long_is_unknown(capsys: pytest.CaptureFixture[str]) -> None:
    """After a long loss that no view bridges; one of them may be known without the other."""
    end = {
        "position_m": [1.0, 2.0, 3.0], "std_position_m": 18.0, "std_position_percent": 520.0,
        "heading_deg": -126.53, "std_heading_deg": 455.0,
    }  # fmt: skip
    print_summary(_SUMMARY | {"end": end}, None, stages=False)
    shown = capsys.readouterr().out
    assert "unknown, σ 18 m, more than the path" in shown and "heading unknown" in shown
    print_summary(_SUMMARY | {"end": end | {"std_position_percent": 4.0}}, None, stages=False)
    assert "(1.000, 2.000, 3.000) m, σ 18 m, 4 % of the path" in capsys.readouterr().out
