// φ of a part in extended precision: where K_d is nearly singular q is closed by it to its own rounding; see
// mechanism/constraint/extended_precision.py.
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "constraint/closures.h"
#include "tree/chain.h"
#include "tree/parts.h"

namespace rg {

class Extended {
  public:
    using Wide = long double;

    Extended(const Chain& chain, const Part& part, const Closures& closures)
        : chain_(chain), part_(part), closures_(closures), couplings_(closures.couplings()), axes_(chain.bodies.size()),
          p_(chain.bodies.size()) {
        for (int j : part.joints)
            for (int column = 0; column < 3; ++column) {
                const Vec& axis = chain.bodies[j].placed[column];
                exact_ = exact_ && (axis.x == 0.0) + (axis.y == 0.0) + (axis.z == 0.0) == 2;
            }
    }

    // To what φ is known: frames that were turned, so that joints are about z, were rounded, but for quarter turns.
    double eps() const { return exact_ ? static_cast<double>(std::numeric_limits<Wide>::epsilon()) : EPS; }

    // φ at q, by row; what carries the part stays where the chain has it.
    void residual(const double* q, std::size_t count, double* phi) {
        q_.assign(q, q + count);
        phi_.resize(closures_.phi.size());
        couplings_.residual(q_.data(), phi_.data());
        couplings_.each_bend([&](int row, int, double) { phi[row] = static_cast<double>(phi_[static_cast<std::size_t>(row)]); });
        axes_[part_.root] = {}, p_[part_.root] = {};
        for (int j : part_.joints) place(chain_.bodies[j], j);
        const Axes& carrier = chain_.axes[part_.root];
        for (const Loop& loop : closures_.loops()) {
            const AxesOf<Wide>*one = &axes_[loop.joint[0]], *two = &axes_[loop.joint[1]];
            const VecOf<Wide> apart = (p_[loop.joint[0]] + one->turn(wide(loop.point[0]))) -
                                      (p_[loop.joint[1]] + two->turn(wide(loop.point[1])));
            for (int i = 0; i < loop.rows; ++i) {
                const Row& row = closures_.row(loop, i);
                Wide value = 0;
                if (row.axis >= 0)
                    value = axes_of(carrier).turn(apart)[row.axis];
                else if (row.axis == ALONG)
                    value = dot(apart, two->turn(wide(row.terms[0].n)));
                else
                    for (const Term& t : row.terms) value += t.w * dot(one->turn(wide(t.u)), two->turn(wide(t.n)));
                phi[closures_.number(loop, i)] = static_cast<double>(row.weight * value);
            }
        }
    }

  private:
    static constexpr double EPS = std::numeric_limits<double>::epsilon();

    static VecOf<Wide> wide(const Vec& v) { return {v.x, v.y, v.z}; }
    static AxesOf<Wide> axes_of(const Axes& a) { return {wide(a.x), wide(a.y), wide(a.z)}; }

    void place(const Body& body, int j) {
        const AxesOf<Wide>& parent = axes_[body.parent];
        VecOf<Wide> r = parent.turn(wide(body.at));
        Wide* q = &q_[static_cast<std::size_t>(body.q)];
        switch (body.kind) {  // numbers that are on a circle or a sphere but for their rounding
            case CONTINUOUS: normalise(q, 2); break;
            case SPHERICAL: normalise(q, 4); break;
            case FREE_FLYER: normalise(q + 3, 4); break;
            case PLANAR: normalise(q + 2, 2); break;
            default: break;
        }
        axes_[j] = moved(body.kind, q, parent.turn(axes_of(body.placed)), r);
        p_[j] = p_[body.parent] + r;
    }

    static void normalise(Wide* q, int count) {
        Wide square = 0;
        for (int i = 0; i < count; ++i) square += q[i] * q[i];
        for (int i = 0; i < count; ++i) q[i] /= std::sqrt(square);
    }

    const Chain& chain_;
    const Part& part_;
    const Closures& closures_;
    Couplings couplings_;
    bool exact_ = true;
    std::vector<AxesOf<Wide>> axes_;
    std::vector<VecOf<Wide>> p_;
    std::vector<Wide> q_, phi_;
};

}  // namespace rg
