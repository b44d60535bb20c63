// Joints on groups in no loop: at origin ⊕ w, where y has w.
#pragma once

#include <algorithm>
#include <vector>

#include "abi.h"
#include "tree/chain.h"
#include "tree/groups.h"
#include "tree/parts.h"
#include "path/point.h"

namespace rg {

class OnGroups {
  public:
    OnGroups(const Description& d, const Chain& chain, const Parts& parts) : chain_(chain), input_(d.nv, -1) {
        for (int k = 0; k < d.m; ++k) input_[d.independent[k]] = k;
        for (const Part& part : parts.list)
            if (part.on_group) parts_.push_back(&part);
    }

    bool some() const { return !parts_.empty(); }

    // One of them at its place; `origin` is a whole q.
    void place(const Part& part, const double* origin, Point& point) const {
        const Body& b = body(part);
        double w[6];
        take(b, point.y(), w);
        integrate_joint(b.kind, origin + b.q, w, point.q() + b.q);
    }

    void place(const double* origin, Point& point) const {
        for (const Part* part : parts_) place(*part, origin, point);
    }

    // Their ẏ, into that of all; of other joints it is u.
    void rate(Point& point, double* rate) const {
        double w[6], u[6], turned[6];
        for (const Part* part : parts_) {
            const Body& b = body(*part);
            take(b, point.y(), w);
            take(b, point.ydot(), u);
            rate_in_chart(b.kind, w, u, turned);
            for (int i = 0; i < b.count; ++i) rate[input_[b.first + i]] = turned[i];
        }
    }

    // Entries of y or ẏ, or what is laid out alike, of a joint.
    void take(const Body& b, const double* y, double* own) const {
        for (int i = 0; i < b.count; ++i) own[i] = y[input_[b.first + i]];
    }

    const Body& body(const Part& part) const { return chain_.bodies[part.joints[0]]; }

  private:
    const Chain& chain_;
    std::vector<const Part*> parts_;
    std::vector<int> input_;  // by velocity, where it is in y, −1 where it is dependent
};

}  // namespace rg
