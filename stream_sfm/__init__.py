"""Stereo odometry and local structure from image streams, with covariances one can trust.

    import stream_sfm as sfm

    engine = sfm.Engine(sfm.StereoRig.from_calibration("calibration.toml"))
    estimate = engine.step(sfm.StereoFrame(stamp_ns, left, right))    # live
    result = sfm.replay("log.mcap", "out")                            # a recorded log

The names in `__all__` are the public API. Every module below is private and may change at any time. Poses are
`world_from_cam` of the physical left camera (x right, y down, z forward; metres); the world is that camera in the first
frame. Covariances of poses are those of ξ = (translation, rotation) in `world_from_cam · Exp(ξ)`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

__all__ = [
    "Camera",
    "Cloud",
    "ComparisonResult",
    "Config",
    "ConfigError",
    "DenseConfig",
    "DepthImages",
    "Engine",
    "EngineBusyError",
    "EstimateRecord",
    "Estimator",
    "FrameError",
    "FrameEstimate",
    "FrontendConfig",
    "GroundTruthFile",
    "ImageMessage",
    "Imported",
    "InputError",
    "JobResult",
    "LogError",
    "MapStart",
    "Mesh",
    "MonoFrame",
    "MonoRig",
    "MotionConfig",
    "Observations",
    "OutputError",
    "PointTable",
    "PreparedImages",
    "ReadStats",
    "RecordedFrame",
    "Recovered",
    "RefinedRig",
    "Refinement",
    "RelativeMotions",
    "ReplayInterrupted",
    "ReplayResult",
    "ResultFolder",
    "RigChange",
    "RigConfig",
    "RigError",
    "RigEstimate",
    "RobustConfig",
    "RosConfig",
    "RunResults",
    "Selection",
    "Sink",
    "Solution",
    "Status",
    "StereoFrame",
    "StereoLog",
    "StereoPair",
    "StereoProjection",
    "StereoRig",
    "StreamSfmError",
    "Surface",
    "Trajectory",
    "WindowConfig",
    "__version__",
    "calibrate",
    "compare",
    "compare_many",
    "config_to_toml",
    "draw_mesh",
    "evaluate",
    "import_euroc",
    "import_images",
    "import_kitti",
    "import_video",
    "inspect",
    "open_log",
    "open_viewer",
    "read_clouds",
    "read_config",
    "read_estimates",
    "read_results",
    "read_trajectory",
    "read_tum",
    "recover",
    "replay",
    "replay_batch",
    "simulate",
    "surface",
    "write_ply",
    "write_png",
    "write_surface_recording",
]

# Module -> its public names. It is imported on first use, so that a bare import and `--help` cost nothing.
_HOMES = {
    "batch.job": ("JobResult",),
    "batch.replay_batch": ("replay_batch",),
    "camera.models": ("Camera",),
    "camera.refinement": ("Refinement",),
    "camera.rig": ("MonoRig", "StereoRig"),
    "config": (
        "Config",
        "DenseConfig",
        "FrontendConfig",
        "MotionConfig",
        "RigConfig",
        "RobustConfig",
        "RosConfig",
        "WindowConfig",
        "config_to_toml",
        "read_config",
    ),
    "dense.mesh": ("Mesh",),
    "dense.ply": ("write_ply",),
    "dense.preview": ("preview as draw_mesh", "write_png"),
    "dense.surface": ("Surface", "surface"),
    "engine": ("Engine",),
    "errors": (
        "ConfigError",
        "EngineBusyError",
        "FrameError",
        "InputError",
        "LogError",
        "OutputError",
        "RigError",
        "StreamSfmError",
    ),
    "evaluation.summary": ("evaluate",),
    "frontend.prepared": ("PreparedImages",),
    "geometry.stereo": ("StereoProjection",),
    "importers.data_sets": ("Imported", "import_euroc", "import_images", "import_kitti"),
    "importers.video": ("import_video",),
    "inspection.overview": ("inspect_log as inspect",),
    "mcap_file.recover": ("Recovered", "recover"),
    "recording.frames": ("RecordedFrame",),
    "recording.truth_file": ("GroundTruthFile",),
    "recording.ground_truth": ("DepthImages",),
    "recording.messages": ("ImageMessage",),
    "recording.pair_reader": ("ReadStats", "StereoPair"),
    "recording.stereo_log": ("StereoLog", "open_log"),
    "results.estimates_reader": ("Cloud", "read_clouds", "read_estimates", "read_trajectory"),
    "results.folder": ("ResultFolder",),
    "results.run_results": ("PointTable", "RunResults", "read_results"),
    "results.schema": ("EstimateRecord",),
    "results.trajectory_files": ("read_tum",),
    "run.compare": ("ComparisonResult", "compare"),
    "run.many": ("compare_many",),
    "run.refine": ("RefinedRig", "calibrate"),
    "run.replay": ("ReplayInterrupted", "ReplayResult", "replay"),
    "simulation.experiments": ("simulate",),
    "types": (
        "Estimator",
        "FrameEstimate",
        "MapStart",
        "MonoFrame",
        "Observations",
        "RelativeMotions",
        "RigChange",
        "RigEstimate",
        "Selection",
        "Sink",
        "Solution",
        "Status",
        "StereoFrame",
        "Trajectory",
    ),
    "viewer": ("open_viewer",),
    "viewer.surface": ("write_surface_recording",),
}

if TYPE_CHECKING:
    from .batch.job import JobResult
    from .batch.replay_batch import replay_batch
    from .camera.models import Camera
    from .camera.refinement import Refinement
    from .camera.rig import MonoRig, StereoRig
    from .config import (
        Config,
        DenseConfig,
        FrontendConfig,
        MotionConfig,
        RigConfig,
        RobustConfig,
        RosConfig,
        WindowConfig,
        config_to_toml,
        read_config,
    )
    from .dense.mesh import Mesh
    from .dense.ply import write_ply
    from .dense.preview import preview as draw_mesh
    from .dense.preview import write_png
    from .dense.surface import Surface, surface
    from .engine import Engine
    from .errors import (
        ConfigError,
        EngineBusyError,
        FrameError,
        InputError,
        LogError,
        OutputError,
        RigError,
        StreamSfmError,
    )
    from .evaluation.summary import evaluate
    from .frontend.prepared import PreparedImages
    from .geometry.stereo import StereoProjection
    from .importers.data_sets import Imported, import_euroc, import_images, import_kitti
    from .importers.video import import_video
    from .inspection.overview import inspect_log as inspect
    from .mcap_file.recover import Recovered, recover
    from .recording.frames import RecordedFrame
    from .recording.ground_truth import DepthImages
    from .recording.messages import ImageMessage
    from .recording.pair_reader import ReadStats, StereoPair
    from .recording.stereo_log import StereoLog, open_log
    from .recording.truth_file import GroundTruthFile
    from .results.estimates_reader import Cloud, read_clouds, read_estimates, read_trajectory
    from .results.folder import ResultFolder
    from .results.run_results import PointTable, RunResults, read_results
    from .results.schema import EstimateRecord
    from .results.trajectory_files import read_tum
    from .run.compare import ComparisonResult, compare
    from .run.many import compare_many
    from .run.refine import RefinedRig, calibrate
    from .run.replay import ReplayInterrupted, ReplayResult, replay
    from .simulation.experiments import simulate
    from .types import (
        Estimator,
        FrameEstimate,
        MapStart,
        MonoFrame,
        Observations,
        RelativeMotions,
        RigChange,
        RigEstimate,
        Selection,
        Sink,
        Solution,
        Status,
        StereoFrame,
        Trajectory,
    )
    from .viewer import open_viewer
    from .viewer.surface import write_surface_recording


def __getattr__(name: str) -> Any:
    for home, names in _HOMES.items():
        for inside, _, outside in (entry.partition(" as ") for entry in names):
            if name == (outside or inside):
                value = globals()[name] = getattr(import_module(f".{home}", __name__), inside)
                return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
