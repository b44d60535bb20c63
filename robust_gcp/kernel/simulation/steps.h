// One step of a method with fixed steps: the classical Runge–Kutta method's, or a tableau's.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "abi.h"
#include "linalg/cells.h"
#include "simulation/evaluator.h"

namespace rg {

class Steps : public Evaluator {
  public:
    explicit Steps(const Description& d) : Evaluator(d), x_(n_), sum_(n_), rate_(n_) {}

  protected:
    // From the state `x_` at the accepted point to the state `sum_` at the next time.
    Reason fixed(const Request& r, std::int64_t i) { return r.stages > 0 ? by_tableau(r, i) : classical(r, i); }

    Cells<double> x_, sum_, rate_;
    std::vector<Cells<double>> k_;  // rates at the stages of a tableau

  private:
    Reason classical(const Request& r, std::int64_t i) {
        const double t = r.times[i], h = r.times[i + 1] - t, half = 0.5 * h;
        rate(*accepted_, rate_);
        sum_ = rate_;
        advance(half);
        if (Reason reason = evaluate(r, t + half, i, 1)) return reason;
        gather(2.0);
        advance(half);
        if (Reason reason = evaluate(r, t + half, i, 1)) return reason;
        gather(2.0);
        advance(h);
        if (Reason reason = evaluate(r, t + h, i + 1, 0)) return reason;
        gather(1.0);
        for (int k = 0; k < n_; ++k) sum_[k] = x_[k] + (h / 6.0) * sum_[k];
        return DONE;
    }

    // k_s = f(t + c_s h, x + h Σ a_sj k_j), x ← x + h Σ b_s k_s.
    Reason by_tableau(const Request& r, std::int64_t i) {
        const double t = r.times[i], h = r.times[i + 1] - t, *weights = r.tableau;
        const int stages = r.stages;
        const double* c = weights + stages * (stages + 1) / 2;
        k_.resize(static_cast<std::size_t>(stages));
        for (int s = 0; s <= stages; ++s) {
            Cells<double>& to = s < stages ? stage_ : sum_;
            std::fill(to.begin(), to.end(), 0.0);
            for (int j = 0; j < s; ++j, ++weights)
                for (int k = 0; *weights != 0.0 && k < n_; ++k) to[k] += *weights * k_[j][k];
            for (int k = 0; k < n_; ++k) to[k] = x_[k] + h * to[k];
            if (s == stages) break;
            if (s > 0)
                if (Reason reason = evaluate(r, t + c[s] * h, i, s)) return reason;
            k_[s].resize(static_cast<std::size_t>(n_));
            rate(s > 0 ? *anchor_ : *accepted_, k_[s]);
        }
        return DONE;
    }

    void gather(double weight) {
        rate(*anchor_, rate_);
        for (int i = 0; i < n_; ++i) sum_[i] += weight * rate_[i];
    }

    void advance(double h) {
        for (int i = 0; i < n_; ++i) stage_[i] = x_[i] + h * rate_[i];
    }
};

}  // namespace rg
