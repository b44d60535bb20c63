// Pinocchio's constrained dynamics in a loop of the classical Runge-Kutta method, without Python between steps:
// `constraintDynamics`, `lcaba`, and `aba` for a tree. `compiled.py` builds it and says what the arrays hold.
#include <pinocchio/fwd.hpp>

#include <cmath>
#include <cstdint>
#include <exception>
#include <memory>
#include <string>

#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/constrained-dynamics.hpp>
#include <pinocchio/algorithm/kinematics.hpp>
#include <pinocchio/algorithm/loop-constrained-aba.hpp>
#include <pinocchio/multibody.hpp>

namespace {

// Pinocchio's own joints for axes x, y, z and others: the ones that a model read from a file has.
template <typename S, int O>
struct Joints {
    using Scalar = S;
    static constexpr int Options = O;
    using JointModelVariant = boost::variant<
        pinocchio::JointModelRevoluteTpl<S, O, 0>, pinocchio::JointModelRevoluteTpl<S, O, 1>,
        pinocchio::JointModelRevoluteTpl<S, O, 2>, pinocchio::JointModelRevoluteUnalignedTpl<S, O>,
        pinocchio::JointModelPrismaticTpl<S, O, 0>, pinocchio::JointModelPrismaticTpl<S, O, 1>,
        pinocchio::JointModelPrismaticTpl<S, O, 2>, pinocchio::JointModelPrismaticUnalignedTpl<S, O>,
        pinocchio::JointModelSphericalTpl<S, O>, pinocchio::JointModelFreeFlyerTpl<S, O>,
        boost::recursive_wrapper<pinocchio::JointModelMimicTpl<S, O, Joints>>>;
    using JointDataVariant = boost::variant<
        pinocchio::JointDataRevoluteTpl<S, O, 0>, pinocchio::JointDataRevoluteTpl<S, O, 1>,
        pinocchio::JointDataRevoluteTpl<S, O, 2>, pinocchio::JointDataRevoluteUnalignedTpl<S, O>,
        pinocchio::JointDataPrismaticTpl<S, O, 0>, pinocchio::JointDataPrismaticTpl<S, O, 1>,
        pinocchio::JointDataPrismaticTpl<S, O, 2>, pinocchio::JointDataPrismaticUnalignedTpl<S, O>,
        pinocchio::JointDataSphericalTpl<S, O>, pinocchio::JointDataFreeFlyerTpl<S, O>,
        boost::recursive_wrapper<pinocchio::JointDataMimicTpl<S, O, Joints>>>;
};

using JointModel = pinocchio::JointModelTpl<double, 0, Joints>;
using Model = pinocchio::ModelTpl<double, 0, Joints>;
using Data = pinocchio::DataTpl<double, 0, Joints>;
using Constraint = pinocchio::RigidConstraintModelTpl<double, 0>;
using ConstraintData = pinocchio::RigidConstraintDataTpl<double, 0>;
using Settings = pinocchio::ProximalSettingsTpl<double>;
using Vector = Eigen::VectorXd;
using Given = Eigen::Map<const Vector>;
using V3 = Eigen::Vector3d;

constexpr int SPHERICAL = 8, FREE_FLYER = 9;
enum Algorithm : std::int32_t { CONSTRAINT_DYNAMICS, LCABA, ABA };

JointModel joint_of(int kind, const V3& axis) {
    switch (kind) {
        case 0: return pinocchio::JointModelRevoluteTpl<double, 0, 0>();
        case 1: return pinocchio::JointModelRevoluteTpl<double, 0, 1>();
        case 2: return pinocchio::JointModelRevoluteTpl<double, 0, 2>();
        case 3: return pinocchio::JointModelRevoluteUnalignedTpl<double, 0>(axis);
        case 4: return pinocchio::JointModelPrismaticTpl<double, 0, 0>();
        case 5: return pinocchio::JointModelPrismaticTpl<double, 0, 1>();
        case 6: return pinocchio::JointModelPrismaticTpl<double, 0, 2>();
        case 7: return pinocchio::JointModelPrismaticUnalignedTpl<double, 0>(axis);
        case SPHERICAL: return pinocchio::JointModelSphericalTpl<double, 0>();
        default: return pinocchio::JointModelFreeFlyerTpl<double, 0>();
    }
}

pinocchio::SE3 place_of(const double* numbers) {
    const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> R(numbers);
    return {Eigen::Matrix3d(R), V3(numbers[9], numbers[10], numbers[11])};
}

}  // namespace

