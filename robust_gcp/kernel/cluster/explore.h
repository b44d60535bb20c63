// Bridges that are built before a motion comes to them.
#pragma once

#include <vector>

#include "cluster/tracker.h"

namespace rg {

// Trackers of one coordinate come to know those that lie both ways, as far as y goes or two turns, in which a mode closes.
inline void explore(std::vector<Tracker>& trackers) {
    constexpr double STEP = 0.1, FARTHEST = 4.0 * PI;
    for (Tracker& tracker : trackers) {
        const Space& space = *tracker.anchor->space;
        if (space.m > 1) continue;
        const double y = tracker.anchor->y()[0], unit = space.D[space.chosen[0]];
        for (const double step : {STEP / unit, -STEP / unit}) {
            Tracker scout = tracker.copy();
            try {
                for (int i = 1; i * STEP < FARTHEST; ++i) scout.at(Vector::Constant(1, y + i * step));
            } catch (const Lost&) {  // y goes no farther
            } catch (const Stop&) {
            }
            tracker.known_curves = scout.known_curves;
        }
    }
}

}  // namespace rg
