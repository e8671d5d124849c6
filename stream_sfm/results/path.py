"""The path so far, in bounded memory: a long path is thinned, and published less often."""

from typing import Any

_MAX_POSES = 4096  # of one message; beyond it every other pose is dropped
_GROWTH = 1.05  # the path is published again when it is 5 % longer


class PathSoFar:
    """Collects the poses of all frames; a path is due with the first ones, and whenever it is a twentieth longer."""

    def __init__(self) -> None:
        self._kept: list[Any] = []
        self._latest: Any = None
        self._frames = 0
        self._stride = 1
        self._due_at = 1.0

    def add(self, pose: Any) -> bool:
        """Add the next pose, and return whether a path is due."""
        if self._frames % self._stride == 0:
            if len(self._kept) == _MAX_POSES:  # an even number: this frame belongs to the thinned ones, too
                del self._kept[1::2]
                self._stride *= 2
            self._kept.append(pose)
        self._latest = pose
        self._frames += 1
        if self._frames < self._due_at:
            return False
        self._due_at = self._frames * _GROWTH
        return True

    def poses(self) -> list[Any]:
        """Return the path, from the first pose to the latest."""
        if not self._kept or self._kept[-1] is self._latest:
            return list(self._kept)
        return [*self._kept, self._latest]
