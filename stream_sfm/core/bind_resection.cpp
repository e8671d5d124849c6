// Python's view of resection.hpp.

#include "binding.hpp"
#include "resection.hpp"
#include "tracks.hpp"

namespace binding {

void bind_resection(nb::module_& m) {
    describe_returned<Fitted>(m, R"(A motion (4, 4), its covariance (6, 6), accepted views (n,) with their χ² and degrees of freedom; the `spread` of
squared residuals; whether enough views agree and determine the motion (`ok`); squared residuals (n,), `share` of the
votes, amplitudes (j,) of shared errors and their covariance (j, j).)");
    describe_returned<Second>(m, R"(A second motion (4, 4), its covariance (6, 6), the views (n,) that agree only with it, and their odds.)");
    describe_taken<ResectionRules>(m, R"(The settings of a resection, as in `RobustRules`.)");
    describe_taken<TurnRules>(m);
    describe_taken<Wanted>(m);
    def<&fit_motion>(m, "fit_motion", R"(Return the motion of the views that agree with one near it, eqs. (22) and (23).

It starts at a motion (4, 4) and amplitudes (j,). `anneal`: use Cauchy weights first. `votes` (n,): the weight of each
view in the share. Raises LinAlgError like `linearise_views`.)",
        "views"_a, "cam_from_ref"_a, "amplitudes"_a, "votes"_a, "rules"_a, "anneal"_a);
    def<&resect>(m, "resect", R"(Return the motion of the views, whatever the start (4, 4), and a second one that others share, eqs. (20) to (23).

`amplitudes` (j,): of the shared errors at the start.
`votes` (n,) are the weights of views. If too few agree with the result from the start, the whole space of motions is
searched for the one with the largest support: each view adds its vote, reduced by the share of the gate that its
squared residual uses up, and the extent of the agreeing views in the image adds a little. Random numbers depend only on
the number of views. With a predicted motion (4, 4) the result is that of one rigid scene: if halves of the views
disagree (near and far, left and right, or upper and lower ones), the motion is sought again from theirs and from the
predicted one.)",
        "views"_a, "cam_from_ref"_a, "amplitudes"_a, "votes"_a, "rules"_a, "wanted"_a, "predicted"_a.none());
    def<&motion_of_flow>(m, "motion_of_flow", R"(Return the motion (4, 4) of tracks from the left positions (n, 2) that flow has `found` (n,), eq. (20).

`std_flow_px` is their σ in template pixels. Returns whether there is a motion, the motion, which tracks agree (n,), and
their share of the `votes` (n,) of the found ones. It starts at (4, 4); `gate` is that of squared residuals.)",
        "pinholes"_a, "tracks"_a, "votes"_a, "left_px"_a, "found"_a, "cam_from_previous"_a, "std_flow_px"_a, "gate"_a, "rules"_a);
    def<&effects_of_turn>(m, "effects_of_turn", R"(Return the effect (n, 2, 3), px per radian, of a turn of the right camera at positions (n, 2) in its image.)",
        "pinholes"_a, "right_px"_a);
    def<&views_by_turn>(m, "views_by_turn", R"(Return the effect (n, 4, e) px of unit amplitudes of a turn of the right camera on views (n, 4), eq. (36b).

The covariance of the turn is `root` (3, e) times its transpose, rad². The effect on a missing right side is zero.)",
        "pinholes"_a, "z_px"_a, "root"_a);
    def<&with_turn>(m, "with_turn", R"(Return covariances (n, 4, 4) of views (n, 4), increased by that of a turn of the right camera as in `views_by_turn`.)",
        "pinholes"_a, "z_px"_a, "cov_px"_a, "root"_a);
    def<&fit_turn>(m, "fit_turn", R"(Return the turn (3,) rad of the right camera that views show, its covariance (3, 3), and which (n,) agree, eq. (72d).

It is estimated together with the motion (4, 4), in a few steps of reweighting if a knock of σ `std_rad` may be likelier
than a `usual` turn of covariance (3, 3). Also returns χ² of the latter. The views must have no shared errors.)",
        "views"_a, "cam_from_ref"_a, "usual"_a, "rules"_a);
    describe_taken<ApparentTurnsView>(m);
    describe_taken<TurnView>(m);
    describe_taken<UsualTurnsView>(m);
    def<&weigh_turn>(m, "weigh_turn", R"(Return the log of how much likelier a turn is with a knock than without, eq. (72f), and its log-likelihoods (k,).

The latter are of usual turns that are `sizes` (k,) times as large.)",
        "usual"_a, "turn"_a, "sizes"_a);
    def<&learn_turn>(m, "learn_turn", R"(Return `measured` and `real` (3, 3) and `late` (2,) of usual turns after one that counts as usual, in their n-th frame.)",
        "usual"_a, "turn"_a, "frames"_a);
}

}  // namespace binding
