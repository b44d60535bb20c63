// A loop cluster in dimensionless joint coordinates x, q = q_ref ⊕ D x: φ, K and φ'' there; see maps/cluster/space.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "cluster/outcomes.h"
#include "linalg/dense.h"
#include "abi.h"
#include "tree/chain.h"
#include "constraint/closures.h"
#include "tree/groups.h"
#include "tree/parts.h"
#include "linalg/lu.h"

namespace rg {

using Chart = std::shared_ptr<const Matrix>;  // C (nv, m): y = Cᵀ x

class Space {
  public:
    const int nv, m, nd, rows;
    const bool flat;       // whether joints have one number each, and q_ref = 0
    const double phi_size;
    const std::vector<int> iq, iv, chosen, inputs;
    const Vector D;
    const Vector balance;  // K · balance has columns of size one
    const Chart chart;  // that y is given in
    std::optional<Vector> apex;  // of an isolated cone, where φ is taken relative to it; see maps/cluster/apex.py
    Lu lu;  // of [P K; Cᵀ] where it was factorised last
    Vector phi, dx;  // room for Newton's method
    Matrix K;

    explicit Space(const Cluster& c)
        : nv(c.loops->nv), m(c.loops->m), nd(nv - m), rows(c.loops->rows),
          flat(c.loops->nq == nv && !turning(*c.loops)), phi_size(c.phi_size), iq(c.iq, c.iq + c.loops->nq), iv(c.iv, c.iv + nv), chosen(c.loops->independent, c.loops->independent + m),
          inputs(c.inputs, c.inputs + m), D(Eigen::Map<const Vector>(c.loops->scale, nv)),
          balance(Eigen::Map<const Vector>(c.balance, nv)),
          chart(std::make_shared<Matrix>(picking(nv, chosen))), lu(nv), chain_(*c.loops), closures_(*c.loops, chain_, all_of(*c.loops, chain_)),
          rotates_(c.rotates, c.rotates + nv), periodic_(c.periodic, c.periodic + nv),
          reference_(Vector::Zero(c.loops->nq)), q_(c.loops->nq), v_(nv), placed_(Vector::Constant(nv, std::nan(""))), rate_(closures_.entries.size() + 1) {
        for (const int i : chosen)
            for (const int j : chain_.all) {
                const Body& b = chain_.bodies[j];
                if (b.first <= i && i < b.first + b.count && turns(b.kind)) in_charts_.push_back(j);
            }
    }

    Space(const Space&) = delete;

    // Whether some of its y are in charts, as entries of x about the charts' origin.
    bool charted() const { return !in_charts_.empty(); }

    // Coordinates are about the cluster's own part of a whole q from now on, those of joints in charts about `origin`;
    // of use before anything else is asked.
    void about(const double* q, const double* origin) {
        for (std::size_t i = 0; i < iq.size(); ++i) reference_[static_cast<Eigen::Index>(i)] = q[iq[i]];
        for (const int j : in_charts_) {
            const Body& b = chain_.bodies[j];
            for (int i = b.q; i < b.q + NUMBERS[b.kind].q; ++i) reference_[i] = origin[iq[static_cast<std::size_t>(i)]];
        }
        placed_.setConstant(std::nan(""));
    }
    const Vector& reference() const { return reference_; }
    void refer(const Vector& reference) {
        reference_ = reference;
        placed_.setConstant(std::nan(""));
    }

    // φ (rows) and K (rows, nv).
    void linear(const Vector& x, Vector& phi, Matrix& K) {
        if (apex) relative(x, phi, K);
        jacobian(x, K);
        if (!apex) phi = Eigen::Map<const Vector>(closures_.phi.data(), rows);
    }

    // φ''[a, ·] (rows, nv).
    template <typename Way>
    void second(const Vector& x, const Way& a, Matrix& rate) {
        place(x);
        const Matrix T = flat ? Matrix() : turn(x);
        if (flat)
            v_ = D.cwiseProduct(a);
        else
            v_ = T * a;
        chain_.move(chain_.all, v_.data());
        closures_.jacobian_rate(v_.data(), rate_.data());
        fill(rate_, rate);
        if (flat) return;
        Matrix own;
        fill(closures_.values, own);
        rate = rate * (D.cwiseInverse().asDiagonal() * T) + own * (D.cwiseInverse().asDiagonal() * turn_rate(x, a));
    }

