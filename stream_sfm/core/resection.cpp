// Robust resection: a fit near the start, the global search if too few agree, the motion that the other views share, and that
// of one rigid scene if a body and the background agree with a motion between theirs.

#include "resection.hpp"
#include "poses.hpp"
#include "tracks.hpp"

namespace core {
namespace {

// A near body and a far background may agree with one motion, each view within its noise, although all together they do not.
// Halves of the views show this: in a static scene near and far, left and right, upper and lower ones give the same motion.
enum : std::size_t { LEAST = 16 };  // views; fewer are not enough for two halves

class Resection {
   public:
    Resection(const PointViews& views, Vector amplitudes, Vector votes, const ResectionRules& rules, const Wanted& wanted)
        : views(views), amplitudes(amplitudes), votes(votes), rules(rules), wanted(wanted), n(views.points.shape[0]) {}

    Fitted fit(Matrix start, Vector amplitudes, bool anneal) const {
        return fit_motion(views, start, amplitudes, votes, rules, anneal);
    }

    // The motion that most views agree with, from a start, without annealing if the start is close.
    Fitted first(Matrix start) const {
        if (wanted.start_is_close) {
            Fitted found = fit(start, amplitudes, false);
            if (found.ok && (wanted.start_is_decided || nearly_all_agree(found))) return found;
        }
        Fitted found = fit(start, amplitudes, true);
        if (found.share >= rules.calm_share && !wanted.search) return found;
        // no annealing: even small weights of many views that move together would lead away from the result
        Array<double, 2> searched = search_motion(views, start, votes, rules, 0);
        Fitted other = fit(searched, amplitudes, false);
        return other.ok && support(other) > support(found) ? std::move(other) : std::move(found);
    }

    // The better one of a motion and the fit that starts at the `predicted` motion.
    //
    // Far points agree with any translation that a rotation compensates. So if flow has followed a few near points of a body, all
    // far points may agree with their motion, each within its gate. The votes and the shared errors decide together.
    Fitted better(Fitted found, Matrix predicted) const {
        Fitted other = fit(predicted, amplitudes, false);
        bool same = found.ok && other.ok && are_one(found.cam_from_ref, found.cov_pose, other.cam_from_ref, other.cov_pose);
        return other.ok && !same && (!found.ok || support(other) > support(found)) ? std::move(other) : std::move(found);
    }

    // The motion of other views, which views agree with only one of the two motions, and the evidence of these, (23c).
    struct Other {
        Fitted motion;
        Array<bool, 1> only_other, only_found;
        double odds;
    };

    // The motion that views which clearly disagree with the one found have in common, if there is one.
    //
    // Many views may agree with both motions; they do not show which of the two is that of the background. A view has three
    // coordinates of its own; correspondingly more views are required if they also determine shared errors.
    std::optional<Other> other_than(const Fitted& found) const {
        std::vector<std::size_t> off = rows_where(n, [&](std::size_t i) { return is_beyond(found, i); });
        if (!wanted.second || !found.ok || off.size() < rules.second_views) return std::nullopt;
        Other other{fit(search_among(off, found), found.amplitudes, false), Array<bool, 1>(n), Array<bool, 1>(n), 0.0};
        const Fitted& motion = other.motion;
        std::size_t agree = 0;
        for (std::size_t i : off) agree += other.only_other.data[i] = motion.accepted.data[i];
        double determined = static_cast<double>(motion.amplitudes.shape[0]);
        for (std::size_t k = 0; k < motion.amplitudes.shape[0]; k++) determined -= motion.cov_amplitudes[k][k];
        if (!motion.ok || static_cast<double>(agree) < static_cast<double>(rules.second_views) + determined / 3) return std::nullopt;
        for (std::size_t i = 0; i < n; i++) other.only_found.data[i] = found.accepted.data[i] && is_beyond(motion, i);
        other.odds = evidence_of(other.only_other) / std::max(evidence_of(other.only_found), 1e-12);
        return other;
    }

    // Two motions; exchanged if the second is clearly better.
    Resected both(Fitted found, Other other) const {
        if (other.odds <= 1 / rules.ambiguous_share)
            return {std::move(found), Second{std::move(other.motion.cam_from_ref), std::move(other.motion.cov_pose), std::move(other.only_other), other.odds}};
        Second first{std::move(found.cam_from_ref), std::move(found.cov_pose), std::move(other.only_found), 1 / other.odds};
        return {std::move(other.motion), std::move(first)};
    }

