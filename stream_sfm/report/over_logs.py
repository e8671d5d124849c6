"""Comparisons of several logs as one: ratios to the window with intervals over logs, on a page of their own.

A path is one sample, however long it is, so that the intervals hold for further logs of the same kind.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from markupsafe import Markup

from .. import __version__
from ..evaluation.drift import KINDS
from ..evaluation.paired import mean_ratio
from ..methods import REFERENCE, REPLAYED, key_of
from ..system.files import json_bytes, write_whole
from ..system.wording import counted
from .conclusion import decided, who_is_ahead
from .numbers import SCHEMA_VERSION
from .pages import REPORT
from .svg import Row, intervals
from .tables import Name, Table, of_method, render, text_of

WINDOW = key_of(REFERENCE)
Ratios = dict[str, dict[str, dict[str, Any]]]  # by method and kind


def numbers_over_logs(reports: Mapping[str, dict[str, Any]]) -> dict[str, Any]:
    """Return the content of report.json of several logs, by the names of their folders."""
    verdicts = {name: report["drift"]["verdict"] for name, report in reports.items()}
    by_log = {name: {} if verdict is None else verdict["ratios"] for name, verdict in verdicts.items()}
    ratios = _over(list(by_log.values()))
    return {
        "schema_version": SCHEMA_VERSION,
        "software_version": __version__,
        "complete": all(report["complete"] for report in reports.values()),
        "conclusion": _conclusion(ratios, len(reports)),
        "verdict": decided(ratios) if ratios else None,
        "table": _table(reports),
        "sigma_factor": {key: _sigma_factors(reports, key) for key in _keys(reports)},
        "logs": [
            {
                "name": name,
                "log": report["log"],
                "frames": report["frames"],
                "frames_with_ground_truth": report["frames_with_ground_truth"],
                "against": None if verdicts[name] is None else verdicts[name]["against"],
                "ratios": by_log[name],
                "conclusion": report["conclusion"],
            }
            for name, report in reports.items()
        ],
    }


def _conclusion(ratios: Ratios, logs: int) -> str:
    """Say who is ahead over all logs. What is decided against the window comes first."""
    shown_by = "This log" if logs == 1 else f"These {logs} logs"
    if not ratios:
        return f"{shown_by} cannot separate the methods: fewer than two are long enough for ratios."
    return " ".join(f"{sentence}." for sentence in who_is_ahead(decided(ratios), shown_by))


def _keys(reports: Mapping[str, dict[str, Any]]) -> list[str]:
    """Return the methods with one calibration, in order of the first log that has them."""
    keys = dict.fromkeys(key for report in reports.values() for key in report["methods"])
    return [key for key in keys if key != key_of(REPLAYED)]


def _over(of_logs: list[Ratios]) -> Ratios:
    """Return the mean ratios over logs of the methods that at least two of them have."""
    result: Ratios = {}
    for key in dict.fromkeys(key for ratios in of_logs for key in ratios):
        values = [[ratios[key][kind]["value"] for ratios in of_logs if key in ratios] for kind in KINDS]
        found = [mean_ratio(each, len(KINDS)) for each in values]
        if (both := [r for r in found if r is not None]) and len(both) == len(KINDS):
            result[key] = {
                kind: {"value": r.value, "ci95": list(r.ci95), "logs": r.logs}
                for kind, r in zip(KINDS, both, strict=True)
            }
    return result


def _table(reports: Mapping[str, dict[str, Any]]) -> list[dict[str, Any]]:
    """Return for each span of frames the mean ratios over logs."""
    lines: dict[int, list[Ratios]] = {}
    for report in reports.values():
        for line in report["drift"]["table"]:
            lines.setdefault(line["frames"], []).append(_over_window(line["methods"], report["drift"]["reference"]))
    return [{"frames": span, "methods": found} for span, each in sorted(lines.items()) if (found := _over(each))]


def _over_window(methods: Mapping[str, Mapping[str, Any]], reference: str) -> Ratios:
    """Return the ratios of one log over one span; those to its `reference` are divided by that of the window.

    Both must be against the truth, or both from halves of the tracks.
    """
    result: Ratios = {}
    for key in methods if WINDOW in methods else ():
        if key in (WINDOW, key_of(REPLAYED)):
            continue
        pairs = [[_to_reference(methods[each], each, reference, kind) for each in (key, WINDOW)] for kind in KINDS]
        if all(mine and window and (mine[1] == window[1] or reference in (key, WINDOW)) for mine, window in pairs):
            result[key] = {
                kind: {"value": mine[0] / window[0]}
                for kind, (mine, window) in zip(KINDS, pairs, strict=True)
                if mine and window
            }
    return result


def _to_reference(of: Mapping[str, Any], key: str, reference: str, kind: str) -> tuple[float, bool] | None:
    """Return the ratio of a method to the reference, and whether it is from halves; None if it is not known."""
    if key == reference:
        return 1.0, False
    ratio = of[f"{kind}_over_{reference}"]
    return None if ratio is None else (ratio["value"], of[f"{kind}_from_halves"])


def _sigma_factors(reports: Mapping[str, dict[str, Any]], key: str) -> list[float]:
    """Return the factors by which σ of the pose would have to grow, in order of their size."""
    found = [report["methods"].get(key, {}).get("sigma_factor") for report in reports.values()]
    return sorted(factor for factor in found if factor is not None)


def write_over_logs(content: dict[str, Any], folder: Path) -> None:
    """Write report.json, the `content`, and report.html of several logs to a folder. Raises OutputError."""
    write_whole(folder / REPORT[0], json_bytes(content))
    write_whole(folder / REPORT[1], render_over_logs(content).encode())


def render_over_logs(content: dict[str, Any]) -> str:
    """Render the content of report.json of several logs as HTML."""
    logs = counted(len(content["logs"]), "log")
    return render(
        "over_logs.html.j2",
        title=logs,
        n=content,
        charts=[_chart(content, kind) for kind in KINDS] if content["verdict"] else [],
        spans=[(kind, _by_span(content, kind)) for kind in KINDS],
        logs=_by_log(content),
    )


def _chart(content: dict[str, Any], kind: str) -> Markup:
    """Draw the ratio of each method with its interval over logs."""
    rows = []
    for key, of in content["verdict"]["ratios"].items():
        look, ratio = of_method(key), of[kind]
        rows.append(Row(look.name, ratio["value"], ratio["ci95"][0], ratio["ci95"][1], look.colour))
    note = f"{of_method(REFERENCE).name} is 1; the interval is over {counted(len(content['logs']), 'log')}"
    return intervals(f"{kind.capitalize()} errors over those of the window", "ratio", rows, note)


def _by_span(content: dict[str, Any], kind: str) -> Table:
    """Return the ratios of a kind of error, over all spans and over each, and the factors of σ."""
    spans, sigma = content["table"], content["sigma_factor"]
    ratios = content["verdict"]["ratios"] if content["verdict"] else {}
    rows = []
    for key, factors in sigma.items():
        look = of_method(key)
        cells = [ratios.get(key, {}).get(kind), *(line["methods"].get(key, {}).get(kind) for line in spans)]
        texts = [text_of(1) if key == WINDOW else _cell(cell, len(content["logs"])) for cell in cells]
        between = f"{factors[0]:.2g} to {factors[-1]:.2g}" if factors else text_of(None)
        rows.append((Name(look.name, "", look.colour), [(text, "") for text in (*texts, between)]))
    headings = [
        ("all spans", "up to a 20th of the log"),
        *((counted(line["frames"], "frame"), "") for line in spans),
    ]
    return Table([*headings, ("σ would have to grow by", "single logs")], rows)


def _cell(ratio: dict[str, Any] | None, logs: int) -> str:
    """Return a ratio with its interval, and the number of its logs if it is not that of all."""
    text = text_of(ratio)
    if ratio is None or ratio["logs"] == logs:
        return text
    return text + Markup("<small>{}</small>").format(counted(ratio["logs"], "log"))


def _by_log(content: dict[str, Any]) -> Table:
    """Return the ratio of the position error of each method in each log, with its interval within the log."""
    keys = [key for key in content["sigma_factor"] if key != WINDOW]
    rows = []
    for log in content["logs"]:
        source = {"truth": "against the truth", "halves": "from halves of the tracks"}.get(log["against"], "too short")
        name = Name(log["name"], f"{counted(log['frames'], 'frame')}, {source}", href=f"{log['name']}/{REPORT[1]}")
        rows.append((name, [(text_of(log["ratios"].get(key, {}).get(KINDS[0])), "") for key in keys]))
    return Table([(of_method(key).name, "") for key in keys], rows)
