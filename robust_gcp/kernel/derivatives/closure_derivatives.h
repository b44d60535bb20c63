// How closures and the wrenches of their reactions change when the bodies are displaced, and their velocities and
// accelerations with them.
//
// Along a direction, a body that is displaced by the twist X has the velocity V + [X, V] + P and the acceleration
// A + [X, A] + [P, V] + Q: what is carried along turns as a whole, P and Q come on top. So P and Q are the same for
// all bodies that another one carries.
#pragma once

#include <cstddef>
#include <vector>

#include "constraint/closures.h"
#include "tree/groups.h"

namespace rg {

struct Change {
    Twist X, P, Q;
};

// A point or direction that is fixed to a body, and its rates.
struct Moved {
    Vec x, d, dd;
};

inline Vec at(const Twist& v, const Vec& p) { return v.linear + cross(v.angular, p); }

inline Moved point_moved(const Vec& p, const Twist& V, const Twist& A) {
    const Vec d = at(V, p);
    return {p, d, at(A, p) + cross(V.angular, d)};
}

inline Moved direction_moved(const Vec& n, const Twist& V, const Twist& A) {
    const Vec d = cross(V.angular, n);
    return {n, d, cross(A.angular, n) + cross(V.angular, d)};
}

inline Moved point_changed(const Moved& p, const Change& c) {
    return {at(c.X, p.x), cross(c.X.angular, p.d) + at(c.P, p.x),
            cross(c.X.angular, p.dd) + at(c.Q, p.x) + 2.0 * cross(c.P.angular, p.d)};
}

inline Moved direction_changed(const Moved& n, const Change& c) {
    const Vec &X = c.X.angular, &P = c.P.angular;
    return {cross(X, n.x), cross(X, n.d) + cross(P, n.x),
            cross(X, n.dd) + cross(c.Q.angular, n.x) + 2.0 * cross(P, n.d)};
}

inline Moved operator-(const Moved& a, const Moved& b) { return {a.x - b.x, a.d - b.d, a.dd - b.dd}; }

// Changes of the first and of the second rate of a · b.
inline double rate_changed(const Moved& a, const Moved& b, const Moved& da, const Moved& db) {
    return dot(da.d, b.x) + dot(a.d, db.x) + dot(da.x, b.d) + dot(a.x, db.d);
}

inline double second_rate_changed(const Moved& a, const Moved& b, const Moved& da, const Moved& db) {
    return dot(da.dd, b.x) + dot(a.dd, db.x) + dot(da.x, b.dd) + dot(a.x, db.dd) + 2.0 * (dot(da.d, b.d) + dot(a.d, db.d));
}

// One closure at a point of a motion, in the world's axes.
class LoopMoved {
  public:
    LoopMoved(const Closures& closures, const Loop& loop) : loop(loop), closures_(closures) {
        for (int i = 0; i < loop.rows; ++i) terms_.resize(terms_.size() + row(i).terms.size());
    }

    const Loop& loop;

    // Takes up where the bodies are and how they move. `turned` are the axes that rows are along: the world's, but
    // of a root that the closure takes to stand still.
    void place(const Chain& chain, const Vec& near, const Axes& turned, const Twist* V, const Twist* A) {
        turned_ = turned;
        for (int side = 0; side < 2; ++side) {
            const int j = loop.joint[side];
            ends_[side] = point_moved(chain.p[j] + chain.axes[j].turn(loop.point[side]) - near, V[j], A[j]);
        }
        const int first = loop.joint[0], second = loop.joint[1];
        std::size_t term = 0;
        for (int i = 0; i < loop.rows; ++i)
            for (const Term& t : row(i).terms)
                terms_[term++] = {direction_moved(chain.axes[first].turn(t.u), V[first], A[first]),
                                  direction_moved(chain.axes[second].turn(t.n), V[second], A[second])};
    }

