// Forces along paths: tendons' springs and dampers, and actuators under their controls or activations; see
// mechanism/actuation.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "abi.h"
#include "dynamics/arms.h"
#include "dynamics/wrapping.h"
#include "linalg/cells.h"
#include "tree/chain.h"

namespace rg {

enum Law { SPRING = 0, AFFINE = 1, MUSCLE = 2 };

// Gain and bias of a muscle, by c = lengths 2, range 2, force, lmin, lmax, vmax, fpmax, fvmax.
inline void muscle(const double* c, double length, double rate, double& gain, double& bias) {
    const double force = c[4], lmin = c[5], lmax = c[6], fvmax = c[9];
    const double best = (c[1] - c[0]) / std::max(TINY, c[3] - c[2]);
    const double L = c[2] + (length - c[0]) / std::max(TINY, best), V = rate / std::max(TINY, best * c[7]);
    const double a = 0.5 * (lmin + 1.0), b = 0.5 * (1.0 + lmax);
    double active = 0.0, x;
    if (L >= lmin && L <= lmax) {
        if (L <= a)
            x = (L - lmin) / std::max(TINY, a - lmin), active = 0.5 * x * x;
        else if (L <= b)
            x = (L - 1.0) / std::max(TINY, L <= 1.0 ? 1.0 - a : b - 1.0), active = 1.0 - 0.5 * x * x;
        else
            x = (lmax - L) / std::max(TINY, lmax - b), active = 0.5 * x * x;
    }
    const double most = fvmax - 1.0;
    double fast = fvmax;
    if (V <= -1.0)
        fast = 0.0;
    else if (V <= 0.0)
        fast = (V + 1.0) * (V + 1.0);
    else if (V <= most)
        fast = fvmax - (most - V) * (most - V) / std::max(TINY, most);
    double passive = 0.0;
    if (L > 1.0) {
        x = (std::min(L, b) - 1.0) / std::max(TINY, b - 1.0);
        passive = c[8] * (0.5 * x * x + std::max(L - b, 0.0) / std::max(TINY, b - 1.0));
    }
    gain = -force * active * fast;
    bias = -force * passive;
}

class Pulls {
  public:
    explicit Pulls(const Description& d) : arm_(d.nv), total_(d.nv), effort_(d.effort, d.effort + (d.pulls ? 2 * d.nv : 0)) {
        for (int i = 0; i < d.paths; ++i) paths_.push_back(path_of(d, i));
        for (int i = 0; i < d.pulls; ++i) {
            const std::int32_t* at = d.pull_at + 4 * i;
            const double* x = d.pull + 15 * i;
            Pull pull{at[0], at[1], at[2], at[3], x[0], {}, x[11], x[12], x[13], x[14], {}};
            std::copy(x + 1, x + 11, pull.c);
            pull.arms.resize(paths_[pull.path].velocities.size());
            groups_ = std::max(groups_, pull.group + 1);
            (pull.law == SPRING ? springs_ : actuators_).push_back(pull);
        }
        sums_.resize(static_cast<std::size_t>(groups_));
    }

    bool some() const { return !springs_.empty(); }

    // Adds τ of springs and dampers, and the power of the dampers.
    void act(const Chain& chain, const double* q, const double* v, double* tau, double& power) {
        for (Pull& s : springs_) {
            const double length = measure(s, chain, q), rate = rate_of(s, v);
            const double force = -s.c[0] * stretch(s, length) - s.c[3] * rate;
            power -= s.c[3] * rate * rate;
            add(s, force, tau);
        }
    }

    // Adds τ of the actuators under their controls or activations, and their power; none where these are no numbers.
    void drive(const Chain& chain, const double* q, const double* v, const double* control, double* tau, double& power) {
        if (actuators_.empty() || std::isnan(control[0])) return;
        std::fill(total_.begin(), total_.end(), 0.0);
        std::fill(sums_.begin(), sums_.end(), 0.0);
        for (Pull& p : actuators_) {
            const double length = measure(p, chain, q), rate = rate_of(p, v);
            double gain = p.c[0] + p.c[1] * length + p.c[2] * rate, bias = p.c[3] + p.c[4] * length + p.c[5] * rate;
            if (p.law == MUSCLE) muscle(p.c, length, rate, gain, bias);
            p.force = gain * control[p.control] + bias;
            if (p.group >= 0) sums_[p.group] += p.force;
        }
        for (Pull& p : actuators_) {
            if (p.group >= 0) {
                const double sum = sums_[p.group], most = std::min(std::max(sum, p.group_low), p.group_high);
                if (sum != most) p.force *= most / sum;
            }
            add(p, std::min(std::max(p.force, p.low), p.high), total_.data());
        }
        for (std::size_t i = 0; i < total_.size(); ++i) {
            const double share = std::min(std::max(total_[i], effort_[2 * i]), effort_[2 * i + 1]);
            tau[i] += share;
            power += share * v[i];
        }
    }

    // Potential energy of the springs, J.
    double energy(const Chain& chain, const double* q) {
        double energy = 0.0;
        for (Pull& s : springs_) {
            const double x = stretch(s, measure(s, chain, q));
            energy += 0.5 * s.c[0] * x * x;
        }
        return energy;
    }

