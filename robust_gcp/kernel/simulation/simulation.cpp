// The functions that Python calls for motions. Nothing here is global: each handle is a workspace of its own.
#include "exports.h"
#include "simulation/rows.h"
#include "simulation/solver.h"

RG_EXPORT std::int32_t rg_version() { return rg::VERSION; }

// Size of a structure of abi.h, to compare with the caller's.
RG_EXPORT std::int32_t rg_size(std::int32_t structure) {
    constexpr std::size_t sizes[] = {sizeof(rg::Description), sizeof(rg::Cluster), sizeof(rg::Bridging),
                                     sizeof(rg::Request), sizeof(rg::States), sizeof(rg::ModeSeries),
                                     sizeof(rg::Assembly), sizeof(rg::Guarded), sizeof(rg::Rows),
                                     sizeof(rg::ExportedChart), sizeof(rg::Exported)};
    return static_cast<std::int32_t>(sizes[structure]);
}

// A workspace for a mechanism, or null with the reason in `why`.
RG_EXPORT void* rg_create(const rg::Description* description, char* why, std::int32_t length) {
    return rg::made<rg::Solver>(*description, why, length);
}

RG_EXPORT void rg_destroy(void* stepper) { delete static_cast<rg::Solver*>(stepper); }

RG_EXPORT void rg_run(void* stepper, rg::Request* request) { static_cast<rg::Solver*>(stepper)->run(*request); }

// Steps of many motions; the request says how, and `stepper` takes those that need none of their own.
RG_EXPORT void rg_rows(void* stepper, const rg::Request* request, rg::Rows* rows) {
    rg::RowsOf(*static_cast<rg::Solver*>(stepper), *request, *rows).run();
}

RG_EXPORT void rg_look(void* stepper, rg::Request* request) { static_cast<rg::Solver*>(stepper)->look(*request); }

// The state of the clusters' trackers, as many numbers as `count` then says; valid until the next call.
RG_EXPORT const double* rg_trackers(void* stepper, std::int64_t* count) {
    return static_cast<rg::Solver*>(stepper)->trackers(*count);
}

// Makes a start of a configuration and velocities, for rg_run.
RG_EXPORT void rg_begin(void* stepper, rg::Request* request) { static_cast<rg::Solver*>(stepper)->set_out(*request); }

RG_EXPORT void rg_follow_from(void* stepper, rg::Request* request) {
    static_cast<rg::Solver*>(stepper)->set_out_from(*request);
}

RG_EXPORT void rg_follow(void* stepper, rg::Request* request) {
    static_cast<rg::Solver*>(stepper)->follow(*request);
}

RG_EXPORT void rg_bend(void* stepper, rg::Request* request, const double* unit, double* A) {
    static_cast<rg::Solver*>(stepper)->bend(*request, unit, A);
}

// What a solver's step from t0 to t1 passed: `ends` are the states (y, ẏ) there, `series` the coefficients of Chebyshev
// polynomials for (y, ẏ, ÿ), one after the other.
RG_EXPORT void rg_passed(void* stepper, rg::Request* request, double t0, double t1, const double* ends,
                         const double* series, std::int64_t count) {
    rg::Solver& solver = *static_cast<rg::Solver*>(stepper);
    const rg::Matrix table = Eigen::Map<const rg::Matrix>(series, 3 * solver.path.layout.m, count);
    solver.passed(*request, ends, rg::Series(table, t0, t1));
}

RG_EXPORT void rg_tell(void* stepper, rg::Request* request) { static_cast<rg::Solver*>(stepper)->tell(*request); }

RG_EXPORT void rg_keep(void* stepper) { static_cast<rg::Solver*>(stepper)->keep(); }

RG_EXPORT void rg_forget(void* stepper) { static_cast<rg::Solver*>(stepper)->clusters.forget(); }

RG_EXPORT void rg_renew(void* stepper) { static_cast<rg::Solver*>(stepper)->renew(); }
