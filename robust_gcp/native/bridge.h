// A finished bridge for one coordinate: a polynomial through the singular surface; see line.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "abi.h"
#include "cells.h"
#include "path.h"

namespace rg {

class Bridge {
  public:
    Bridge(const Table& table, const Layout& layout, int independent, int independent_q)
        : t_(table), l_(layout), independent_(independent), independent_q_(independent_q),
          values_(table.width) {}

    bool contains(double y) const { return t_.left <= y - t_.origin && y - t_.origin <= t_.right; }

    // Whether a step from y0 to y1 may pass a singular surface. Which of two steps that meet on it to rounding
    // does is for the caller to say, so both are told of.
    bool passes(double y0, double y1) const {
        const double slack = 1e-9 * (t_.right - t_.left);
        for (int i = 0; i < t_.surfaces; ++i) {
            const double zero = t_.origin + t_.zeros[i];
            if (std::min(y0, y1) - slack <= zero && zero <= std::max(y0, y1) + slack) return true;
        }
        return false;
    }

    // The innermost node on y's side of the surface.
    const double* exit(double y) const {
        return y - t_.origin > 0.5 * (t_.left + t_.right) ? t_.after : t_.before;
    }

    void at(double y, double ydot, Point& point) {
        const double s = y - t_.origin;
        const double u = ((s - t_.center) / t_.unit - t_.middle) / t_.half;
        evaluate(u);
        const int nv = l_.nv;
        const double square = ydot * ydot;
        for (int i = 0; i < nv; ++i) {
            point.q()[i] = t_.reference[i] + values_[i];
            point.G()[i] = values_[nv + i] / t_.pace;
            point.curvature()[i] = values_[2 * nv + i] / (t_.pace * t_.pace);
        }
        point.q()[independent_q_] = y;
        point.G()[independent_] = 1.0;
        point.curvature()[independent_] = 0.0;
        for (int i = 0; i < nv; ++i) point.g()[i] = point.curvature()[i] * square;
        for (int b = 0; b < l_.blocks; ++b) {
            point.det()[b] = values_[3 * nv + b];
            point.rcond()[b] = 0.0;  // K_d says nothing of a point on a bridge
        }
        point.y()[0] = y;
        point.ydot()[0] = ydot;
        point.conditioning() = 0.0;
        point.correction = point.distance = point.turn = 0.0;
    }

  private:
    // Σ c_k T_k(u) by the recurrence of the Chebyshev polynomials.
    void evaluate(double u) {
        const double* row = t_.coefficients;
        double last = u, term = 1.0;  // T_{−1}(u) = T_1(u)
        std::fill(values_.begin(), values_.end(), 0.0);
        for (int k = 0; k < t_.orders; ++k, row += t_.width) {
            for (int i = 0; i < t_.width; ++i) values_[i] += term * row[i];
            const double next = 2.0 * u * term - last;
            last = term;
            term = next;
        }
    }

    const Table& t_;
    const Layout& l_;
    int independent_, independent_q_;
    Cells<double> values_;
};

}  // namespace rg
