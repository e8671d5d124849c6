# The public names, once: type checkers read these imports, and `__init__.py` makes them when a name is used.

from .batch.replay_batch import replay_batch as replay_batch
from .camera.models import Camera as Camera
from .camera.rig import MonoRig as MonoRig
from .camera.rig import StereoRig as StereoRig
from .config import Config as Config
from .config import config_to_toml as config_to_toml
from .config import read_config as read_config
from .dense.mesh import write_ply as write_ply
from .dense.surface import surface as surface
from .engine import Engine as Engine
from .errors import ConfigError as ConfigError
from .errors import FrameError as FrameError
from .errors import InputError as InputError
from .errors import LogError as LogError
from .errors import OutputError as OutputError
from .errors import StreamSfmError as StreamSfmError
from .evaluation.summary import evaluate as evaluate
from .geometry.stereo import StereoProjection as StereoProjection
from .importers import import_euroc as import_euroc
from .importers import import_images as import_images
from .importers import import_kitti as import_kitti
from .importers import recover as recover
from .inspection.overview import inspect_log as inspect
from .motion import Motion as Motion
from .motion import Odometry as Odometry
from .places.place_map import PlaceMap as PlaceMap
from .recording.stereo_log import open_camera as open_camera
from .recording.stereo_log import open_log as open_log
from .recording.truth_file import GroundTruthFile as GroundTruthFile
from .results.estimate_messages import RosMessages as RosMessages
from .results.estimates_reader import read_clouds as read_clouds
from .results.estimates_reader import read_estimates as read_estimates
from .results.folder import ResultFolder as ResultFolder
from .results.run_results import RunResults as RunResults
from .results.run_results import read_results as read_results
from .run.compare import compare as compare
from .run.refine import refine as refine
from .run.replay import ReplayInterrupted as ReplayInterrupted
from .run.replay import replay as replay
from .simulation.experiments import simulate as simulate
from .types import Estimator as Estimator
from .types import FrameEstimate as FrameEstimate
from .types import MonoFrame as MonoFrame
from .types import Observations as Observations
from .types import Selection as Selection
from .types import Sink as Sink
from .types import Solution as Solution
from .types import Status as Status
from .types import StereoFrame as StereoFrame
from .types import Trajectory as Trajectory
from .viewer import open_viewer as open_viewer

__version__: str
__all__: list[str]
