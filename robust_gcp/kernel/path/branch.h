// The test of the branch: whether Newton's method stayed on it; as in regular_ground.py, which says why.
#pragma once

#include <algorithm>

#include "path/point.h"

namespace rg {

constexpr double DETERMINANT_RATIO = 2.5, POOR = 0.3, CORRECTION = 0.25, ROUNDING = 1e-12,
                 FARTHEST = 0.5, PACE = 3.0;

// Whether Newton ended near enough to the prediction.
inline bool near_prediction(Point& after, int blocks) {
    if (blocks == 0) return true;
    const double beyond = after.correction - CORRECTION * after.distance;
    return !(after.turn > FARTHEST) && !(beyond > 0.0 && beyond * std::max(after.conditioning(), 1e-12) > ROUNDING);
}

// Whether Newton, started from the prediction, stayed on the branch of `before`.
inline bool same_branch(Point& before, Point& after, int blocks) {
    if (!near_prediction(after, blocks)) return false;
    const double conditioning = after.conditioning();
    const double *a = before.det(), *b = after.det();
    int changed = 0;  // of all blocks at once, as vectors: none is left early
    for (int i = 0; i < blocks; ++i) changed |= !(a[i] * b[i] > 0.0);
    if (changed) return false;
    if (conditioning >= POOR && before.conditioning() >= POOR) return true;
    for (int i = 0; i < blocks; ++i) {
        if (std::min(before.rcond()[i], after.rcond()[i]) >= POOR) continue;
        const double ratio = b[i] / a[i];
        if (!(1.0 / DETERMINANT_RATIO < ratio && ratio < DETERMINANT_RATIO)) return false;
    }
    return true;
}

}  // namespace rg
