// Inputs that move as prescribed, and what that takes; see dynamics/prescribed/driven.py.
#pragma once

#include <algorithm>
#include <vector>

#include "abi.h"
#include "dynamics/inverse.h"
#include "dynamics/sweep.h"
#include "linalg/cells.h"
#include "path/path.h"
#include "tree/parts.h"

namespace rg {

class Driven {
  private:
    Path& path_;
    const std::vector<int> which_, independent_;
    const std::vector<Part> free_;

  public:
    Sweep sweep;  // of the other inputs

    Driven(const Description& d, Path& path)
        : path_(path), which_(d.driven_y, d.driven_y + d.driven), independent_(d.independent, d.independent + d.m),
          free_(without(path.parts.list, which_)), sweep(d, path, free_),
          inverse_(d, path.chain.bodies.size()), bias_(d.nv), a_(d.nv), force_(d.nv), effort_(which_.size()) {}

    // Whether other inputs move freely.
    bool leaves_some() const { return static_cast<int>(which_.size()) < path_.layout.m; }

    // Takes up what is prescribed, (3, driven), which replaces entries of y and ẏ.
    void prescribe(const double* now, double* y, double* ydot) {
        now_ = now;
        for (std::size_t k = 0; k < which_.size(); ++k) {
            y[which_[k]] = now[k];
            ydot[which_[k]] = now[which_.size() + k];
        }
    }

    // g + G_d d̈, (nv).
    const double* bias(Point& point) {
        const int m = path_.layout.m;
        for (int i = 0; i < path_.layout.nv; ++i) {
            bias_[i] = point.g()[i];
            for (std::size_t k = 0; k < which_.size(); ++k) bias_[i] += point.G()[i * m + which_[k]] * acceleration(k);
        }
        return bias_.data();
    }

    // Completes ÿ, and adds G_dᵀ (M (G ÿ + g) + C − τ) to τ; returns its power.
    double effort(const Chain& chain, Point& point, const double* v, double* ydd, double* tau) {
        const int m = path_.layout.m;
        for (std::size_t k = 0; k < which_.size(); ++k) ydd[which_[k]] = acceleration(k);
        path_.acceleration(point, ydd, a_.data());
        inverse_.at(chain, v, a_.data(), force_.data());
        double power = 0.0;
        for (std::size_t k = 0; k < which_.size(); ++k) {
            effort_[k] = 0.0;
            for (int i = 0; i < path_.layout.nv; ++i) effort_[k] += point.G()[i * m + which_[k]] * (force_[i] - tau[i]);
            power += effort_[k] * point.ydot()[which_[k]];
        }
        for (std::size_t k = 0; k < which_.size(); ++k) tau[independent_[which_[k]]] += effort_[k];
        return power;
    }

    // What `effort` found last, (driven,).
    void write(double* to) const { std::copy(effort_.begin(), effort_.end(), to); }
    // As it was then.
    void read(const double* from) { std::copy(from, from + effort_.size(), effort_.begin()); }
    // Numbers that are prescribed at a time.
    std::int64_t width() const { return 3 * static_cast<std::int64_t>(which_.size()); }

  private:
    double acceleration(std::size_t k) const { return now_[2 * which_.size() + k]; }

    // Parts with all inputs but these.
    static std::vector<Part> without(std::vector<Part> parts, const std::vector<int>& which) {
        int first = 0;
        for (Part& part : parts) {
            auto& inputs = part.inputs;
            const auto drop = [&](int k) { return std::find(which.begin(), which.end(), k) != which.end(); };
            inputs.erase(std::remove_if(inputs.begin(), inputs.end(), drop), inputs.end());
            part.first = first;
            first += part.count();
        }
        return parts;
    }

    Inverse inverse_;
    Cells<double> bias_, a_, force_, effort_;
    const double* now_ = nullptr;  // what is prescribed
};

}  // namespace rg
