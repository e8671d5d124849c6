"""The error of the calibration over the image, as a picture: what the disparity is off by in each part, with its σ."""

import numpy as np
from markupsafe import Markup

from .records import CalibrationError
from .svg import WIDTH

_CELL_HEIGHT = 40
_LEAST_SCALE_PX = 0.1  # of the strongest colour: less than that is no error worth colour


def picture(calibration: CalibrationError | None) -> Markup:
    """The left image in cells, coloured by sign and size of the error; empty where nothing is known."""
    if calibration is None:
        return Markup("")
    rows, columns = calibration.disparity_px.shape
    strongest_px = max(float(np.abs(calibration.disparity_px).max()), _LEAST_SCALE_PX)
    w, h = 2 * WIDTH / columns, _CELL_HEIGHT
    cells = []
    for row in range(rows):
        for column in range(columns):
            error_px, std_px = calibration.disparity_px[row, column], calibration.std_px[row, column]
            sign = "more" if error_px > 0 else "less"
            x, y = column * w, row * h
            text = f"{error_px:+.2f} ± {std_px:.2f}".replace("-", "−")
            cells.append(
                f'<rect class="f-{sign}" x="{x:.1f}" y="{y}" width="{w:.1f}" height="{h}" '
                f'style="fill-opacity:{0.75 * abs(error_px) / strongest_px:.2f}"/>'
                f'<text class="tick mid figure" x="{x + w / 2:.1f}" y="{y + h / 2 + 4:.0f}">{text}</text>'
            )
    return Markup(
        '<figure class="wide"><figcaption><b>Error of the disparity</b> '
        "<span>of the given calibration, over the left image, px</span></figcaption>"
        '<svg viewBox="0 0 {} {}" role="img">{}</svg></figure>'
    ).format(2 * WIDTH, rows * h, Markup("".join(cells)))
