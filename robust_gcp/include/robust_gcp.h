/* Closed-loop mechanisms in minimal coordinates, from C.
 *
 * A mechanism is what an .rgcp file holds, which `mechanism.export` of the Python package writes; it never changes, and
 * threads may share it. A motion is one simulation of it, for one thread at a time. There are no globals, no exceptions
 * leave, nothing is printed. Functions that can fail return an rgcp_status, and rgcp_why says in words what was wrong.
 * Arrays are doubles, row by row; SI units. */
#ifndef ROBUST_GCP_H
#define ROBUST_GCP_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define RGCP_API 1 /* raised by what breaks callers */

typedef enum {
    RGCP_OK = 0,
    RGCP_BAD_ARGUMENT = 1,
    RGCP_NO_START = 2,      /* not closed, or at a singular configuration */
    RGCP_STOPPED = 3,       /* the motion is where its last good step ended */
    RGCP_NO_DERIVATIVES = 4,
    RGCP_NO_MEMORY = 5      /* begin again, or restore */
} rgcp_status;

typedef struct {
    int32_t nq, nv, m;   /* numbers of q, of v, independent velocities */
    int32_t controls;    /* actuators */
    int32_t charts;      /* choices of independent joints that were exported; the first is the one that was named */
} rgcp_counts;

typedef struct rgcp_mechanism rgcp_mechanism;
typedef struct rgcp_motion rgcp_motion;

int32_t rgcp_api(void);

/* A mechanism from a file, or from `size` bytes of one; NULL with the reason in `why`. */
rgcp_mechanism* rgcp_open(const char* path, char* why, size_t length);
rgcp_mechanism* rgcp_open_bytes(const void* bytes, size_t size, char* why, size_t length);
void rgcp_close(rgcp_mechanism*);
rgcp_counts rgcp_count(const rgcp_mechanism*);
const char* rgcp_joints(const rgcp_mechanism*);                         /* names, one a line */
const char* rgcp_actuators(const rgcp_mechanism*);                      /* the same */
const double* rgcp_home(const rgcp_mechanism*);                         /* (nq,) */
const int32_t* rgcp_independent(const rgcp_mechanism*, int32_t chart);  /* (m,) in v; NULL for none */

/* A motion of a mechanism, which has to stay open. Steps take memory of the system's, for as long as they last. */
rgcp_motion* rgcp_new(const rgcp_mechanism*, char* why, size_t length);
/* The same within one block of `bytes`, beside which no call asks the system for memory; used up, it is RGCP_NO_MEMORY.
 * rgcp_used tells how many were taken so far at most: what one motion needs is measured once, with plenty. */
rgcp_motion* rgcp_new_within(const rgcp_mechanism*, size_t bytes, char* why, size_t length);
size_t rgcp_used(const rgcp_motion*);
void rgcp_free(rgcp_motion*);
const char* rgcp_why(const rgcp_motion*);

/* Begin at q (nq,), closed by Newton at its own y, with independent velocities u (m,) of the first chart; at home and at
 * rest where NULL. */
rgcp_status rgcp_begin(rgcp_motion*, const double* q, const double* u, double t);
/* After rgcp_begin: builds the bridges of loops of one coordinate on both sides, as far as the coordinate goes or two
 * turns, so that no later step does while the chart is kept. Motions differ in rounding by it. */
rgcp_status rgcp_prepare(rgcp_motion*);
/* n steps of RK4 of h seconds under torques tau (nv,) and controls (controls,), held; none where NULL. */
rgcp_status rgcp_step(rgcp_motion*, double h, int64_t n, const double* tau, const double* control);

double rgcp_time(const rgcp_motion*);
int32_t rgcp_chart(const rgcp_motion*);              /* the coordinates y that it is in */
int64_t rgcp_crossings(const rgcp_motion*);          /* singular configurations passed */
const double* rgcp_q(const rgcp_motion*);            /* (nq,) */
const double* rgcp_v(const rgcp_motion*);            /* (nv,) = G u */
const double* rgcp_y(const rgcp_motion*);            /* (m,), then u (m,) */
const double* rgcp_acceleration(const rgcp_motion*); /* (m,): u' under what was held last */
const double* rgcp_G(const rgcp_motion*);            /* (nv, m): v = G u */
const double* rgcp_g(const rgcp_motion*);            /* (nv,): v' = G u' + g */

/* M (m, m) and b (m,) of M u' = b: G^T M G, and G^T (tau - C - M g) under what was held last. */
rgcp_status rgcp_reduced(rgcp_motion*, double* M, double* b);
/* u' (m,) and its derivatives by y, u and tau, (m, 2 m + nv), under tau (nv,) or none. */
rgcp_status rgcp_derivatives(rgcp_motion*, const double* tau, double* acceleration, double* rows);

/* The present state as plain bytes: how many, written where there is room for these, and put back, by any motion of a
 * mechanism from the same file. */
size_t rgcp_state_size(rgcp_motion*);
rgcp_status rgcp_save(rgcp_motion*, void* bytes, size_t size);
rgcp_status rgcp_restore(rgcp_motion*, const void* bytes, size_t size);

#ifdef __cplusplus
}
#endif
#endif
