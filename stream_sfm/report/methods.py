"""How a method is named and drawn in legends."""

LABELS = {
    "cross-frame": "cross-frame",
    "cross-frame-wc": "per-point WC",
    "cross-frame-cc": "per-point CC",
    "ekf": "EKF",
    "iterated-ekf": "iterated EKF",
    "ekf-cv": "constant-velocity EKF",
    "frame-to-frame": "frame-to-frame",
}


def style(name: str) -> str:
    """The CSS class of a method's lines."""
    return f"m-{name}" if name in LABELS else "m-other"


def label(name: str) -> str:
    """A method's name in legends."""
    return LABELS.get(name, name)