    // Changes of φ̇, or of φ̈, by the description's number of each row.
    template <bool SECOND>
    void rows_changed(const Change* change, double* rows) const {
        const auto product = [](const Moved& a, const Moved& b, const Moved& da, const Moved& db) {
            return SECOND ? second_rate_changed(a, b, da, db) : rate_changed(a, b, da, db);
        };
        const Moved apart = ends_[0] - ends_[1];
        const Moved moved = point_changed(ends_[0], change[0]) - point_changed(ends_[1], change[1]);
        std::size_t term = 0;
        for (int i = 0; i < loop.rows; ++i) {
            double sum = row(i).axis >= 0 ? dot(axis(i), SECOND ? moved.dd : moved.d) : 0.0;
            for (const Term& t : row(i).terms) {
                const Pair& pair = terms_[term++];
                const Moved n = direction_changed(pair.n, change[1]);
                sum += row(i).axis == ALONG ? product(apart, pair.n, moved, n)
                                            : t.w * product(pair.u, pair.n, direction_changed(pair.u, change[0]), n);
            }
            rows[closures_.number(loop, i)] = row(i).weight * sum;
        }
    }

    // Wrenches of the reactions λ on the two bodies, and how a displacement X of these changes them.
    template <typename W>
    void reactions(const double* lambda, W* on) const {
        each_reaction(lambda, [&](const Vec& f, const Vec& moment, int second) {
            on[0] += W{f, cross(ends_[0].x, f) + moment};
            on[1] += W{-1.0 * f, -1.0 * (cross(ends_[second].x, f) + moment)};
        });
    }

    template <typename W>
    void reactions_changed(const double* lambda, const Change* change, W* on) const {
        Vec moved[2];
        for (int side = 0; side < 2; ++side) moved[side] = at(change[side].X, ends_[side].x);
        std::size_t term = 0;
        for (int i = 0; i < loop.rows; ++i) {
            const double size = lambda[closures_.number(loop, i)] * row(i).weight;
            if (row(i).axis >= 0) {
                const Vec f = size * axis(i);
                on[0] += W{{}, cross(moved[0], f)};
                on[1] += W{{}, cross(moved[1], -1.0 * f)};
            }
            for (const Term& t : row(i).terms) {
                const Pair& pair = terms_[term++];
                const Vec n = cross(change[1].X.angular, pair.n.x);
                W turned;
                if (row(i).axis == ALONG) {
                    turned = W{size * n, size * (cross(moved[0], pair.n.x) + cross(ends_[0].x, n))};
                } else {
                    const Vec u = cross(change[0].X.angular, pair.u.x);
                    turned = W{{}, (size * t.w) * (cross(u, pair.n.x) + cross(pair.u.x, n))};
                }
                on[0] += turned;
                on[1] += W{-1.0 * turned.force, -1.0 * turned.moment};
            }
        }
    }

  private:
    struct Pair {
        Moved u, n;
    };

    const Row& row(int i) const { return closures_.row(loop, i); }

    Vec axis(int i) const { return turned_[row(i).axis]; }

    // Visits each row's force and moment on the first body, and at which end the force acts on the second.
    template <typename Visit>
    void each_reaction(const double* lambda, Visit visit) const {
        std::size_t term = 0;
        for (int i = 0; i < loop.rows; ++i) {
            const double size = lambda[closures_.number(loop, i)] * row(i).weight;
            if (row(i).axis >= 0) visit(size * axis(i), Vec{}, 1);
            for (const Term& t : row(i).terms) {
                const Pair& pair = terms_[term++];
                if (row(i).axis == ALONG)
                    visit(size * pair.n.x, Vec{}, 0);
                else
                    visit(Vec{}, (size * t.w) * cross(pair.u.x, pair.n.x), 1);
            }
        }
    }

    const Closures& closures_;
    Axes turned_;
    Moved ends_[2];
    std::vector<Pair> terms_;
};

}  // namespace rg
