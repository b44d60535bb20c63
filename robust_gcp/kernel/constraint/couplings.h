// Rows that tie numbers of joints: φ = q₁ − P(q₂) − Σ cᵢ qᵢ, scaled.
#pragma once

#include <cmath>
#include <cstddef>
#include <vector>

#include "abi.h"

namespace rg {

struct Entry {  // of K: row, column, what its value is multiplied by
    int row, v;
    double scale;
};

class Couplings {
  public:
    Couplings() = default;

    // Appends the entries of its rows: of each that of the second joint, of further ones, of the first.
    Couplings(const Description& d, const std::vector<int>& which, std::vector<Entry>& entries)
        : first_(entries.size()) {
        for (int c : which) {
            const std::int32_t* at = d.coupling_at + 5 * c;
            Tie tie;
            tie.row = at[0], tie.q1 = at[1], tie.q2 = at[3], tie.v2 = at[4];
            tie.weight = d.row_weight[tie.row];
            for (int i = 0; i < d.coupling_width; ++i)
                tie.curve.push_back(d.coupling_curve[c * d.coupling_width + i]);
            // a joint that is held stands in for its second one: its own entry comes last
            entries.push_back({tie.row, at[4], -tie.weight * d.scale[at[4]]});
            for (int f = 0; f < d.coupling_further; ++f) {
                const std::int32_t* more = d.further_at + 3 * f;
                if (more[0] != c) continue;
                tie.further.push_back({more[1], d.further_arm[f]});
                entries.push_back({tie.row, more[2], -tie.weight * d.scale[more[2]]});
            }
            entries.push_back({tie.row, at[2], tie.weight * d.scale[at[2]]});
            ties_.push_back(tie);
        }
    }

    // φ of its rows at q; returns max |φ| of these, NaN where φ is not finite.
    template <typename T>
    T residual(const T* q, T* phi) {
        T size = 0;
        for (Tie& tie : ties_) {
            const T x = q[tie.q2];
            T value = 0, slope = 0, bend = 0;  // of P, by Horner's rule
            for (std::size_t i = tie.curve.size(); i-- > 0;) {
                bend = bend * x + 2 * slope;
                slope = slope * x + value;
                value = value * x + tie.curve[i];
            }
            tie.slope = static_cast<double>(slope);
            tie.bend = static_cast<double>(bend);
            value = q[tie.q1] - value;
            for (const Arm& arm : tie.further) value -= arm.length * q[arm.q];
            phi[tie.row] = tie.weight * value;
            const T magnitude = std::fabs(phi[tie.row]);
            if (!(magnitude <= size)) size = magnitude;
            if (std::isnan(size)) return size;
        }
        return size;
    }

    // Its entries of K after `residual` at the same q.
    void jacobian(const std::vector<Entry>& entries, double* values) const {
        std::size_t at = first_;
        for (const Tie& tie : ties_) {
            values[at] = entries[at].scale * tie.slope;
            ++at;
            for (const Arm& arm : tie.further) {
                values[at] = entries[at].scale * arm.length;
                ++at;
            }
            values[at] = entries[at].scale;
            ++at;
        }
    }

    // The rates of these along v after `residual` at the same q.
    void jacobian_rate(const std::vector<Entry>& entries, const double* v, double* rates) const {
        std::size_t at = first_;
        for (const Tie& tie : ties_) {
            rates[at] = entries[at].scale * tie.bend * v[tie.v2];
            for (std::size_t i = 0; i <= tie.further.size(); ++i) rates[++at] = 0.0;
            ++at;
        }
    }

    // k = P″(q₂) v₂² after `residual` at the same q.
    void bias(const double* v, double* k) const {
        for (const Tie& tie : ties_) k[tie.row] = tie.weight * tie.bend * v[tie.v2] * v[tie.v2];
    }

    // Changes of φ̇ and φ̈ along dq (at `stride`), where v and a are held, and of φ̈ where v changes by dv, after
    // `residual` at the same q.
    void rows_changed(const double* q, const double* v, const double* a, const double* dq, const double* dv, int stride,
                      double* d, double* dd) const {
        for (const Tie& tie : ties_) {
            const double speed = v[tie.v2], along = dq[tie.v2 * stride], faster = dv[tie.v2 * stride];
            d[tie.row] = -tie.weight * tie.bend * speed * along;
            dd[tie.row] = -tie.weight * ((tie.third(q[tie.q2]) * speed * speed + tie.bend * a[tie.v2]) * along +
                                         2.0 * tie.bend * speed * faster);
        }
    }

    // Visits the only entry of each row of K that changes: row, velocity, its change by that joint's number.
    template <typename Visit>
    void each_bend(Visit visit) const {
        for (const Tie& tie : ties_) visit(tie.row, tie.v2, -tie.weight * tie.bend);
    }

  private:
    struct Arm {
        int q;
        double length;
    };
    struct Tie {
        int row = 0, q1 = 0, q2 = 0, v2 = 0;
        double weight = 1.0;
        std::vector<double> curve;  // coefficients of P by rising power
        std::vector<Arm> further;
        double slope = 0.0, bend = 0.0;

        // P‴ at x.
        double third(double x) const {
            double sum = 0.0;
            for (std::size_t i = curve.size(); i-- > 3;)
                sum = sum * x + static_cast<double>(i * (i - 1) * (i - 2)) * curve[i];
            return sum;
        }
    };

    std::size_t first_ = 0;
    std::vector<Tie> ties_;
};

}  // namespace rg
