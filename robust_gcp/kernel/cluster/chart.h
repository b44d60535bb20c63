// Which components may parametrise a mode; see maps/cluster/chart.py, which says why.
#pragma once

#include <cmath>
#include <vector>

#include "cluster/jet.h"
#include "linalg/dense.h"

namespace rg {

constexpr double CHANGE = 0.35;

// σ_min of the chosen rows of a tangent basis (nv, m).
inline double smallest(const Matrix& tangent, const std::vector<int>& chosen) {
    Matrix rows(tangent.cols(), tangent.cols());
    for (std::size_t i = 0; i < chosen.size(); ++i) rows.row(static_cast<Eigen::Index>(i)) = tangent.row(chosen[i]);
    return Svd(rows).s[tangent.cols() - 1];
}

// Whether the chosen components still parametrise the mode, to a share of how well the best ones do.
inline bool serves(const Jet& jet, const std::vector<int>& chosen, double share) {
    if (jet.J.cols() == 1)
        return std::fabs(jet.J(chosen[0], 0)) >= share * jet.J.col(0).cwiseAbs().maxCoeff();
    // those of J are the unit matrix: with J = Q R they are R⁻¹ in Q
    const double here = 1.0 / std::sqrt(Svd(transposed_times(jet.J, jet.J)).s[0]);
    if (here >= share) return true;
    const Matrix tangent = jet.tangent();
    return here >= share * smallest(tangent, best_rows(tangent));
}

// Whether a step in one chart led across a fold, where y turns back.
inline bool turned_over(const Jet& here, const Jet& there) { return determinant(transposed_times(here.J, there.J)) < 0.0; }

}  // namespace rg
