// Newton's method to a point of a cluster's mode; see maps/cluster/jet.py.
#pragma once

#include <cmath>
#include <memory>
#include <utility>

#include "linalg/dense.h"
#include "cluster/jet.h"
#include "cluster/space.h"

namespace rg {

// Newton on P φ = 0, Cᵀ x = y.
struct Newton {
    Vector x;
    double first = FAR;  // the size of the first correction
    Matrix rows;         // P K at x, which the space has factorised

    Newton(Space& space, Vector guess, const Matrix& C, const Vector& y, const Matrix& P) : x(std::move(guess)) {
        constexpr double CONVERGED = 3e-15, STAGNANT = 1e-11;
        constexpr int MAX_NEWTON = 12;
        const int nd = space.nd;
        double size = FAR, last = FAR;
        Vector& dx = space.dx;
        dx.resize(space.nv);
        for (int iteration = 0; iteration < MAX_NEWTON; ++iteration) {
            linearise(space, C, P);
            if (space.rows == nd)
                dx.head(nd) = space.phi;
            else
                dx.head(nd).noalias() = P * space.phi;
            dx.tail(space.m) = C.transpose().lazyProduct(x) - y;
            space.lu.solve(dx.data());
            size = dx.cwiseQuotient(space.balance).cwiseAbs().maxCoeff();  // rounding of φ turns short links far
            if (!(size < 1e3) || !dx.allFinite()) throw Lost{};
            if (iteration == 0) first = dx.cwiseAbs().maxCoeff();
            if (size < CONVERGED) return;  // so that K need not be asked for again
            x -= dx;
            if (size < STAGNANT && size > 0.3 * last) break;
            last = size;
        }
        if (!(size < 1e-9)) throw Lost{};
        linearise(space, C, P);
    }

    // The jet there.
    JetPtr jet(Space& space, const Chart& C, const std::shared_ptr<const Matrix>& P) const {
        return space.rows == space.nd ? jet_of(space, x, C, rows, P) : jet_at(space, x, C);
    }

  private:
    void linearise(Space& space, const Matrix& C, const Matrix& P) {
        if (space.rows == space.nd) {
            space.linear(x, space.phi, rows);
        } else {
            space.linear(x, space.phi, space.K);
            rows = times(P, space.K);
        }
        space.factor(rows, C);
    }
};

// Newton from a guess and the jet there.
inline std::pair<JetPtr, double> solved(Space& space, Vector guess, const Chart& C, const Vector& y,
                                        const std::shared_ptr<const Matrix>& P) {
    const Newton found(space, std::move(guess), *C, y, *P);
    return {found.jet(space, C, P), found.first};
}

// Sine of the largest angle between two tangent spaces.
inline double apart(const Jet& one, const Jet& other) {
    const Matrix T = other.tangent(), own = one.tangent();
    return Svd(Matrix(T - times(own, transposed_times(own, T)))).s[0];
}

}  // namespace rg
