// What crosses the boundary between Python and the kernel: plain arrays in plain structs.
// Mirrored by structures.py; change VERSION with any change here. Functions that cross it are RG_EXPORT (exports.h).
#pragma once

#include <cstdint>

namespace rg {

constexpr std::int32_t VERSION = 31;

enum Reason : std::int32_t {
    DONE = 0,
    ZONE = 1,       // the regular path is not good enough, and the clusters' bridges do not serve
    BRANCH = 2,     // Newton may have gone to another branch
    NEWTON = 3,     // Newton did not contract
    NON_FINITE = 4,
    INERTIA = 5,    // the reduced inertia is singular
    FORCE = 6,      // a point spring has no length
    TORQUE = 7,     // the torque callback failed
    CHART = 8,      // an entry of J = G by dimensionless coordinates is large
    MET = 9,        // what is guarded may have left its bounds
    REFUSED = 10,   // with error control: a trial went farther than the mode can be followed
    ROWS = 11,      // other rows of φ may determine the dependent joints better
    OBSTACLE = 12,  // without error control: no certified bridge leads on, nor would Python find one
};

// Reads q and v and writes τ in the request's shared buffers; nonzero stops the run.
using Torque = std::int32_t (*)(double t);

struct Cluster;

struct Description {
    std::int32_t joints, nq, nv, m;
    const std::int32_t* parent;         // (joints,), 0 is the ground, joints count from 1
    const std::int32_t* kind;           // (joints,): see joints.h
    const double* placement;            // (joints, 12): rotation row by row, translation
    const double* inertia;              // (joints, 10): mass, centre, inertia at the centre xx xy yy xz yz zz
    const double* armature;             // (nv,)
    const double* gravity;              // (3,)
    const double* ground;               // (3,): the point of the ground that positions are seen from
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
    std::int32_t paths, pulls;
    const std::int32_t* path_at;        // (paths, 4): first of its arms and how many, first of its stretches and how many
    const std::int32_t* arm_at;         // (arms, 2): in q and in v
    const double* arm;                  // (arms,)
    const std::int32_t* stretch_at;     // (stretches, 5): joints of its ends; −1 straight, 0 round a sphere, 1 a cylinder;
                                        // joints of that, and of a point beside it or −1
    const double* stretch;              // (stretches, 23): share, ends, radius, centre, axes row by row, point beside it
    const std::int32_t* pull_at;        // (pulls, 4): path, a Law in pulls.h, number of its control, of its group or −1
    const double* pull;                 // (pulls, 15): gear, 10 numbers of the law, range, range of the group
    const double* effort;               // (nv, 2): range of what actuators do together
    std::int32_t driven;
    const std::int32_t* driven_y;       // (driven,): which of y are prescribed
    std::int32_t redundant;             // whether rows of φ are left over
    std::int32_t clusters;              // 0 where the kernel does not follow them one by one
    const Cluster* const* cluster;      // (clusters,)
    const double* home;                 // (nq,)
};

struct Cluster {  // a loop cluster
    const Description* loops;           // all its rows; `scale` is what x is multiplied by
    const std::int32_t* iq;             // (nq,) in q
    const std::int32_t* iv;             // (nv,) in v
    const std::int32_t* inputs;         // (m,) in y
    const std::int32_t* rotates;        // (nv,)
    const std::int32_t* periodic;       // (nv,)
    const double* balance;              // (nv,): makes columns of K of size one, 1 but for very short links
    double phi_size;                    // what a second-order form is compared with
};

struct Bridging {  // see maps/cluster/options.py
    std::int32_t count;
    const double* nodes;                // (count,)
    std::int32_t error_controlled;      // the caller controls its error: no look ahead
    double reach, reach_of_several;     // distances at which bridges take over, for one coordinate and for more
    double closure_tolerance, geometric_tolerance, transversality;
    double last_resort;                 // share of the best chart's quality to which error control goes on
};

struct States {  // where derivatives are asked for
    std::int64_t count;
    const double* q;        // (count, nq)
    const double* v;        // (count, nv)
    const double* tau;      // (count, nv), or null
    double zone;            // conditioning below which K_d is too poor
    double steady;          // change of a state's G and its derivatives by rounding up to which it serves below; 0: none does
    double close, same;     // how far q and v may be from closed ones, and a step's end from the next state
    double at_rest;         // what is added to the largest |v| where differences of v are relative to it
    const double* mode;     // (nv, m): G of the mode that states where modes meet are on, or null: as v tells
    // results, null where not wanted
    double* ydd;            // (count, m)
    double* rows;           // (count, m, 2m + nv): ∂u̇ by y, u and τ
    double* G;              // (count, nv, m)
    double* v_y;            // (count, nv, m): ∂v/∂y
    double* a;              // (count, nv)
    double* a_y;            // (count, nv, m): ∂a/∂y and ∂a/∂u, u̇ held
    double* a_u;
    std::int32_t* status;   // (count,): a Reason
    // of steps between states, or from each of them
    std::int64_t drives;      // how many of the driven inputs, from the first, move as prescribed; others stay
    const double* prescribed; // (count, 4, 3, drives): y, ẏ and ÿ of these at each stage
    Torque torque;          // asked at each stage, besides tau, or null
    double* torque_q;       // as in Request
    double* torque_v;
    double* torque_tau;
    double* torque_stored;
    double *q_out, *v_out;  // (count, nq), (count, nv): the states that were reached
    double* A;              // (count, 2m, 2m), (count, 2m, nv): derivatives of the step from each state
    double* B;
    double* stage_q;        // (4 (count − 1), …): at each stage of the steps between states
    double* stage_v;
    double* stage_a;
    double* stage_G;
    double* stage_v_y;
};

enum Beginning : std::int32_t {
    GO_ON = 0,    // from the last step that was accepted here
    REGULAR = 1,  // from `anchor`, on regular ground
    IN_ZONE = 2,  // from `anchor`, with `trackers`
    ON = 3,       // as GO_ON, in the same request: counts and the safe output go on too
    TURNED = 4,   // the same, after a look at the state under another torque held
};

// Sums r of joints, or their rates ṙ, that are to stay within bounds.
struct Guarded {
    std::int32_t values, rates;  // the first `values` of them bound r, the others ṙ
    const std::int32_t* begin;   // (values + rates + 1,): where the terms of each begin
    const std::int32_t* in_q;    // (terms,)
    const std::int32_t* in_v;    // (terms,)
    const double* weight;        // (terms,)
    const double* lower;         // (values + rates,)
    const double* upper;
};

// Where outputs are written, a row each; null where they are not wanted. `effort` is (rows, driven).
struct OutputRows {
    double *q, *v, *a, *tau, *energy, *work, *effort;
};

struct Request {
    std::int64_t steps;
    std::int64_t first;       // number of the time to begin from; outputs are those of times 1, 2, …
    const double* times;      // (first + steps + 1,)
    double zone;              // conditioning below which the regular path ends
    const Bridging* bridging;  // null: no zones, no test of the branch
    std::int32_t beginning;
    const double* sizes;      // (nv,): 1 / unit of each velocity, 0 where J does not matter; or null
    double best;              // largest conditioning of an output of this run, in and out
    double limit;             // largest entry of J up to which steps go on
    const double* uneven;     // (m,): largest unevenness of each input's cluster up to which they do; or null
    Torque torque;            // or null
    double *torque_q, *torque_v, *torque_tau;  // (nq,), (nv,), (nv,): what the callback reads and writes
    double* torque_stored;    // (2,): power of torque_tau that a potential gives, W, and that potential, J
    const double* held;       // (nv,): a constant torque, or null
    const double* control;    // of the actuators, at `first` and each stage after it, one row after the other; or null
    std::int32_t control_stride;  // numbers from row to row; 0 where they are constant
    std::int32_t control_rows;    // the last one counts for all that would come after it
    Torque looked;            // told when each step ends that is done; the batch ends where it gives not 0; or null
    Torque tell;              // makes rows 0 of `control` and `prescribed` those of a time, for error control; or null
    const double* trackers;   // as `rg_trackers` gave them
    const double* prescribed; // (times, stages, 3, driven): y, ẏ and ÿ at each time and stage after it; or null
    double* effort;           // (driven,), in and out: what moves them
    std::int32_t stages;      // of an explicit Runge–Kutta method; 0 for the classical one
    const double* tableau;    // its rows of a below the diagonal, b, and c
    const Guarded* guard;     // or null
    const double* solver;     // of one with error control, see error_control.h, or null: so, and its estimates' weights
    double rtol, atol;        // its tolerances
    std::int64_t safe_from;   // number of the time from which a well-conditioned output ends its steps
    double* x;                // state, in and out
    double* rate;             // its rate, out; n numbers as in x, or null
    double* anchor;           // point at the state, in and out
    double* origin;           // (nq,), in and out: where charts have theirs
    double* ydd;              // (m,), in and out
    double* tau;              // (nv,), in and out
    double* safe;             // out: point, state of the last well-conditioned output
    OutputRows ends;          // at the ends of steps
    OutputRows within;        // at times within steps,
    const double* times_within;  // increasing,
    const std::int64_t* before;  // (steps + 1,): how many of them come before each of `times`; or null
    const double* prescribed_within;  // a row of `prescribed` at each of them; or null
    const double* control_within;     // one of `control`; or null where that is constant
    // results
    std::int64_t completed;   // steps; −1 where the look under another torque failed
    std::int64_t safe_step;   // number of its time, −1 where there was none
    std::int64_t rhs, newton, constraint_evaluations, force_evaluations, zone_evaluations;
    std::int64_t marching_steps, svds, bridges_built, second_order;
    std::int64_t logged;      // singular places passed
    const double* log;        // (logged, 8 + nq), valid until the next call: step, time, cluster, corank,
                              // closure, transversality, whether a near miss, order of contact, q
    double power;             // in and out
    std::int32_t in_zone;     // whether the last accepted state is in a zone: 2 on a bridge there
    std::int32_t reason;
    std::int32_t met;         // whether singular places may have been passed that nobody was told of
    double uncertain;         // of G at most, by rounding, beside singular places without a bridge,
    double asked, nearest;    // the least tolerance to ask for there, and their distance
    std::int32_t plain;       // whether all was done and there is nothing to tell of it
};

constexpr std::int32_t ALONE = -1;  // a row goes through singular places: it needs a workspace of its own

// Many motions of one mechanism, a row each: see simulation/rows.h.
struct Rows {
    std::int64_t count;
    const std::int64_t* which;      // (count,): the rows that are to be stepped
    double step;
    const double* t0;               // (rows,), as all that follows
    std::int64_t* at;               // steps taken since t0, in and out
    std::int64_t* left;             // steps that are to be taken, in; that were not, out
    std::int64_t* passed;           // singular places passed so far, in and out
    void* const* own;               // workspaces of their own, or null
    std::int32_t* going;            // whether those are where the row is, in and out
    const double* const* trackers;  // of a row in a zone from which no workspace goes on; or null
    std::int32_t* in_zone;          // out
    std::int32_t* status;           // out: a Reason, or ALONE
    const double* limit;            // as in Request, and (rows, m)
    const double* uneven;
    std::int32_t width;             // numbers of `held`
    const double* held;             // (rows, width): the torque, and controls after it
    double* x;                      // (rows, 2m), as in Request
    double* anchor;
    double* origin;
    double* ydd;
    double* q;                      // (rows, nq), (rows, nv), out
    double* v;
};

// A mechanism as a file holds it, in each choice of independent joints: see public/image.h.
struct ExportedChart {
    const Description* description;
    const double* sizes;   // as in Request
    const double* uneven;
    double limit;
};

struct Exported {
    std::int32_t charts, controls;
    double zone;
    const Bridging* bridging;
    const ExportedChart* const* chart;  // (charts,)
    const double* ranges;               // (controls, 2)
    const char* joints;                 // names, one a line, ended by zero
    const char* actuators;
};

// A mode of one or two coordinates about a place: see modes.h.
struct ModeSeries {
    std::int64_t count, inputs, first, second;
    const std::int32_t* velocities;  // (count,) in v
    const double* center;            // (inputs,)
    const double* shares;            // (inputs, inputs): by y less the centre
    const double* terms;             // (first, second, count): of γ by powers of the shares
};

// How loops are closed from afar: see constraint/assembly.h.
struct Assembly {
    std::int32_t free_count, point_count, turn_count;
    const std::int32_t* free;    // (free_count,): velocities that move
    const std::int32_t* points;  // (point_count,): rows of φ that count while points are closed, and later too
    const std::int32_t* turns;   // (turn_count,): those that count later only
    const std::int32_t* sort;    // (closures, 2): whether it holds its points together; 1 a weld's turn, 2 a hinge's
    const double* frames;        // (closures, 18): rotations of its frames in their joints, row by row
    const double* axis;          // (closures, 3): of a revolute joint
    const double* row_scale;     // (rows,)
    const double* column_scale;  // (nv,)
    const double* units;         // (nv,)
    double length;
};

}  // namespace rg
