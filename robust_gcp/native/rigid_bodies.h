// Pinocchio's algorithms on the same tree: M, C and steps on the configuration manifold.
#pragma once

#include <memory>

#include "abi.h"

namespace rg {

class RigidBodies {
  public:
    explicit RigidBodies(const Description& d);
    ~RigidBodies();

    // M(q) a + C(q, v), (nv,)
    void rnea(const double* q, const double* v, const double* a, double* tau);
    // M(q), (nv, nv), both triangles
    void crba(const double* q, double* M);
    // q ⊕ dv; `moved` must be another array than q
    void integrate(const double* q, const double* dv, double* moved);
    // What a right-hand side asks of Pinocchio: computeJointJacobians, rnea twice, crba
    void right_hand_side(const double* q, const double* v);

  private:
    struct Pinocchio;
    std::unique_ptr<Pinocchio> pinocchio_;
};

}  // namespace rg
