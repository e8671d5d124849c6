"""Data sets and folders of images to logs in MCAP, image bytes unchanged; the profile is in docs/log-profile.md.

One module a kind; `common.py` writes for all. Not here: reading logs (`recording/`).
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

_PUBLIC = {"Imported": "common", "import_euroc": "euroc", "import_images": "folders", "import_kitti": "kitti"}

__all__ = ["Imported", "import_euroc", "import_images", "import_kitti"]

if TYPE_CHECKING:
    from .common import Imported
    from .euroc import import_euroc
    from .folders import import_images
    from .kitti import import_kitti


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_PUBLIC[name]}", __name__), name)
