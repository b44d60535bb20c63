// RK4 steps of many motions on regular ground, some at once side by side: the same steps and the same tests as
// evaluator.h, branch.h and watch.h have them, around the stage of one mechanism that stage.py writes down.
// A motion that fails a test is left where its last good step ended, and the kernel goes on with it.
#include <cmath>
#include <cstdint>
#include <cstring>

#ifndef LANES
#define LANES 4
#endif

namespace {

typedef double real __attribute__((vector_size(8 * LANES)));
typedef std::int64_t mask __attribute__((vector_size(8 * LANES)));

inline real fixed(double x) { return x - real{}; }
inline real larger(real a, real b) { return a > b ? a : b; }
inline real smaller(real a, real b) { return a < b ? a : b; }
inline real absolute(real a) { return (real)((mask)a & (INT64_MAX - mask{})); }
inline real root(real a) {
    real out;
    for (int i = 0; i < LANES; ++i) out[i] = __builtin_sqrt(a[i]);
    return out;
}
inline bool some(mask m) {
    std::int64_t all = 0;
    for (int i = 0; i < LANES; ++i) all |= m[i];
    return all != 0;
}

// Reduced by multiples of π/2 in three parts, then the series of Taylor's theorem on [−π/4, π/4], which end below
// 1e-17; for |x| up to FAR, beyond which the parts of π/2 do not suffice.
constexpr double FAR = 1e5;
inline void turned(real x, real& sine, real& cosine) {
    const double round = 6755399441055744.0;  // 1.5 · 2⁵²
    const real shifted = x * 0.63661977236758134308 + round, n = shifted - round;
    const mask quarter = (mask)shifted;
    real r = x - n * 1.5707963267341256;
    r = r - n * 6.0771005063039660e-11;
    r = r - n * 2.0222662487959506e-21;
    const real z = r * r;
    real s = fixed(-1.0 / 1307674368000.0), c = fixed(1.0 / 20922789888000.0);
    s = s * z + 1.0 / 6227020800.0, c = c * z - 1.0 / 87178291200.0;
    s = s * z - 1.0 / 39916800.0, c = c * z + 1.0 / 479001600.0;
    s = s * z + 1.0 / 362880.0, c = c * z - 1.0 / 3628800.0;
    s = s * z - 1.0 / 5040.0, c = c * z + 1.0 / 40320.0;
    s = s * z + 1.0 / 120.0, c = c * z - 1.0 / 720.0;
    s = s * z - 1.0 / 6.0, c = c * z + 1.0 / 24.0;
    s = r + r * z * s, c = 1.0 - 0.5 * z + z * z * c;
    const mask odd = (quarter & 1) != 0;
    sine = odd ? c : s, cosine = odd ? s : c;
    sine = (quarter & 2) != 0 ? -sine : sine;
    cosine = ((quarter + 1) & 2) != 0 ? -cosine : cosine;
}

#include "mechanism.h"  // NV, M, BLOCKS, FREE, REVOLUTE, SIZE, TURN, and the macro STAGE: the lines of the stage

constexpr double POOR = 0.3, PACE = 3.0, FARTHEST = 0.5, CORRECTION = 0.25, ROUNDING = 1e-12, RATIO = 2.5;  // branch.h
constexpr double SERIES = 1e-3, LEFT = 1e-16;  // a first correction that stage.py's series hold for; what Newton leaves

struct Point {
    real y[M], u[M], q[NV], v[NV], G[NV * M], g[NV], bend[NV], det[BLOCKS], rcond[BLOCKS], a[M];
    real first, second, sound, conditioning;
};

struct Acting {
    real tau[NV], ctrl[CONTROLS + 1], power;  // power: 0 where actuators have none
};

// The point at y with velocities u, predicted from another one; where it can be trusted.
inline mask evaluate(const Point& from, const real* y, const real* u, const Acting& acts, double zone, Point& out) {
    real q[NV], c[NV], s[NV], change[M], weight = real{}, distance = real{}, turn = real{}, far = real{};
    for (int k = 0; k < M; ++k) change[k] = y[k] - from.y[k];
    if (M == 1) {
        weight = 0.5 * change[0] * change[0];
    } else {
        real speed = real{}, along = real{};
        for (int k = 0; k < M; ++k) speed += from.u[k] * from.u[k], along += change[k] * from.u[k];
        along = speed > 0.0 ? along / speed : real{};
        weight = 0.5 * along * along;
    }
    for (int i = 0; i < NV; ++i) {
        real step = weight * (M == 1 ? from.bend[i] : from.g[i]);
        for (int k = 0; k < M; ++k) step += from.G[i * M + k] * change[k];
        distance = larger(distance, absolute(step * SIZE[i]));
        turn = larger(turn, absolute(step * TURN[i]));
        q[i] = from.q[i] + step;
    }
    for (int k = 0; k < M; ++k) q[FREE[k]] = y[k];
    for (int i = 0; i < NV; ++i)
        if (REVOLUTE[i]) far = larger(far, absolute(q[i])), turned(q[i], s[i], c[i]);
    const real *tau = acts.tau, *ctrl = acts.ctrl, power = acts.power;
    STAGE
    for (int k = 0; k < M; ++k) out.y[k] = y[k], out.u[k] = u[k];
    real worst = fixed(1.0);
    mask good = (out.first < SERIES) & (out.second * out.first < LEFT) & (far < FAR) & (out.sound > 0.0);
    for (int b = 0; b < BLOCKS; ++b) {
        worst = smaller(out.rcond[b], worst);
        const real ratio = out.det[b] / from.det[b];
        good &= (ratio > 1.0 / RATIO) & (ratio < RATIO);
    }
    out.conditioning = worst;
    good &= worst >= larger(fixed(zone), smaller(fixed(POOR), PACE * turn));
    good &= turn <= FARTHEST;
    const real beyond = out.first - CORRECTION * distance;
    good &= ~((beyond > 0.0) & (beyond * larger(worst, fixed(1e-12)) > ROUNDING));
    for (int k = 0; k < M; ++k) good &= absolute(out.a[k]) < 1e300;
    return good;
}

inline void choose(mask which, const Point& from, Point& to) {
    const real* a = reinterpret_cast<const real*>(&from);
    real* b = reinterpret_cast<real*>(&to);
    for (std::size_t i = 0; i < sizeof(Point) / sizeof(real); ++i) b[i] = which ? a[i] : b[i];
}

// Whether other coordinates may serve better; see watch.h. `sizes` null: never.
inline mask exceeds(const Point& point, const double* sizes, const real& limit, const real* uneven) {
    mask large = mask{};
    if (sizes == nullptr) return large;
    for (int p = 0; p < PARTS; ++p) {
        real even = fixed(-1.0), most = real{}, bent = real{};
        for (int k = 0; k < M; ++k)
            if (PART_OF_INPUT[k] == p && sizes[FREE[k]] > 0.0) even = larger(even, uneven[k]);
        for (int i = 0; i < NV; ++i) {
            if (PART[i] != p) continue;
            for (int k = 0; k < M; ++k)
                if (PART_OF_INPUT[k] == p && sizes[FREE[k]] > 0.0)
                    large |= (even >= 0.0) & (absolute(point.G[i * M + k]) * sizes[i] > limit * sizes[FREE[k]]);
            most = larger(most, absolute(point.v[i] * TURN[i]));
            bent = larger(bent, absolute(point.g[i] * TURN[i]));
        }
        large |= (even >= 0.0) & (most > 0.0) & (bent > even * most * most);
    }
    return large;
}

}  // namespace