    // The motion with that of the clearly disagreeing views, if they have one.
    Resected with_second(Fitted found) const {
        std::optional<Other> other = other_than(found);
        if (!other) return {std::move(found), std::nullopt};
        return both(std::move(found), std::move(*other));
    }

    // The motion of one rigid scene: if halves of the views disagree, it is sought again from the motion of each half, and from
    // the predicted one. Of several results that reject views which the first one accepted, the one with most evidence is used.
    Resected rigid(Resected first, Matrix predicted) const {
        if (!first.found.ok) return first;
        Halves halves = halves_of(first.found);
        Resected best{Fitted(0, 0), std::nullopt};
        Array<bool, 1> without(0);
        double most = 0, odds = 0;
        for (std::size_t k = 0; halves.apart >= rules.halves_apart && k <= halves.motions.shape[0]; k++) {
            Matrix start = k ? Matrix{halves.motions[k - 1], {4, 4}} : predicted;
            Fitted other = fit(start, first.found.amplitudes, false);
            Array<bool, 1> left_out(n);
            std::size_t count = 0;
            for (std::size_t i = 0; i < n; i++) count += left_out.data[i] = first.found.accepted.data[i] && is_beyond(other, i);
            double says = evidence_of(other.accepted), share = evidence_of(left_out) / says;
            if (!other.ok || count < rules.second_views || says <= most || halves_of(other).apart >= rules.halves_apart || share > rules.max_odds) continue;
            best.found = std::move(other);
            without = std::move(left_out);
            most = says, odds = share;
        }
        if (most == 0) return first;
        // the first motion is between those of two sets, and that of neither
        std::optional<Other> other = other_than(best.found);
        if (other && halves_of(other->motion).apart < rules.halves_apart) return both(std::move(best.found), std::move(*other));
        Fitted alone = fit_alone(rows_where(n, [&](std::size_t i) { return without.data[i]; }), std::move(first.found));
        best.second = Second{std::move(alone.cam_from_ref), std::move(alone.cov_pose), std::move(without), odds};
        return best;
    }

   private:
    // Whether two motions agree within their covariances, so that it does not matter which one is right.
    bool are_one(Matrix motion, Matrix cov, Matrix other, Matrix cov_other) const {
        Array<double, 3> back = pose_inverse({other.data, {1, 4, 4}}), apart(1, 4, 4);
        multiply<4, 4, 4>(motion.data, back[0], apart[0]);
        Array<double, 2> xi = pose_log(apart);
        std::vector<double> both(36), x(xi[0], xi[0] + 6);
        for (std::size_t i = 0; i < 36; i++) both[i] = cov.data[i] + cov_other.data[i];
        solve_damped(both, x.data(), 6);
        double distance = 0;
        for (std::size_t i = 0; i < 6; i++) distance += xi[0][i] * x[i];
        return distance < rules.halves_apart;
    }

    Halves halves_of(const Fitted& motion) const {
        if (std::count(motion.accepted.data.get(), motion.accepted.data.get() + n, true) < static_cast<std::ptrdiff_t>(LEAST))
            return {0.0, Array<double, 3>(0, 4, 4)};
        return motions_of_halves(views, motion.cam_from_ref, motion.amplitudes, motion.accepted, rules.shared_noise);
    }

    // Whether nearly all views agree with a motion, with noise as large as their median residual indicates.
    bool nearly_all_agree(const Fitted& found) const {
        double agree = 0, all = 0, width = std::min(found.spread, rules.calm_spread);
        for (std::size_t i = 0; i < n; i++) {
            all += votes.data[i];
            if (found.squared_residuals.data[i] < width * views.gate.data[i]) agree += votes.data[i];
        }
        return agree >= rules.calm_share * all;
    }

    // The support of a motion by the views, less the squared amplitudes of shared errors, which cost votes as residuals do.
    double support(const Fitted& of) const {
        double squares = 0, most = 0, gate = 0;
        for (std::size_t k = 0; k < of.amplitudes.shape[0]; k++) squares += of.amplitudes.data[k] * of.amplitudes.data[k];
        for (std::size_t i = 0; i < n; i++) most = std::max(most, votes.data[i]), gate = std::max(gate, views.gate.data[i]);
        return motion_support(views, of.cam_from_ref, of.amplitudes, votes, rules) - most * squares / gate;
    }

    bool is_beyond(const Fitted& of, std::size_t i) const { return of.squared_residuals.data[i] > rules.beyond_gates * views.gate.data[i]; }

