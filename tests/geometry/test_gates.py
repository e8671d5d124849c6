"""The gates against SciPy's quantiles."""

import pytest
from scipy.stats import chi2

from stream_sfm.geometry.gates import chi2_gate


@pytest.mark.parametrize("dof", [2, 4])
@pytest.mark.parametrize("probability", [0.5001, 0.9, 0.999, 1 - 1e-9])
def test_gate_is_the_quantile(dof: int, probability: float) -> None:
    assert chi2_gate(dof, probability) == pytest.approx(chi2.isf(1 - probability, dof), rel=1e-9)
