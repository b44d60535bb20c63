// The functions that Python calls for what is measured along a motion.
#include "exports.h"
#include "dynamics/measures.h"
#include "dynamics/reactions.h"

// max |φ| and the energy (count,) along a motion q (count, nq), v (count, nv).
RG_EXPORT void rg_measure(const rg::Description* description, std::int64_t count, const double* q, const double* v,
                          double* open, double* energy) {
    rg::Measures measures(*description);
    for (std::int64_t i = 0; i < count; ++i, q += description->nq, v += description->nv) {
        open[i] = measures.open(q);
        energy[i] = measures.energy(q, v);
    }
}

// λ (count, rows) along a motion with accelerations a and all that acts, tau (count, nv); tau may be null.
RG_EXPORT void rg_react(const rg::Description* description, const double* row_scale, const double* column_scale,
                        std::int64_t count, const double* q, const double* v, const double* a, const double* tau,
                        double* multipliers) {
    rg::Reactions reactions(*description, row_scale, column_scale);
    const std::int64_t nq = description->nq, nv = description->nv;
    for (std::int64_t i = 0; i < count; ++i)
        reactions.at(q + i * nq, v + i * nv, a + i * nv, tau == nullptr ? nullptr : tau + i * nv,
                     multipliers + i * description->rows);
}
