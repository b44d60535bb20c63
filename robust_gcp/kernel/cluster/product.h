// From the coordinates of a cluster to those of the whole mechanism; see maps/cluster/product.py.
#pragma once

#include "cluster/jet.h"
#include "linalg/dense.h"
#include "path/point.h"

namespace rg {

// The share in q, G and g of one with joints on groups. Where some of its y are in charts u are velocities, of
// which the chart's rates follow.
inline void turned(Space& space, const Jet& jet, const double* ydot, const Layout& l, Point& point) {
    space.write(jet.x, point.q());
    const Matrix T = space.turn(jet.x), along = times(T, jet.J);
    Matrix to_rate = Matrix::Zero(space.m, space.m);
    for (int j = 0; j < space.m; ++j) {
        if (space.charted())
            to_rate.row(j) = along.row(space.chosen[j]);
        else
            to_rate(j, j) = space.D[space.chosen[j]];
    }
    to_rate = inverse(to_rate);
    const Matrix own = times(along, to_rate);
    const auto bent = [&](const Vector& u) -> Vector {
        const Vector rate = to_rate * u, way = jet.J * rate;
        Vector left = T * jet.bent(rate, rate) + space.turn_rate(jet.x, way) * way;
        if (!space.charted()) return left;
        Vector at_chosen(space.m);
        for (int j = 0; j < space.m; ++j) at_chosen[j] = left[space.chosen[j]];
        left -= own * at_chosen;
        return left;
    };
    Vector u(space.m);
    for (int j = 0; j < space.m; ++j) u[j] = ydot[space.inputs[j]];
    const Vector bend = bent(u);
    for (int i = 0; i < space.nv; ++i) {
        point.g()[space.iv[i]] = bend[i];
        for (int j = 0; j < space.m; ++j) point.G()[space.iv[i] * l.m + space.inputs[j]] = own(i, j);
    }
    if (l.m > 1) return;
    const Vector once = bent(Vector::Ones(1));
    for (int i = 0; i < space.nv; ++i) point.curvature()[space.iv[i]] = once[i];
}

// The share in q, G and g of a cluster at a point of its mode.
inline void add_share(Space& space, const Jet& jet, const double* ydot, const Layout& l, Point& point) {
    if (!space.flat) {
        turned(space, jet, ydot, l, point);
        return;
    }
    Vector rate(space.m);
    for (int j = 0; j < space.m; ++j) rate[j] = ydot[space.inputs[j]] / space.D[space.chosen[j]];
    const Vector bend = jet.bent(rate, rate);
    for (int i = 0; i < space.nv; ++i) {
        const int v = space.iv[i];
        point.q()[space.iq[i]] = space.D[i] * jet.x[i];
        point.g()[v] = space.D[i] * bend[i];
        for (int j = 0; j < space.m; ++j)
            point.G()[v * l.m + space.inputs[j]] = space.D[i] * jet.J(i, j) / space.D[space.chosen[j]];
        if (l.m == 1) {
            const double unit = space.D[space.chosen[0]];
            point.curvature()[v] = space.D[i] * jet.bend(i, 0) / (unit * unit);
        }
    }
}

}  // namespace rg
