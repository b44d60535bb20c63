// How all bodies move, in one frame: the world's axes at a point near by. S of each velocity, X of the bodies that it
// is asked of, and what bodies take: as they are, then with all that they carry.
#pragma once

#include <algorithm>
#include <vector>

#include "abi.h"
#include "cells.h"
#include "groups.h"
#include "inertias.h"
#include "path.h"

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
    Moving(const Description& d, const Path& path, const std::vector<char>& composed)
        : path_(path), armature_(d.armature, d.armature + d.nv) {
        const std::vector<Part>& parts = path.parts.list;
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
                if (!composed[i]) seen_[j] = parts[i].velocities.size() > 1;
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

    // Velocities, accelerations at u̇ = 0 and the wrenches that these take, where the chain is placed, for v.
    void move(const Chain& chain, Point& point, const double* v) {
        const Vec near = chain.p[1];
        V_[0] = {};
        A_[0] = {Vec{} - chain.gravity, {}};
        double twice = 0.0;
        Twist* S = axes_.data();
        for (const Part& part : path_.parts.list)
            for (const int j : part.joints) {
                const Vec from = chain.p[j] - near;
                twice += move(chain, j, from, point, v, S);
                if (seen_[j]) see(part, j, point, S);
                S += chain.bodies[j].count;
                if (heir_[j]) freed[j] = {};
                if (!chain.bodies[j].heavy) {
                    massive[j] = {}, wrench[j] = {};
                    continue;
                }
                massive[j] = Massive(chain.bodies[j], chain.axes[j], from);
                if (heir_[j]) freed[j].add(massive[j]);
                const Wrench momentum = massive[j] * V_[j];
                twice += dot(V_[j], momentum);
                wrench[j] = massive[j] * A_[j];
                wrench[j].force += cross(V_[j].angular, momentum.force);
                wrench[j].moment += cross(V_[j].angular, momentum.moment) + cross(V_[j].linear, momentum.force);
            }
        kinetic = 0.5 * twice;
    }

  private:
    // S, V and A of a joint's body; returns twice the energy of its rotors.
    double move(const Chain& chain, int j, const Vec& from, Point& point, const double* v, Twist* S) {
        const double* g = point.g();
        const Body& b = chain.bodies[j];
        Twist own, bent;
        double twice = 0.0;
        for (int i = b.first; i < b.first + b.count; ++i, ++S) {
            const Vec& axis = chain.axes[j][chain.freedoms[i].column];
            *S = chain.freedoms[i].turning ? Twist{cross(from, axis), axis} : Twist{axis, {}};
            own += v[i] * *S;
            bent += g[i] * *S;
            twice += armature_[i] * v[i] * v[i];
        }
        V_[j] = V_[b.parent] + own;
        A_[j] = A_[b.parent] + bent + bracket(V_[b.parent], own);
        return twice;
    }

    // X of a body.
    void see(const Part& part, int j, Point& point, const Twist* S) {
        const Body& b = path_.chain.bodies[j];
        const std::size_t count = part.inputs.size();
        Twist* X = ways.data() + ways_at[j];
        if (b.parent == part.root)
            std::fill(X, X + count, Twist{});
        else
            std::copy(ways.data() + ways_at[b.parent], ways.data() + ways_at[b.parent] + count, X);
        for (int i = b.first; i < b.first + b.count; ++i, ++S)
            for (std::size_t a = 0; a < count; ++a) {
                const double turn = point.G()[i * path_.layout.m + part.inputs[a]];
                if (turn != 0.0) X[a] += turn * *S;
            }
    }

    const Path& path_;
    const Cells<double> armature_;
    std::vector<char> heir_;  // what carries parts, and in composed parts what carries such a body
    std::vector<char> seen_;  // whether X is asked for
    std::vector<std::size_t> axes_at_;
    Cells<Twist> axes_, V_, A_;  // S part by part; by body
};

}  // namespace rg
