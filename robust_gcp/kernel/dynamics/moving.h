// How all bodies move, in one frame: the world's axes at a point near by. S of each velocity, X of the bodies that it
// is asked of, and what bodies take: as they are, then with all that they carry.
#pragma once

#include <algorithm>
#include <vector>

#include "abi.h"
#include "linalg/cells.h"
#include "tree/groups.h"
#include "tree/inertias.h"
#include "path/path.h"

namespace rg {

class Moving {
  public:
    std::vector<char> bears;            // by body: whether it carries parts
    std::vector<std::size_t> ways_at;   // where X of a body begins, one for each input of its part
    Cells<Twist> ways;
    Cells<Massive> massive;    // of each body, then with all that it carries
    Cells<Articulated> freed;  // of heirs: with parts that are carried moving freely
    Cells<Wrench> wrench;
    double kinetic = 0.0;

    // `composed`: parts whose bodies are put together joint by joint. X is that of all other bodies but those of
    // single joints, and of bodies that carry parts.
    Moving(const Description& d, const Path& path, const std::vector<Part>& parts, const std::vector<char>& composed)
        : path_(path), parts_(parts), armature_(d.armature, d.armature + d.nv) {
        const std::size_t n = path.chain.bodies.size();
        massive.resize(n), freed.resize(n), wrench.resize(n), V_.resize(n), A_.resize(n);
        axes_.resize(static_cast<std::size_t>(d.nv)), ways_at.resize(n);
        bears.assign(n, 0), heir_.assign(n, 0), seen_.assign(n, 0);
        for (const Part& part : parts) bears[part.root] = part.root > 0;
        std::size_t ways_end = 0, axes_end = 0;
        for (std::size_t i = 0; i < parts.size(); ++i) {
            axes_at_.push_back(axes_end);
            axes_end += parts[i].velocities.size();
            for (const int j : parts[i].joints) {
                ways_at[j] = ways_end;
                ways_end += parts[i].inputs.size();
                if (!composed[i]) seen_[j] = !parts[i].single();
                if (!bears[j]) continue;
                heir_[j] = 1;
                for (int p = j; composed[i] && p != parts[i].root; p = path.chain.bodies[p].parent) heir_[p] = 1;
            }
            for (const int j : parts[i].joints) seen_[j] = seen_[j] || heir_[j];
        }
        ways.resize(ways_end);
    }

    const Twist* X(int j) const { return ways.data() + ways_at[j]; }
    // Of a part's velocities.
    const Twist* S(std::size_t part) const { return axes_.data() + axes_at_[part]; }

    // The wrench that a body and what was handed down to it need for a motion.
    Wrench needed(int j, const Twist& motion) const { return heir_[j] ? freed[j] * motion : massive[j] * motion; }

    // What a body takes, and what was handed down to it, to one that carries it.
    void hand_down(int j, int to) {
        if (to == 0) return;
        if (heir_[j])
            freed[to] += freed[j];
        else if (heir_[to])
            freed[to].add(massive[j]);
        massive[to] += massive[j];
        wrench[to] += wrench[j];
    }

    // What an input that pushes a body so is not asked of it any more.
    void release(int j, const Wrench& push, double right) {
        freed[j].release(push);
        wrench[j] += right * push;
    }

    // Velocities, accelerations g and the wrenches that these take, where the chain is placed, for v.
    void move(const Chain& chain, Point& point, const double* g, const double* v) {
        const Vec near = chain.p[1];
        V_[0] = {};
        A_[0] = {Vec{} - chain.gravity, {}};
        double twice = 0.0;
        Twist* S = axes_.data();
        for (const Part& part : parts_)
            for (const int j : part.joints) {
                const Body& b = chain.bodies[j];
                const Vec from = chain.p[j] - near;
                twice += move(chain, b, j, from, g, v, S);
                if (seen_[j]) see(part, b, j, point, S);
                S += b.count;
                if (heir_[j]) freed[j] = {};
                if (!b.heavy) {
                    massive[j] = {}, wrench[j] = {};
                    continue;
                }
                const Massive own(b, chain.axes[j], from);
                const Twist V = V_[j];
                const Wrench momentum = own * V;
                twice += dot(V, momentum);
                Wrench taken = own * A_[j];
                taken.force += cross(V.angular, momentum.force);
                taken.moment += cross(V.angular, momentum.moment) + cross(V.linear, momentum.force);
                wrench[j] = taken, massive[j] = own;
                if (heir_[j]) freed[j].add(own);
            }
        kinetic = 0.5 * twice;
    }

  private:
    // S, V and A of a joint's body; returns twice the energy of its rotors.
    double move(const Chain& chain, const Body& b, int j, const Vec& from, const double* g, const double* v, Twist* S) {
        const auto along = [&](int i) -> Twist {
            const Vec axis = chain.axes[j][chain.freedoms[i].column];
            return chain.freedoms[i].turning ? Twist{cross(from, axis), axis} : Twist{axis, {}};
        };
        const Twist first = along(b.first), before = V_[b.parent];
        Twist own = v[b.first] * first, bent = g[b.first] * first;
        double twice = armature_[b.first] * v[b.first] * v[b.first];
        S[0] = first;
        for (int k = 1; k < b.count; ++k) {
            const int i = b.first + k;
            S[k] = along(i);
            own += v[i] * S[k];
            bent += g[i] * S[k];
            twice += armature_[i] * v[i] * v[i];
        }
        V_[j] = before + own;
        A_[j] = A_[b.parent] + bent + bracket(before, own);
        return twice;
    }

    // X of a body.
    void see(const Part& part, const Body& b, int j, Point& point, const Twist* S) {
        const std::size_t count = part.inputs.size();
        const double* G = point.G() + b.first * path_.layout.m;
        Twist* X = ways.data() + ways_at[j];
        const Twist* of_parent = ways.data() + ways_at[b.parent];
        for (std::size_t a = 0; a < count; ++a) {
            Twist sum = b.parent == part.root ? Twist{} : of_parent[a];
            for (int k = 0; k < b.count; ++k) sum += G[k * path_.layout.m + part.inputs[a]] * S[k];
            X[a] = sum;
        }
    }

    const Path& path_;
    const std::vector<Part>& parts_;
    const Cells<double> armature_;
    std::vector<char> heir_;  // what carries parts, and in composed parts what carries such a body
    std::vector<char> seen_;  // whether X is asked for
    std::vector<std::size_t> axes_at_;
    Cells<Twist> axes_, V_, A_;  // S part by part; by body
};

}  // namespace rg
