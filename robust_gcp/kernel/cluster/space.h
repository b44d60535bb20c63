// A loop cluster in dimensionless joint coordinates x = q / D: φ, K and φ'' there; see maps/cluster/space.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <vector>

#include "linalg/dense.h"
#include "abi.h"
#include "tree/chain.h"
#include "constraint/closures.h"
#include "linalg/lu.h"

namespace rg {

using Chart = std::shared_ptr<const Matrix>;  // C (nv, m): y = Cᵀ x

// Newton left the mode; a smaller step may help.
struct Lost {};
// No certified bridge exists here; a shorter one may.
struct NoBridge {
    bool tangential = false;  // the modes part at higher than second order
};
// A place that Python has to judge.
struct Stop {};

class Space {
  public:
    const int nv, m, nd, rows;
    const double phi_size;
    const std::vector<int> iq, iv, chosen, inputs;
    const Vector D;        // q = D x
    const Vector balance;  // K · balance has columns of size one
    const Chart chart;  // that y is given in
    std::optional<Vector> apex;  // of an isolated cone, where φ is taken relative to it; see maps/cluster/apex.py
    Lu lu;  // of [P K; Cᵀ] where it was factorised last
    Vector phi, dx;  // room for Newton's method
    Matrix K;

    explicit Space(const Cluster& c)
        : nv(c.loops->nv), m(c.loops->m), nd(nv - m), rows(c.loops->rows), phi_size(c.phi_size),
          iq(c.iq, c.iq + nv), iv(c.iv, c.iv + nv), chosen(c.loops->independent, c.loops->independent + m),
          inputs(c.inputs, c.inputs + m), D(Eigen::Map<const Vector>(c.loops->scale, nv)),
          balance(Eigen::Map<const Vector>(c.balance, nv)),
          chart(std::make_shared<Matrix>(picking(nv, chosen))), lu(nv), chain_(*c.loops), closures_(*c.loops, chain_, whole(*c.loops, chain_)),
          rotates_(c.rotates, c.rotates + nv), periodic_(c.periodic, c.periodic + nv),
          q_(nv), v_(nv), placed_(Vector::Constant(nv, std::nan(""))), rate_(closures_.entries.size() + 1) {}

    Space(const Space&) = delete;

    // φ (rows) and K (rows, nv).
    void linear(const Vector& x, Vector& phi, Matrix& K) {
        if (apex) relative(x, phi, K);
        place(x);
        if (!apex) phi = Eigen::Map<const Vector>(closures_.phi.data(), rows);
        fill(closures_.values, K);
    }

    // φ''[a, ·] (rows, nv).
    template <typename Way>
    void second(const Vector& x, const Way& a, Matrix& rate) {
        place(x);
        v_ = D.cwiseProduct(a);
        chain_.move(chain_.all, v_.data());
        closures_.jacobian_rate(v_.data(), rate_.data());
        fill(rate_, rate);
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

    // The whole turns of hinges nearest to a shift of x, in x.
    Vector whole_turns(const Vector& shift) const {
        Vector turns = Vector::Zero(nv);
        for (int i = 0; i < nv; ++i)
            if (periodic_[i]) turns[i] = 2.0 * PI * std::nearbyint(shift[i] * D[i] / (2.0 * PI)) / D[i];
        return turns;
    }

    Vector x(const double* q) const {
        Vector found(nv);
        for (int i = 0; i < nv; ++i) found[i] = q[iq[i]] / D[i];
        return found;
    }

    // The cluster's coordinates y in its chart.
    Vector wanted(const double* y) const {
        Vector found(m);
        for (int i = 0; i < m; ++i) found[i] = y[inputs[i]] / D[chosen[i]];
        return found;
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
            place(*apex + (0.5 + 0.5 * PLACES[i]) * away);
            fill(closures_.values, K);
            phi += 0.5 * WEIGHTS[i] * (K * away);
        }
    }

    // All joints and closures of the cluster.
    static Part whole(const Description& d, const Chain& chain) {
        Part part;
        part.joints = chain.all;
        for (int i = 0; i < d.closures; ++i) part.closures.push_back(i);
        for (int i = 0; i < d.couplings; ++i) part.couplings.push_back(i);
        return part;
    }

    void place(const Vector& x) {
        if (x == placed_) return;
        placed_ = x;
        q_ = D.cwiseProduct(x);
        chain_.place(chain_.all, q_.data());
        size_ = closures_.residual(q_.data());
        if (!std::isfinite(size_)) {
            placed_.setConstant(std::nan(""));
            throw Lost{};
        }
        closures_.jacobian();
    }

    void fill(const Cells<double>& values, Matrix& K) const {
        K.setZero(rows, nv);
        std::size_t at = 0;
        for (const Entry& entry : closures_.entries) K(entry.row, entry.v) += values[at++];
    }

    Chain chain_;
    Closures closures_;
    std::vector<char> rotates_, periodic_;
    Vector q_, v_, placed_;
    Cells<double> rate_;
    double size_ = 0.0;
};

}  // namespace rg