    // Some of the views without the errors that all share, which a motion has found.
    SelectedViews selected(const std::vector<std::size_t>& rows, const Fitted& found) const {
        SelectedViews seen(views, rows);
        std::size_t amplitudes = found.amplitudes.shape[0];
        for (std::size_t i = 0; i < 4 * rows.size(); i++)
            for (std::size_t k = 0; k < amplitudes; k++) seen.z.data[i] -= seen.shared.data[i * amplitudes + k] * found.amplitudes.data[k];
        seen.shared = Array<double, 3>(rows.size(), 4, 0);
        return seen;
    }

    // The motion of these views by themselves, near a motion that they agree with; this one, if they do not determine one.
    Fitted fit_alone(const std::vector<std::size_t>& rows, Fitted near) const {
        SelectedViews seen = selected(rows, near);
        Fitted alone = fit_motion(seen.views(), near.cam_from_ref, Array<double, 1>(0), rows_of(votes, rows), rules, false);
        return alone.ok ? std::move(alone) : std::move(near);
    }

    // The motion that most of these views agree with.
    Array<double, 2> search_among(const std::vector<std::size_t>& rows, const Fitted& found) const {
        SelectedViews seen = selected(rows, found);
        return search_motion(seen.views(), found.cam_from_ref, rows_of(votes, rows), rules, rules.second_views);
    }

    double evidence_of(const Array<bool, 1>& rows) const {
        Array<double, 1> weights(n);
        for (std::size_t i = 0; i < n; i++) weights.data[i] = rows.data[i] ? votes.data[i] : 0.0;
        return evidence(views.projection, views.z_px, weights, rules);
    }

    const PointViews& views;
    Vector amplitudes;  // of the shared errors, from which the first motion is sought
    Vector votes;
    const ResectionRules& rules;
    const Wanted& wanted;
    std::size_t n;
};

}  // namespace

Resected resect(const PointViews& views, Matrix start, Vector amplitudes, Vector votes, const ResectionRules& rules,
                const Wanted& wanted, std::optional<Matrix> predicted) {
    require_shape(amplitudes, {views.shared.shape[2]}, "amplitudes");
    Resection resection(views, amplitudes, votes, rules, wanted);
    if (!predicted) return resection.with_second(resection.first(start));
    require_shape(*predicted, {4, 4}, "predicted");
    Resected found = resection.with_second(resection.better(resection.first(start), *predicted));
    return resection.rigid(std::move(found), *predicted);
}

// The motion of tracks from the left positions at which flow has found some of them.
FlowMotion motion_of_flow(const Pinholes& pinholes, const TrackTable& tracks, Vector votes, Matrix at, Flags found,
                          Matrix start, double std_flow, double gate, const ResectionRules& rules) {
    std::size_t n = tracks.points.shape[0];
    require_shape(votes, {n}, "votes");
    require_shape(at, {n, 2}, "at_px");
    require_shape(found, {n}, "found");
    require_shape(tracks.points, {n, 4}, "points");
    require_shape(tracks.scale, {n}, "scale");
    require_shape(start, {4, 4}, "cam_from_previous");
    FlowMotion result{false, {4, 4}, {n}, 0.0};
    Array<double, 3> cov_points = track_covariances(tracks.cov_left_px, tracks.var_rho, {nullptr, {0}}, pinholes.f_px, pinholes.baseline_m);
    Array<double, 3> cov(n, 4, 4), none(n, 4, 0);
    Array<double, 2> z(n, 4);
    Array<double, 1> gates(n);
    for (std::size_t i = 0; i < n; i++) {
        double std = std_flow * static_cast<double>(tracks.scale.data[i]);
        for (int c = 0; c < 4; c++) {
            z[i][c] = c < 2 ? at[i][c] : std::numeric_limits<double>::quiet_NaN();
            cov[i][5 * c] = std * std;
        }
        gates.data[i] = gate;
    }
    std::vector<std::size_t> rows = rows_where(n, [&](std::size_t i) { return found.data[i]; });
    if (rows.size() < MIN_VIEWS) return result;
    SelectedViews seen({pinholes, tracks.points, cov_points, z, cov, none, gates}, rows);
    Fitted motion = resect(seen.views(), start, Array<double, 1>(0), rows_of(votes, rows), rules, {false, false, false, false}, std::nullopt).found;
    for (std::size_t k = 0; k < rows.size(); k++) result.agree.data[rows[k]] = motion.accepted.data[k];
    result.ok = motion.ok;
    result.cam_from_previous = std::move(motion.cam_from_ref);
    result.share = motion.share;
    return result;
}

}  // namespace core
