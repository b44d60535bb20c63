// Pinocchio's algorithms on the same tree: what the kernel's own are measured against.
#pragma once

#include <memory>

#include "abi.h"

namespace rg {

class RigidBodies {
  public:
    explicit RigidBodies(const Description& d);
    ~RigidBodies();

    // What a right-hand side asks of Pinocchio: computeJointJacobians, rnea twice, crba
    void right_hand_side(const double* q, const double* v);

  private:
    struct Pinocchio;
    std::unique_ptr<Pinocchio> pinocchio_;
};

}  // namespace rg