    // T D with v = T D ẋ, (nv, nv).
    Matrix turn(const Vector& x) const {
        Matrix T = D.asDiagonal();
        for (const int j : chain_.all) {
            const Body& b = chain_.bodies[j];
            if (b.count == 1) continue;
            const auto [w, rates] = in_chart(b, x);
            T.block(b.first, b.first, b.count, b.count) = inverse(rates) * D.segment(b.first, b.count).asDiagonal();
        }
        return T;
    }

    // d(T D)/ds along x + s a, by a difference of the eighth order, as in space.py.
    Matrix turn_rate(const Vector& x, const Vector& a) const {
        constexpr double STEP = 1e-2, WEIGHTS[] = {4.0 / 5.0, -1.0 / 5.0, 4.0 / 105.0, -1.0 / 280.0};
        Matrix rate = Matrix::Zero(nv, nv);
        for (int i = 0; i < 4; ++i) {
            const Vector move = (i + 1) * STEP * a;
            rate += WEIGHTS[i] / STEP * (turn(x + move) - turn(x - move));
        }
        return rate;
    }

    // ẋ for which the joints move with velocities v.
    Vector rate(const Vector& x, const Vector& v) const {
        Vector found = v;
        for (const int j : chain_.all) {
            const Body& b = chain_.bodies[j];
            if (b.count > 1) found.segment(b.first, b.count) = in_chart(b, x).second * v.segment(b.first, b.count);
        }
        return found.cwiseQuotient(D);
    }

    // Factorises [P K; Cᵀ] for these rows P K (nd, nv).
    void factor(const Matrix& rows, const Matrix& C) {
        Eigen::Map<Matrix> B(lu.matrix(), nv, nv);
        B.topRows(nd) = rows;
        B.bottomRows(m) = C.transpose();
        lu.factor();
    }

    // max |φ|.
    double residual(const Vector& x) {
        place(x);
        return size_;
    }

    // What rounding leaves of φ at best.
    double noise(const Vector& x) const {
        double largest = 0.0;
        for (int i = 0; i < nv; ++i)
            if (rotates_[i]) largest = std::max(largest, std::fabs(D[i] * x[i]));
        return 4e-16 * (nv + largest);
    }

    // The whole turns of revolute joints nearest to a shift of x, in x.
    Vector whole_turns(const Vector& shift) const {
        Vector turns = Vector::Zero(nv);
        for (int i = 0; i < nv; ++i)
            if (periodic_[i]) turns[i] = 2.0 * PI * std::nearbyint(shift[i] * D[i] / (2.0 * PI)) / D[i];
        return turns;
    }

    // Of a whole q.
    Vector x(const double* q) const {
        Vector found(nv);
        if (flat) {
            for (int i = 0; i < nv; ++i) found[i] = q[iq[i]] / D[i];
            return found;
        }
        for (const int j : chain_.all) {
            const Body& b = chain_.bodies[j];
            double own[7];
            for (int i = 0; i < NUMBERS[b.kind].q; ++i) own[i] = q[iq[b.q + i]];
            joint_difference(b.kind, reference_.data() + b.q, own, found.data() + b.first);
        }
        return found.cwiseQuotient(D);
    }

    // Writes x into a whole q.
    void write(const Vector& x, double* q) {
        numbers(x);
        for (std::size_t i = 0; i < iq.size(); ++i) q[iq[i]] = q_[static_cast<Eigen::Index>(i)];
    }

    // The cluster's coordinates y in its chart.
    Vector wanted(const double* y) const {
        Vector found(m);
        for (int i = 0; i < m; ++i) found[i] = chart_of(i, y[inputs[i]]);
        return found;
    }
    double chart_of(int i, double y) const { return (y - number_at_origin(i)) / D[chosen[i]]; }

    // Whether a joint has turned so far that coordinates about another place serve better.
    bool far(const Vector& x) const {
        if (flat) return false;
        for (int i = 0; i < nv; ++i)
            if (rotates_[i] && std::fabs(D[i] * x[i]) > 1.0) return true;  // OUTGROWN of explicit.py
        return false;
    }

