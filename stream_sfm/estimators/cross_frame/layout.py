"""Where named blocks of a vector begin and end: the one place where their sizes are added up."""

from functools import lru_cache
from itertools import accumulate


class Layout(dict[str, slice]):
    """Blocks one after the other: `Layout(pose=6, state=17)["state"]` is `slice(6, 23)`."""

    def __init__(self, **sizes: int) -> None:
        *_, self.size = ends = list(accumulate(sizes.values()))
        super().__init__({name: slice(end - sizes[name], end) for name, end in zip(sizes, ends, strict=True)})

    def span(self, first: str, last: str) -> slice:
        """Return where blocks are from the first to the last one."""
        return slice(self[first].start, self[last].stop)

    def within(self, block: str, part: slice) -> slice:
        """Return where a part of a block is."""
        start: int = self[block].start
        return slice(start + part.start, start + part.stop)


@lru_cache(maxsize=1024)
def layout(**sizes: int) -> Layout:
    """Return the layout of these sizes, which is made once."""
    return Layout(**sizes)
