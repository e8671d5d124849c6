// Stages that find a motion, from views or from flow, and the turn of the right camera.
#pragma once

#include "views.hpp"

namespace core {

struct ResectionRules {  // as in RobustRules
    double calm_share, calm_spread, beyond_gates, ambiguous_share, halves_apart, shared_noise, max_odds;
    double first_half_weight, robust_converged, final_converged, settled_spread, spread_gates;
    double first_refining_gates, refining_gates, extent_power, min_extent;
    int wide_steps, robust_steps, final_steps, relinearised, sample_steps, refining_steps;
    std::size_t second_views, samples, clean_samples, refined, places;
    RECORD(ResectionRules, calm_share, calm_spread, beyond_gates, ambiguous_share, halves_apart, shared_noise, max_odds,
           first_half_weight, robust_converged, final_converged, settled_spread, spread_gates, first_refining_gates,
           refining_gates, extent_power, min_extent, wide_steps, robust_steps, final_steps, relinearised, sample_steps,
           refining_steps, second_views, samples, clean_samples, refined, places)
};

// fit.cpp
struct Fitted {
    Array<double, 2> cam_from_ref, cov_pose, cov_amplitudes;
    Array<double, 1> squared_residuals, amplitudes;
    Array<bool, 1> accepted;
    std::int64_t dof = -6;
    double chi2 = 0, spread = 1, share = 0;
    bool ok = false;

    Fitted(std::size_t n, std::size_t j)
        : cam_from_ref(4, 4), cov_pose(6, 6), cov_amplitudes(j, j), squared_residuals(n), amplitudes(j), accepted(n) {}
    RECORD(Fitted, cam_from_ref, cov_pose, accepted, chi2, dof, spread, ok, squared_residuals, share, amplitudes, cov_amplitudes)
};
Fitted fit_motion(const PointViews& views, Matrix start, Vector amplitudes, Vector votes, const ResectionRules& rules,
                  bool anneal);
struct Halves {
    double apart;
    Array<double, 3> motions;
};
Halves motions_of_halves(const PointViews& views, Matrix motion, Vector amplitudes, Flags accepted,
                         double shared_noise);

// search.cpp
Array<double, 2> search_motion(const PointViews& views, Matrix start, Vector weights, const ResectionRules& rules,
                               std::size_t agreeing);
double motion_support(const PointViews& views, Matrix motion, Vector amplitudes, Vector weights, const ResectionRules& rules);
double evidence(const Pinholes& pinholes, Matrix z, Vector weights, const ResectionRules& rules);

// resection.cpp
struct Wanted {
    bool second, start_is_close, start_is_decided, search;
    RECORD(Wanted, second, start_is_close, start_is_decided, search)
};
struct Second {
    Array<double, 2> cam_from_ref, cov_pose;
    Array<bool, 1> views;
    double odds;
    RECORD(Second, cam_from_ref, cov_pose, views, odds)
};
struct Resected {
    Fitted found;
    std::optional<Second> second;
    FIELDS(found, second)
};
struct FlowMotion {
    bool ok;
    Array<double, 2> cam_from_previous;
    Array<bool, 1> agree;
    double share;
    FIELDS(ok, cam_from_previous, agree, share)
};
struct TrackTable;
FlowMotion motion_of_flow(const Pinholes& pinholes, const TrackTable& tracks, Vector votes, Matrix at, Flags found,
                          Matrix start, double std_flow, double gate, const ResectionRules& rules);
Resected resect(const PointViews& views, Matrix start, Vector amplitudes, Vector votes, const ResectionRules& rules,
                const Wanted& wanted, std::optional<Matrix> predicted);

// turn.cpp
// Adds (sign 1) or subtracts (-1) the effect of a turn (3,) of the right camera on right positions (n, 2).
void turn_by(const Pinholes& pinholes, Vector rad, double sign, Array<double, 2>& right);
struct TurnRules {
    double std_rad, limit;
    int steps, guess_frames;
    RECORD(TurnRules, std_rad, limit, steps, guess_frames)
};
struct ApparentTurnsView {
    Matrix cov_others;
    Vector per_s;
    double var_delay_s2, std_rad;
    RECORD(ApparentTurns, cov_others, per_s, var_delay_s2, std_rad)
};
struct TurnView {
    Vector rad;
    Matrix cov;
    double chi2;
    ApparentTurnsView apparent;
    RECORD(Turn, rad, cov, chi2, apparent)
};
struct UsualTurnsView {
    TurnRules rules;
    Matrix measured, real;
    int frames;
    Vector late;
    RECORD(UsualTurns, rules, measured, real, frames, late)
};
struct WeighedTurn {
    double log_odds;
    Array<double, 1> log_likelihoods;
    FIELDS(log_odds, log_likelihoods)
};
struct LearntTurns {
    Array<double, 2> measured{3, 3}, real{3, 3};
    Array<double, 1> late{2};
    FIELDS(measured, real, late)
};
struct FittedTurn {
    Array<double, 1> rad;
    Array<double, 2> cov;
    Array<bool, 1> agree;
    double log_odds, squared;
    FIELDS(rad, cov, agree, squared)  // the odds only decide how many steps are needed
};
Array<double, 3> effects_of_turn(const Pinholes& pinholes, Matrix right);
WeighedTurn weigh_turn(const UsualTurnsView& usual, const TurnView& turn, Vector sizes);
LearntTurns learn_turn(const UsualTurnsView& usual, const TurnView& turn, int frames);
Array<double, 3> views_by_turn(const Pinholes& pinholes, Matrix z, Matrix root);
Array<double, 3> with_turn(const Pinholes& pinholes, Matrix z, Matrices cov, Matrix root);
FittedTurn fit_turn(const PointViews& views, Matrix motion, Matrix usual, const TurnRules& rules);

}  // namespace core
