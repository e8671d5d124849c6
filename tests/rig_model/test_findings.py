"""The findings of a run about its rig in sentences; errors held at zero still have a covariance."""

from dataclasses import replace

import numpy as np
import pytest

from stream_sfm.config import RigConfig
from stream_sfm.rig_model.estimate import RigEstimate
from stream_sfm.rig_model.sizes import mixture
from stream_sfm.rig_model.terms import DELAY, FOCAL, FOCUSING, READOUT, TERMS, TURNING


def found(**known: tuple[float, float]) -> RigEstimate:
    """An estimate in units, with mean and σ of timing, focal length and rates; the rest is unknown."""
    mean, std = np.zeros(len(TERMS)), np.ones(len(TERMS))
    for name in (DELAY, READOUT, FOCAL, *TURNING, FOCUSING):
        mean[TERMS.index(name)], std[TERMS.index(name)] = known.get(name.replace(" ", "_"), (0.0, 1e-4))
    return RigEstimate(mean, np.diag(std**2), 0.2, mean, np.diag(std**2), std, evidence=np.abs(mean) / std)


@pytest.mark.parametrize(
    ("known", "sentence"),
    [
        ({"delay": (8.1e-3, 2e-4)}, "the right camera is 8.10 ± 0.20 ms late"),
        ({"delay": (-2e-3, 1e-4)}, "the right camera is 2.00 ± 0.10 ms early"),
        ({"readout": (19.04e-3, 1e-3)}, "the shutters read out in 19.04 ± 1.00 ms"),
        ({"readout": (-5e-3, 2e-4)}, "the shutters read out in 5.00 ± 0.20 ms, from the bottom up"),
        ({"focal_length": (5e-3, 5e-4)}, "the focal length is 0.50 ± 0.05 % longer"),
        ({"focal_length": (-2e-3, 3e-4)}, "the focal length is 0.20 ± 0.03 % shorter"),
        ({"focusing": (2e-3, 1e-4)}, "the focal length grows by 0.200 ± 0.010 % per second"),
        (
            {"turning_y": (-4e-4, 1e-5)},
            "the right camera turns against the left one by 24.00 ± 0.60 mrad per minute",
        ),
    ],
)
def test_certain_errors_are_reported(known: dict[str, tuple[float, float]], sentence: str) -> None:
    assert found(**known).findings() == [sentence]


def test_errors_on_which_thirds_of_the_run_disagree_are_not_reported() -> None:
    """This holds however small the overall σ is; a run that is too short to have thirds reports nothing either."""
    sure = found(delay=(2e-3, 1e-5))
    assert sure.findings()
    assert replace(sure, evidence=np.full(len(TERMS), 3.0)).findings() == []
    assert replace(sure, evidence=None).findings() == []


def test_uncertain_errors_are_not_reported() -> None:
    """They are below five standard deviations; several findings are reported one by one."""
    assert found(delay=(4.9e-4, 1e-4), readout=(-4e-3, 1e-3), focal_length=(0.0, 1e-5)).findings() == []
    assert len(found(delay=(6e-3, 1e-3), readout=(0.02, 1e-3), focal_length=(4e-3, 1e-3)).findings()) == 2


def test_a_calibration_counts_as_wrong_if_that_is_more_probable() -> None:
    assert not replace(found(), p_wrong=0.5).applied and replace(found(), p_wrong=0.51).applied
    assert found(delay=(8e-3, 2e-4)).term(DELAY) == pytest.approx((8e-3, 2e-4))


@pytest.mark.parametrize("seed", range(5))
def test_errors_that_are_most_probably_zero_have_no_negative_variances(seed: int) -> None:
    """Views determine all errors to 1e-5 σ, and found none: rounding must not make a variance negative."""
    rng = np.random.default_rng(seed)
    m = len(TERMS) + 40
    size = np.r_[np.ones(len(TERMS)), np.full(40, 1e-3)]
    j = 1e2 * rng.normal(size=(3 * m, m))
    cov = np.linalg.inv(j.T @ j + np.diag(size**-2.0))
    mixed = mixture(np.zeros(m), cov, size, RigConfig())
    assert mixed.p_wrong < 1e-4  # a single error below 1e-3 of its σ, in one of twenty calibrations
    assert (np.diag(mixed.cov) >= 0).all()
    basis = rng.normal(size=(100, m))
    assert (np.einsum("ni,ij,nj->n", basis, mixed.cov, basis) >= 0).all()
