"""The frozen records that modules exchange, and the protocols of those that take them.

Arrays are float64 unless stated otherwise, and never written to. A record equals only itself; its `repr` is one line.
"""

from .estimates import CommonErrors as CommonErrors
from .estimates import FrameEstimate as FrameEstimate
from .estimates import InertialEstimate as InertialEstimate
from .estimates import Prediction as Prediction
from .estimates import RelativeMotions as RelativeMotions
from .estimates import Solution as Solution
from .estimates import Status as Status
from .estimates import Trajectory as Trajectory
from .frames import Frame as Frame
from .frames import Image as Image
from .frames import MonoFrame as MonoFrame
from .frames import Picture as Picture
from .frames import Selection as Selection
from .frames import StereoFrame as StereoFrame
from .observations import Ambiguity as Ambiguity
from .observations import ExpectedMotion as ExpectedMotion
from .observations import InertialView as InertialView
from .observations import LastingErrors as LastingErrors
from .observations import MapStart as MapStart
from .observations import Observations as Observations
from .observations import RigChange as RigChange
from .observations import RigView as RigView
from .protocols import Estimator as Estimator
from .protocols import InertialEstimator as InertialEstimator
from .protocols import Sink as Sink
