// The functions that Python calls for derivatives.
#include "exports.h"
#include "derivatives/derivation.h"

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

RG_EXPORT void rg_pull(void* derivation, std::int64_t first, std::int64_t last, std::int32_t count, double* rows,
                       const double* after, const double* before, double* by_tau) {
    static_cast<rg::Derivation*>(derivation)->pull(first, last, count, rows, after, before, by_tau);
}
