// Joints in loops some of whose velocities are inputs: at origin ⊕ w, where y has those entries of w and Newton's
// method finds the others. See maps/charted_path.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "abi.h"
#include "linalg/cells.h"
#include "tree/chain.h"
#include "constraint/closures.h"
#include "tree/groups.h"
#include "linalg/lu.h"
#include "tree/parts.h"
#include "path/point.h"

namespace rg {

class Charts {
  public:
    // Those of one part.
    Charts(const Description& d, const Chain& chain, const Part& part)
        : m_(d.m), inputs_(part.inputs), step_(d.m), aim_(d.m) {
        if (!part.charted) return;
        std::vector<int> input(d.nv, -1);
        for (int k : part.inputs)
            if (d.independent_q[k] < 0) input[d.independent[k]] = k;
        for (int j : part.joints) {
            const Body& b = chain.bodies[j];
            const auto first = input.begin() + b.first, end = first + b.count;
            if (std::all_of(first, end, [](int k) { return k < 0; })) continue;
            joints_.push_back({&b, {first, end}, {}, Lu(b.count)});
        }
    }

    bool some() const { return !joints_.empty(); }

    // Where w has its other entries from a predicted q, which is put there.
    void begin(const double* origin, const double* y, double* q) {
        for (Joint& joint : joints_) {
            const Body& b = *joint.body;
            joint_difference(b.kind, origin + b.q, q + b.q, joint.w);
            for (int i = 0; i < b.count; ++i)
                if (joint.input[i] >= 0) joint.w[i] = y[joint.input[i]];
            integrate_joint(b.kind, origin + b.q, joint.w, q + b.q);
        }
    }

    // Their numbers in one whole q, into another.
    void copy(const double* from, double* q) const {
        for (const Joint& joint : joints_) {
            const int at = joint.body->q;
            std::copy(from + at, from + at + NUMBERS[joint.body->kind].q, q + at);
        }
    }

    // Largest entry of w after `begin`.
    double largest() const {
        double most = 0.0;
        for (const Joint& joint : joints_)
            for (int i = 0; i < joint.body->count; ++i) most = std::max(most, std::fabs(joint.w[i]));
        return most;
    }

    // The columns of K by w in place of those by velocities in own axes.
    void turn(Closures& closures) {
        for (Joint& joint : joints_) {
            const Body& b = *joint.body;
            for (int i = 0; i < b.count; ++i) {
                double unit[6] = {};
                unit[i] = 1.0;
                rate_in_chart(b.kind, joint.w, unit, joint.rate.matrix() + i * b.count);
            }
            joint.rate.factor();
            double turned[36] = {};
            for (int i = 0; i < b.count; ++i) {
                turned[i * b.count + i] = 1.0;
                joint.rate.solve(turned + i * b.count);
            }
            closures.recombine(b.first, b.count, turned);
        }
    }

    // After a step (nv) of the other entries of w.
    void move(const double* origin, const double* step, double* q) {
        for (Joint& joint : joints_) {
            const Body& b = *joint.body;
            for (int i = 0; i < b.count; ++i) joint.w[i] += step[b.first + i];
            integrate_joint(b.kind, origin + b.q, joint.w, q + b.q);
        }
    }

    // ẏ of the inputs for velocities G u: dexp⁻¹(w) G u.
    void rate(const double* origin, Point& point, const double* u, double* rate) const {
        for (const Joint& joint : joints_) {
            const Body& b = *joint.body;
            double w[6], v[6], turned[6];
            joint_difference(b.kind, origin + b.q, point.q() + b.q, w);
            for (int i = 0; i < b.count; ++i) {
                const double* row = point.G() + (b.first + i) * m_;
                double sum = 0.0;
                for (int k : inputs_) sum += row[k] * u[k];
                v[i] = joint.input[i] < 0 ? sum : u[joint.input[i]];
            }
            rate_in_chart(b.kind, w, v, turned);
            for (int i = 0; i < b.count; ++i)
                if (joint.input[i] >= 0) rate[joint.input[i]] = turned[i];
        }
    }

    // The y to which G Δy leads where y is asked for, to the first order in w: y itself but for entries in charts.
    const double* aim(const double* origin, Point& anchor, const double* y) {
        if (!some()) return y;
        for (int k : inputs_) step_[k] = y[k] - anchor.y()[k];
        rate(origin, anchor, step_.data(), aim_.data());
        for (const Joint& joint : joints_)
            for (int k : joint.input)
                if (k >= 0) step_[k] += step_[k] - aim_[k];
        for (int k : inputs_) aim_[k] = anchor.y()[k] + step_[k];
        return aim_.data();
    }

    // Largest entry of w.
    double away(const double* origin, Point& point) const {
        double most = 0.0;
        for (const Joint& joint : joints_) {
            double w[6];
            joint_difference(joint.body->kind, origin + joint.body->q, point.q() + joint.body->q, w);
            for (int i = 0; i < joint.body->count; ++i) most = std::max(most, std::fabs(w[i]));
        }
        return most;
    }

  private:
    struct Joint {
        const Body* body;
        std::vector<int> input;  // by velocity, where it is in y, −1 where it is dependent
        double w[6];
        Lu rate;                 // dexp⁻¹(w)
    };

    int m_;
    std::vector<int> inputs_;  // of the part
    Cells<double> step_, aim_;
    std::vector<Joint> joints_;
};

}  // namespace rg
