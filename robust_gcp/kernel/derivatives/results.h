// What is told of states, and of the stages of steps between them.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "abi.h"
#include "derivatives/displacements.h"
#include "dynamics/motion.h"
#include "path/point.h"

namespace rg {

class Results {
  public:
    Results(const Layout& layout, const Motion& motion, const Displacements& moved)
        : m_(layout.m), nq_(layout.nq), nv_(layout.nv), motion_(motion), moved_(moved) {}

    // Of state i, which was evaluated, and differentiated where that is asked for.
    void write(const States& s, std::int64_t i, Point& point) const {
        if (s.ydd != nullptr) std::copy(motion_.ydd.begin(), motion_.ydd.end(), s.ydd + i * m_);
        if (s.G != nullptr) std::copy(point.G(), point.G() + nv_ * m_, s.G + i * nv_ * m_);
        if (s.v_y != nullptr) std::copy(moved_.v_y.begin(), moved_.v_y.end(), s.v_y + i * nv_ * m_);
        if (s.a == nullptr) return;
        std::copy(moved_.a.begin(), moved_.a.end(), s.a + i * nv_);
        std::copy(moved_.a_y.begin(), moved_.a_y.end(), s.a_y + i * nv_ * m_);
        std::copy(moved_.a_u.begin(), moved_.a_u.end(), s.a_u + i * nv_ * m_);
    }

    // The state that was reached from state i, or is that.
    void reached(const States& s, std::int64_t i, Point& point) const {
        if (s.q_out == nullptr) return;
        std::copy(point.q(), point.q() + nq_, s.q_out + i * nq_);
        std::copy(motion_.v.begin(), motion_.v.end(), s.v_out + i * nv_);
    }

    // A stage of a step, which was differentiated.
    void record(const States& s, std::size_t step, std::size_t stage, Point& point) const {
        if (s.stage_q == nullptr) return;
        const std::size_t row = 4 * step + stage, nv = static_cast<std::size_t>(nv_), tall = nv * static_cast<std::size_t>(m_);
        std::copy(point.q(), point.q() + nq_, s.stage_q + row * static_cast<std::size_t>(nq_));
        std::copy(motion_.v.begin(), motion_.v.end(), s.stage_v + row * nv);
        std::copy(moved_.a.begin(), moved_.a.end(), s.stage_a + row * nv);
        std::copy(point.G(), point.G() + tall, s.stage_G + row * tall);
        std::copy(moved_.v_y.begin(), moved_.v_y.end(), s.stage_v_y + row * tall);
    }

  private:
    int m_, nq_, nv_;
    const Motion& motion_;
    const Displacements& moved_;
};

}  // namespace rg
