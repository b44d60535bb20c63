// Whether sums of joints, or their rates, may have left their bounds in a step: see guard.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "abi.h"
#include "linalg/cells.h"
#include "path/path.h"

namespace rg {

class Guard {
  public:
    explicit Guard(int nv) : nv_(nv) {}

    // What a request asks to look at, from the point at which its steps begin.
    void follow(const Request& r, const Path& path, Point& point) {
        rows_ = r.guard;
        if (rows_ == nullptr) return;
        const int n = rows_->values + rows_->rates;
        was_.resize(n);
        now_.resize(n);
        a_.resize(nv_);
        v_.resize(nv_);
        path.velocity(point, v_.data());
        if (rows_->rates > 0) path.acceleration(point, r.ydd, a_.data());
        look(point.q(), v_.data());
        std::swap(was_, now_);
    }

    // Whether a step of length h that ends at a point, with velocities v there, is to be looked at. Functions that
    // turn inside are taken to go no further beyond its end than REACH times their largest rate.
    bool met(const Path& path, Point& point, const double* v, const double* ydd, double h) {
        if (rows_ == nullptr) return false;
        if (rows_->rates > 0) path.acceleration(point, ydd, a_.data());
        bool out = look(point.q(), v), turned = false;
        const int n = rows_->values + rows_->rates;
        for (int j = 0; j < n; ++j) turned |= was_[j] * now_[j] < 0.0;
        for (int j = 0; turned && !out && j < n; ++j) {
            const double value = j < rows_->values ? sum(j, point.q(), rows_->in_q) : sum(j, v, rows_->in_v);
            const double near = std::min(value - rows_->lower[j], rows_->upper[j] - value);
            out = was_[j] * now_[j] < 0.0 && near <= REACH * h * std::max(std::fabs(was_[j]), std::fabs(now_[j]));
        }
        std::swap(was_, now_);
        return out;
    }

  private:
    static constexpr double REACH = 8.0;

    double sum(int j, const double* x, const std::int32_t* at) const {
        double total = 0.0;
        for (int k = rows_->begin[j]; k < rows_->begin[j + 1]; ++k) total += rows_->weight[k] * x[at[k]];
        return total;
    }

    // Rates of what is bounded; whether something is out of bounds.
    bool look(const double* q, const double* v) {
        bool out = false;
        for (int j = 0; j < rows_->values; ++j) {
            const double value = sum(j, q, rows_->in_q);
            out |= !(value > rows_->lower[j]) | !(value < rows_->upper[j]);
            now_[j] = sum(j, v, rows_->in_v);
        }
        for (int j = rows_->values; j < rows_->values + rows_->rates; ++j) {
            const double value = sum(j, v, rows_->in_v);
            out |= !(value > rows_->lower[j]) | !(value < rows_->upper[j]);
            now_[j] = sum(j, a_.data(), rows_->in_v);
        }
        return out;
    }

    int nv_;
    const Guarded* rows_ = nullptr;  // those of the request
    Cells<double> was_, now_, a_, v_;
};

}  // namespace rg
