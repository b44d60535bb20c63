// Gᵀ M G by the velocities of all bodies in each column of G.
#pragma once

#include <vector>

#include "tree/chain.h"

namespace rg {

inline void reduced_inertia(const Description& d, Chain& chain, const double* q, const double* G, double* M) {
    struct Pace {
        Vec push, spin, velocity, turn;
    };
    const int m = d.m, nv = d.nv;
    std::vector<std::vector<Pace>> columns(m);
    std::vector<double> column(nv);
    chain.place(chain.all, q);
    for (int k = 0; k < m; ++k) {
        for (int i = 0; i < nv; ++i) column[i] = G[i * m + k];
        chain.move(chain.all, column.data());
        for (int j : chain.all) {
            const Body& body = chain.bodies[j];
            const Vec pace = chain.u[j] + cross(chain.omega[j], chain.axes[j].turn(body.centre));
            const Vec turn = chain.axes[j].local(chain.omega[j]);
            columns[k].push_back({body.mass * pace, times_inertia(body.inertia, turn), pace, turn});
        }
    }
    for (int k = 0; k < m; ++k)
        for (int l = 0; l < m; ++l) {
            double sum = 0.0;
            for (std::size_t j = 0; j < columns[k].size(); ++j)
                sum += dot(columns[k][j].push, columns[l][j].velocity) + dot(columns[k][j].spin, columns[l][j].turn);
            for (int i = 0; i < nv; ++i) sum += d.armature[i] * G[i * m + k] * G[i * m + l];
            M[k * m + l] = sum;
        }
}

}  // namespace rg
