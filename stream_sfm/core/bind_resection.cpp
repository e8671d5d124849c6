// Python's view of resection.hpp.

#include "binding.hpp"
#include "resection.hpp"
#include "tracks.hpp"

namespace binding {

void bind_resection(nb::module_& m) {
    describe_returned<Fitted>(m, R"(A motion (4, 4), its covariance (6, 6), accepted views (n,), and of these χ² and degrees of freedom; the `spread` of
squared residuals; whether enough views agree and determine the motion (`ok`); squared residuals (n,), `share` of the
votes, amplitudes (j,) of shared errors and their covariance (j, j).)");
    describe_returned<Second>(m, R"(A second motion (4, 4), its covariance (6, 6), the views (n,) that agree with it only, and their odds.)");
    describe_taken<ResectionRules>(m, R"(The settings of a resection, as in `RobustConfig`.)");
    describe_taken<TurnRules>(m, R"(The σ of a knock about each axis, and the most steps of reweighting.)");
    describe_taken<Wanted>(m, R"(Whether a second motion is looked for; whether most views agree with the start already, and whether it has been
decided that no other motion than that is looked for; whether all motions are searched in any case.)");
    def<&fit_motion>(m, "fit_motion", R"(Return the motion of the views that agree with one near it, eqs. (22) and (23).

Start: motion (4, 4) and amplitudes (j,). `anneal`: with Cauchy weights first. `votes` (n,): how much each view
counts in the share. Raises LinAlgError as `linearise_views`.)",
        "views"_a, "cam_from_ref"_a, "amplitudes"_a, "votes"_a, "rules"_a, "anneal"_a);
    def<&resect>(m, "resect", R"(Return the motion of the views, whatever the start (4, 4), and what others agree on, eqs. (20) to (23).

With `votes` (n,). Where too few agree with what a start led to, the whole space of motions is searched, for the one
with the largest support: each view gives its vote, less the share of the gate that its squared residual uses up;
the extent that the agreeing views have in the image adds a little. Samples depend on the number of views only.
With a predicted motion (4, 4) it is that of one rigid scene: where halves of the views disagree, near and far, left
and right or upper and lower ones, the motion is sought again from theirs and from the predicted one.)",
        "views"_a, "cam_from_ref"_a, "votes"_a, "rules"_a, "wanted"_a, "predicted"_a.none());
    def<&motion_of_flow>(m, "motion_of_flow", R"(Return the motion (4, 4) of tracks by left positions (n, 2), known to σ, that flow has `found` (n,), eq. (20).

σ in pixels of the templates. Returns whether there is one, the motion, which tracks agree (n,), and their share of
the `votes` (n,) of what was found. Start (4, 4); `gate` of squared residuals.)",
        "pinholes"_a, "tracks"_a, "votes"_a, "left_px"_a, "found"_a, "cam_from_previous"_a, "std_flow_px"_a, "gate"_a, "rules"_a);
    def<&effects_of_turn>(m, "effects_of_turn", R"(Return what a turn of the right camera does at positions (n, 2) in its image: (n, 2, 3) px per radian.)",
        "pinholes"_a, "right_px"_a);
    def<&views_by_turn>(m, "views_by_turn", R"(Return what amplitudes of a turn of the right camera do to views (n, 4): (n, 4, e) px, eq. (36b).

Its covariance is `root` (3, e) times its transpose, rad². A missing right side has zeros.)",
        "pinholes"_a, "z_px"_a, "root"_a);
    def<&with_turn>(m, "with_turn", R"(Return covariances (n, 4, 4) of views (n, 4) with that of a turn of the right camera, as of `views_by_turn`.)",
        "pinholes"_a, "z_px"_a, "cov_px"_a, "root"_a);
    def<&fit_turn>(m, "fit_turn", R"(Return the turn of the right camera (3,) rad that views show, and which (n,) agree, eq. (72d).

By a few steps of reweighting, together with the motion (4, 4). And by how much likelier it is a knock of
σ `std_rad` than a `usual` one, of covariance (3, 3): a logarithm, eq. (72f); and χ² of the latter. The views
have no shared errors.)",
        "views"_a, "cam_from_ref"_a, "usual"_a, "rules"_a);
}

}  // namespace binding