  private:
    struct Term {
        int q, v;
        double arm;
    };
    struct Stretch {
        int joint[2];
        Vec at[2];
        double share;
        int wrap, on, beside;  // −1 none, 0 sphere, 1 cylinder; joints that carry it and the side's point, or −1
        double radius;
        Vec centre, side;
        Axes axes;
    };
    struct Path {
        std::vector<Term> terms;
        std::vector<Stretch> stretches;
        std::vector<int> velocities;
    };
    struct Pull {
        int path, law, control, group;
        double gear, c[10], low, high, group_low, group_high;
        std::vector<double> arms;  // gear ∂ℓ/∂q at the path's velocities
        double force = 0.0;
    };

    static Path path_of(const Description& d, int i) {
        const std::int32_t* at = d.path_at + 4 * i;
        Path path;
        std::vector<char> moves(static_cast<std::size_t>(d.nv), 0);
        for (int k = at[0]; k < at[0] + at[1]; ++k) {
            path.terms.push_back({d.arm_at[2 * k], d.arm_at[2 * k + 1], d.arm[k]});
            moves[path.terms.back().v] = 1;
        }
        const Chain chain(d);
        for (int k = at[2]; k < at[2] + at[3]; ++k) {
            const std::int32_t* j = d.stretch_at + 5 * k;
            const double* x = d.stretch + 23 * k;
            path.stretches.push_back({{j[0], j[1]}, {{x[1], x[2], x[3]}, {x[4], x[5], x[6]}}, x[0], j[2], j[3], j[4], x[7],
                                      {x[8], x[9], x[10]}, {x[20], x[21], x[22]},
                                      {{x[11], x[14], x[17]}, {x[12], x[15], x[18]}, {x[13], x[16], x[19]}}});
            for (int joint : {j[0], j[1], j[2] >= 0 ? j[3] : 0})
                over_freedoms(chain, joint, {}, {}, [&](int v, double) { moves[v] = 1; });
        }
        for (int v = 0; v < d.nv; ++v)
            if (moves[v]) path.velocities.push_back(v);
        return path;
    }

    static double stretch(const Pull& s, double length) { return length - std::min(std::max(length, s.c[1]), s.c[2]); }

    static Vec world(const Chain& chain, int joint, const Vec& at) { return chain.p[joint] + chain.axes[joint].turn(at); }

    // gear ℓ, and the arms.
    double measure(Pull& pull, const Chain& chain, const double* q) {
        const Path& path = paths_[pull.path];
        double length = 0.0;
        for (int v : path.velocities) arm_[v] = 0.0;
        for (const Term& term : path.terms) {
            length += term.arm * q[term.q];
            arm_[term.v] += term.arm;
        }
        for (const Stretch& s : path.stretches) length += s.share * along(s, chain);
        for (std::size_t k = 0; k < path.velocities.size(); ++k) pull.arms[k] = pull.gear * arm_[path.velocities[k]];
        return pull.gear * length;
    }

    double along(const Stretch& s, const Chain& chain) {
        const Vec start = world(chain, s.joint[0], s.at[0]), end = world(chain, s.joint[1], s.at[1]);
        if (s.wrap >= 0) {
            const Vec side = s.beside >= 0 ? world(chain, s.beside, s.side) : Vec();
            const Wrapped w = wrapped(start, end, world(chain, s.on, s.centre), chain.axes[s.on].turn(s.axes), s.radius,
                                      s.wrap == 1, s.beside >= 0 ? &side : nullptr);
            if (w.some)
                return straight(s, chain, s.joint[0], start, s.on, w.first) + w.length +
                       straight(s, chain, s.on, w.last, s.joint[1], end);
        }
        return straight(s, chain, s.joint[0], start, s.joint[1], end);
    }

    double straight(const Stretch& s, const Chain& chain, int a, const Vec& start, int b, const Vec& end) {
        const Vec way = end - start;
        const double length = std::sqrt(dot(way, way));
        if (length == 0.0 || a == b) return length;
        const Vec u = (1.0 / length) * way;
        over_freedoms(chain, b, end, u, [&](int v, double rate) { arm_[v] += s.share * rate; });
        over_freedoms(chain, a, start, u, [&](int v, double rate) { arm_[v] -= s.share * rate; });
        return length;
    }

    double rate_of(const Pull& pull, const double* v) const {
        const std::vector<int>& at = paths_[pull.path].velocities;
        double rate = 0.0;
        for (std::size_t k = 0; k < at.size(); ++k) rate += pull.arms[k] * v[at[k]];
        return rate;
    }

    void add(const Pull& pull, double force, double* tau) const {
        const std::vector<int>& at = paths_[pull.path].velocities;
        for (std::size_t k = 0; k < at.size(); ++k) tau[at[k]] += force * pull.arms[k];
    }

    Cells<double> arm_, total_, effort_;
    std::vector<double> sums_;
    std::vector<Path> paths_;
    std::vector<Pull> springs_, actuators_;
    int groups_ = 0;
};

}  // namespace rg
