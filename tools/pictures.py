"""Make the pictures of the README and of docs/ anew, from today's code: `python tools/pictures.py [NAME …]`.

    output    not a picture: what the first command of docs/quickstart.md prints; its times are those of this machine
    viewer    logs/demo.mcap in the Rerun viewer, without a window
    drift     the page of `stream-sfm compare logs/demo.mcap`
    transitory  its figure of the tracks against the frames, as in the paper's Figure 1
    surface   the mesh of `stream-sfm surface logs/room.mcap --all`, from above
    figure6   `stream-sfm simulate figure6`, 100 trials: five to ten minutes

`viewer` needs a Vulkan driver (Debian: mesa-vulkan-drivers draws without a graphics card), `drift` and `transitory`
need Chromium.
"""

import argparse
import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import cv2

sys.path.insert(0, str(Path(__file__).parent))
from surface_picture import preview

ROOT = Path(__file__).parents[1]
LOG, DEMO = ROOT / "logs/room.mcap", ROOT / "logs/demo.mcap"
PICTURES = ROOT / "docs/pictures"
VIEWER_SIZE = (1500, 850)
VIEWER_BAR_PX = 36  # menu and window buttons, above the picture
VIEWER_LOADS_S = 60.0  # on two busy cores without a graphics card
VIEWER_TRIES = 4
REPORT_SIZE = (1280, 1086)
TRANSITORY_SIZE = (1000, 370)
REPORT_LEFT_OUT = (  # of the last column, too: times are those of this machine at this moment
    "<style>main > .scroll tr > :last-child, details, .how:last-child { display: none }</style>"
)


def stream_sfm(*arguments: object) -> None:
    """Run a command of the package."""
    subprocess.run([sys.executable, "-m", "stream_sfm", *map(str, arguments)], check=True, cwd=ROOT)


def output(folder: Path) -> None:
    """The block below the first command of the quickstart."""
    (folder / "logs").symlink_to(LOG.parent)
    command = [sys.executable, "-m", "stream_sfm", "replay", "logs/demo.mcap"]
    printed = subprocess.run(command, check=True, cwd=folder, capture_output=True, text=True).stdout
    block = "\n".join(line.rstrip() for line in printed.strip().splitlines())
    page = (ROOT / "docs/quickstart.md").read_text(encoding="utf-8")
    shown = re.compile(r"(?<=```\n)logs/demo\.mcap: .*?(?=\n```)", re.DOTALL)
    (ROOT / "docs/quickstart.md").write_text(shown.sub(lambda _: block, page, count=1), encoding="utf-8")


def viewer(folder: Path) -> None:
    """The recording of a replay, drawn by Rerun."""
    from rerun.experimental import ViewerClient

    recording, whole, port = folder / "room.rrd", folder / "viewer.png", 9911
    stream_sfm("replay", DEMO, "--out", folder / "out", "--rrd", recording, "-q")
    size = "x".join(map(str, VIEWER_SIZE))
    command = ["rerun", "--headless", "--window-size", size, "--port", str(port), str(recording)]
    # a session of its own, so that the viewer ends with the Python process that starts it
    with subprocess.Popen(
        [sys.executable, "-m", *command], stderr=subprocess.DEVNULL, start_new_session=True
    ) as process:
        try:
            for _ in range(VIEWER_TRIES):
                time.sleep(VIEWER_LOADS_S)
                with contextlib.suppress(TimeoutError, ConnectionError):
                    ViewerClient(f"rerun+http://127.0.0.1:{port}/proxy").save_screenshot(str(whole))
                    break
        finally:
            os.killpg(process.pid, signal.SIGTERM)
    picture = cv2.imread(str(whole))
    assert picture is not None
    cv2.imwrite(str(PICTURES / "viewer.png"), picture[VIEWER_BAR_PX:])


def drift(folder: Path) -> None:
    """The page of a comparison in a browser: its table and its charts."""
    stream_sfm("compare", DEMO, "--out", folder, "-q", "--methods", "cross-frame,ekf,iterated-ekf,frame-to-frame")
    report = (folder / "report.html").read_text(encoding="utf-8")
    photograph(report.replace("</head>", f"{REPORT_LEFT_OUT}</head>"), folder, "drift", REPORT_SIZE)


def transitory(folder: Path) -> None:
    """One line per point from its first to its last frame: nothing is seen throughout."""
    stream_sfm("compare", LOG, "--out", folder, "-q", "--methods", "cross-frame")
    report = (folder / "report.html").read_text(encoding="utf-8")
    style = re.search(r"<style>.*?</style>", report, re.DOTALL)
    figure = re.search(r'<figure class="wide"><figcaption><b>Track lifetimes.*?</figure>', report, re.DOTALL)
    assert style is not None and figure is not None
    head = f'<head><meta charset="utf-8">{style[0]}</head>'
    page = f'<!doctype html><html lang="en">{head}<body>{figure[0]}</body></html>'
    photograph(page, folder, "transitory", TRANSITORY_SIZE)


def photograph(html: str, folder: Path, name: str, size: tuple[int, int]) -> None:
    """A picture of the top of a page."""
    browser = next(
        (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None
    )
    if browser is None:
        raise SystemExit(f"{name} needs Chromium: apt-get install chromium")
    page = folder / "excerpt.html"
    page.write_text(html, encoding="utf-8")
    subprocess.run(
        [
            browser, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
            f"--window-size={size[0]},{size[1]}", f"--screenshot={PICTURES / f'{name}.png'}", page.as_uri(),
        ],
        check=True, stderr=subprocess.DEVNULL,
    )  # fmt: skip


def surface(folder: Path) -> None:
    """The fused surface, from above."""
    import stream_sfm as sfm

    picture = preview(sfm.surface(LOG, None).mesh, azimuth_deg=20, elevation_deg=35)
    cv2.imwrite(str(PICTURES / "surface.png"), picture[:, :, ::-1])


def figure6(folder: Path) -> None:
    """The paper's Figure 6."""
    stream_sfm("simulate", "figure6", "--out", folder)
    shutil.copy(folder / "figure6.png", PICTURES / "figure6.png")


MAKERS = {maker.__name__: maker for maker in (output, viewer, drift, transitory, surface, figure6)}


def main() -> None:
    """Make the pictures that are named, or all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help="default: all")
    for name in parser.parse_args().names or MAKERS:
        if name not in MAKERS:
            parser.error(f"{name} is not a picture; there are {', '.join(MAKERS)}")
        with tempfile.TemporaryDirectory() as folder:
            MAKERS[name](Path(folder))


if __name__ == "__main__":
    main()
