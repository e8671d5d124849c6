"""A ray caster for stereo test images: exact geometry, anti-aliased textures, ground-truth depth."""

from .caster import CLEAN, Sensor, pixel_rays
from .demo import demo_recording, demo_rigs
from .faults import FAULTS, Fault
from .hard import RECORDINGS
from .loops import LOOPS
from .motions import MOTIONS
from .recording import SIDES, Recording, Shot
from .room import room_path, room_recording, room_rig, room_scene
from .scene import Box, Scene, build_scene

__all__ = [
    "CLEAN",
    "FAULTS",
    "LOOPS",
    "MOTIONS",
    "RECORDINGS",
    "SIDES",
    "Box",
    "Fault",
    "Recording",
    "Scene",
    "Sensor",
    "Shot",
    "build_scene",
    "demo_recording",
    "demo_rigs",
    "pixel_rays",
    "room_path",
    "room_recording",
    "room_rig",
    "room_scene",
]
