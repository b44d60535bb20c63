// The functions that Python calls to close loops, and for what is measured along a motion.
#include "exports.h"
#include "constraint/assembly.h"
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

// Into sums (joints, 10) and (3,): what `Inverse::weigh` adds at states with accelerations a and λ (count, nv).
RG_EXPORT void rg_weigh(const rg::Description* description, std::int64_t count, const double* q, const double* v,
                        const double* a, const double* lambda, double* sums) {
    rg::Chain chain(*description);
    rg::Inverse inverse(*description, chain.bodies.size());
    const std::int64_t nq = description->nq, nv = description->nv;
    for (std::int64_t i = 0; i < count; ++i) {
        chain.place(chain.all, q + i * nq);
        inverse.weigh(chain, v + i * nv, a + i * nv, lambda + i * nv, sums);
    }
}

// Closes guesses q (count, nq) in place: what is left of each, dimensionless, and the rotations between the frames of
// the closures (count, closures, 9) there.
RG_EXPORT void rg_assemble(const rg::Description* description, const rg::Assembly* assembly, std::int64_t count,
                           double* q, double* left, double* turns) {
    rg::Assembler assembler(*description, *assembly);
    for (std::int64_t i = 0; i < count; ++i, q += description->nq) {
        left[i] = assembler.close(q);
        for (int c = 0; c < description->closures; ++c, turns += 9) assembler.turn(c, turns);
    }
}

// Velocities v (count, nv) in place: those in `free` from the others; whether they are determined in `status`.
RG_EXPORT void rg_lift(const rg::Description* description, const rg::Assembly* assembly, std::int64_t count, double rank,
                       const double* q, double* v, std::int32_t* status) {
    rg::Assembler assembler(*description, *assembly);
    for (std::int64_t i = 0; i < count; ++i, q += description->nq, v += description->nv)
        status[i] = assembler.velocities(q, v, rank);
}
