#include "engine/tissue/deformable_setup.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <string>

#include "engine/base/check.hpp"
#include "engine/base/error.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/tissue/bending_forces.hpp"
#include "engine/tissue/pressure_force.hpp"
#include "engine/tissue/stable_step.hpp"
namespace trocar {
namespace {

[[noreturn]] void refuse(const Bodies& bodies, uint32_t body, const std::string& reason) {
    throw InputError((bodies.name[body].empty() ? "body " + std::to_string(body) : bodies.name[body]) + ": " + reason);
}

void check_tissue(const Bodies& bodies, uint32_t body) {
    const Tissue& tissue = bodies.tissue[body];
    const auto positive = [&](double value, const char* what) {
        if (!(value > 0 && std::isfinite(value))) refuse(bodies, body, std::string(what) + " must be positive");
    };
    const auto not_negative = [&](double value, const char* what) {
        if (!(value >= 0 && std::isfinite(value))) refuse(bodies, body, std::string(what) + " must not be negative");
    };
    positive(tissue.youngs_modulus, "Young's modulus");
    positive(tissue.density, "density");
    positive(tissue.wall, "wall");
    positive(tissue.depth, "depth");
    not_negative(tissue.damping, "damping");
    not_negative(tissue.friction, "friction");
    not_negative(tissue.pressure_modulus, "pressure modulus");
    not_negative(tissue.bending, "bending");
}

void check_poisson(const Bodies& bodies, uint32_t body) {
    const double nu = bodies.tissue[body].poisson;
    if (!(nu >= 0.25 && nu < 0.4999))
        refuse(bodies, body, "Poisson's ratio of a solid must be at least 0.25 (springs cannot do less) and below 0.5");
}

double body_mass(const MeshInfo& info, const Tissue& tissue, double thickness) {
    if (info.admission == Admission::kSheet) return tissue.density * info.area * (thickness > 0 ? thickness : tissue.wall);
    return tissue.density * std::abs(info.volume);
}

// Goals of a free body are relative to their stiffness-weighted centroid: small numbers stay precise in
// float.
void centre_goals(Anchors& anchors, Range range) {
    Vec3d sum = Vec3d::Zero();
    double stiffness = 0;
    for (uint32_t p = range.first; p < range.end(); ++p) {
        sum += anchors.stiffness[p] * Vec3d(anchors.rest_x[p], anchors.rest_y[p], anchors.rest_z[p]);
        stiffness += anchors.stiffness[p];
    }
    if (stiffness <= 0) return;
    const Vec3d centre = sum / stiffness;
    for (uint32_t p = range.first; p < range.end(); ++p) {
        anchors.rest_x[p] = static_cast<float>(anchors.rest_x[p] - centre.x());
        anchors.rest_y[p] = static_cast<float>(anchors.rest_y[p] - centre.y());
        anchors.rest_z[p] = static_cast<float>(anchors.rest_z[p] - centre.z());
    }
}

// Whether the preceding body is a copy: all inputs of stable_dt are the same (none is a position).
bool steps_as_body_before(uint32_t body, Range range, const Particles& particles, const Anchors& anchors, const Bodies& bodies) {
    if (body == 0 || bodies.mesh[body - 1] != bodies.mesh[body] || !std::isfinite(bodies.stable_dt[body - 1])) return false;
    const Range before = bodies.particles[body - 1], own = bodies.particles[body];
    const uint32_t skin = own.count - range.count;
    if (before.count != own.count || before.end() > own.first || bodies.spring_stiffness[body - 1] != bodies.spring_stiffness[body])
        return false;
    if (bodies.tissue[body - 1].damping != bodies.tissue[body].damping) return false;
    for (const uint32_t b : {body - 1, body})
        if (has_pressure(bodies, b) || has_bending(bodies, b)) return false;
    for (uint32_t i = skin; i < own.count; ++i) {
        const uint32_t p = before.first + i, q = own.first + i;
        if (particles.offset[p].w != particles.offset[q].w || anchors.stiffness[p] != anchors.stiffness[q]) return false;
    }
    return true;
}

}  // namespace

void add_deformable(const Meshes& meshes, const Springs& springs, const Poses& poses, uint32_t body, Bodies& bodies, Particles& particles,
                    Anchors& anchors, const BodyNodes* nodes) {
    check_tissue(bodies, body);
    if (nodes) check_poisson(bodies, body);
    const uint32_t prototype = bodies.mesh[body];
    TROCAR_ASSERT(prototype < springs.vertices.size());
    const MeshInfo& info = meshes.info[prototype];
    const Tissue& tissue = bodies.tissue[body];
    if (has_pressure(bodies, body) && (info.admission != Admission::kSolid || info.volume == 0))
        refuse(bodies, body, "only a closed, oriented surface without self-crossings keeps its volume (pressure modulus)");
    const std::span share = std::span(springs.area_share).subspan(springs.vertices[prototype].first, springs.vertices[prototype].count);
    const double mass = nodes ? tissue.density * std::accumulate(nodes->volume.begin(), nodes->volume.end(), 0.0)
                              : body_mass(info, tissue, bodies.thickness[body]);
    if (!(mass > 0 && std::isfinite(mass) && info.area > 0)) refuse(bodies, body, "a deformable body must have a mass");

    bodies.spring_stiffness[body] =
        static_cast<float>(nodes ? nodes->spring_stiffness : 0.5 * std::sqrt(3.0) * tissue.youngs_modulus * tissue.wall);
    bodies.inv_mass[body] = 0;
    const Range range{static_cast<uint32_t>(particles.offset.size()), static_cast<uint32_t>(share.size())};
    bodies.particles[body] = range;
    particles.offset.resize(range.end());
    for (auto* field : {&particles.velocity_x, &particles.velocity_y, &particles.velocity_z, &anchors.stiffness, &anchors.rest_x,
                        &anchors.rest_y, &anchors.rest_z}) {
        field->resize(range.end(), 0.0f);
    }
    if (particles.last_dt.size() <= body) particles.last_dt.resize(body + 1, 0.0);

    const bool turned = bodies.anchor_frame[body] == AnchorFrame::kWorld;
    const uint32_t skin = nodes ? nodes->skin : 0;
    const uint32_t surface = skin > 0 ? 0 : info.vertices.count;
    const uint32_t count = surface + (nodes ? static_cast<uint32_t>(nodes->inner.size()) : 0);
    for (uint32_t v = 0; v < count; ++v) {
        const uint32_t p = range.first + skin + v;
        const Vec3d rest = v < surface ? meshes.position[info.vertices.first + v] : nodes->inner[v - surface];
        const Vec3d placed = rotate(poses.orientation[body], rest);
        Float4& offset = particles.offset[p];
        offset = {static_cast<float>(placed.x()), static_cast<float>(placed.y()), static_cast<float>(placed.z()), 0.0f};
        if (nodes && nodes->volume[v] > 0) offset.w = static_cast<float>(1.0 / (tissue.density * nodes->volume[v]));
        if (share[skin + v] > 0) {
            if (!nodes) offset.w = static_cast<float>(1.0 / (mass * share[v] / info.area));
            anchors.stiffness[p] = static_cast<float>(tissue.youngs_modulus * share[skin + v] / tissue.depth);
        }
        anchors.rest_x[p] = turned ? offset.x : static_cast<float>(rest.x());
        anchors.rest_y[p] = turned ? offset.y : static_cast<float>(rest.y());
        anchors.rest_z[p] = turned ? offset.z : static_cast<float>(rest.z());
    }
    if (!turned) centre_goals(anchors, {range.first + skin, count});
    if (!nodes) update_stable_dt(springs, body, particles, anchors, bodies);
}

void update_stable_dt(const Springs& springs, uint32_t body, const Particles& particles, const Anchors& anchors, Bodies& bodies) {
    const uint32_t prototype = bodies.mesh[body];
    const uint32_t skin = springs.info[prototype].skin;
    const Range slices = springs.info[prototype].slices, range{bodies.particles[body].first + skin, bodies.particles[body].count - skin};
    // ten thousand copies would take 1.3 s
    if (steps_as_body_before(body, range, particles, anchors, bodies)) return void(bodies.stable_dt[body] = bodies.stable_dt[body - 1]);
    const std::span held = std::span(anchors.stiffness).subspan(range.first, range.count);
    const std::vector<double> diagonal(held.begin(), held.end());
    double omega_squared =
        stiffest_mode({std::span(springs.slice_column).subspan(slices.first + prototype, slices.count + 1), springs.neighbour.data(),
                       springs.info[prototype].varied ? springs.factor.data() : nullptr, bodies.spring_stiffness[body], diagonal,
                       std::span(particles.offset).subspan(range.first, range.count)});
    if (has_pressure(bodies, body)) omega_squared += pressure_omega_squared(springs, bodies, particles, body);
    if (has_bending(bodies, body)) omega_squared += bending_omega_squared(springs, bodies, particles, body);
    const double damping = bodies.tissue[body].damping;
    bodies.stable_dt[body] = omega_squared > 0 ? kStableShare * (std::sqrt(damping * damping + 4 * omega_squared) - damping) / omega_squared
                                               : std::numeric_limits<double>::infinity();
    double radius = 0;
    for (uint32_t p = range.first; p < range.end(); ++p)
        radius = std::max(radius, std::hypot(double{particles.offset[p].x}, double{particles.offset[p].y}, double{particles.offset[p].z}));
    if (is_heated_by_rounding(radius, bodies.stable_dt[body])) bodies.stable_dt[body] *= kStiffShare / kStableShare;
}

uint32_t substeps_for(double seconds, double stable_dt, double largest) {
    const double dt = std::min(stable_dt, largest);
    TROCAR_ASSERT(dt > 0 && seconds >= 0);
    // a quotient that is an integer up to rounding counts as that integer
    return static_cast<uint32_t>(std::clamp(std::ceil(seconds / dt * (1 - 1e-12)), 1.0, 1e9));
}

}  // namespace trocar