extern "C" {

// As `Description` in compiled.py.
struct Description {
    std::int32_t joints, closures, springs, lines;
    const std::int32_t *kind, *parent;            // (joints,)
    const double *axis, *placement, *inertia;     // (joints, 3), (joints, 12), (joints, 10): mass, lever, about it
    const double *armature, *damping, *drive;     // (nv,)
    const double* gravity;                        // (3,)
    const std::int32_t *full, *closure_joint;     // (closures,): 1 for a frame, 0 for a point; (closures, 2)
    const double* closure_place;                  // (closures, 2, 12)
    const std::int32_t *spring_at, *line_joint;   // (springs, 2): in q and in v; (lines, 2)
    const double *spring, *line;                  // (springs, 2): k, rest; (lines, 9): two points, k, rest, c
};

// As `Request` in compiled.py.
struct Request {
    std::int32_t algorithm, outputs, substeps, iterations;
    double step, stiffness, damping, mu, accuracy, bound;
    double *q, *v;  // (outputs + 1, nq), (outputs + 1, nv): the first is given
};

}  // extern "C"

namespace {

class Loop {
  public:
    explicit Loop(const Description& d) : d_(d) {
        for (int j = 0; j < d.joints; ++j) {
            const auto at = model_.addJoint(
                static_cast<std::size_t>(d.parent[j]), joint_of(d.kind[j], V3(d.axis + 3 * j)),
                place_of(d.placement + 12 * j), std::to_string(j));
            const double* i = d.inertia + 10 * j;
            Eigen::Matrix3d about;
            about << i[4], i[5], i[7], i[5], i[6], i[8], i[7], i[8], i[9];
            model_.inertias[at] = pinocchio::Inertia(i[0], V3(i[1], i[2], i[3]), about);
        }
        model_.armature = Given(d.armature, model_.nv);
        model_.gravity.linear() = V3(d.gravity);
        data_ = std::make_unique<Data>(model_);
        for (int c = 0; c < d.closures; ++c) {
            const double* place = d.closure_place + 24 * c;
            constraints_.emplace_back(
                d.full[c] ? pinocchio::CONTACT_6D : pinocchio::CONTACT_3D, model_,
                static_cast<std::size_t>(d.closure_joint[2 * c]), place_of(place),
                static_cast<std::size_t>(d.closure_joint[2 * c + 1]), place_of(place + 12), pinocchio::LOCAL);
            constraint_data_.emplace_back(constraints_.back());
        }
        for (auto* x : {&tau_, &moved_, &rate_, &slope_, &speeds_, &w_, &a_}) x->setZero(model_.nv);
        q_ = at_ = Vector::Zero(model_.nq);
    }

    // How many outputs were reached within the bound; a run that blew up ends before the first that was not.
    int run(const Request& r) {
        settings_ = Settings(r.accuracy, r.accuracy, r.mu, r.iterations);
        for (auto& c : constraints_) {
            c.m_baumgarte_parameters.Kp = r.stiffness;
            c.m_baumgarte_parameters.Kd = r.damping;
        }
        algorithm_ = r.algorithm;
        if (algorithm_ == CONSTRAINT_DYNAMICS)
            pinocchio::initConstraintDynamics(model_, *data_, constraints_, constraint_data_);
        if (algorithm_ == LCABA) pinocchio::computeJointMinimalOrdering(model_, *data_, constraints_);
        q_ = Given(r.q, model_.nq);
        Vector v = Given(r.v, model_.nv);
        for (int i = 1; i <= r.outputs; ++i) {
            for (int s = 0; s < r.substeps; ++s) step(v, r.step);
            // so written for NaN's sake
            if (!(q_.cwiseAbs().maxCoeff() < r.bound && v.cwiseAbs().maxCoeff() < r.bound)) return i - 1;
            Eigen::Map<Vector>(r.q + i * model_.nq, model_.nq) = q_;
            Eigen::Map<Vector>(r.v + i * model_.nv, model_.nv) = v;
        }
        return r.outputs;
    }

    // a = q̈(q, v), (nv,)
    void acceleration(const Request& r, double* a) {
        Request none = r;
        none.outputs = 0;
        run(none);
        Eigen::Map<Vector>(a, model_.nv) = f(Given(r.q, model_.nq), Given(r.v, model_.nv));
    }

  private:
    const Vector& f(const Vector& q, const Vector& v) {
        forces(q, v);
        if (algorithm_ == CONSTRAINT_DYNAMICS)
            pinocchio::constraintDynamics(model_, *data_, q, v, tau_, constraints_, constraint_data_, settings_);
        else if (algorithm_ == LCABA)
            pinocchio::lcaba(model_, *data_, q, v, tau_, constraints_, constraint_data_, settings_);
        else
            pinocchio::aba(model_, *data_, q, v, tau_, pinocchio::Convention::WORLD);
        return data_->ddq;
    }

