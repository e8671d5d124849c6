"""The observations of a run on disk, so that methods can read them again after the whole run.

They take some 100 kB per frame in a file without a name, which the system removes however the run ends.
"""

import pickle
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import IO

from ..errors import OutputError
from ..frontend.learnt.template_errors import TemplateErrors
from ..pipeline.observer import Observed, Observer
from ..record import changed
from ..rig_model.estimate import RigEstimate
from ..rig_model.model import RigModel
from ..types import FrameEstimate, RigChange
from .lane import Lane


class StoredObservations:
    """A check of a run that stores the observations of each frame, and the rig estimate of the `lane`.

    Iterating gives the frames as observed; `calibrated` gives them as with an exact calibration.
    """

    def __init__(self, lane: Lane) -> None:
        self._lane = lane
        self._file: IO[bytes] = tempfile.TemporaryFile(prefix="stream-sfm-")  # noqa: SIM115 until `close`
        self._model: RigModel | None = None  # the same in all frames
        self._newest_id = -1
        self._frames = 0
        self.changes: list[RigChange] = []  # changes of the rig, such as by a knock
        # (first frame, final estimate, its stamp): one more each time that the right camera is knocked
        self._found: list[tuple[int, RigEstimate | None, int]] = []

    def __len__(self) -> int:
        return self._frames

    def add(self, observed: Observed, estimates: Mapping[str, FrameEstimate]) -> None:
        """Store the next frame. Raises OutputError if the disk is full."""
        seen = observed.observations
        if not self._found or (seen.rig is not None and seen.rig.change is not None):
            self._found.append((seen.frame_index, None, 0))
        if seen.rig is not None and seen.rig.change is not None:
            self.changes.append(seen.rig.change)
        self._found[-1] = self._found[-1][0], self._lane.rig, seen.stamp_ns
        new = observed.errors.begun > self._newest_id
        ids, stds_px = observed.errors.begun[new], observed.errors.stds_px[new]
        self._newest_id = int(ids.max(initial=self._newest_id))
        if seen.rig is not None:
            self._model = seen.rig.model
            seen = replace(seen, rig=replace(seen.rig, model=None))  # type: ignore[arg-type]
        known = observed.errors
        errors = TemplateErrors(begun=ids, stds_px=stds_px, least_px=known.least_px, rules=known.rules)
        kept = changed(observed, observations=seen, errors=errors)
        try:
            pickle.dump(kept, self._file, protocol=pickle.HIGHEST_PROTOCOL)
        except OSError as error:
            raise OutputError(
                f"observations of {self._frames} frames fill {tempfile.gettempdir()}: {error.strerror}; name another "
                "folder for temporary files in the environment variable TMPDIR"
            ) from None
        self._frames += 1

    def __iter__(self) -> Iterator[Observed]:
        """Yield the frames as observed; only one iteration at a time."""
        self._file.seek(0)
        errors: TemplateErrors | None = None
        for _ in range(self._frames):
            observed: Observed = pickle.load(self._file)
            seen = observed.observations
            errors = observed.errors if errors is None else errors.joined(observed.errors)
            if seen.rig is not None:
                seen = replace(seen, rig=replace(seen.rig, model=self._model))  # type: ignore[arg-type]
            yield changed(observed, observations=seen, errors=errors)

    def calibrated(self, observer: Observer) -> Iterator[Observed]:
        """Yield the frames without the rig errors, as known at the end."""
        found = iter(self._found)
        _, errors, known_ns = next(found)
        coming = next(found, None)
        for observed in self:
            seen = observed.observations
            if coming is not None and seen.frame_index == coming[0]:
                (_, errors, known_ns), coming = coming, next(found, None)
            if errors is not None:
                age_s = max(0.0, errors.age_s - (known_ns - seen.stamp_ns) / 1e9)  # for errors that grow
                yield observer.calibrated(observed, changed(errors, age_s=age_s))
            else:
                yield observer.calibrated(observed, None)

    def close(self) -> None:
        """Remove the file."""
        self._file.close()
