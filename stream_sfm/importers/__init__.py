"""Data sets, folders of images and videos to logs in MCAP; the profile is in docs/log-profile.md.

The data sets themselves are read in `sources/`, which `open_log` uses too: an import is a copy of a source.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

_PUBLIC = {
    "Imported": "data_sets",
    "import_euroc": "data_sets",
    "import_images": "data_sets",
    "import_kitti": "data_sets",
    "import_video": "video",
}

__all__ = ["Imported", "import_euroc", "import_images", "import_kitti", "import_video"]

if TYPE_CHECKING:
    from .data_sets import Imported, import_euroc, import_images, import_kitti
    from .video import import_video


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_PUBLIC[name]}", __name__), name)
