"""Estimates as bytes, to compare them exactly."""

import dataclasses

import numpy as np

import stream_sfm as sfm


def bytes_of(estimate: sfm.FrameEstimate) -> bytes:
    """All fields but the timings."""
    parts = []
    for field in dataclasses.fields(estimate):
        value = getattr(estimate, field.name)
        if field.name != "timings_ms":
            parts.append(value.tobytes() if isinstance(value, np.ndarray) else repr(value).encode())
    return b"|".join(parts)
