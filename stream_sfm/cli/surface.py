"""`stream-sfm surface`: the dense, textured surface that one frame or a whole log shows."""

import argparse
import os
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import ExitCode
from ..wording import printable
from . import arguments

if TYPE_CHECKING:
    from ..dense.surface import Surface


def add_parser(subparsers: Any) -> None:
    """Add the command to the parser of `stream-sfm`."""
    parser = arguments.add_command(
        subparsers,
        "surface",
        run,
        summary="reconstruct a dense, textured surface from one frame or from a whole log",
        description="Reconstruct a textured mesh by dense stereo: a binary PLY file with the colour, the normal and "
        "std_m of each vertex (σ along the viewing ray, metres). The mesh of one frame is in the axes of its left "
        "camera; all frames are fused in the world frame (the first left camera) by the estimated poses.",
        usage="LOG --out FILE.ply [options]",
    )
    arguments.add_log(parser)
    _add_results(parser)
    arguments.add_cameras(parser)
    frames = arguments.add_selection(parser)
    which = frames.add_mutually_exclusive_group()
    which.add_argument(
        "--frame", type=arguments.not_negative, default=0, metavar="N", help="use frame N, from 0 (default: 0)"
    )
    which.add_argument("--all", action="store_true", help="fuse all frames")
    arguments.add_settings(parser)
    arguments.add_general(parser, json="the figures of the surface, as one JSON object,", quiet=True)


def _add_results(parser: argparse.ArgumentParser) -> None:
    results = parser.add_argument_group("results")
    results.add_argument(
        "--out", type=arguments.output, metavar="FILE.ply", required=True, help="the mesh to write"
    )
    results.add_argument(
        "--preview",
        metavar="FILE.png",
        help="also render a picture of the mesh; of one frame, as far as σ lets shapes be seen",
    )
    results.add_argument(
        "--viewpoint",
        nargs=2,
        type=arguments.degrees,
        default=(20.0, 20.0),
        metavar=("RIGHT", "UP"),
        help="direction from which the picture is taken, in degrees to the right of the first camera and above it "
        "(default: 20 20)",
    )
    results.add_argument("--rrd", metavar="FILE", help="also write a recording for the Rerun viewer (extra [view])")


def run(args: argparse.Namespace) -> int:
    """Reconstruct, write, print, and return whether the log was read to its end."""
    from .printing import print_json, print_notes

    started_s = time.process_time()
    surface = _reconstruct(args)
    _write(surface, args)
    if not args.quiet:
        print_notes("warning", surface.warnings)
    figures = _figures(surface, args) | {"cpu_s": time.process_time() - started_s}
    if args.json:
        print_json(figures)
    elif not args.quiet:
        _print(figures)
    if surface.interrupted:
        return ExitCode.INTERRUPTED
    return ExitCode.DONE if surface.complete else ExitCode.INPUT


def _reconstruct(args: argparse.Namespace) -> "Surface":
    from ..dense.surface import surface
    from ..recording import open_log
    from .progress import frame_progress

    config = arguments.read_settings(args)
    selection = arguments.read_selection(args)
    _check_files(args)
    log = open_log(args.log, args.left, args.right, args.calibration)
    if not args.all:
        return surface(log, args.frame, config, selection)
    with frame_progress("surface", selection.count(log.expected_frames), args.quiet) as progress:
        return surface(log, None, config, selection, sinks=[progress])


def _check_files(args: argparse.Namespace) -> None:
    """Before the work is done, rather than after. Raises ConfigError, OutputError."""
    from ..errors import ConfigError, OutputError
    from ..viewer import require_rerun

    if args.rrd is not None:
        require_rerun()
    for option, ending in (("out", ".ply"), ("preview", ".png"), ("rrd", ".rrd")):
        name = getattr(args, option)
        if name is None:
            continue
        path = Path(name)
        if path.suffix.lower() != ending:
            raise ConfigError(f"--{option} {name}: the name must end in {ending}")
        if os.path.isdir(path):
            raise OutputError(f"cannot write {name}: it is a folder")
        if not os.path.isdir(path.parent):
            raise OutputError(f"cannot write {name}: the folder {path.parent} does not exist")
        if not os.access(path.parent, os.W_OK):
            raise OutputError(f"cannot write {name}: no permission to write to {path.parent}")
    arguments.protect_inputs(args, [args.out, args.preview, args.rrd])


def _write(surface: "Surface", args: argparse.Namespace) -> None:
    from ..dense.ply import write_ply

    axes = (
        "all frames, world: the first left camera" if args.all else f"frame {args.frame}, axes of its left camera"
    )
    write_ply(args.out, surface.mesh, f"{Path(args.log).name}: {axes}; x right, y down, z forward")
    if args.preview:
        from ..dense.preview import near_part, preview, write_png

        shown = surface.mesh if args.all else near_part(surface.mesh)
        write_png(args.preview, preview(shown, *args.viewpoint))
    if args.rrd:
        from ..viewer.surface import write_surface_recording

        write_surface_recording(args.rrd, surface.mesh, surface.path, f"{Path(args.log).stem}: {axes}")


def _figures(surface: "Surface", args: argparse.Namespace) -> dict[str, Any]:
    import numpy as np

    from ..run.summary import peak_rss_mib

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
    std, out = figures["std_m"], printable(figures["out"])
    frames = f"frame {figures['frame']}" if figures["frame"] is not None else f"{figures['frames']['used']} frames"
    voxel = f", voxels of {1e3 * figures['voxel_m']:.1f} mm" if figures["voxel_m"] else ""
    print(f"{out}: {figures['vertices']} vertices and {figures['faces']} triangles from {frames}{voxel}")
    print(f"σ {1e3 * std['p50']:.1f} mm (median), {1e3 * std['p5']:.1f} to {1e3 * std['p95']:.1f} mm (5 to 95 %)")
