"""Positions of named blocks in a vector: the only place where their sizes are added up."""

from functools import lru_cache
from itertools import accumulate


class Layout(dict[str, slice]):
    """Blocks one after the other: `Layout(pose=6, state=17)["state"]` is `slice(6, 23)`."""

    def __init__(self, **sizes: int) -> None:
        *_, self.size = ends = list(accumulate(sizes.values()))
        super().__init__({name: slice(end - sizes[name], end) for name, end in zip(sizes, ends, strict=True)})

    def span(self, first: str, last: str) -> slice:
        """Return the slice from the start of one block to the end of another."""
        return slice(self[first].start, self[last].stop)

    def within(self, block: str, part: slice) -> slice:
        start: int = self[block].start
        return slice(start + part.start, start + part.stop)


@lru_cache(maxsize=1024)
def layout(**sizes: int) -> Layout:
    """Return the cached layout of these sizes."""
    return Layout(**sizes)