  private:
    static Matrix picking(int n, const std::vector<int>& chosen) {
        Matrix C = Matrix::Zero(n, static_cast<int>(chosen.size()));
        for (std::size_t i = 0; i < chosen.size(); ++i) C(chosen[i], static_cast<int>(i)) = 1.0;
        return C;
    }

    // φ = ∫₀¹ K(x* + s ξ) ξ ds with ξ = x − x*, by Gauss' rule of five points, exact to rounding ε |ξ|.
    void relative(const Vector& x, Vector& phi, Matrix& K) {
        constexpr double PLACES[] = {0.0, 0.5384693101056831, -0.5384693101056831, 0.9061798459386640,
                                     -0.9061798459386640};
        constexpr double WEIGHTS[] = {0.5688888888888889, 0.4786286704993665, 0.4786286704993665,
                                      0.2369268850561891, 0.2369268850561891};
        const Vector away = x - *apex;
        phi.setZero(rows);
        for (int i = 0; i < 5; ++i) {
            jacobian(*apex + (0.5 + 0.5 * PLACES[i]) * away, K);
            phi += 0.5 * WEIGHTS[i] * (K * away);
        }
    }

    void place(const Vector& x) {
        if (x == placed_) return;
        placed_ = x;
        numbers(x);
        chain_.place(chain_.all, q_.data());
        size_ = closures_.residual(q_.data());
        if (!std::isfinite(size_)) {
            placed_.setConstant(std::nan(""));
            throw Lost{};
        }
        closures_.jacobian();
    }

    // K by x.
    void jacobian(const Vector& x, Matrix& K) {
        place(x);
        fill(closures_.values, K);
        if (!flat) K = K * (D.cwiseInverse().asDiagonal() * turn(x));
    }

    // The joints' numbers.
    void numbers(const Vector& x) {
        if (flat) {
            q_ = D.cwiseProduct(x);
            return;
        }
        const Vector w = D.cwiseProduct(x);
        for (const int j : chain_.all) {
            const Body& b = chain_.bodies[j];
            integrate_joint(b.kind, reference_.data() + b.q, w.data() + b.first, q_.data() + b.q);
        }
    }

    // w of a joint, and dexp⁻¹(w).
    std::pair<Vector, Matrix> in_chart(const Body& b, const Vector& x) const {
        const Vector w = D.segment(b.first, b.count).cwiseProduct(x.segment(b.first, b.count));
        Matrix rates(b.count, b.count);
        for (int i = 0; i < b.count; ++i)
            rate_in_chart(b.kind, w.data(), Vector(Vector::Unit(b.count, i)).data(), rates.col(i).data());
        return {w, rates};
    }

    // Whether a joint of one velocity has another number of numbers.
    static bool turning(const Description& d) {
        return std::any_of(d.kind, d.kind + d.joints, [](int kind) { return NUMBERS[kind].q != 1; });
    }

    // Whether the velocities of a joint are no rates of its numbers.
    static bool turns(int kind) { return NUMBERS[kind].q != NUMBERS[kind].v; }

    // y at x = 0.
    double number_at_origin(int i) const {
        const int v = chosen[i];
        const bool in_chart = std::any_of(in_charts_.begin(), in_charts_.end(), [&](int j) {
            return chain_.bodies[j].first <= v && v < chain_.bodies[j].first + chain_.bodies[j].count;
        });
        return in_chart ? 0.0 : reference_[chain_.number_at[v]];
    }

    void fill(const Cells<double>& values, Matrix& K) const {
        K.setZero(rows, nv);
        std::size_t at = 0;
        for (const Entry& entry : closures_.entries) K(entry.row, entry.v) += values[at++];
    }

    Chain chain_;
    Closures closures_;
    std::vector<char> rotates_, periodic_;
    std::vector<int> in_charts_;  // joints some of whose velocities are chosen, and no rates of numbers
    Vector reference_, q_, v_, placed_;
    Cells<double> rate_;
    double size_ = 0.0;
};

}  // namespace rg
