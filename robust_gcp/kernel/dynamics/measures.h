// How far loops are open, and energies, along a motion: of the mechanism as it is described, whatever path was
// taken; all rows of φ, in the world's axes.
#pragma once

#include <cstdint>
#include <vector>

#include "abi.h"
#include "tree/chain.h"
#include "constraint/closures.h"
#include "dynamics/forces.h"
#include "tree/parts.h"

namespace rg {

class Measures {
  public:
    explicit Measures(const Description& d)
        : chain_(d), whole_(all_of(d, chain_)), closures_(d, chain_, whole_), forces_(d),
          armature_(d.armature, d.armature + d.nv) {}

    // max |φ| at q, NaN where it is not finite. Leaves the chain placed.
    double open(const double* q) {
        chain_.place(chain_.all, q);
        return closures_.residual(q);
    }

    // Kinetic and potential energy, J, where the chain was placed at q.
    double energy(const double* q, const double* v) {
        chain_.move(chain_.all, v);
        double twice = 0.0;
        for (std::size_t i = 0; i < armature_.size(); ++i) twice += armature_[i] * v[i] * v[i];
        for (const Body& b : chain_.bodies) {
            if (!b.heavy) continue;
            const auto j = static_cast<std::size_t>(&b - chain_.bodies.data());
            const Axes& axes = chain_.axes[j];
            const Vec &omega = chain_.omega[j], spin = axes.local(omega);
            const Vec velocity = chain_.u[j] + cross(omega, axes.turn(b.centre));
            twice += b.mass * dot(velocity, velocity) + dot(times_inertia(b.inertia, spin), spin);
        }
        return 0.5 * twice + gravity_energy(chain_) + forces_.energy(chain_, q);
    }

  private:
    Chain chain_;
    const Part whole_;
    Closures closures_;
    Forces forces_;
    const std::vector<double> armature_;
};

}  // namespace rg