    // Springs, dampers and drives.
    void forces(const Vector& q, const Vector& v) {
        tau_ = Given(d_.drive, model_.nv) - Given(d_.damping, model_.nv).cwiseProduct(v);
        for (int i = 0; i < d_.springs; ++i)
            tau_[d_.spring_at[2 * i + 1]] -= d_.spring[2 * i] * (q[d_.spring_at[2 * i]] - d_.spring[2 * i + 1]);
        if (d_.lines == 0) return;
        pinocchio::forwardKinematics(model_, *data_, q, v);
        for (int i = 0; i < d_.lines; ++i) {
            const double* line = d_.line + 9 * i;
            V3 point[2], speed[2];
            for (int end = 0; end < 2; ++end) {
                const auto j = static_cast<std::size_t>(d_.line_joint[2 * i + end]);
                const pinocchio::SE3& place = data_->oMi[j];
                const V3 local(line + 3 * end);
                point[end] = place.act(local);
                speed[end] = place.rotation() * (data_->v[j].linear() + data_->v[j].angular().cross(local));
            }
            const V3 along = point[1] - point[0];
            const double length = along.norm();
            const V3 u = along / length;
            const V3 pull = (line[6] * (length - line[7]) + line[8] * u.dot(speed[1] - speed[0])) * u;
            for (int end = 0; end < 2; ++end) apply(d_.line_joint[2 * i + end], point[end], end ? V3(-pull) : pull);
        }
    }

    // A force at a point, both in the world, on the body of joint j.
    void apply(int j, const V3& point, const V3& force) {
        const pinocchio::Force wrench(force, point.cross(force));
        for (auto i = static_cast<std::size_t>(j); i > 0; i = model_.parents[i]) {
            const pinocchio::Force local = data_->oMi[i].actInv(wrench);
            const auto S = data_->joints[i].S().matrix();
            tau_.segment(model_.idx_vs[i], model_.nvs[i]) += S.transpose() * local.toVector();
        }
    }

    // The classical Runge-Kutta step in the chart q ⊕ x, ẋ = v + ½ [x, v] + ¹⁄₁₂ [x, [x, v]] (Munthe-Kaas).
    void step(Vector& v, double h) {
        a_ = f(q_, v);
        speeds_ = v;
        slope_ = a_;
        rate_ = v;
        const double shares[3] = {0.5, 0.5, 1.0};
        for (const double share : shares) {
            moved_ = share * h * rate_;
            w_ = v + share * h * a_;
            pinocchio::integrate(model_, q_, moved_, at_);
            a_ = f(at_, w_);
            rate_ = w_;
            correct(moved_, w_, rate_);
            const double weight = share == 1.0 ? 1.0 : 2.0;
            speeds_ += weight * rate_;
            slope_ += weight * a_;
        }
        moved_ = h / 6.0 * speeds_;
        at_ = q_;
        pinocchio::integrate(model_, at_, moved_, q_);
        v += h / 6.0 * slope_;
    }

    // The brackets of free and ball joints; others have none.
    void correct(const Vector& x, const Vector& v, Vector& rate) const {
        for (int j = 0; j < d_.joints; ++j) {
            if (d_.kind[j] < SPHERICAL) continue;
            const int at = model_.idx_vs[static_cast<std::size_t>(j) + 1];
            if (d_.kind[j] == SPHERICAL) {
                const V3 turn = x.segment<3>(at), once = turn.cross(V3(v.segment<3>(at)));
                rate.segment<3>(at) += 0.5 * once + turn.cross(once) / 12.0;
            } else {
                const pinocchio::Motion move(x.segment<6>(at)), once = move.cross(pinocchio::Motion(v.segment<6>(at)));
                rate.segment<6>(at) += 0.5 * once.toVector() + move.cross(once).toVector() / 12.0;
            }
        }
    }

    Description d_;
    Model model_;
    std::unique_ptr<Data> data_;
    PINOCCHIO_ALIGNED_STD_VECTOR(Constraint) constraints_;
    PINOCCHIO_ALIGNED_STD_VECTOR(ConstraintData) constraint_data_;
    Settings settings_;
    std::int32_t algorithm_ = CONSTRAINT_DYNAMICS;
    Vector tau_, moved_, rate_, slope_, speeds_, w_, a_, q_, at_;
};

}  // namespace

#define EXPORTED extern "C" __attribute__((visibility("default")))

EXPORTED void* loop_create(const Description* d) {
    try {
        return new Loop(*d);
    } catch (const std::exception&) {
        return nullptr;
    }
}

EXPORTED void loop_destroy(void* loop) { delete static_cast<Loop*>(loop); }

// Outputs reached; −1 when Pinocchio refuses.
EXPORTED std::int32_t loop_run(void* loop, const Request* r) {
    try {
        return static_cast<Loop*>(loop)->run(*r);
    } catch (const std::exception&) {
        return -1;
    }
}

EXPORTED std::int32_t loop_acceleration(void* loop, const Request* r, double* a) {
    try {
        static_cast<Loop*>(loop)->acceleration(*r, a);
        return 0;
    } catch (const std::exception&) {
        return -1;
    }
}
