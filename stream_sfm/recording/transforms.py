"""Where two frames of reference stand to each other by the transforms that a log carries, as on `/tf_static`."""

import numpy as np

from ..geometry import se3
from ..geometry.se3 import Array
from ..mcap_file.log_file import Damage, LogFile
from .messages import MessageDecoder, UndecodableMessage
from .survey import Survey

_STILL = 1e-6  # a transform whose numbers change by more moves, and says nothing of how two cameras are mounted

_MAX_EDGES = 2**12  # between frames of one log; further ones are left out


def fixed_transform(file: LogFile, survey: Survey, target: str, source: str) -> Array | None:
    """`target_from_source` (4, 4), metres, along transforms that stay as they are through the whole log.

    None where no chain of them leads from one frame to the other. Raises LogError where a topic cannot be read.
    """
    topics = frozenset(survey.of_kind("transform"))
    static = frozenset(t for t in topics if t.endswith("tf_static"))
    for wanted in (static, topics):  # what is static by its name is read first: often there is a lot of /tf
        if wanted and (found := _chain(_still(file, wanted), target, source)) is not None:
            return found
    return None


def _still(file: LogFile, topics: frozenset[str]) -> dict[tuple[str, str], Array]:
    """(parent, child) -> parent_from_child, of the transforms that do not change."""
    decoder = MessageDecoder(file.path)
    still: dict[tuple[str, str], Array] = {}
    moving: set[tuple[str, str]] = set()
    for message in file.messages(Damage(), topics):
        try:
            poses = decoder.poses(message)
        except UndecodableMessage:
            continue
        for pose in poses:
            edge = (pose.parent, pose.child)
            if edge not in still and len(still) >= _MAX_EDGES:
                continue
            known = still.setdefault(edge, pose.parent_from_child)
            if not np.allclose(known, pose.parent_from_child, rtol=0, atol=_STILL):
                moving.add(edge)
    return {edge: pose for edge, pose in still.items() if edge not in moving}


def _chain(edges: dict[tuple[str, str], Array], target: str, source: str) -> Array | None:
    """target_from_source by the fewest transforms, each taken either way."""
    steps: dict[str, list[tuple[str, Array]]] = {}  # frame -> (next frame, frame_from_next)
    for (parent, child), parent_from_child in edges.items():
        steps.setdefault(parent, []).append((child, parent_from_child))
        steps.setdefault(child, []).append((parent, se3.inverse(parent_from_child)))
    reached: dict[str, Array] = {target: np.eye(4)}
    front = [target]
    while front and source not in reached:
        ahead = []
        for frame in front:
            for following, frame_from_following in steps.get(frame, ()):
                if following not in reached:
                    reached[following] = reached[frame] @ frame_from_following
                    ahead.append(following)
        front = ahead
    return reached.get(source)
