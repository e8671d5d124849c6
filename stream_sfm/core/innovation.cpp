// A motion by images beside the one that samples predict: how far apart they are, and how likely that is, eq. (85).

#include "inertial.hpp"
#include "poses.hpp"
#include "vectors3.hpp"

namespace core {
namespace {

// xᵀ A⁻¹ x of rows and columns of a covariance (n, n), and log |A|; `solved`: R Rᵀ x with R Rᵀ = A⁻¹.
double squared(Rows cov, std::size_t n, const double* x, double& log_det, double* solved) {
    Array<double, 2> root = inverse_root_of(cov, n, true);
    double sum = 0;
    log_det = 0;
    std::fill(solved, solved + n, 0.0);
    for (std::size_t k = 0; k < n; k++) {
        double whitened = 0;
        for (std::size_t i = 0; i <= k; i++) whitened += root[i][k] * x[i];
        for (std::size_t i = 0; i <= k; i++) solved[i] += root[i][k] * whitened;
        sum += whitened * whitened;
        log_det -= 2 * std::log(root[k][k]);
    }
    return sum;
}

}  // namespace

Innovation innovation(Matrix expected, Matrix cov_expected, Matrix cam_from_previous, Matrix cov, double std_slide_rad) {
    for (Matrix pose : {expected, cam_from_previous}) require_shape(pose, {4, 4}, "a pose");
    for (Matrix of : {cov_expected, cov}) require_shape(of, {6, 6}, "a covariance");
    Innovation out;
    Array<double, 3> motion = pose_inverse({cam_from_previous.data, {1, 4, 4}}), apart = pose_inverse({expected.data, {1, 4, 4}});
    double by[16];
    multiply<4, 4, 4>(apart[0], motion[0], by);
    std::copy_n(pose_log({by, {1, 4, 4}})[0], 6, out.apart.data.get());
    std::copy_n(pose_log(motion)[0], 6, out.motion.data.get());
    Vec turned = log_so3(rotation_in(expected.data));
    out.turned_rad = std::sqrt(turned.x[0] * turned.x[0] + turned.x[1] * turned.x[1] + turned.x[2] * turned.x[2]);
    for (std::size_t i = 0; i < 36; i++) out.cov.data[i] = cov_expected.data[i] + cov.data[i];
    for (std::size_t i = 3; i < 6; i++) out.cov[i][i] += std_slide_rad * std_slide_rad;
    return out;
}

WeighedInnovation weigh_innovation(Vector apart, Matrix cov, Vector twist) {
    require_shape(apart, {6}, "apart");
    require_shape(cov, {6, 6}, "cov");
    require_shape(twist, {6}, "twist");
    WeighedInnovation out;
    double log_det, solved[6], per_second[6];
    out.distance2 = squared({cov.data, 6}, 6, apart.data, log_det, solved);
    for (std::size_t i = 0; i < 6; i++) per_second[i] = 1e-9 - twist.data[i];  // not zero
    double of_apart = std::inner_product(per_second, per_second + 6, solved, 0.0);
    out.var_s2 = 1 / squared({cov.data, 6}, 6, per_second, log_det, solved);
    out.late_s = out.var_s2 * of_apart;
    for (std::size_t part = 0; part < 2; part++) {  // rotation, then translation
        std::size_t at = part ? 0 : 3;
        double distance2 = squared({cov.data + 7 * at, 6}, 3, apart.data + at, log_det, solved);
        out.log_likelihoods.data[part] = -0.5 * (distance2 + log_det);
    }
    return out;
}

}  // namespace core
