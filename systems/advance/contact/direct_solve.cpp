#include "systems/advance/contact/direct_solve.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <bit>

#include "systems/advance/island/constants.hpp"
#include "systems/advance/rigid/free_bodies.hpp"
namespace trocar {
namespace {

using Matrix3 = Eigen::Matrix3d;
using Matrix36 = Eigen::Matrix<double, 3, 6>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Vector6 = Eigen::Matrix<double, 6, 1>;

Vec3d vec3(Vec4d v) { return {v[0], v[1], v[2]}; }

Matrix3 cross_matrix(const Vec3d& v) {
    Matrix3 m;
    m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
    return m;
}

// Velocity of a point of a body at `arm` from its centre: velocity and spin to m/s.
Matrix36 point_velocity(Vec4d arm) {
    Matrix36 j;
    j << Matrix3::Identity(), -cross_matrix(vec3(arm));
    return j;
}

// kg m^2, world axes
Matrix3 inertia_of(const AdvanceFree& f) {
    Matrix3 inverse;
    for (int k = 0; k < 3; ++k) inverse.col(k) = vec3(f.inv_inertia[k]);
    return inverse.inverse();
}

uint32_t node_of(const AdvanceIsland& island, uint32_t free) { return island.rigid[island.free[free].rigid].node; }

// Index in DirectSolve::body of a constraint's side; kNone if no free body is there.
uint32_t side_of(const ContactComponents& components, const AdvanceIsland& island, const PreparedConstraint::Angular& angular, int side) {
    return angular.free[side] == kNone ? kNone : components.component_of[node_of(island, angular.free[side])];
}

// Whether a constraint is between free bodies, or between one and a static body. Constraints of scripted
// bodies and hands are not: between closing jaws not all can be satisfied.
bool is_between_free(const AdvanceIsland& island, const PreparedConstraint& constraint) {
    if (!constraint.turns()) return false;
    const auto is_led = [&](uint32_t rigid) {
        return rigid != kNone && (island.rigid[rigid].path != kNone || island.rigid[rigid].tool != kNone);
    };
    if (is_led(constraint.rigid_a) || is_led(constraint.rigid_b)) return false;
    const auto is_loose = [&](uint32_t n) {
        if (island.nodes.node[n].particle != kNone) return false;
        const uint32_t free = island.rigid[island.nodes.node[n].owner].free;
        return free != kNone && !island.free[free].held;
    };
    return std::all_of(constraint.node.begin(), constraint.node.begin() + constraint.nodes, is_loose);
}

// Numbers the bodies of a component so that neighbours are close (Cuthill, McKee 1969): breadth first from
// one with fewest neighbours.
bool number_bodies(const AdvanceIsland& island, ContactComponents& components, std::span<PreparedConstraint* const> constraints,
                   DirectSolve& d) {
    d.body.clear();
    const auto meet = [&](uint32_t free) {
        if (free == kNone || std::ranges::find(d.body, free) != d.body.end()) return;
        components.component_of[node_of(island, free)] = static_cast<uint32_t>(d.body.size());
        d.body.push_back(free);
    };
    for (const PreparedConstraint* constraint : constraints) {
        if (!is_between_free(island, *constraint)) return false;
        for (const uint32_t free : constraint->angular.free) meet(free);
        if (d.body.size() > DirectSolve::kMostBodies) return false;
    }
    std::array<uint64_t, DirectSolve::kMostBodies> neighbours{};
    for (const PreparedConstraint* constraint : constraints) {
        const auto& angular = constraint->angular;
        const uint32_t a = side_of(components, island, angular, 0), b = side_of(components, island, angular, 1);
        if (a == kNone || b == kNone) continue;
        neighbours[a] |= uint64_t{1} << b;
        neighbours[b] |= uint64_t{1} << a;
    }
    const uint32_t count = static_cast<uint32_t>(d.body.size());
    uint32_t start = 0;
    for (uint32_t i = 1; i < count; ++i)
        if (std::popcount(neighbours[i]) < std::popcount(neighbours[start])) start = i;
    std::array<uint32_t, DirectSolve::kMostBodies> order{start};
    uint64_t met = uint64_t{1} << start;
    for (uint32_t next = 0, end = 1; next < end; ++next)
        for (uint64_t left = neighbours[order[next]] & ~met; left != 0; left &= left - 1) {
            order[end++] = static_cast<uint32_t>(std::countr_zero(left));
            met |= left & -left;
        }
    d.ordered.clear();
    for (uint32_t i = 0; i < count; ++i) d.ordered.push_back(d.body[order[i]]);
    std::swap(d.body, d.ordered);
    for (uint32_t i = 0; i < count; ++i) components.component_of[node_of(island, d.body[i])] = i;
    return true;
}

// How a constraint resists a velocity at its point: kg along its normal, and across it unless it slides.
// Constraints without load, or that are closing or bouncing, do not: four corners of a box with four target
// velocities would contradict each other.
struct Resistance {
    double along = 0, across = 0;
};
Resistance resistance_of(const PreparedConstraint& constraint) {
    if (!(constraint.normal_impulse > 0) || constraint.target_velocity != 0) return {};
    const double most = constraint.friction * constraint.normal_impulse;
    const bool sticks = norm2(constraint.friction_impulse) < kSticks * most * most;
    return {constraint.effective_mass / kSoftness, sticks ? constraint.angular.friction_mass / kSoftness : 0};
}

// N s
Vec4d resisting_impulse(const Resistance& resistance, Vec4d normal, Vec4d velocity) {
    return (resistance.across - resistance.along) * dot(normal, velocity) * normal - resistance.across * velocity;
}

void add_block(uint32_t row_body, uint32_t column_body, const Matrix6& block, DirectSolve& d) {
    for (int i = 0; i < 6; ++i) {
        double* to = d.row(6 * row_body + i) + 6 * column_body;
        for (int k = 0; k < 6; ++k) to[k] += block(i, k);
    }
}

void add_constraint(const ContactComponents& components, const AdvanceIsland& island, const PreparedConstraint& constraint,
                    DirectSolve& d) {
    const auto& angular = constraint.angular;
    const Resistance resistance = resistance_of(constraint);
    if (resistance.along == 0) return;
    const Vec3d n = vec3(constraint.normal);
    const Matrix3 matrix = (resistance.along - resistance.across) * n * n.transpose() + resistance.across * Matrix3::Identity();
    const Vec3d load = vec3(resisting_impulse(resistance, constraint.normal, free_point_velocity(island, constraint)));
    std::array<uint32_t, 2> at{side_of(components, island, angular, 0), side_of(components, island, angular, 1)};
    std::array<Matrix36, 2> jacobian, resisted;
    for (int side = 0; side < 2; ++side) {
        if (at[side] == kNone) continue;
        jacobian[side] = (side == 0 ? 1.0 : -1.0) * point_velocity(angular.arm[side]);
        resisted[side] = matrix * jacobian[side];
        Eigen::Map<Vector6>(d.solution.data() + 6 * at[side]) += jacobian[side].transpose() * load;
        const Matrix6 block = jacobian[side].transpose() * resisted[side];
        add_block(at[side], at[side], block, d);
    }
    if (at[0] == kNone || at[1] == kNone) return;
    const int low = at[0] < at[1] ? 0 : 1;
    const Matrix6 block = jacobian[1 - low].transpose() * resisted[low];
    add_block(at[1 - low], at[low], block, d);
}

void lay_out(const ContactComponents& components, const AdvanceIsland& island, std::span<PreparedConstraint* const> constraints,
             DirectSolve& d) {
    const uint32_t count = static_cast<uint32_t>(d.body.size());
    d.first.resize(count);
    d.begin.resize(count + 1);
    for (uint32_t i = 0; i < count; ++i) d.first[i] = i;
    for (const PreparedConstraint* constraint : constraints) {
        const auto& angular = constraint->angular;
        const uint32_t a = side_of(components, island, angular, 0), b = side_of(components, island, angular, 1);
        if (a == kNone || b == kNone) continue;
        d.first[std::max(a, b)] = std::min(d.first[std::max(a, b)], std::min(a, b));
    }
    d.begin[0] = 0;
    for (uint32_t i = 0; i < count; ++i) d.begin[i + 1] = d.begin[i] + 36 * (i - d.first[i] + 1);
}

double work_of(const DirectSolve& d) {
    double work = 0;
    for (uint32_t i = 0; i < d.body.size(); ++i) {
        const double width = 6.0 * (i - d.first[i] + 1);
        work += 3 * width * width;
    }
    return work;
}

void assemble(const ContactComponents& components, const AdvanceIsland& island, std::span<PreparedConstraint* const> constraints,
              DirectSolve& d) {
    const uint32_t count = static_cast<uint32_t>(d.body.size());
    d.matrix.assign(d.begin[count], 0.0);
    d.solution.assign(6 * count, 0.0);
    for (uint32_t i = 0; i < count; ++i) {
        const AdvanceFree& f = island.free[d.body[i]];
        Matrix6 inertia = Matrix6::Zero();
        inertia.topLeftCorner<3, 3>().diagonal().setConstant(f.mass.mass);
        inertia.bottomRightCorner<3, 3>() = inertia_of(f);
        add_block(i, i, inertia, d);
    }
    for (const PreparedConstraint* constraint : constraints) add_constraint(components, island, *constraint, d);
}

// Cholesky factor, overwriting the lower half of the matrix within its row envelope. False if there is none.
bool factorise(DirectSolve& d) {
    for (uint32_t r = 0; r < d.solution.size(); ++r) {
        double* matrix_row = d.row(r);
        const uint32_t first = d.first_column(r);
        for (uint32_t c = first; c <= r; ++c) {
            const double* other = d.row(c);
            const uint32_t from = std::max(first, d.first_column(c));
            double sum = matrix_row[c];
            for (uint32_t k = from; k < c; ++k) sum -= matrix_row[k] * other[k];
            if (c < r) {
                matrix_row[c] = sum / other[c];
            } else {
                if (!(sum > 0)) return false;
                matrix_row[c] = std::sqrt(sum);
            }
        }
    }
    return true;
}

void substitute(DirectSolve& d) {
    const uint32_t size = static_cast<uint32_t>(d.solution.size());
    for (uint32_t r = 0; r < size; ++r) {
        const double* matrix_row = d.row(r);
        for (uint32_t k = d.first_column(r); k < r; ++k) d.solution[r] -= matrix_row[k] * d.solution[k];
        d.solution[r] /= matrix_row[r];
    }
    for (uint32_t r = size; r-- > 0;) {
        const double* matrix_row = d.row(r);
        d.solution[r] /= matrix_row[r];
        for (uint32_t k = d.first_column(r); k < r; ++k) d.solution[k] -= matrix_row[k] * d.solution[r];
    }
}

// The impulse that a change of velocities causes, N s.
Vec4d impulse_of(const ContactComponents& components, const AdvanceIsland& island, const PreparedConstraint& constraint,
                 const DirectSolve& d) {
    const auto& angular = constraint.angular;
    const Resistance resistance = resistance_of(constraint);
    if (resistance.along == 0) return Vec4d{};
    Vec4d velocity = free_point_velocity(island, constraint);
    for (int side = 0; side < 2; ++side) {
        const uint32_t at = side_of(components, island, angular, side);
        if (at == kNone) continue;
        const double* u = d.solution.data() + 6 * at;
        const Vec4d change = make_vec4(u[0], u[1], u[2]) + cross(make_vec4(u[3], u[4], u[5]), angular.arm[side]);
        velocity += side == 0 ? change : -change;
    }
    return resisting_impulse(resistance, constraint.normal, velocity);
}

// Largest share of a change of impulse that a constraint can take before it pulls or, if it sticks, slides.
double longest_step(const PreparedConstraint& constraint, Vec4d impulse) {
    const double along = dot(impulse, constraint.normal);
    const double step = -along > constraint.normal_impulse ? constraint.normal_impulse / -along : 1;
    const Vec4d across = impulse - along * constraint.normal;
    const double most = constraint.friction * constraint.normal_impulse, grows = constraint.friction * along;
    // |friction_impulse + t across|^2 = (most + t grows)^2
    const double a = norm2(across) - grows * grows, half_b = dot(constraint.friction_impulse, across) - most * grows,
                 c = norm2(constraint.friction_impulse) - most * most;
    if (!(c < 0) || norm2(constraint.friction_impulse) >= kSticks * most * most || a + 2 * half_b + c <= 0) return step;
    const double root = std::sqrt(std::max(0.0, half_b * half_b - a * c));
    return std::min(step, -c / (half_b + root));
}

void apply(Vec4d impulse, AdvanceIsland& island, PreparedConstraint& constraint) {
    const double along = dot(impulse, constraint.normal);
    constraint.normal_impulse = std::max(0.0, constraint.normal_impulse + along);
    constraint.friction_impulse += impulse - along * constraint.normal;
    give_impulse(constraint, impulse, island);
}

}  // namespace

bool prepare_direct(const AdvanceIsland& island, ContactComponents& components, std::span<PreparedConstraint* const> constraints,
                    DirectSolve& d) {
    if (!number_bodies(island, components, constraints, d)) return false;
    lay_out(components, island, constraints, d);
    return work_of(d) < kMostWorkPerConstraint * static_cast<double>(constraints.size());
}

bool solve_directly(const ContactComponents& components, AdvanceIsland& island, std::span<PreparedConstraint* const> constraints,
                    DirectSolve& d) {
    assemble(components, island, constraints, d);
    if (!factorise(d)) return false;
    substitute(d);
    if (!std::ranges::all_of(d.solution, [](double x) { return std::isfinite(x); })) return false;
    d.before.clear();
    for (const uint32_t free : d.body) d.before.push_back({island.nodes.node[node_of(island, free)].velocity, island.free[free].spin});
    d.impulse_before.clear();
    d.impulse.clear();
    double step = 1;
    for (const PreparedConstraint* constraint : constraints) {
        d.impulse_before.push_back({constraint->friction_impulse, constraint->normal_impulse});
        d.impulse.push_back(impulse_of(components, island, *constraint, d));
        step = std::min(step, longest_step(*constraint, d.impulse.back()));
    }
    for (size_t i = 0; i < constraints.size(); ++i) apply(step * d.impulse[i], island, *constraints[i]);
    return true;
}

void undo_solution(const DirectSolve& d, AdvanceIsland& island, std::span<PreparedConstraint* const> constraints) {
    for (size_t i = 0; i < d.body.size(); ++i) {
        const ContactNode node = island.nodes.node[node_of(island, d.body[i])];
        node.velocity = d.before[i].velocity;
        island.free[d.body[i]].spin = d.before[i].spin;
    }
    for (size_t i = 0; i < constraints.size(); ++i) {
        constraints[i]->friction_impulse = d.impulse_before[i].friction;
        constraints[i]->normal_impulse = d.impulse_before[i].normal;
    }
}

double potential(const AdvanceIsland& island, const DirectSolve& d, std::span<PreparedConstraint* const> constraints) {
    double sum = 0;
    for (const uint32_t free : d.body) {
        const AdvanceFree& f = island.free[free];
        sum += 0.5 * f.mass.mass * norm2(island.nodes.node[node_of(island, free)].velocity) +
               0.5 * vec3(f.spin).dot(inertia_of(f) * vec3(f.spin));
    }
    for (const PreparedConstraint* constraint : constraints) sum -= constraint->normal_impulse * constraint->target_velocity;
    return sum;
}

}  // namespace trocar