extern "C" {

// As `Rows` of abi.h; `sizes` as in Request. Where there is room for so many outputs of each row, `all_q` and `all_v`
// (rows, room, NV) take them by the number of steps.
struct Motions {
    std::int64_t count;
    const std::int64_t* which;
    double step, zone;
    const double* t0;
    std::int64_t *at, *left;
    std::int32_t* status;
    const double *limit, *uneven, *sizes;
    std::int64_t width;
    const double* held;
    double *x, *anchor, *ydd, *q, *v;
    std::int64_t room;
    double *all_q, *all_v;
};

enum { DONE = 0, CHART = 8, LEFT_TO_KERNEL = -2 };

static void take(const Motions& all, const std::int64_t* rows) {
    Point now, next;
    Acting acts;
    real uneven[M], limit = real{};
    const int size = 2 * M + NV + NV * M + NV + (M == 1 ? NV : 0) + 2 * BLOCKS_OF_KERNEL + 1;
    std::memset(&now, 0, sizeof now);
    for (int l = 0; l < LANES; ++l) {
        const std::int64_t i = rows[l];
        const double* from = all.anchor + i * size;
        for (int k = 0; k < M; ++k) now.y[k][l] = *from++;
        for (int k = 0; k < M; ++k) now.u[k][l] = *from++;
        for (int j = 0; j < NV; ++j) now.q[j][l] = *from++;
        for (int j = 0; j < NV * M; ++j) now.G[j][l] = *from++;
        for (int j = 0; j < NV; ++j) now.g[j][l] = *from++;
        for (int j = 0; M == 1 && j < NV; ++j) now.bend[j][l] = *from++;
        for (int b = 0; b < BLOCKS_OF_KERNEL; ++b) now.det[b][l] = *from++;
        for (int b = BLOCKS_OF_KERNEL; b < BLOCKS; ++b) now.det[b][l] = 1.0;
        const double* held = all.held + i * all.width;
        for (int j = 0; j < NV; ++j) acts.tau[j][l] = held[j];
        acts.power[l] = CONTROLS > 0 && !std::isnan(held[NV]);
        for (int c = 0; c < CONTROLS; ++c) acts.ctrl[c][l] = acts.power[l] > 0.0 ? held[NV + c] : 0.0;
        for (int k = 0; k < M; ++k) uneven[k][l] = all.uneven[i * M + k];
        limit[l] = all.limit[i];
    }
    // ÿ under the torque that is held now
    mask going = evaluate(now, now.y, now.u, acts, all.zone, next);
    mask charts = mask{};
    for (int k = 0; k < M; ++k) now.a[k] = next.a[k];
    for (int j = 0; j < NV; ++j) now.v[j] = next.v[j];
    for (int b = 0; b < BLOCKS; ++b) now.rcond[b] = next.rcond[b];
    now.conditioning = next.conditioning;
    std::int64_t taken[LANES] = {};
    mask left;
    for (int l = 0; l < LANES; ++l) left[l] = all.left[rows[l]];
    going &= left > 0;
    for (std::int64_t n = 0; some(going); ++n) {
        real h, y[M], u[M], sum_y[M], sum_u[M], rate_y[M], rate_u[M];
        for (int l = 0; l < LANES; ++l) {
            const double begin = static_cast<double>(all.at[rows[l]] + n);
            h[l] = (all.t0[rows[l]] + all.step * (begin + 1.0)) - (all.t0[rows[l]] + all.step * begin);
        }
        mask good = going;
        Point stages[2];
        const Point* last = &now;
        for (int k = 0; k < M; ++k) sum_y[k] = rate_y[k] = now.u[k], sum_u[k] = rate_u[k] = now.a[k];
        for (int stage = 0; stage < 3; ++stage) {
            const real part = stage < 2 ? 0.5 * h : h;
            for (int k = 0; k < M; ++k) y[k] = now.y[k] + part * rate_y[k], u[k] = now.u[k] + part * rate_u[k];
            Point& point = stages[stage & 1];
            good &= evaluate(*last, y, u, acts, all.zone, point);
            last = &point;
            const double weight = stage < 2 ? 2.0 : 1.0;
            for (int k = 0; k < M; ++k) {
                rate_y[k] = u[k], rate_u[k] = point.a[k];
                sum_y[k] += weight * rate_y[k], sum_u[k] += weight * rate_u[k];
            }
        }
        for (int k = 0; k < M; ++k) y[k] = now.y[k] + h / 6.0 * sum_y[k], u[k] = now.u[k] + h / 6.0 * sum_u[k];
        good &= evaluate(*last, y, u, acts, all.zone, next);
        choose(good, next, now);
        for (int l = 0; l < LANES; ++l) {
            taken[l] += good[l] != 0;
            if (all.room == 0 || good[l] == 0) continue;
            const std::int64_t to = NV * (all.room * rows[l] + all.at[rows[l]] + taken[l]);
            for (int j = 0; j < NV; ++j) all.all_q[to + j] = now.q[j][l], all.all_v[to + j] = now.v[j][l];
        }
        const mask turned_back = good & exceeds(next, all.sizes, limit, uneven);
        charts |= turned_back;
        going = good & ~turned_back & (left > n + 1);
    }
    for (int l = 0; l < LANES; ++l) {
        const std::int64_t i = rows[l];
        if (l > 0 && i == rows[l - 1]) continue;  // lanes to spare hold the last row again
        all.at[i] += taken[l];
        all.left[i] -= taken[l];
        all.status[i] = charts[l] ? CHART : all.left[i] > 0 ? LEFT_TO_KERNEL : DONE;
        if (taken[l] == 0) continue;
        double* to = all.anchor + i * size;
        for (int k = 0; k < M; ++k) *to++ = now.y[k][l];
        for (int k = 0; k < M; ++k) *to++ = now.u[k][l];
        for (int j = 0; j < NV; ++j) *to++ = now.q[j][l];
        for (int j = 0; j < NV * M; ++j) *to++ = now.G[j][l];
        for (int j = 0; j < NV; ++j) *to++ = now.g[j][l];
        for (int j = 0; M == 1 && j < NV; ++j) *to++ = now.bend[j][l];
        for (int b = 0; b < BLOCKS_OF_KERNEL; ++b) *to++ = now.det[b][l];
        for (int b = 0; b < BLOCKS_OF_KERNEL; ++b) *to++ = now.rcond[b][l];
        *to = now.conditioning[l];
        for (int k = 0; k < M; ++k) {
            all.x[2 * M * i + k] = now.y[k][l];
            all.x[2 * M * i + M + k] = now.u[k][l];
            all.ydd[M * i + k] = now.a[k][l];
        }
        for (int j = 0; j < NV; ++j) all.q[NV * i + j] = now.q[j][l], all.v[NV * i + j] = now.v[j][l];
    }
}

// Steps of some rows, LANES of them at once.
void straight_steps(const Motions* all) {
    for (std::int64_t k = 0; k < all->count; k += LANES) {
        std::int64_t rows[LANES];
        for (int l = 0; l < LANES; ++l) rows[l] = all->which[k + l < all->count ? k + l : all->count - 1];
        take(*all, rows);
    }
}

}
