"""How methods are named and drawn; all functions take a name as in METHODS, or the key of report.json."""

LABELS = {
    "cross-frame": "cross-frame",
    "cross-frame-wc": "per-point WC",
    "cross-frame-cc": "per-point CC",
    "ekf": "EKF",
    "iterated-ekf": "iterated EKF",
    "ekf-cv": "constant-velocity EKF",
    "frame-to-frame": "frame-to-frame",
}
_IN_COLOUR = (
    "cross-frame",
    "ekf",
    "frame-to-frame",
    "iterated-ekf",
)  # four lines are the most that a chart shows well
_SHORT = {"ekf-cv": "const.-velocity EKF"}  # where a chart has no room


def label(name: str) -> str:
    """A method's name in tables and sentences."""
    return LABELS.get(_plain(name), name)


def short(name: str) -> str:
    """A method's name in charts."""
    return _SHORT.get(_plain(name), label(name))


def quiet(name: str) -> bool:
    """Whether a method's lines are grey."""
    return _plain(name) not in _IN_COLOUR


def style(name: str) -> str:
    """The CSS class of a method's lines."""
    return "m-other" if quiet(name) else f"m-{_plain(name)}"


def _plain(name: str) -> str:
    return name.replace("_", "-")
