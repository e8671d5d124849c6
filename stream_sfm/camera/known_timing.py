"""What is known about when the images of a pair are exposed, beside their stamps."""

from dataclasses import dataclass, fields

import numpy as np

from ..errors import ConfigError
from ..geometry import Array


@dataclass(frozen=True, slots=True)
class KnownTiming:
    """Delay of the right camera, and time in which both shutters read out an image from the top down; each with its σ.

    Seconds. Raises ConfigError for values that are not finite, and for a σ that is not positive.
    """

    delay_s: float
    std_delay_s: float
    readout_s: float
    std_readout_s: float

    def __post_init__(self) -> None:
        for name in (field.name for field in fields(self)):
            value = getattr(self, name)
            if not -1 <= value <= 1:  # larger ones are milliseconds given as seconds
                raise ConfigError(f"{name} is {value!r}: give seconds, at most 1")
            if name.startswith("std") and value <= 0:
                raise ConfigError(f"{name} is {value!r}: give the σ of what is known, above 0")

    @property
    def mean(self) -> Array:
        """Delay and readout (2,)."""
        return np.array([self.delay_s, self.readout_s])

    @property
    def std(self) -> Array:
        """Their σ (2,)."""
        return np.array([self.std_delay_s, self.std_readout_s])
