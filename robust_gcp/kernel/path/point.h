// A configuration on the constraint with the explicit map's derivatives, in one row of numbers.
#pragma once

#include <algorithm>
#include <vector>

#include "abi.h"
#include "linalg/cells.h"

namespace rg {

// y (m), ẏ (m), q (nq), G (nv, m), g (nv), γ'' (nv, for m = 1), det (blocks), rcond (blocks), conditioning.
struct Layout {
    int m, nq, nv, blocks;
    int ydot, q, G, g, curvature, det, rcond, conditioning, size;

    explicit Layout(const Description& d) : m(d.m), nq(d.nq), nv(d.nv), blocks(d.blocks) {
        ydot = m;
        q = ydot + m;
        G = q + nq;
        g = G + nv * m;
        curvature = g + nv;
        det = curvature + (m == 1 ? nv : 0);
        rcond = det + blocks;
        conditioning = rcond + blocks;
        size = conditioning + 1;
    }
};

struct Point {
    explicit Point(const Layout& l) : numbers(l.size), l_(&l) {}

    double* y() { return numbers.data(); }
    double* ydot() { return numbers.data() + l_->ydot; }
    double* q() { return numbers.data() + l_->q; }
    double* G() { return numbers.data() + l_->G; }
    double* g() { return numbers.data() + l_->g; }
    double* curvature() { return numbers.data() + l_->curvature; }
    double* det() { return numbers.data() + l_->det; }
    double* rcond() { return numbers.data() + l_->rcond; }
    double& conditioning() { return numbers[l_->conditioning]; }

    void read(const double* from) { std::copy(from, from + l_->size, numbers.begin()); }
    void write(double* to) const { std::copy(numbers.begin(), numbers.end(), to); }

    Cells<double> numbers;
    double correction = 0.0;  // Newton's first step, dimensionless
    double distance = 0.0;    // the predicted step, dimensionless
    bool by_modes = false;    // whether parts are on series of modes.h, whose det and rcond are unknown
    double turn = 0.0;        // largest rotation in it, rad, or slide in lengths

  private:
    const Layout* l_;
};

}  // namespace rg
