// Constraint forces: λ with Kᵀ λ = M a + C − τ, the shortest one where rows are redundant; see dynamics/equations.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "abi.h"
#include "constraint/closures.h"
#include "dynamics/inverse.h"
#include "linalg/dense.h"
#include "tree/chain.h"
#include "tree/parts.h"

namespace rg {

constexpr double STRUCTURAL = 1e-9, UNBALANCED = 1e-6;  // as in tolerances.py and equations.py

class Reactions {
  public:
    // Of all rows, in their own units; the scales make K dimensionless.
    Reactions(const Description& d, const double* row_scale, const double* column_scale)
        : chain_(d), parts_(d, chain_), inverse_(d, chain_.bodies.size()), nv_(d.nv), rows_(d.rows),
          row_scale_(row_scale), column_scale_(column_scale), still_(d.nv), bias_(d.nv), force_(d.nv) {
        std::vector<int> row_at(rows_);
        for (const Part& part : parts_.list) {
            if (!part.tied()) continue;
            Tied tied{&part, Closures(d, chain_, part), {}, {}};
            for (const Entry& e : tied.closures.entries)
                if (std::find(tied.rows.begin(), tied.rows.end(), e.row) == tied.rows.end()) tied.rows.push_back(e.row);
            for (std::size_t i = 0; i < tied.rows.size(); ++i) row_at[tied.rows[i]] = static_cast<int>(i);
            for (const Entry& e : tied.closures.entries) {
                const auto at = std::find(part.velocities.begin(), part.velocities.end(), e.v);
                tied.places.push_back({static_cast<int>(at - part.velocities.begin()), row_at[e.row]});
            }
            tied_.push_back(std::move(tied));
        }
    }

    // λ (rows,) at a state, or NaN where no λ balances it; tau (nv,) may be null.
    void at(const double* q, const double* v, const double* a, const double* tau, double* multipliers) {
        chain_.place(chain_.all, q);
        inverse_.at(chain_, v, a, force_.data());
        inverse_.at(chain_, v, still_.data(), bias_.data());
        double size = 0.0, left = 0.0;
        for (int i = 0; i < nv_; ++i) {
            const double acting = tau == nullptr ? 0.0 : tau[i];
            for (const double part : {force_[i], bias_[i], acting})
                size = std::max(size, std::fabs(column_scale_[i] * part));
            force_[i] = column_scale_[i] * (force_[i] - acting);
        }
        std::fill(multipliers, multipliers + rows_, 0.0);
        for (const Part& part : parts_.list)
            for (const int i : part.velocities)
                if (!part.tied()) left = std::max(left, std::fabs(force_[i]));
        for (Tied& tied : tied_) left = std::max(left, solve(tied, q, multipliers));
        if (!(left <= UNBALANCED * size))
            std::fill(multipliers, multipliers + rows_, std::numeric_limits<double>::quiet_NaN());
    }

  private:
    struct Place {  // of an entry in Kᵀ of its part
        int velocity, row;
    };
    struct Tied {
        const Part* part;
        Closures closures;
        std::vector<int> rows;
        std::vector<Place> places;
    };

    // A part's λ; returns what of the forces is left.
    double solve(Tied& tied, const double* q, double* multipliers) {
        Closures& closures = tied.closures;
        const std::vector<int>& velocities = tied.part->velocities;
        closures.residual(q);
        closures.jacobian();
        Matrix A = Matrix::Zero(static_cast<Eigen::Index>(velocities.size()), static_cast<Eigen::Index>(tied.rows.size()));
        for (std::size_t e = 0; e < tied.places.size(); ++e) {
            const Entry& entry = closures.entries[e];
            A(tied.places[e].velocity, tied.places[e].row) +=
                closures.values[e] * column_scale_[entry.v] / row_scale_[entry.row];
        }
        Vector b(A.rows());
        for (Eigen::Index i = 0; i < b.size(); ++i) b[i] = force_[velocities[static_cast<std::size_t>(i)]];
        const Vector x = shortest(A, b, STRUCTURAL);
        for (Eigen::Index i = 0; i < x.size(); ++i) {
            const int row = tied.rows[static_cast<std::size_t>(i)];
            multipliers[row] = x[i] / row_scale_[row];
        }
        return (b - A * x).cwiseAbs().maxCoeff();
    }

    Chain chain_;
    const Parts parts_;
    Inverse inverse_;
    const int nv_, rows_;
    const double *row_scale_, *column_scale_;
    std::vector<Tied> tied_;
    const Cells<double> still_;
    Cells<double> bias_, force_;
};

}  // namespace rg
