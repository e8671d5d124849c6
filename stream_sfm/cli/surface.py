"""`stream-sfm surface`: the dense, textured surface in one frame or in a whole log."""

import os
import time
from pathlib import Path
from typing import Annotated

from ..errors import ConfigError, ExitCode, OutputError
from ..system.wording import printable
from . import options
from .printing import print_json, print_notes
from .tables import Parameter


def surface(
    log: options.Recording,
    /,
    *,
    out: options.OutFile,
    cameras: options.Cameras = options.Cameras(),
    frame: options.MaybeIndex = None,
    all: Annotated[bool, Parameter(group=options.FRAMES)] = False,
    frames: options.Frames = options.Frames(),
    settings: options.Settings = options.Settings(),
    method: options.MethodName = None,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> int:
    """Reconstruct a dense, textured surface from one frame or from a whole log.

    Reconstructs a textured mesh by dense stereo: a binary PLY file with the colour, the normal and std_m of each
    vertex (σ along the viewing ray, metres). The mesh of one frame is in the axes of its left camera; all frames are
    fused in the world frame (the first left camera) by the estimated poses.

    Args:
        out: the mesh to write, a .ply
        frame: use frame N, from 0 (0)
        all: fuse all frames
    """
    import numpy as np

    from ..dense import surface as dense
    from ..dense.mesh import write_ply
    from ..logs.recording.stereo_log import open_log
    from ..run.summary import peak_rss_mib
    from .progress import frame_progress

    started_s = time.process_time()
    if all and frame is not None:
        raise ConfigError("--frame and --all exclude each other: leave one out")
    number = None if all else frame or 0
    config, selection = settings.read(method=method), frames.selection()
    path = Path(out)  # checked before the work, not after it
    if path.suffix.lower() != ".ply":
        raise ConfigError(f"--out {out}: the name must end in .ply")
    if not os.path.isdir(path.parent):
        raise OutputError(f"cannot write {out}: the folder {path.parent} does not exist")
    if not os.access(path.parent, os.W_OK):
        raise OutputError(f"cannot write {out}: no permission to write to {path.parent}")
    options.protect([out], log, settings.config, cameras.calibration)
    recording = open_log(log, **cameras.chosen)
    with frame_progress("surface", selection.count(recording.expected_frames), quiet or not all) as progress:
        found = dense.surface(recording, number, config, selection, sinks=[progress] if all else [])
    axes = "all frames, world: the first left camera" if all else f"frame {number}, axes of its left camera"
    write_ply(out, found.mesh, f"{Path(log).name}: {axes}; x right, y down, z forward")
    if not quiet:
        print_notes("warning", found.warnings)
    mesh = found.mesh
    low_m, median_m, high_m = map(float, np.percentile(mesh.std_m, [5, 50, 95]))
    if json:
        figures = {
            "log": log,
            "out": out,
            "frame": number,
            "frames": {"read": found.read, "used": found.used},
            "complete": found.complete,
            "warnings": found.warnings,
            "vertices": len(mesh.vertices),
            "faces": len(mesh.faces),
            "std_m": {"p5": low_m, "p50": median_m, "p95": high_m},
            "voxel_m": found.voxel_m or None,
            "peak_rss_mib": peak_rss_mib(),
            "cpu_s": time.process_time() - started_s,
        }
        print_json(figures)
    elif not quiet:
        used = f"{found.used} frames" if all else f"frame {number}"
        voxel = f", voxels of {1e3 * found.voxel_m:.1f} mm" if found.voxel_m else ""
        print(f"{printable(out)}: {len(mesh.vertices)} vertices and {len(mesh.faces)} triangles from {used}{voxel}")
        print(f"σ {1e3 * median_m:.1f} mm (median), {1e3 * low_m:.1f} to {1e3 * high_m:.1f} mm (5 to 95 %)")
    if found.interrupted:
        return ExitCode.INTERRUPTED
    return ExitCode.DONE if found.complete else ExitCode.INPUT
