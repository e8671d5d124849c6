"""Rigid motions are a group; Exp and Log are inverse; the adjoint and the perturbation side are as documented."""

import numpy as np
import pytest

from stream_sfm.geometry import se3


@pytest.fixture(autouse=True)
def _same_numbers_in_any_order():
    global RNG
    RNG = np.random.default_rng(7)


def tangents(scale: float) -> np.ndarray:
    return RNG.normal(size=(200, 6)) * scale


@pytest.mark.parametrize("scale", [1e-12, 1e-7, 1e-4, 1e-2, 0.8])
def test_log_inverts_exp_also_near_identity(scale):
    xi = tangents(scale)
    assert np.abs(se3.log(se3.exp(xi)) - xi).max() < 1e-14 + 1e-13 * scale


def test_exp_inverts_log_near_half_turn():
    axis = RNG.normal(size=(200, 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    rotation = se3.exp_so3(axis * (np.pi - RNG.uniform(0, 1e-6, (200, 1))))
    assert np.abs(se3.exp_so3(se3.log_so3(rotation)) - rotation).max() < 1e-12


def test_group_axioms():
    a, b, c = (se3.exp(tangents(0.7)) for _ in range(3))
    assert np.allclose((a @ b) @ c, a @ (b @ c), atol=1e-12)
    assert np.allclose(a @ se3.inverse(a), np.eye(4), atol=1e-14)
    assert np.allclose(a[:, :3, :3] @ np.swapaxes(a[:, :3, :3], 1, 2), np.eye(3), atol=1e-14)
    assert np.allclose(np.linalg.det(a[:, :3, :3]), 1, atol=1e-14)


def test_adjoint_moves_a_perturbation_to_the_other_side():
    pose, xi = se3.exp(tangents(0.7)), tangents(0.3)
    left = se3.exp((se3.adjoint(pose) @ xi[..., None])[..., 0]) @ pose
    assert np.allclose(left, pose @ se3.exp(xi), atol=1e-12)


def test_the_jacobian_of_log_is_numerical():
    for xi in tangents(0.3)[:20]:
        steps = 1e-6 * np.eye(6)
        numerical = [(se3.log(se3.exp(xi) @ se3.exp(d)) - se3.log(se3.exp(xi) @ se3.exp(-d))) / 2e-6 for d in steps]
        assert np.allclose(se3.log_jacobian(xi), np.transpose(numerical), atol=2e-3 * max(1, np.linalg.norm(xi)))


def test_transform_composes_and_names_cancel():
    a_from_b, b_from_c = se3.exp(tangents(0.7)[0]), se3.exp(tangents(0.7)[0])
    points_in_c = RNG.normal(size=(50, 3))
    both = se3.transform(a_from_b, se3.transform(b_from_c, points_in_c))
    assert np.allclose(both, se3.transform(a_from_b @ b_from_c, points_in_c), atol=1e-13)


def test_quaternions_round_trip_in_every_quadrant():
    rotation = se3.exp_so3(RNG.normal(size=(500, 3)) * 2)
    quat = se3.quat_xyzw_from_matrix(rotation)
    assert np.allclose(np.linalg.norm(quat, axis=1), 1, atol=1e-15)
    assert (quat[:, 3] >= 0).all()
    assert np.allclose(se3.matrix_from_quat_xyzw(quat), rotation, atol=1e-14)
    assert np.allclose(se3.matrix_from_quat_xyzw([0, 0, np.sqrt(0.5), np.sqrt(0.5)]) @ [1, 0, 0], [0, 1, 0])


def test_orthonormalise_repairs_a_rotation():
    pose = se3.exp(tangents(0.7))
    damaged = pose.copy()
    damaged[:, :3, :3] += RNG.normal(size=(200, 3, 3)) * 1e-6
    repaired = se3.orthonormalise(damaged)
    assert np.abs(repaired[:, :3, :3] @ np.swapaxes(repaired[:, :3, :3], 1, 2) - np.eye(3)).max() < 1e-14
    assert np.abs(repaired - pose).max() < 1e-5  # the damage was 1e-6
