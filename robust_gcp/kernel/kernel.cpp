// The functions that Python calls. Nothing here is global: each handle is a workspace of its own.
#include <algorithm>
#include <cstring>
#include <exception>

#include "abi.h"
#include "derivatives/derivation.h"
#include "dynamics/measures.h"
#include "simulation/solver.h"

#define RG_EXPORT extern "C" __attribute__((visibility("default")))

RG_EXPORT std::int32_t rg_version() { return rg::VERSION; }

// Size of a structure of abi.h, to compare with the caller's.
RG_EXPORT std::int32_t rg_size(std::int32_t structure) {
    constexpr std::size_t sizes[] = {sizeof(rg::Description), sizeof(rg::Cluster), sizeof(rg::Bridging),
                                     sizeof(rg::Request), sizeof(rg::States), sizeof(rg::ModeSeries)};
    return static_cast<std::int32_t>(sizes[structure]);
}

// A workspace for a mechanism, or null with the reason in `why`.
RG_EXPORT void* rg_create(const rg::Description* description, char* why, std::int32_t length) {
    try {
        return new rg::Solver(*description);
    } catch (const std::exception& error) {
        std::strncpy(why, error.what(), static_cast<std::size_t>(length) - 1);
        return nullptr;
    }
}

RG_EXPORT void rg_destroy(void* stepper) { delete static_cast<rg::Solver*>(stepper); }

RG_EXPORT void rg_run(void* stepper, rg::Request* request) { static_cast<rg::Solver*>(stepper)->run(*request); }

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

RG_EXPORT void rg_tell(void* stepper, rg::Request* request) { static_cast<rg::Solver*>(stepper)->tell(*request); }

RG_EXPORT void rg_keep(void* stepper) { static_cast<rg::Solver*>(stepper)->keep(); }

RG_EXPORT void rg_forget(void* stepper) { static_cast<rg::Solver*>(stepper)->clusters.forget(); }

RG_EXPORT void rg_renew(void* stepper) { static_cast<rg::Solver*>(stepper)->renew(); }

// A workspace for derivatives of a mechanism, or null with the reason in `why`.
RG_EXPORT void* rg_derive(const rg::Description* description, char* why, std::int32_t length) {
    try {
        return new rg::Derivation(*description);
    } catch (const std::exception& error) {
        std::strncpy(why, error.what(), static_cast<std::size_t>(length) - 1);
        return nullptr;
    }
}

RG_EXPORT void rg_derived(void* derivation) { delete static_cast<rg::Derivation*>(derivation); }

// Whether the derivation took the series in.
RG_EXPORT std::int32_t rg_learn(void* derivation, const rg::ModeSeries* series) {
    return static_cast<rg::Derivation*>(derivation)->learn(*series);
}

RG_EXPORT void rg_slopes(void* derivation, const rg::States* states) {
    static_cast<rg::Derivation*>(derivation)->at(*states);
}

RG_EXPORT void rg_take(void* derivation, const rg::States* states, const double* times) {
    static_cast<rg::Derivation*>(derivation)->take(*states, times);
}

RG_EXPORT void rg_pull(void* derivation, std::int64_t first, std::int64_t last, std::int32_t count, double* rows,
                       const double* after, const double* before, double* by_tau) {
    static_cast<rg::Derivation*>(derivation)->pull(first, last, count, rows, after, before, by_tau);
}

// max |φ| and the energy (count,) along a motion q (count, nq), v (count, nv).
RG_EXPORT void rg_measure(const rg::Description* description, std::int64_t count, const double* q, const double* v,
                          double* open, double* energy) {
    rg::Measures measures(*description);
    for (std::int64_t i = 0; i < count; ++i, q += description->nq, v += description->nv) {
        open[i] = measures.open(q);
        energy[i] = measures.energy(q, v);
    }
}
