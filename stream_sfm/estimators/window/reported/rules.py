"""The rules of what is reported: how long errors of views last, and how the reported pose follows the filter."""

from typing import Annotated

from ....config.section import Section, expert


class ReportedRules(Section, frozen=True, kw_only=True):
    """How long errors of views last, how much tracks differ, and how the reported pose follows the filter."""

    # Lasting errors are a property of cameras and scene, and change slowly.
    halves_memory: Annotated[float, expert("frames from which the duration of errors is learnt", 1, 1e6)] = 25.0
    # Neighbouring windows have most of their views in common.
    halves_every: Annotated[int, expert("examine halves every n-th frame once memory is full", 1, 10_000)] = 4
    halves_guess: Annotated[float, expert("weight of the guess that errors do not last, frames", 0, 1e6)] = 2.5
    halves_least: Annotated[float, expert("smallest share of the tracks that counts as a half", 0, 0.5)] = 0.125
    # Four times the gate. Views that a minimum has gated are 12 to 19 % of those of real logs, and are in the halves.
    halves_within: Annotated[float, expert("largest squared residual of a view in halves, σ²", 1, 1e9)] = 74.0
    # A body that moves in one half is not a lasting error. Gaussian errors exceed this in one frame of 10¹⁰.
    halves_most: Annotated[float, expert("cap on the squares of a frame, multiples of the mean", 1, 1e8)] = 10.0
    # On 20 rendered logs and four simulations, σ of motions over one frame needs a factor of 0.6 to 1.1 with all of
    # it, and of 0.7 to 1.4 without. The largest is in a corridor, which then has 24 frames beyond 5 σ instead of 9.
    apparent_turns: Annotated[
        float, expert("share of the variance of rotations by sliding patches, added to the window's motions", 0, 1)
    ] = 0.25
    # While rig errors are being estimated, the corrections of the path are not noise. With a late right camera, ATE
    # is a third larger than that of the filter with 1.0, and a tenth with 0.5. Over one frame, 0.3 to 1.0 are
    # equally accurate.
    most_followed: Annotated[float, expert("largest lag of the reported pose behind the filter, σ", 0, 10)] = 0.5
    # The tracks of some hundred frames: how much tracks differ is also a property of cameras and scene.
    tracks_memory: Annotated[float, expert("tracks from which the spread of noise is learnt", 1, 1e9)] = 20_000.0
    tracks_guess: Annotated[float, expert("weight of the guess that all tracks are alike, tracks", 1, 1e9)] = 300.0
    # Residuals of moving objects are not noise.
    tracks_most: Annotated[float, expert("cap on the squares of a track, multiples of the mean", 1, 1e8)] = 4.0
