// More right sides of a tree that was swept (sweep.h), by wrenches and twists: at the same cost for each input, however
// many carry it, where tree_factor.h goes from input to input.
#pragma once

#include <algorithm>
#include <vector>

#include "linalg/cells.h"
#include "tree/inertias.h"
#include "tree/parts.h"
#include "dynamics/tree_factor.h"

namespace rg {

class TreeRound {
  public:
    // `m`: inputs of all parts.
    explicit TreeRound(std::size_t m) : columns_(3 * m) {}

    // (Gᵀ M G)⁻¹ of rows (m, 3m) that are `apart`, in y.
    void solve(const std::vector<Part>& parts, const Swept& swept, const std::vector<std::size_t>& ways_at,
               const std::vector<char>& bears, double* rows, std::size_t apart) {
        const std::size_t width = columns_;
        const auto row = [&](const Part& part, int a) { return rows + static_cast<std::size_t>(part.inputs[a]) * apart; };
        const auto of = [&](int body) { return more_.data() + static_cast<std::size_t>(body) * 6 * width; };
        const auto take = [width](double* from, double share, const double* x) {
            if (share == 0.0) return;
            for (std::size_t c = 0; c < width; ++c) from[c] -= share * x[c];
        };
        more_.assign(bears.size() * 6 * width, 0.0);  // wrenches
        for (std::size_t i = parts.size(); i-- > 0;) {
            const Part& part = parts[i];
            const int count = part.count();
            const double* U = swept.factors + swept.factors_at[i];
            for (int j : part.joints) {
                if (!bears[j]) continue;
                for (int a = 0; a < count; ++a) {
                    const Twist& X = swept.ways[ways_at[j] + a];
                    for (int k = 0; k < 6; ++k) take(row(part, a), k < 3 ? X.linear[k] : X.angular[k - 3], of(j) + k * width);
                }
                if (part.root > 0)
                    for (int k = 0; k < 6; ++k) take(of(part.root) + k * width, -1.0, of(j) + k * width);
            }
            for (int a = 0; a < count; ++a) {
                for (int b = 0; b < a; ++b) take(row(part, a), U[b * count + a], row(part, b));
                for (double *x = row(part, a), *end = x + width; x != end; ++x) *x *= U[a * count + a];
                if (part.root == 0) continue;
                const Wrench& push = swept.push[part.first + a];
                for (int k = 0; k < 6; ++k)
                    take(of(part.root) + k * width, k < 3 ? -push.force[k] : -push.moment[k - 3], row(part, a));
            }
        }
        for (std::size_t i = 0; i < parts.size(); ++i) {  // twists
            const Part& part = parts[i];
            const int count = part.count();
            const double* U = swept.factors + swept.factors_at[i];
            for (int a = count; a-- > 0;) {
                const Wrench& push = swept.push[part.first + a];
                if (part.root > 0)
                    for (int k = 0; k < 6; ++k)
                        take(row(part, a), k < 3 ? push.force[k] : push.moment[k - 3], of(part.root) + k * width);
                for (int b = a + 1; b < count; ++b) take(row(part, a), U[a * count + b], row(part, b));
                for (double *x = row(part, a), *end = x + width; x != end; ++x) *x *= U[a * count + a];
            }
            for (int j : part.joints) {
                if (!bears[j]) continue;
                if (part.root > 0)
                    std::copy(of(part.root), of(part.root) + 6 * width, of(j));
                else
                    std::fill(of(j), of(j) + 6 * width, 0.0);
                for (int a = 0; a < count; ++a) {
                    const Twist& X = swept.ways[ways_at[j] + a];
                    for (int k = 0; k < 6; ++k) take(of(j) + k * width, k < 3 ? -X.linear[k] : -X.angular[k - 3], row(part, a));
                }
            }
        }
    }

  private:
    std::size_t columns_;
    Cells<double> more_;  // by body: wrenches, then twists
};

}  // namespace rg
