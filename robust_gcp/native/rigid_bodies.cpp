// Pinocchio's algorithms on the kernel's joints.
#include "rigid_bodies.h"

#include <pinocchio/fwd.hpp>

#include <memory>
#include <string>

#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/jacobian.hpp>
#include <pinocchio/algorithm/rnea.hpp>
#include <pinocchio/multibody.hpp>

#include "joints.h"  // after Pinocchio, whose types it names

namespace rg {

using Model = pinocchio::ModelTpl<double, 0, Joints>;
using Data = pinocchio::DataTpl<double, 0, Joints>;
using Vector = Eigen::Map<const Eigen::VectorXd>;

static Model build(const Description& d) {
    Model model;
    for (int j = 1; j <= d.joints; ++j) {
        const double* m = d.placement + 12 * (j - 1);
        const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> R(m);
        const pinocchio::SE3 placement(R, Eigen::Vector3d(m[9], m[10], m[11]));
        const auto parent = static_cast<std::size_t>(d.parent[j - 1]);
        const std::string name = std::to_string(j);
        const auto index = model.addJoint(parent, pinocchio_joint(d.kind[j - 1]), placement, name);
        const double* i = d.inertia + 10 * (j - 1);
        Eigen::Matrix3d about;
        about << i[4], i[5], i[7], i[5], i[6], i[8], i[7], i[8], i[9];
        model.inertias[index] = pinocchio::Inertia(i[0], Eigen::Vector3d(i[1], i[2], i[3]), about);
    }
    model.armature = Vector(d.armature, d.nv);
    model.gravity.linear() = Eigen::Vector3d(d.gravity[0], d.gravity[1], d.gravity[2]);
    return model;
}

#if PINOCCHIO_MAJOR_VERSION == 4 && PINOCCHIO_MINOR_VERSION == 1
// Data of which only what `rnea`, `crba` and `computeJointJacobians` read and write has its size: a whole one
// holds four tensors of nv³ numbers. The algorithms of this version were looked through for that.
static std::unique_ptr<Data> workspace(const Model& model) {
    auto data = std::make_unique<Data>();
    const auto joints = static_cast<std::size_t>(model.njoints);
    for (const auto& joint : model.joints) data->joints.push_back(joint.createData());
    data->liMi.assign(joints, pinocchio::SE3::Identity());
    data->oMi.assign(joints, pinocchio::SE3::Identity());
    for (auto* motions : {&data->v, &data->a_gf}) motions->assign(joints, pinocchio::Motion::Zero());
    for (auto* forces : {&data->f, &data->h}) forces->assign(joints, pinocchio::Force::Zero());
    data->oYcrb.assign(joints, pinocchio::Inertia::Zero());
    data->J = data->Ag = Data::Matrix6x::Zero(6, model.nv);
    data->M = Data::MatrixXs::Zero(model.nv, model.nv);
    data->tau = Eigen::VectorXd::Zero(model.nv);
    data->mass.assign(1, 0.0);  // of the whole, and its centre
    data->com.assign(1, Eigen::Vector3d::Zero());
    data->nvSubtree.assign(joints, 0);
    for (std::size_t j = joints; j-- > 1;) {
        data->nvSubtree[j] += model.nvs[j];
        data->nvSubtree[model.parents[j]] += data->nvSubtree[j];
    }
    return data;
}
#else
static std::unique_ptr<Data> workspace(const Model& model) { return std::make_unique<Data>(model); }
#endif

struct RigidBodies::Pinocchio {
    explicit Pinocchio(const Description& d) : model(build(d)) {}

    // Made when first asked for, which steps do not.
    Data& data() {
        if (made == nullptr) made = workspace(model);
        return *made;
    }

    Vector q(const double* q) const { return {q, model.nq}; }
    Vector v(const double* v) const { return {v, model.nv}; }

    Model model;
    std::unique_ptr<Data> made;
};

RigidBodies::RigidBodies(const Description& d) : pinocchio_(new Pinocchio(d)) {}
RigidBodies::~RigidBodies() = default;

void RigidBodies::right_hand_side(const double* q, const double* v) {
    Pinocchio& p = *pinocchio_;
    pinocchio::computeJointJacobians(p.model, p.data(), p.q(q));
    pinocchio::rnea(p.model, p.data(), p.q(q), p.v(v), p.v(v));
    pinocchio::rnea(p.model, p.data(), p.q(q), p.v(v), p.v(v));
    pinocchio::crba(p.model, p.data(), p.q(q), pinocchio::Convention::WORLD);
}

}  // namespace rg
