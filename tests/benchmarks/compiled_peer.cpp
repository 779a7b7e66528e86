// Four frequencies and the tip's drop of a held arm of three ball joints, by Pinocchio and Eigen: what compiled C++ takes.
//
// Coordinates p are the rotation vectors of the ball joints in the axes of their shafts, so that the stiffness K is a
// constant diagonal; a joint's velocity is B(p) dp/dt, B = 1 - a [p] + b [p]^2, a = (1 - cos t) / t^2, b = (t - sin t) /
// t^3, t = |p|. Equilibrium: B'g(p) + K p = 0. Modes: (K + slope of B'g) v = lambda B'MB v.

#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/joint-configuration.hpp>
#include <pinocchio/algorithm/kinematics.hpp>
#include <pinocchio/algorithm/rnea-derivatives.hpp>
#include <pinocchio/algorithm/rnea.hpp>
#include <pinocchio/multibody.hpp>

#include <Eigen/Eigenvalues>
#include <cmath>

namespace pin = pinocchio;
using Eigen::Matrix3d, Eigen::Vector3d;
constexpr int JOINTS = 3, N = 3 * JOINTS;
using Vector = Eigen::Matrix<double, N, 1>;
using Matrix = Eigen::Matrix<double, N, N>;
using Configuration = Eigen::Matrix<double, 4 * JOINTS, 1>;

struct Held {
  pin::Model model;
  pin::Data data;
  Vector3d end;
  double rest;
};

static Matrix3d cross(const Vector3d& v) {
  Matrix3d S;
  S << 0, -v[2], v[1], v[2], 0, -v[0], -v[1], v[0], 0;
  return S;
}

// The slopes a', b' are those by t^2 / 2; series where t is small, as a gravity-loaded bushing's twist always is.
static void series(double t2, double& a, double& b, double& a1, double& b1) {
  if (t2 > 0.04) {
    const double t = std::sqrt(t2), s = std::sin(t), c = std::cos(t);
    a = (1 - c) / t2, b = (t - s) / (t2 * t);
    a1 = (s / t - 2 * a) / t2, b1 = (a - 3 * b) / t2;
    return;
  }
  a = 0.5 - t2 * (1 / 24. - t2 * (1 / 720. - t2 * (1 / 40320. - t2 / 3628800.)));
  b = 1 / 6. - t2 * (1 / 120. - t2 * (1 / 5040. - t2 * (1 / 362880. - t2 / 39916800.)));
  a1 = -(1 / 12. - t2 * (1 / 180. - t2 * (1 / 6720. - t2 / 453600.)));
  b1 = -(1 / 60. - t2 * (1 / 1260. - t2 * (1 / 60480. - t2 / 4989600.)));
}

static Configuration configuration(const Vector& p) {
  Configuration q;
  for (int j = 0; j < JOINTS; ++j) {
    const Vector3d v = p.segment<3>(3 * j);
    const double half = v.norm() / 2, s = half > 1e-8 ? std::sin(half) / (2 * half) : 0.5;
    q.segment<4>(4 * j) << s * v, std::cos(half);
  }
  return q;
}

extern "C" Held* held(const double* places, const double* bodies, const double* gravity, const double* end) {
  auto* arm = new Held;
  arm->model.gravity.linear() = Eigen::Map<const Vector3d>(gravity);
  pin::JointIndex parent = 0;
  for (int j = 0; j < JOINTS; ++j) {
    const double *place = places + 12 * j, *body = bodies + 13 * j;
    using Rows = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
    const pin::SE3 at(Matrix3d(Eigen::Map<const Rows>(place)), Vector3d(Eigen::Map<const Vector3d>(place + 9)));
    parent = arm->model.addJoint(parent, pin::JointModelSpherical(), at, "joint" + std::to_string(j));
    const pin::Inertia inertia(body[0], Eigen::Map<const Vector3d>(body + 1), Matrix3d(Eigen::Map<const Rows>(body + 4)));
    arm->model.appendBodyToJoint(parent, inertia, pin::SE3::Identity());
  }
  arm->data = pin::Data(arm->model);
  arm->end = Eigen::Map<const Vector3d>(end);
  pin::forwardKinematics(arm->model, arm->data, configuration(Vector::Zero()));
  arm->rest = arm->data.oMi[JOINTS].act(arm->end)[2];
  return arm;
}

// stiffness (N, count), row by row; out (modes + 1, count): hertz and drop.
extern "C" void predict(Held* arm, const double* stiffness, int count, int modes, double* out) {
  Eigen::GeneralizedSelfAdjointEigenSolver<Matrix> solver;
  for (int i = 0; i < count; ++i) {
    Vector k, p = Vector::Zero(), residual;
    for (int n = 0; n < N; ++n) k[n] = stiffness[n * count + i];
    Matrix H, B = Matrix::Zero(), D(N, N);
    for (int turn = 0; turn < 12; ++turn) {
      const Configuration q = configuration(p);
      D.setZero();
      pin::computeGeneralizedGravityDerivatives(arm->model, arm->data, q, D);
      const Vector g = arm->data.g;
      Matrix chart = Matrix::Zero();
      for (int j = 0; j < JOINTS; ++j) {
        const Vector3d v = p.segment<3>(3 * j), m = g.segment<3>(3 * j), vm = v.cross(m), vvm = v.cross(vm);
        double a, b, a1, b1;
        series(v.squaredNorm(), a, b, a1, b1);
        const Matrix3d S = cross(v);
        B.block<3, 3>(3 * j, 3 * j) = Matrix3d::Identity() - a * S + b * S * S;
        chart.block<3, 3>(3 * j, 3 * j) =
            -a * cross(m) - b * (cross(vm) + S * cross(m)) + (a1 * vm + b1 * vvm) * v.transpose();
      }
      residual = B.transpose() * g + k.cwiseProduct(p);
      H = B.transpose() * D * B + chart;
      H.diagonal() += k;
      H = (0.5 * (H + H.transpose())).eval();
      const Vector move = H.ldlt().solve(residual);
      // Newton's last move is not taken: H and B belong to this p, and the error left is the square of the move.
      if (move.cwiseAbs().maxCoeff() < 1e-10) break;
      p -= move;
    }
    pin::crba(arm->model, arm->data, configuration(p), pin::Convention::WORLD);
    Matrix M = arm->data.M;
    M.triangularView<Eigen::StrictlyLower>() = M.transpose().triangularView<Eigen::StrictlyLower>();
    solver.compute(H, (B.transpose() * M * B).eval(), Eigen::EigenvaluesOnly | Eigen::Ax_lBx);
    for (int n = 0; n < modes; ++n) out[n * count + i] = std::sqrt(solver.eigenvalues()[n]) / (2 * M_PI);
    pin::forwardKinematics(arm->model, arm->data, configuration(p));
    out[modes * count + i] = arm->rest - arm->data.oMi[JOINTS].act(arm->end)[2];
  }
}
