"""A ray caster for stereo test images: exact geometry, anti-aliased textures, ground-truth depth."""

from .caster import CLEAN, Sensor, Shot, pixel_rays, render_stereo
from .hard import RECORDINGS
from .recording import Recording
from .room import room_path, room_recording, room_rig, room_scene
from .scene import Box, Scene, build_scene

__all__ = [
    "CLEAN",
    "RECORDINGS",
    "Box",
    "Recording",
    "Scene",
    "Sensor",
    "Shot",
    "build_scene",
    "pixel_rays",
    "render_stereo",
    "room_path",
    "room_recording",
    "room_rig",
    "room_scene",
]
