"""Stereo odometry and local structure from image streams, with covariances one can trust.

    import stream_sfm as sfm

    engine = sfm.Engine(sfm.StereoRig.from_calibration("calibration.toml"))
    estimate = engine.step(sfm.StereoFrame(stamp_ns, left, right))    # live
    result = sfm.replay("log.mcap", "out")                            # a recorded log

The names in `__all__` are the public API. Every module below is private and may change at any time. Poses are
`world_from_cam` of the physical left camera (x right, y down, z forward; metres); the world is that camera in the first
frame. Covariances of poses are those of ξ = (translation, rotation) in `world_from_cam · Exp(ξ)`.
"""

from typing import Any

__version__ = "1.0.0"


def __getattr__(name: str) -> Any:
    """Import what is used: the public names and their modules are the imports of `__init__.pyi`."""
    from importlib import import_module
    from pathlib import Path

    stub = Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")
    imports = (line.split() for line in stub.splitlines() if line.startswith("from "))
    homes = {public: (module[1:], inside) for _, module, _, inside, _, public in imports}
    if name == "__all__":
        value: Any = sorted([*homes, "__version__"])
    elif name in homes:
        module, inside = homes[name]
        value = getattr(import_module(f".{module}", __name__), inside)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    names: list[str] = __getattr__("__all__")
    return names
