// Python's view of poses.hpp.

#include "binding.hpp"
#include "poses.hpp"
#include "products.hpp"

namespace binding {

void bind_poses(nb::module_& m) {
    describe_taken<PhysicalAxes>(m);
    def<&among>(m, "among", R"(Return which of `ids` (n,) are in `known`, which is ascending.)",
        "ids"_a, "known"_a);
    def<&times_among>(m, "times_among", R"(Return how often each of the ascending `ids` (n,) is in those of `others` (m,) that are `counted`.)",
        "ids"_a, "others"_a, "counted"_a);
    def<&union_of>(m, "union_of", R"(Return the unique values of ids (n,), which may have any order, ascending.)",
        "ids"_a);
    def<&point_motions>(m, "point_motions", R"(Return the motion of points in each of a few cameras: twists ξ̇ and their change ξ̈ per second (n, 2, 6).

A point X at the time of a pose is Exp(t ξ̇ + ½ t² ξ̈) X after t seconds. Poses (n, 4, 4) are camera from reference, at
ascending `seconds` (n,). Polynomials through the poses of the frames around each give the result; it is zero for a
single pose.)",
        "poses"_a, "seconds"_a);
    def<&errors_of_motions>(m, "errors_of_motions", R"(Return size and bend (n, 2) of the errors of `point_motions` at these times, eq. (70e).

The error of the twist in each frame is its size times that of the newest frame of many, which are one `period` apart. The twist
some time t after the frame errs by 1 + 2 t times the bend as much. Sizes have signs. Those of a single frame are zero.)",
        "seconds"_a, "period"_a);
    def<&reported_motions>(m, "reported_motions", R"(Return poses (n, 4, 4) in axes of the physical camera, covariances (n, 6, 6), and effects (n, 6, 3 + t) of errors.

`cov` (n, 6, 6), of right perturbations, is increased by that of errors that no view shows. The effects are the
perturbations by these errors, and by further ones, which are `by_terms` (n, 6, t). Eqs. (7) and (73a).)",
        "axes"_a, "poses"_a, "cov"_a, "by_terms"_a);
    def<&reported_points>(m, "reported_points", R"(Return points (n, 3) in axes of the physical camera, with covariances (n, 3, 3), eqs. (18) and (73).

They were seen from a camera (4, 4) in their frame. `std_shared` (n,), 1/m: σ of their inverse depths by an error that
all views of a point share. `cov_points` (n, 3, 3) is increased by that of errors that no view shows.)",
        "axes"_a, "points"_a, "cov_points"_a, "std_shared"_a, "frame_from_cam"_a);
    def<&pose_exp>(m, "pose_exp", R"(Return the poses (n, 4, 4) Exp(ξ) of tangents (n, 6), eq. (3).)",
        "xi"_a);
    def<&pose_log>(m, "pose_log", R"(Return the tangents (n, 6) of poses (n, 4, 4); the inverse of `pose_exp`.)",
        "poses"_a);
    def<&pose_inverse>(m, "pose_inverse", R"(Return the inverses of poses (n, 4, 4).)",
        "poses"_a);
    def<&pose_adjoint>(m, "pose_adjoint", R"(Return Ad(T) (n, 6, 6) of poses (n, 4, 4), eq. (4).)",
        "poses"_a);
    def<&rotation_vectors>(m, "rotation_vectors", R"(Return rotation vectors (n, 3) of norm ≤ π of rotation matrices (n, 3, 3).)",
        "rotations"_a);
    def<&quaternions>(m, "quaternions", R"(Return unit quaternions (n, 4) = (x, y, z, w), w ≥ 0, of rotation matrices (n, 3, 3).)",
        "rotations"_a);
    def<&orthonormalise>(m, "orthonormalise", R"(Return poses (n, 4, 4) with their approximate rotations projected onto SO(3).)",
        "poses"_a);
    def<&inverse_root>(m, "inverse_root", R"(Return R (n, n), upper triangular, with R Rᵀ = A⁻¹ of a symmetric positive definite A, of which the lower triangle is read.

A is scaled to a unit diagonal. With `repair`, a matrix that has lost definiteness to rounding gets the smallest increase
of that diagonal that restores it. Raises LinAlgError if A is not definite.)",
        "matrix"_a, "repair"_a);
    def<&large_product>(m, "_large_product", R"(Return A B (p, q) of A (p, n) and B (n, q).)", "a"_a, "b"_a);
    def<&large_gram>(m, "_large_gram", R"(Return the lower triangle of Aᵀ A (n, n).)", "a"_a);
    def<&solved_by_size>(m, "solved_by_size", R"(Return the log determinants (n,) of I + S A S, and S (I + S A S)⁻¹ S b (n, k, r), with S the diagonal of each of n sizes.

These are the evidence for errors of σ `sizes` (n, k), and their means, with `information` A (k, k) about them and r
`weighted` sums b (k, r). Raises LinAlgError if a matrix is not definite.)",
        "information"_a, "weighted"_a, "sizes"_a);
}

}  // namespace binding
