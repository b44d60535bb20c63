// One line across a singular surface: a mode's jets at its nodes, and between them by Hermite's polynomials; see
// maps/cluster/line.py.
#pragma once

#include <memory>
#include <utility>
#include <vector>

#include "cluster/hermite.h"
#include "cluster/jet.h"
#include "linalg/newton_form.h"

namespace rg {

struct Line {
    Space* space;
    Chart C;
    Vector d;
    Matrix basis;  // orthonormal, its first direction d

    Line(Space& where, Chart chart, Vector way) : space(&where), C(std::move(chart)), d(std::move(way)) {
        Matrix beside(d.size(), d.size() + 1);
        beside << d, Matrix::Identity(d.size(), d.size());
        basis = orthonormal(beside);
    }

    // x by Hermite in (x, J d, Γ[d, d]), J in (J, Γ[d, ·]); Γ by values, its parts along d from these.
    JetPtr at(const std::vector<double>& ss, const std::vector<JetPtr>& jets, double s) const {
        const Eigen::Index m = d.size(), nv = space->nv;
        const auto n = static_cast<Eigen::Index>(ss.size());
        const auto order = order_of(ss);
        double center = 0.0;
        for (const double one : ss) center += one / static_cast<double>(n);
        double half = 0.5 * (ss[order.back()] - ss[order.front()]);
        if (half == 0.0) half = 1.0;
        std::vector<double> units;
        Matrix x_data(nv, 3 * n), J_data(m * nv, 2 * n), bend_data(m * m * nv, n), along(nv, m);
        double sigma = 0.0;
        std::shared_ptr<const Matrix> P;
        for (Eigen::Index i = 0; i < n; ++i) {
            const std::size_t at = order[static_cast<std::size_t>(i)];
            const Jet& node = *jets[at];
            units.push_back((ss[at] - center) / half);
            along.setZero();  // Γ[d, ·]
            for (Eigen::Index a = 0; a < m; ++a) along += d[a] * node.bend.middleCols(a * m, m);
            x_data.col(3 * i) = node.x;
            x_data.col(3 * i + 1) = half * node.J.lazyProduct(d);
            x_data.col(3 * i + 2) = half * half * along.lazyProduct(d);
            J_data.col(2 * i) = node.J.reshaped();
            J_data.col(2 * i + 1) = half * along.reshaped();
            bend_data.col(i) = node.bend.reshaped();
            if (P == nullptr || (space->rows != space->nd && node.sigma() > sigma))  // else any serves
                sigma = space->rows != space->nd ? node.sigma() : 0.0, P = node.P;
        }
        const double z = (s - center) / half;
        auto made = std::make_shared<Jet>();
        made->space = space, made->C = C, made->P = P;
        Vector slope, bent, J, rates, none, values;
        NewtonForm(units, 3, x_data).evaluate(z, made->x, slope, bent);
        NewtonForm(units, 2, J_data).evaluate(z, J, rates, none);
        NewtonForm(units, 1, bend_data).evaluate(z, values, none, none);
        made->J = J.reshaped(nv, m);
        // in a basis whose first direction is d, the parts along d are derivatives of what is known better
        const double length = basis.col(0).dot(d);
        const Matrix row = times(rates.reshaped(nv, m), basis) / (half * length);
        Matrix turned = Matrix::Zero(nv, m * m);
        const auto bend = values.reshaped(nv, m * m);
        for (Eigen::Index a = 0; a < m; ++a)
            for (Eigen::Index b = 0; b < m; ++b) {
                auto sum = turned.col(a * m + b);
                if (a == 0 && b == 0)
                    sum = bent / (half * half * length * length);
                else if (a == 0 || b == 0)
                    sum = row.col(a + b);
                else
                    for (Eigen::Index i = 0; i < m; ++i)
                        for (Eigen::Index j = 0; j < m; ++j) sum += basis(i, a) * basis(j, b) * bend.col(i * m + j);
            }
        made->bend = Matrix::Zero(nv, m * m);
        for (Eigen::Index i = 0; i < m; ++i)
            for (Eigen::Index j = 0; j < m; ++j)
                for (Eigen::Index a = 0; a < m; ++a)
                    for (Eigen::Index b = 0; b < m; ++b)
                        made->bend.col(i * m + j) += basis(i, a) * basis(j, b) * turned.col(a * m + b);
        return made;
    }
};

}  // namespace rg
