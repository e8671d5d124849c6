"""The pose between two coordinate frames from the transforms in a log, such as on `/tf_static`."""

from itertools import chain

import numpy as np

from ...geometry import Array, se3
from ...system.inputs import LIMITS
from ..mcap_file.message import Source
from .messages import MessageDecoder, decoded, same_numbers
from .survey import Survey


def fixed_transform(source: Source, survey: Survey, target: str, origin: str) -> Array | None:
    """Return `target_from_origin` (4, 4), metres, along transforms that stay the same through the whole log.

    None if no chain of them leads from one frame to the other. Raises LogError if a topic cannot be read.
    """
    topics = frozenset(survey.of_kind("transform"))
    static = frozenset(t for t in topics if t.endswith("tf_static"))
    for wanted in (static, topics):  # the static topic first: /tf is often large
        if wanted and (found := _chain(fixed_edges(source, wanted), target, origin)) is not None:
            return found
    return None


def fixed_edges(source: Source, topics: frozenset[str]) -> dict[tuple[str, str], Array]:
    """Return (parent, child) -> parent_from_child of the transforms on `topics` that never change."""
    first: dict[tuple[str, str], Array] = {}
    moving: set[tuple[str, str]] = set()
    for pose in chain.from_iterable(decoded(source, topics, MessageDecoder.poses)):
        edge = (pose.parent, pose.child)
        if edge in first or len(first) < LIMITS.named:
            known = first.setdefault(edge, pose.parent_from_child)
            if not same_numbers(known, pose.parent_from_child):  # it says nothing about how two cameras are mounted
                moving.add(edge)
    return {edge: pose for edge, pose in first.items() if edge not in moving}


def _chain(edges: dict[tuple[str, str], Array], target: str, origin: str) -> Array | None:
    """Return target_from_origin by the fewest transforms, each used in either direction."""
    neighbours: dict[str, list[tuple[str, Array]]] = {}  # frame -> (next frame, frame_from_next)
    for (parent, child), parent_from_child in edges.items():
        neighbours.setdefault(parent, []).append((child, parent_from_child))
        neighbours.setdefault(child, []).append((parent, se3.inverse(parent_from_child)))
    target_from: dict[str, Array] = {target: np.eye(4)}
    frontier = [target]
    while frontier and origin not in target_from:
        reached = []
        for frame in frontier:
            for following, frame_from_following in neighbours.get(frame, ()):
                if following not in target_from:
                    target_from[following] = target_from[frame] @ frame_from_following
                    reached.append(following)
        frontier = reached
    return target_from.get(origin)
