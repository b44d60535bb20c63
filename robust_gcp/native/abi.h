// What crosses the boundary between Python and the kernel: plain arrays in plain structs.
// Mirrored by structures.py; change VERSION with any change here.
#pragma once

#include <cstdint>

namespace rg {

constexpr std::int32_t VERSION = 5;

enum Reason : std::int32_t {
    DONE = 0,
    ZONE = 1,       // K_d is conditioned below the zone's threshold
    BRANCH = 2,     // Newton may have gone to another branch
    NEWTON = 3,     // Newton did not contract
    NON_FINITE = 4,
    INERTIA = 5,    // the reduced inertia is singular
    FORCE = 6,      // a point spring has no length
    TORQUE = 7,     // the torque callback failed
    PASSED = 8,     // a singular surface was passed on a bridge
    CHART = 9,      // an entry of J = G by dimensionless coordinates is large
};

// Reads q and v and writes τ in the request's shared buffers; nonzero stops the run.
using Torque = std::int32_t (*)(double t);

struct Description {
    std::int32_t joints, nq, nv, m;
    const std::int32_t* parent;         // (joints,), 0 is the ground, joints count from 1
    const std::int32_t* kind;           // (joints,): see joints.h
    const double* placement;            // (joints, 12): rotation row by row, translation
    const double* inertia;              // (joints, 10): mass, centre, inertia at the centre xx xy yy xz yz zz
    const double* armature;             // (nv,)
    const double* gravity;              // (3,)
    const std::int32_t* independent;    // (m,) in v
    const std::int32_t* independent_q;  // (m,) in q
    const double* size;                 // (nv,): makes a step dimensionless
    const double* turn;                 // (nv,): makes a step rotations, rad, or slides in lengths
    const double* own;                  // (1,): inertia of the joints' motions one by one at u = 1
    const double* scale;                // (nv,): column scale of K, 1 for independent ones
    std::int32_t closures, rows;
    const std::int32_t* closure_joint;  // (closures, 2)
    const double* closure_point;        // (closures, 6): the two origins in their joints' frames
    const std::int32_t* row_closure;    // (rows,), −1 for a row of a coupling
    const std::int32_t* row_axis;       // (rows,): world axis of a position row, or Sort in closures.h
    const double* row_weight;           // (rows,)
    const std::int32_t* row_terms;      // (rows + 1,): where the terms of each row begin
    const double* terms;                // (terms, 7): w, u in joint 1, n in joint 2
    std::int32_t couplings, coupling_width, coupling_further;
    const std::int32_t* coupling_at;    // (couplings, 5): row, first joint in q and v, second in q and v
    const double* coupling_curve;       // (couplings, coupling_width): P by rising power
    const std::int32_t* further_at;     // (coupling_further, 3): coupling, further joint in q and v
    const double* further_arm;          // (coupling_further,)
    std::int32_t blocks;
    const std::int32_t* block_start;    // (blocks + 1,)
    const std::int32_t* block_rows;     // (rows,)
    const std::int32_t* block_columns;  // (rows,) in v
    const double* reference;            // (blocks,)
    std::int32_t springs, lines, forces, works;
    const std::int32_t* spring_at;      // (springs, 2): in q and in v
    const double* spring;               // (springs, 2): stiffness, rest
    const double* damping;              // (nv,)
    const double* drive;                // (nv,)
    const std::int32_t* line_joint;     // (lines, 2)
    const double* line;                 // (lines, 9): two points, stiffness, rest length, damping
};

struct Table {  // a bridge for one coordinate: Chebyshev coefficients of q, dq/dx, d²q/dx², det
    std::int32_t orders, width, surfaces;
    const double* coefficients;  // (orders, width)
    const double* reference;     // (nv,)
    const double* before;        // the innermost nodes as points
    const double* after;
    const double* zeros;         // (surfaces,): where they are, from the origin
    double origin, left, right, center, unit, middle, half, pace;
};

struct Request {
    std::int64_t steps, every;
    const double* times;      // (steps + 1,)
    double zone;              // conditioning at which to stop
    std::int32_t same_branch;  // whether to check the branch
    const double* sizes;      // (nv,): 1 / unit of each velocity, 0 where J does not matter; or null
    double limit;             // largest entry of J up to which steps go on
    Torque torque;            // or null
    double* torque_q;         // (nq,), (nv,), (nv,): what the callback reads and writes
    double* torque_v;
    double* torque_tau;
    const Table* table;       // the bridge in use, or null
    double* x;                // state, in and out
    double* anchor;           // point at the state, in and out
    double* ydd;              // (m,), in and out
    double* tau;              // (nv,), in and out
    double* before;           // out: point, state and ÿ of the output before the last one
    double* safe;             // out: point, state of the last well-conditioned output
    double* q_out;            // outputs, one row every `every` steps; null where not wanted
    double* v_out;
    double* a_out;
    double* tau_out;
    double* energy_out;
    double* work_out;
    // results
    std::int64_t completed;   // steps
    std::int64_t safe_step;   // −1 where there was none
    std::int64_t rhs, newton, constraint_evaluations, force_evaluations, zone_evaluations;
    double power;             // in and out
    std::int32_t on_bridge;   // whether the table is still in use
    std::int32_t reason;
};

}  // namespace rg
