// Whether other coordinates may serve better: see simulation/runs/coordinates.py and evenness.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "abi.h"
#include "linalg/cells.h"
#include "tree/parts.h"
#include "path/point.h"

namespace rg {

class Watch {
  public:
    Watch(const Description& d, const Parts& parts)
        : m_(d.m), parts_(parts), independent_(d.independent, d.independent + d.m), turn_(d.turn, d.turn + d.nv),
          limits_(d.m), even_(parts.list.size()) {}

    // What a request asks to look for.
    void follow(const Request& r) {
        sizes_ = r.sizes;
        if (sizes_ == nullptr) return;
        for (std::size_t p = 0; p < parts_.list.size(); ++p) {
            even_[p] = -1.0;
            for (int k : parts_.list[p].inputs) {
                const double own = sizes_[independent_[k]];
                limits_[k] = own > 0.0 ? r.limit * own : std::numeric_limits<double>::infinity();
                if (own > 0.0) even_[p] = std::max(even_[p], r.uneven[k]);
            }
        }
    }

    // Whether an entry of G, times its size, is above the limit of its input, or max |g| / (max |v|)² of a part, in
    // radians and lengths, above what its inputs were found to be good at. In zones, which a part of one coordinate
    // leaves soon, those of several alone.
    bool exceeds(Point& point, bool in_zone = false) const { return exceeds(point, in_zone, 0.0); }

    // The same however evenly they move.
    bool turns_back(Point& point, bool in_zone) const {
        return exceeds(point, in_zone, std::numeric_limits<double>::infinity());
    }

  private:
    bool exceeds(Point& point, bool in_zone, double least) const {
        if (sizes_ == nullptr) return false;
        for (std::size_t p = 0; p < parts_.list.size(); ++p)
            if (even_[p] >= 0.0 && !(in_zone && parts_.list[p].count() == 1) &&
                exceeds(parts_.list[p], std::max(least, even_[p]), point))
                return true;
        return false;
    }

    bool exceeds(const Part& part, double even, Point& point) const {
        const double *G = point.G(), *g = point.g(), *u = point.ydot();
        double bent[2] = {}, fastest[2] = {};  // of every other velocity: two chains that do not wait
        int large = 0, chain = 0;
        const auto look = [&](int i, double v) {
            bent[chain] = std::max(bent[chain], std::fabs(g[i] * turn_[i]));
            fastest[chain] = std::max(fastest[chain], std::fabs(v * turn_[i]));
            chain = 1 - chain;
        };
        if (part.count() == 1) {
            const int k = part.inputs[0];
            const double pace = u[k], limit = limits_[k];
            for (int i : part.velocities) {
                const double own = G[i * m_ + k];
                large |= std::fabs(own) * sizes_[i] > limit;
                look(i, own * pace);
            }
        } else {
            for (int i : part.velocities) {
                double v = 0.0;
                for (int k : part.inputs) {
                    v += G[i * m_ + k] * u[k];
                    large |= std::fabs(G[i * m_ + k]) * sizes_[i] > limits_[k];
                }
                look(i, v);
            }
        }
        const double most = std::max(fastest[0], fastest[1]);
        return large || (most > 0.0 && std::max(bent[0], bent[1]) > even * most * most);
    }

    int m_;
    const Parts& parts_;
    const std::vector<int> independent_;
    const Cells<double> turn_;
    const double* sizes_ = nullptr;  // those of the request
    Cells<double> limits_;           // (m,)
    std::vector<double> even_;       // of each part, negative where it is not looked at
};

}  // namespace rg
