"""The preview of one frame ends where σ no longer shows shapes."""

import numpy as np

from stream_sfm.dense.mesh import Mesh, normals_of
from stream_sfm.dense.preview import near_part


def floor(relative_std_at_10_m: float, far_m: float = 100.0) -> Mesh:
    """A floor in front of the camera, whose σ grows with the square of the distance as that of stereo does."""
    z, x = np.meshgrid(np.geomspace(1, far_m, 150), np.linspace(-0.5, 0.5, 30), indexing="ij")
    vertices = np.stack([x.ravel(), np.ones(z.size), z.ravel()], axis=1).astype(np.float32)
    number = np.arange(z.size, dtype=np.int32).reshape(z.shape)
    corners = (number[:-1, :-1], number[1:, :-1], number[:-1, 1:])
    faces = np.stack([c.ravel() for c in corners], axis=1)
    distance = np.linalg.norm(vertices, axis=1)
    std_m = (relative_std_at_10_m * distance**2 / 10).astype(np.float32)
    return Mesh(vertices, faces, normals_of(vertices, faces), np.zeros((z.size, 3), np.uint8), std_m)


def test_the_cut_is_where_the_relative_sigma_is_reached() -> None:
    mesh = floor(0.005)  # 1.5 % at 30 m
    near = near_part(mesh)
    distance = np.linalg.norm(near.vertices, axis=1)
    assert 25 < distance.max() < 35
    whole = np.linalg.norm(mesh.vertices, axis=1)
    assert len(near.vertices) == (whole <= distance.max()).sum()  # nothing nearer is lost
    assert near.faces.max() < len(near.vertices)
    assert near.faces.shape[0] > 0.6 * len(mesh.faces)
    kept = mesh.vertices[whole <= distance.max()]
    assert np.array_equal(near.vertices[near.faces[7]], kept[near.faces[7]])


def test_what_is_certain_or_uncertain_throughout_stays_whole() -> None:
    for mesh in (floor(0.0005), floor(0.2), floor(0.005, far_m=5)):
        assert near_part(mesh) is mesh


def test_an_empty_mesh_stays_empty() -> None:
    empty = np.zeros((0, 3), np.float32)
    mesh = Mesh(empty, np.zeros((0, 3), np.int32), empty, np.zeros((0, 3), np.uint8), np.zeros(0, np.float32))
    assert near_part(mesh) is mesh
