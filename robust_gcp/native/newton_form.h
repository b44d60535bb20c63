// Hermite interpolation in Newton's form; see maps/cluster/newton_form.py.
#pragma once

#include <cstddef>
#include <vector>

#include "dense.h"

namespace rg {

class NewtonForm {
  public:
    NewtonForm() = default;

    // Column i d + k of `data` is the k-th derivative at node i, of all functions.
    NewtonForm(const std::vector<double>& nodes, int d, const Matrix& data) : newton_(data.rows(), data.cols()) {
        const int n = static_cast<int>(nodes.size()) * d;
        for (int i = 0; i < n; ++i) nodes_.push_back(nodes[static_cast<std::size_t>(i / d)]);
        Matrix table(data.rows(), n);
        for (int i = 0; i < n; ++i) table.col(i) = data.col(i - i % d);
        newton_.col(0) = table.col(0);
        double factorial = 1.0;
        for (int order = 1; order < n; ++order) {
            factorial *= order;
            for (int i = 0; i + order < n; ++i) {
                const double apart = at(i + order) - at(i);
                if (apart == 0.0)  // differences between equal nodes are derivatives
                    table.col(i) = data.col(i - i % d + order) / factorial;
                else
                    table.col(i) = (table.col(i + 1) - table.col(i)) * (1.0 / apart);
            }
            newton_.col(order) = table.col(0);
        }
    }

    // f, f′ and f″ at x.
    void evaluate(double x, Vector& value, Vector& slope, Vector& bend) const {
        const int n = static_cast<int>(nodes_.size());
        value = newton_.col(n - 1);
        slope = bend = Vector::Zero(newton_.rows());
        for (int i = n - 2; i >= 0; --i) {
            const double step = x - at(i);
            bend = bend * step + slope;
            slope = slope * step + value;
            value = value * step + newton_.col(i);
        }
        bend *= 2.0;
    }

  private:
    double at(int i) const { return nodes_[static_cast<std::size_t>(i)]; }

    std::vector<double> nodes_;
    Matrix newton_;
};

}  // namespace rg
