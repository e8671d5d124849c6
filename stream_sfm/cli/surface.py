"""`stream-sfm surface`: the dense, textured surface that one frame or a whole log shows."""

import argparse
import math
import os
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import ExitCode
from . import arguments

if TYPE_CHECKING:
    from ..dense.surface import Surface


def add_parser(subparsers: Any) -> None:
    """Add the command to the parser of `stream-sfm`."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "surface",
        help="the dense, textured surface of one frame or of a whole log, as a mesh with σ",
        description="Dense stereo into a textured mesh: a binary PLY with colour, normal and std_m (σ along the "
        "viewing ray, metres) of each vertex. One frame in the axes of its left camera, or all frames fused in the "
        "world (the first left camera) by the estimated poses.",
    )
    arguments.add_log(parser)
    parser.add_argument("--out", metavar="FILE.ply", required=True, help="the mesh")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--frame", type=_number, default=0, metavar="N", help="of this frame, from 0 (default 0)")
    which.add_argument("--all", action="store_true", help="of all frames, fused")
    arguments.add_method(parser)
    arguments.add_selection(parser)
    arguments.add_configuration(parser)
    parser.add_argument("--preview", metavar="FILE.png", help="also a picture of it")
    parser.add_argument(
        "--viewpoint",
        nargs=2,
        type=_degrees,
        default=(20.0, 20.0),
        metavar=("RIGHT", "UP"),
        help="where the picture is taken from: degrees around the surface (default 20 20; 0 0 is the first camera's "
        "side)",
    )
    parser.add_argument("--rrd", metavar="FILE", help="also a recording for the Rerun viewer")
    parser.add_argument("--json", action="store_true", help="print one JSON object, nothing else")
    parser.add_argument("-q", "--quiet", action="store_true", help="print errors only")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Reconstruct, write, print, and say by the exit code whether the log was read whole."""
    from ..dense.surface import surface_of_frame, surface_of_log
    from ..pipeline.replay import check_selection
    from ..recording import open_log
    from . import output

    began_s = time.process_time()
    config = arguments.read_settings(args)
    check_selection(args.start, args.end)
    _check_files(args)
    log = open_log(args.log, args.left, args.right, args.calibration)
    frames = log.decoded(args.start, args.end, args.max_frames, args.stride)
    if args.all:
        with output.progress(output.frames_to_come(log.expected_frames, args), args.quiet) as tell:
            surface = surface_of_log(log, frames, config, tell)
    else:
        surface = surface_of_frame(log, frames, args.frame, config)
    _write(surface, args)
    if not args.quiet:
        output.print_notes("warning", surface.warnings)
    if not args.quiet or args.json:
        figures = _figures(surface, args) | {"cpu_s": time.process_time() - began_s}
        output.print_json(figures) if args.json else _print(figures)
    if surface.interrupted:
        return ExitCode.INTERRUPTED
    return ExitCode.DONE if surface.complete else ExitCode.INPUT


def _check_files(args: argparse.Namespace) -> None:
    """Before the work is done, rather than after. Raises ConfigError, OutputError."""
    from ..errors import ConfigError, OutputError

    for option, ending in (("out", ".ply"), ("preview", ".png"), ("rrd", ".rrd")):
        name = getattr(args, option)
        if name is None:
            continue
        path = Path(name)
        if path.suffix.lower() != ending:
            raise ConfigError(f"--{option} {name}: give a name that ends in {ending}")
        if path.is_dir():
            raise OutputError(f"cannot write {name}: it is a folder")
        if not path.parent.is_dir():
            raise OutputError(f"cannot write {name}: there is no folder {path.parent}")
        if not os.access(path.parent, os.W_OK):
            raise OutputError(f"cannot write {name}: no permission to write into {path.parent}")


def _write(surface: "Surface", args: argparse.Namespace) -> None:
    from ..dense.ply import write_ply

    of = "all frames, world: the first left camera" if args.all else f"frame {args.frame}, axes of its left camera"
    write_ply(args.out, surface.mesh, f"{Path(args.log).name}: {of}; x right, y down, z forward")
    if args.preview:
        from ..dense.preview import preview, write_png

        write_png(args.preview, preview(surface.mesh, *args.viewpoint))
    if args.rrd:
        from ..viewer.surface import write_surface

        write_surface(args.rrd, surface.mesh, surface.path, f"{Path(args.log).stem}: {of}")


def _figures(surface: "Surface", args: argparse.Namespace) -> dict[str, Any]:
    import numpy as np

    from ..pipeline.accounting import peak_rss_mib

    low, median, high = (float(p) for p in np.percentile(surface.mesh.std_m, [5, 50, 95]))
    return {
        "log": args.log,
        "out": args.out,
        "frame": None if args.all else args.frame,
        "frames": {"read": surface.read, "used": surface.used},
        "complete": surface.complete,
        "warnings": surface.warnings,
        "vertices": len(surface.mesh.vertices),
        "faces": len(surface.mesh.faces),
        "std_m": {"p5": low, "p50": median, "p95": high},
        "voxel_m": surface.voxel_m or None,
        "peak_rss_mib": peak_rss_mib(),
    }


def _print(figures: dict[str, Any]) -> None:
    std = figures["std_m"]
    of = f"frame {figures['frame']}" if figures["frame"] is not None else f"{figures['frames']['used']} frames"
    voxel = f", voxels of {1e3 * figures['voxel_m']:.1f} mm" if figures["voxel_m"] else ""
    print(f"{figures['out']}: {figures['vertices']} vertices, {figures['faces']} triangles of {of}{voxel}")
    print(f"σ {1e3 * std['p50']:.1f} mm (median), {1e3 * std['p5']:.1f} to {1e3 * std['p95']:.1f} mm (5 to 95 %)")


def _number(text: str) -> int:
    try:
        value = int(text)
    except ValueError:
        value = -1
    if value < 0:
        raise argparse.ArgumentTypeError(f"{text!r} is not a frame number, 0 or more")
    return value


def _degrees(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not abs(value) <= 360:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of degrees")
    return value
