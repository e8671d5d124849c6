"""docs/benchmarks.md from the baseline of tools/benchmark.py and the figures of other systems in tools/peers.toml."""

import tomllib
from pathlib import Path
from typing import Any

PAGE = Path(__file__).parents[1] / "docs" / "benchmarks.md"
PEERS = Path(__file__).with_name("peers.toml")
_SUITES = {
    "kitti": "KITTI odometry",
    "euroc": "EuRoC MAV",
    "tumvi": "TUM-VI",
    "clips": "Clips",
}
_NAMES = {
    "orb_slam3": "ORB-SLAM3",
    "orb_slam2": "ORB-SLAM2",
    "basalt": "Basalt",
    "libviso2": "libviso2",
    "opencv": "plain OpenCV loop",
}
_HEAD = """# Benchmarks

<!-- Written by `python tools/benchmark.py … --page`; change that, not this page. -->

Version {version}, on {machine}. Poses are causal, as first issued, without loops closed. ATE is aligned in
SE(3), never with a scale. t_rel and r_rel are KITTI's, over 100, 200 … 800 m on paths of at least 200 m, over
shorter segments on shorter paths. RPE is the root mean square of the position's error from frame to frame. NEES of
the pose is 6 where covariances are right, and the factor of σ, over one frame, is 1. A number in brackets is that
of {release}.
Ground truth of real recordings has errors of its own, of millimetres to centimetres, which NEES and the factor
of σ contain.

On your machine, with a data set:

```sh
python tools/benchmark.py kitti /data/kitti/dataset/sequences
python tools/benchmark.py euroc /data/euroc tumvi /data/tum-vi --gate
```

`--gate` fails where a figure is worse than the baseline in git allows; `--update-baseline` accepts it.
"""
_COLUMNS = (  # key, heading, factor, form
    ("t_rel_percent", "t_rel, %", 1, ".2f"),
    ("r_rel_deg_per_100m", "r_rel, °/100 m", 1, ".2f"),
    ("ate_rmse_aligned_m", "ATE, mm", 1e3, ".1f"),
    ("rpe_m", "RPE, mm", 1e3, ".2f"),
    ("nees_pose_mean", "NEES", 1, ".1f"),
    ("factor_of_sigma", "× σ", 1, ".2f"),
    ("cpu_ms_per_frame", "CPU, ms", 1, ".0f"),
    ("p99_ms", "p99, ms", 1, ".0f"),
)
_MEANS = ("t_rel_percent", "r_rel_deg_per_100m", "ate_rmse_aligned_m")  # that whole data sets are compared by


def write_page(baseline: dict[str, Any]) -> None:
    """Write docs/benchmarks.md."""
    PAGE.write_text(page(baseline, tomllib.loads(PEERS.read_text(encoding="utf-8"))), encoding="utf-8")


def page(baseline: dict[str, Any], peers: dict[str, Any]) -> str:
    """The text of the page."""
    release = baseline.get("release") or {}
    last = f"version {release['version']}" if release else "the last release, from the second release on"
    parts = [_HEAD.format(version=baseline["version"], machine=baseline["machine"], release=last)]
    for suite, title in _SUITES.items():
        rows = {n.split("/", 1)[1]: f for n, f in baseline["sequences"].items() if n.startswith(f"{suite}/")}
        before = {n.split("/", 1)[1]: f for n, f in release.get("sequences", {}).items() if n.startswith(f"{suite}/")}
        if rows:
            parts.append(f"## {title}\n\n{_table(rows, before, mean=suite != 'clips')}")
            parts += _others(rows, peers)
    parts.append(_published(peers["published"]))
    return "\n".join(parts)


def _table(rows: dict[str, Any], before: dict[str, Any], mean: bool) -> str:
    headings = ["sequence", "frames", "ok, degraded, lost", *(c[1] for c in _COLUMNS)]
    lines = ["| " + " | ".join(headings) + " |", "|---" * len(headings) + "|"]
    for name, figures in rows.items():
        cells = [name, str(figures["frames"]), _statuses(figures)]
        cells += [_cell(figures.get(key), before.get(name, {}).get(key), *form) for key, _, *form in _COLUMNS]
        lines.append("| " + " | ".join(cells) + " |")
    if mean and len(rows) > 1:
        cells = ["mean", "", ""]
        for key, _, *form in _COLUMNS:
            known = [f[key] for f in rows.values() if f.get(key) is not None]
            cells.append(_cell(sum(known) / len(known) if key in _MEANS and known else None, None, *form))
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _statuses(figures: dict[str, Any]) -> str:
    if not figures["frames"]:
        return "failed"
    degraded, lost = (round(figures[key] * figures["frames"] / 100) for key in ("not_ok_percent", "lost_percent"))
    return f"{figures['frames'] - degraded - lost}, {degraded}, {lost}"


def _cell(now: float | None, before: float | None, factor: float, form: str) -> str:
    if now is None:
        return "–"
    text = format(factor * now, form)
    was = text if before is None else format(factor * before, form)
    return text if was == text else f"{text} ({was})"


def _others(rows: dict[str, Any], peers: dict[str, Any]) -> list[str]:
    """A table of other systems on the same frames, the best of each figure in bold; nothing if none is known."""
    lines = []
    for name, figures in rows.items():
        for key, heading, factor, form in _COLUMNS:
            known = peers.get(name, {}).get(key, {}) | {"": figures.get(key)}
            if len(known) > 1 and known[""] is not None:
                texts = {system: format(factor * value, form) for system, value in known.items()}
                best = min(texts.values(), key=float)
                cells = [f"**{t}**" if (t := texts.get(system, "–")) == best else t for system in ("", *_NAMES)]
                lines.append("| " + " | ".join([name, heading, *cells]) + " |")
    if not lines:
        return []
    head = ["| " + " | ".join(["sequence", "figure", "stream_sfm", *_NAMES.values()]) + " |", "|---" * 8 + "|"]
    text = (
        "By one evaluator, aligned in SE(3). Others ran on the lossless frames; the rendered clips and EuRoC here are "
        "JPEG."
    )
    return ["\n".join(["### Others on the same frames", "", text, "", *head, *lines]) + "\n"]


def _published(rows: list[dict[str, str]]) -> str:
    keys = ("system", "suite", "sequences", "figure", "causal", "aligned", "source")
    lines = [
        "## Published figures",
        "",
        "Of whole sequences, so no clip compares with them. No system here publishes a NEES.",
        "",
    ]
    lines += ["| " + " | ".join(keys) + " |", "|---" * len(keys) + "|"]
    lines += ["| " + " | ".join(_SUITES.get(row[key], row[key]) for key in keys) + " |" for row in rows]
    return "\n".join(lines) + "\n"
