// The functions that Python calls for derivatives.
#include "exports.h"
#include "derivatives/step_derivatives.h"

// A workspace for derivatives of a mechanism, or null with the reason in `why`.
RG_EXPORT void* rg_derive(const rg::Description* description, char* why, std::int32_t length) {
    return rg::made<rg::Derivation>(*description, why, length);
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

RG_EXPORT void rg_step_each(void* derivation, const rg::States* states, double t, double h) {
    static_cast<rg::Derivation*>(derivation)->step_each(*states, t, h);
}

RG_EXPORT void rg_feed(void* derivation, std::int64_t first, std::int64_t count, const double* tau_y,
                       const double* tau_u) {
    static_cast<rg::Derivation*>(derivation)->adjoint().follow(static_cast<std::size_t>(first),
                                                               static_cast<std::size_t>(count), tau_y, tau_u);
}

RG_EXPORT void rg_pull(void* derivation, std::int64_t first, std::int64_t last, std::int32_t count, double* rows,
                       const double* after, const double* before, const double* feedback, double* by_tau,
                       double* by_stage, double* by_drive) {
    static_cast<rg::Derivation*>(derivation)->adjoint().pull(first, last, count, rows, after, before, feedback, by_tau,
                                                             by_stage, by_drive);
}
