// Hermite interpolation in Newton's form; see maps/cluster/newton_form.py.
#pragma once

#include <cstddef>
#include <vector>

#include "dense.h"

namespace rg {

class NewtonForm {
  public:
    NewtonForm() = default;

    // Row i d + k of `data` is the k-th derivative at node i, of all functions.
    NewtonForm(const std::vector<double>& nodes, int d, const Matrix& data) : newton_(data.rows(), data.cols()) {
        const int n = static_cast<int>(nodes.size()) * d;
        for (int i = 0; i < n; ++i) nodes_.push_back(nodes[static_cast<std::size_t>(i / d)]);
        Matrix table(n, data.cols());
        for (int i = 0; i < n; ++i) table.row(i) = data.row(i - i % d);
        newton_.row(0) = table.row(0);
        double factorial = 1.0;
        for (int order = 1; order < n; ++order) {
            factorial *= order;
            for (int i = 0; i + order < n; ++i) {
                const double apart = at(i + order) - at(i);
                if (apart == 0.0)  // differences between equal nodes are derivatives
                    table.row(i) = data.row(i - i % d + order) / factorial;
                else
                    table.row(i) = (table.row(i + 1) - table.row(i)) / apart;
            }
            newton_.row(order) = table.row(0);
        }
    }

    // f, f′ and f″ at x.
    void evaluate(double x, Vector& value, Vector& slope, Vector& bend) const {
        const int n = static_cast<int>(nodes_.size());
        value = newton_.row(n - 1).transpose();
        slope = bend = Vector::Zero(newton_.cols());
        for (int i = n - 2; i >= 0; --i) {
            const double step = x - at(i);
            bend = bend * step + slope;
            slope = slope * step + value;
            value = value * step + newton_.row(i).transpose();
        }
        bend *= 2.0;
    }

  private:
    double at(int i) const { return nodes_[static_cast<std::size_t>(i)]; }

    std::vector<double> nodes_;
    Matrix newton_;
};

}  // namespace rg
