// Hermite interpolation in Newton's form; see maps/cluster/interpolation.py.
#pragma once

#include <cstddef>
#include <vector>

#include "linalg/dense.h"

namespace rg {

class NewtonForm {
  public:
    NewtonForm() = default;

    // Column i d + k of `data` is the k-th derivative at node i, of all functions.
    NewtonForm(const std::vector<double>& nodes, int d, const Matrix& data)
        : nodes_(nodes.size() * static_cast<std::size_t>(d)), newton_(data.rows(), data.cols()) {
        const int n = static_cast<int>(nodes_.size());
        for (int i = 0; i < n; ++i) {
            nodes_[static_cast<std::size_t>(i)] = nodes[static_cast<std::size_t>(i / d)];
            newton_.col(i) = data.col(i - i % d);
        }
        double factorial = 1.0;
        for (int order = 1; order < n; ++order) {  // column i becomes the difference of the last nodes up to i
            factorial *= order;
            for (int i = n - 1; i >= order; --i) {
                const double apart = at(i) - at(i - order);
                if (apart == 0.0)  // differences between equal nodes are derivatives
                    newton_.col(i) = data.col(i - i % d + order) / factorial;
                else
                    newton_.col(i) = (newton_.col(i) - newton_.col(i - 1)) * (1.0 / apart);
            }
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

    // f and f′ of one of the functions.
    void component(int c, double x, double& value, double& slope) const {
        const int n = static_cast<int>(nodes_.size());
        value = newton_(c, n - 1), slope = 0.0;
        for (int i = n - 2; i >= 0; --i) {
            const double step = x - at(i);
            slope = slope * step + value;
            value = value * step + newton_(c, i);
        }
    }

  private:
    double at(int i) const { return nodes_[static_cast<std::size_t>(i)]; }

    std::vector<double> nodes_;
    Matrix newton_;
};

}  // namespace rg
