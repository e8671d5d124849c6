"""Where things are in the checkout."""

from pathlib import Path

ROOT = Path(__file__).parents[2]
ROOM = ROOT / "logs/room.mcap"
DEMO = ROOT / "logs/demo.mcap"
LAB_LATERAL = ROOT.parent / "shared/logs/lab_lateral.mcap"  # may be absent
