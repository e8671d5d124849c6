"""A ray caster for stereo test images: exact geometry, anti-aliased textures, ground-truth depth."""

from .caster import CLEAN, Sensor, Shot, pixel_rays, render_stereo
from .room import room_path, room_rig, room_scene
from .scene import Box, Scene, build_scene

__all__ = [
    "CLEAN",
    "Box",
    "Scene",
    "Sensor",
    "Shot",
    "build_scene",
    "pixel_rays",
    "render_stereo",
    "room_path",
    "room_rig",
    "room_scene",
]
