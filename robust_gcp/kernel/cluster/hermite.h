// The curve through solved points of a mode of mobility 1, and the same as Chebyshev series.
#pragma once

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>
#include <vector>

#include "cluster/jet.h"
#include "linalg/newton_form.h"

namespace rg {

// The places of the sorted values.
inline std::vector<std::size_t> order_of(const std::vector<double>& values) {
    std::vector<std::size_t> order(values.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return values[a] < values[b]; });
    return order;
}

// One polynomial through x, J and Γ at the nodes.
struct Hermite {
    std::vector<double> us;  // ascending
    std::vector<JetPtr> nodes;

    Hermite() = default;
    Hermite(const std::vector<double>& at, const std::vector<JetPtr>& jets) {
        for (const std::size_t i : order_of(at)) us.push_back(at[i]), nodes.push_back(jets[i]);
        const auto n = static_cast<Eigen::Index>(us.size());
        middle_ = std::accumulate(us.begin(), us.end(), 0.0) / static_cast<double>(n);
        half_ = 0.5 * (us.back() - us.front());
        Matrix data(nodes[0]->x.size(), 3 * n);
        std::vector<double> units;
        for (Eigen::Index i = 0; i < n; ++i) {
            const Jet& node = *nodes[static_cast<std::size_t>(i)];
            data.col(3 * i) = node.x;
            data.col(3 * i + 1) = half_ * node.J.col(0);
            data.col(3 * i + 2) = half_ * half_ * node.bend.col(0);
            units.push_back((us[static_cast<std::size_t>(i)] - middle_) / half_);
        }
        form_ = NewtonForm(units, 3, data);
    }

    // Whether u lies between the outermost nodes, where the polynomial still holds.
    bool reaches(double u) const { return us.front() - 1e-9 <= u && u <= us.back() + 1e-9; }

    void evaluate(double u, Vector& x, Vector& slope, Vector& bend) const {
        form_.evaluate((u - middle_) / half_, x, slope, bend);
        slope /= half_;
        bend /= half_ * half_;
    }

    void component(int c, double u, double& x, double& slope) const {
        form_.component(c, (u - middle_) / half_, x, slope);
        slope /= half_;
    }

  private:
    double middle_ = 0.0, half_ = 1.0;
    NewtonForm form_;
};

// x, x′ and x″ between two places as Chebyshev series.
class Series {
  public:
    Series() = default;
    Series(Matrix table, double left, double right)
        : middle_(0.5 * (left + right)), half_(0.5 * (right - left)), table_(std::move(table)) {}
    Series(const Hermite& through, double left, double right)
        : middle_(0.5 * (left + right)), half_(0.5 * (right - left)) {
        const auto n = static_cast<Eigen::Index>(3 * through.us.size());
        const Eigen::Index nv = through.nodes[0]->x.size();
        Matrix values(3 * nv, n), cosines(n, n);
        Vector x, slope, bend;
        for (Eigen::Index j = 0; j < n; ++j) {
            const double angle = PI * (static_cast<double>(j) + 0.5) / static_cast<double>(n);
            through.evaluate(middle_ + half_ * std::cos(angle), x, slope, bend);
            values.col(j) << x, slope, bend;
            for (Eigen::Index k = 0; k < n; ++k)
                cosines(j, k) = (k ? 2.0 : 1.0) / static_cast<double>(n) * std::cos(static_cast<double>(k) * angle);
        }
        table_ = values * cosines;
    }

    void evaluate(double u, Vector& x, Vector& slope, Vector& bend) const {
        const Eigen::Index nv = table_.rows() / 3;
        const double s = (u - middle_) / half_;
        Vector sum = table_.col(0);
        double last = 1.0, term = s;
        for (Eigen::Index k = 1; k < table_.cols(); ++k) {
            sum += term * table_.col(k);
            const double next = 2.0 * s * term - last;
            last = term, term = next;
        }
        x = sum.head(nv), slope = sum.segment(nv, nv), bend = sum.tail(nv);
    }

    void component(int c, double u, double& x, double& slope) const {
        const Eigen::Index nv = table_.rows() / 3;
        const double s = (u - middle_) / half_;
        double last = 1.0, term = s;
        x = table_(c, 0), slope = table_(nv + c, 0);
        for (Eigen::Index k = 1; k < table_.cols(); ++k) {
            x += term * table_(c, k);
            slope += term * table_(nv + c, k);
            const double next = 2.0 * s * term - last;
            last = term, term = next;
        }
    }

    const Matrix& table() const { return table_; }
    double left() const { return middle_ - half_; }
    double right() const { return middle_ + half_; }

  private:
    double middle_ = 0.0, half_ = 1.0;
    Matrix table_;  // (3 nv, orders)
};

}  // namespace rg
