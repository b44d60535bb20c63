// Places near which a motion has no certified bridge; see maps/cluster/obstacles.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>
#include <vector>

#include "cluster/singular.h"

namespace rg {

constexpr double FARTHEST_LOOK = 0.5, APEX = 1e-6;

struct Obstacle {
    enum Kind { CROSSING, NEAR_MISS, CONE, UNKNOWN };

    Kind kind = CROSSING;
    Vector x;               // where it was met
    double radius = 0.0;    // how far from there the verdict holds
    double approach = 0.0;  // how near the motion comes to it, where that is known

    bool covers(const Vector& at) const { return (at - x).norm() <= radius; }

    // Whether a motion followed with error control ends at this distance from the singular set.
    bool stops(double distance, double zone) const {
        return kind != NEAR_MISS && distance < (kind == CONE ? APEX : DEEP * zone);
    }

    static constexpr double DEEP = 0.3;
};

// What a place without a bridge is, by the singular configuration next to it.
inline Obstacle judge(const Jet& here, double largest_gap, double zone) {
    const double delta = here.delta();
    Obstacle made;
    made.kind = Obstacle::UNKNOWN;
    made.x = here.x;
    made.radius = delta < FAR ? std::max(0.9 * delta, 0.5 * Obstacle::DEEP * zone) : 0.1;
    const Place found = place(here);
    if (found.cone())
        made.kind = Obstacle::CONE;
    else if (found.found() && found.gap > largest_gap)
        made.kind = Obstacle::NEAR_MISS;
    return made;
}

// What the singular place ahead of a point is, before any bridge is tried.
inline Obstacle approaching(const Jet& here, double largest_gap) {
    Obstacle made;
    made.x = here.x;
    made.radius = 0.5 * std::min(here.delta(), 1.0);
    const Place found = place(here);
    const double far = (found.x - here.x).norm(), approach = found.approach();
    if (!found.found() || far > 2.0 * FARTHEST_LOOK) return made;
    if (found.cone()) {
        made.kind = Obstacle::CONE;
        made.approach = std::min(far, approach != 0.0 ? approach : far);
    } else if (found.gap > largest_gap) {
        made.kind = Obstacle::NEAR_MISS;
        made.approach = approach;
    }
    return made;
}

// What singular places ahead were found to be, where a motion may pass again, also whole turns later.
class Seen {
  public:
    // Those that `crossed` knows are looked at no further.
    template <typename Crossed>
    const Obstacle& at(const Jet& here, double largest_gap, Crossed crossed) {
        for (const Obstacle& one : ahead_)
            if (one.covers(here.x - here.space->whole_turns(here.x - one.x))) return one;
        if (ahead_.size() >= MOST) ahead_.erase(ahead_.begin());
        if (!crossed()) return ahead_.emplace_back(approaching(here, largest_gap));
        return ahead_.emplace_back(Obstacle{Obstacle::CROSSING, here.x, 0.5 * std::min(here.delta(), 1.0)});
    }

  private:
    static constexpr std::size_t MOST = 8;

    std::vector<Obstacle> ahead_;
};

}  // namespace rg
