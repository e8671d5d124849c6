"""Checks whether both images show everything twice: a reflection in a pane, crosstalk, or a bad cable that echoes.

An image x plus a copy of itself, c times as strong and displaced by d, has the spectrum X·(1 + c·exp(−i ω·d)). Its
cepstrum, the inverse transform of the logarithm of its power, is that of x, which decays within some pixels, plus c at
d and −c²/2 at 2d. Repetitive scenes, such as tiles or windows, have a positive value at 2d as well, from the tile after
the next one. An echo has the same d in both cameras and keeps it while the view changes. So the cepstra of both images
are compared, and those of some frames averaged.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from ..config.image_rules import EchoRules
from ..record import changed, record
from .prepared import Image

Cepstrum = NDArray[np.float32]


@record
class EchoCheck:
    """The evidence so far.

    `cepstra` (2 r + 1, 4 r + 1): of the latest examined frames; `waited`: frames since the last of these; `at_px`
    (x, y): the displacement of the copy, None if there is none.
    """

    cepstra: tuple[Cepstrum, ...] = ()
    waited: int = 0
    at_px: tuple[int, int] | None = None
    rules: EchoRules = EchoRules()

    @property
    def problem(self) -> str:
        """The problem that both images show everything twice, or an empty string."""
        if self.at_px is None:
            return ""
        x, y = self.at_px
        return (
            f"both images show everything twice, displaced by ({x}, {y}) px: is there a pane before the cameras, or a "
            "bad cable?"
        )

    def after(self, left: Image, right: Image) -> "EchoCheck":
        """Return the check after a frame, from the centres of its raw images (h, w)."""
        rules = self.rules
        if len(self.cepstra) >= rules.remembered and self.waited + 1 < rules.every:
            return changed(self, waited=self.waited + 1)
        left, right = _middle(left, rules), _middle(right, rules)
        if min(left.shape) < 4 * rules.largest_px or left.shape != right.shape:
            return self
        shown = np.minimum(_cepstrum(left, rules), _cepstrum(right, rules))
        cepstra = (*self.cepstra, shown)[-rules.remembered :]
        return changed(self, cepstra=cepstra, waited=0, at_px=_echo(np.mean(cepstra, axis=0), rules))


def _middle(image: Image, rules: EchoRules) -> Image:
    """Return the centre of an image (h, w), at most `middle_px` wide and high, with even sides."""
    h, w = (min(n, rules.middle_px) // 2 * 2 for n in image.shape)
    y, x = (image.shape[0] - h) // 2, (image.shape[1] - w) // 2
    return image[y : y + h, x : x + w]


def _cepstrum(image: Image, rules: EchoRules) -> Cepstrum:
    """Return the cepstrum of an image (h, w) for y from 0 to 2 r and x from −2 r to 2 r."""
    grey = image.astype(np.float32)
    grey -= cv2.GaussianBlur(grey, (0, 0), rules.blur_px)
    grey *= cv2.createHanningWindow(image.shape[::-1], cv2.CV_32F)
    spectrum = cv2.dft(grey, flags=cv2.DFT_COMPLEX_OUTPUT)
    power = spectrum[..., 0] ** 2 + spectrum[..., 1] ** 2  # a sum over the last axis takes thirty times as long
    log_power = np.log(power + max(rules.floor * float(power.mean()), 1e-6))
    # it is even, so its transform is real and its own inverse
    whole = cv2.dft(log_power, flags=cv2.DFT_SCALE | cv2.DFT_COMPLEX_OUTPUT)[..., 0]
    far = 2 * rules.largest_px
    rows = whole[: far + 1]
    return np.asarray(np.hstack([rows[:, -far:], rows[:, : far + 1]]), np.float32)


def _echo(cepstrum: Cepstrum, rules: EchoRules) -> tuple[int, int] | None:
    """Return the displacement (x, y) of the copy that a cepstrum shows, or None."""
    r = rules.largest_px
    near = np.ascontiguousarray(cepstrum[: r + 1, r : 3 * r + 1])
    above = near - cv2.medianBlur(near, 5)  # OpenCV has no wider filter for floats
    y, x = np.mgrid[: r + 1, -r : r + 1]
    twice = cepstrum[2 * y, 2 * x + 2 * r]
    above[(x * x + y * y < rules.least_px**2) | ((y == 0) & (x < 0)) | (twice > 0)] = 0
    best = int(np.argmax(above))
    return (int(x.flat[best]), int(y.flat[best])) if above.flat[best] > rules.strength else None
