"""A map of one run, and a second run that is located in it.

    python examples/places.py logs/room.mcap

The first run keeps the places that it has seen. The second one, which begins in the middle and goes faster, is
located as soon as it has recognised some; from then on its poses are in the world of the first. Needs the extra map
(GTSAM).
"""

import argparse
import sys
import tempfile
from pathlib import Path

import stream_sfm as sfm


def main() -> None:
    """Make a map of the whole log, and look for the frames of its second half."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("log")
    parser.add_argument("--max-frames", type=int)
    args = parser.parse_args()
    log = sfm.open_log(args.log)
    with tempfile.TemporaryDirectory() as folder:
        office = Path(folder) / "office.mcap"
        known = sfm.replay(log, selection=sfm.Selection(max_frames=args.max_frames), save_map=office)
        print(f"the map: {known.summary['map']['keyframes']} keyframes, {office.stat().st_size / 1e6:.1f} MB")
        engine, places = sfm.Engine(log.rig), sfm.PlaceMap(log.rig, wait=True, known=office)
    middle_s = known.summary["duration_s"] / 2
    for k, frame in enumerate(log.frames(sfm.Selection(start_s=middle_s, stride=2))):
        estimate = engine.step(frame)
        places.write(estimate, frame)
        if places.located:
            x, y, z = (places.world_from_odom @ estimate.world_from_cam)[:3, 3]
            print(f"located after {k + 1} frames, at {x:.3f} {y:.3f} {z:.3f} m of the map")
            break
    places.close()


if __name__ == "__main__":
    try:
        main()
    except sfm.StreamSfmError as error:
        sys.exit(f"error: {error}")
