// Springs, dampers, constant drives and point springs, see forces.py; potential energies.
#pragma once

#include <cmath>
#include <vector>

#include "abi.h"
#include "dynamics/arms.h"
#include "dynamics/pulls.h"
#include "linalg/cells.h"
#include "tree/chain.h"

namespace rg {

// What gravity has at the chain's placements, J.
inline double gravity_energy(const Chain& chain) {
    double energy = 0.0, mass = 0.0;
    for (std::size_t j = 1; j < chain.bodies.size(); ++j) {
        const Body& b = chain.bodies[j];
        energy -= b.mass * dot(chain.gravity, chain.p[j] + chain.axes[j].turn(b.centre));
        mass += b.mass;
    }
    return energy - mass * dot(chain.gravity, chain.ground);
}

class Forces {
  public:
    struct Spring {
        int q, v;
        double stiffness, rest;
    };
    struct Line {
        int joint[2];
        Vec at[2];
        double stiffness, rest, damping;
    };

    explicit Forces(const Description& d)
        : some_(d.forces != 0),
          damping_(d.damping, d.damping + d.nv),
          drive_(d.drive, d.drive + d.nv),
          pulls_(d) {
        for (int i = 0; i < d.springs; ++i)
            springs_.push_back({d.spring_at[2 * i], d.spring_at[2 * i + 1], d.spring[2 * i], d.spring[2 * i + 1]});
        for (int i = 0; i < d.lines; ++i) {
            const double* x = d.line + 9 * i;
            lines_.push_back({{d.line_joint[2 * i], d.line_joint[2 * i + 1]},
                              {{x[0], x[1], x[2]}, {x[3], x[4], x[5]}},
                              x[6], x[7], x[8]});
        }
    }

    bool some() const { return some_; }
    const Cells<double>& damping() const { return damping_; }
    const std::vector<Spring>& springs() const { return springs_; }
    const std::vector<Line>& lines() const { return lines_; }

    // τ (nv,) and the power of dampers and drives; false where a point spring has no direction.
    bool at(const Chain& chain, const double* q, const double* v, double* tau, double& power) {
        power = 0.0;
        for (std::size_t i = 0; i < damping_.size(); ++i) {
            tau[i] = drive_[i] - damping_[i] * v[i];
            power += tau[i] * v[i];
        }
        for (const Spring& s : springs_) tau[s.v] -= s.stiffness * (q[s.q] - s.rest);
        for (const Line& line : lines_) {
            Vec at[2], velocity;
            for (int end = 0; end < 2; ++end) at[end] = point(chain, line, end);
            const Vec along = at[1] - at[0];
            const double length = std::sqrt(dot(along, along));
            if (length == 0.0) {
                if (line.rest > 0.0 || line.damping > 0.0) return false;
                continue;
            }
            const Vec u = (1.0 / length) * along;
            double tension = line.stiffness * (length - line.rest);
            if (line.damping > 0.0) {
                double speed = 0.0;
                for (int end = 0; end < 2; ++end)
                    over_freedoms(chain, line.joint[end], at[end], u,
                                  [&](int i, double rate) { speed += (end == 1 ? rate : -rate) * v[i]; });
                tension += line.damping * speed;
                power -= line.damping * speed * speed;
            }
            for (int end = 0; end < 2; ++end)
                over_freedoms(chain, line.joint[end], at[end], u,
                              [&](int i, double rate) { tau[i] -= (end == 1 ? tension : -tension) * rate; });
        }
        if (pulls_.some()) pulls_.act(chain, q, v, tau, power);
        return true;
    }

    // Adds τ of actuators and their power.
    void drive(const Chain& chain, const double* q, const double* v, const double* control, double* tau, double& power) {
        pulls_.drive(chain, q, v, control, tau, power);
    }

    // Potential energy of the springs, J.
    double energy(const Chain& chain, const double* q) {
        double energy = pulls_.some() ? pulls_.energy(chain, q) : 0.0;
        for (const Spring& s : springs_) {
            const double stretch = q[s.q] - s.rest;
            energy += 0.5 * s.stiffness * stretch * stretch;
        }
        for (const Line& line : lines_) {
            const Vec along = point(chain, line, 1) - point(chain, line, 0);
            const double stretch = std::sqrt(dot(along, along)) - line.rest;
            energy += 0.5 * line.stiffness * stretch * stretch;
        }
        return energy;
    }

    static Vec point(const Chain& chain, const Line& line, int end) {
        const int j = line.joint[end];
        return chain.p[j] + chain.axes[j].turn(line.at[end]);
    }

  private:
    bool some_;
    Cells<double> damping_, drive_;
    std::vector<Spring> springs_;
    std::vector<Line> lines_;
    Pulls pulls_;
};

}  // namespace rg
