// How a joint in the chart of a step, q = origin ⊕ w, and the rate of w, depend on the start and on w; see
// chart_derivatives.py.
#pragma once

#include <cmath>

#include "tree/groups.h"

namespace rg {

constexpr double WIDEST_CHART = 0.5;  // rad, up to which the series below have all digits

struct ChartSlopes {
    double by_start[36], by_w[36];      // of the joint's displacement in its own axes, (n, n)
    double rate_by_w[36], rate_by_u[36];  // of ẇ = dexp⁻¹(w) u

    ChartSlopes() = default;
    ChartSlopes(int kind, const double* w, const double* u) {
        // (−1)ᵏ Bₖ/k!
        constexpr double inverse[] = {1.0, 0.5, 1.0 / 12.0, 0.0, -1.0 / 720.0, 0.0, 1.0 / 30240.0, 0.0,
                                      -1.0 / 1209600.0, 0.0, 1.0 / 47900160.0, 0.0, -691.0 / 1307674368000.0, 0.0,
                                      1.0 / 74724249600.0, 0.0, -3617.0 / 10670622842880000.0};
        const int n = NUMBERS[kind].v;
        const Twist way = twist_of(kind, w), velocity = twist_of(kind, u);
        for (int j = 0; j < n; ++j) {
            double unit[6] = {};
            unit[j] = 1.0;
            const Twist e = twist_of(kind, unit);
            Twist start = e, own = e, by_velocity = e, turned;  // sums
            Twist term = e, power = velocity, change;           // adᵏ e, adᵏ u, and how this changes with w
            double factor = 1.0;                                // (−1)ᵏ/k!
            for (int k = 1; k <= 16; ++k) {
                change = bracket(way, change) + bracket(e, power);
                term = bracket(way, term);
                power = bracket(way, power);
                factor /= -k;
                start += factor * term;
                own += factor / (k + 1) * term;
                by_velocity += inverse[k] * term;
                turned += inverse[k] * change;
            }
            const Twist* columns[] = {&start, &own, &turned, &by_velocity};
            double* into[] = {by_start, by_w, rate_by_w, rate_by_u};
            for (int part = 0; part < 4; ++part) {
                double entries[6];
                entries_of(kind, *columns[part], entries);
                for (int i = 0; i < n; ++i) into[part][i * n + j] = entries[i];
            }
        }
    }
};

}  // namespace rg
