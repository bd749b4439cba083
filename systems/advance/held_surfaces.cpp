#include "systems/advance/held_surfaces.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include "engine/contact/sleeping_bodies.hpp"
#include "engine/geometry/point_triangle.hpp"
#include "engine/mesh/side_by_side.hpp"
#include "engine/tissue/link_energy.hpp"
namespace trocar {
namespace {

constexpr uint32_t kMostRings = 6;       // added one by one before the whole body is held
constexpr double kFreeShare = 0.49;      // of a distance that either side may go: below a half by what floats round
constexpr double kFarthestLook = 0.75;   // of a mean edge: farther parts need not be looked for, as none goes half of this
constexpr double kClearance = 1e-4;      // of a mean edge, between faces that are parted: some hundred times the rounding of floats
constexpr uint32_t kPartingRounds = 16;  // of parting what crosses: parting some faces may push others together
constexpr uint32_t kPartingSweeps = 40;
constexpr uint32_t kBrakedRings = 3;  // around what was parted, braked first where that stretched it

// A body whose surface crosses itself at the end of a pass.
struct CrossedBody {
    uint32_t body;
    MeshView mesh;
    std::span<const Float4> start;  // m, of its particles
    Particles& particles;
    uint32_t first;  // of its particles

    Float4* offset() const { return particles.offset.data() + first; }
    Vec3d velocity(uint32_t v) const {
        return {particles.velocity_x[first + v], particles.velocity_y[first + v], particles.velocity_z[first + v]};
    }
    void set_velocity(uint32_t v, const Vec3d& to) const {
        particles.velocity_x[first + v] = static_cast<float>(to.x());
        particles.velocity_y[first + v] = static_cast<float>(to.y());
        particles.velocity_z[first + v] = static_cast<float>(to.z());
    }
};

double energy_of(const EnergyInputs& inputs, uint32_t body, BodyEnergyScratch& scratch) {
    Energy sum;
    add_body_energy(inputs, body, scratch, sum);
    return sum.kinetic + sum.elastic + sum.pressure + sum.bending + sum.gravity + energy_of_links(inputs, body, body);
}

void hold_vertex(uint32_t v, HeldSurfacesScratch& scratch) {
    if (scratch.held[v]) return;
    scratch.held[v] = 1;
    scratch.vertex.push_back(v);
}
void hold_faces(const CrossedBody& b, HeldSurfacesScratch& scratch) {
    for (const uint32_t face : scratch.faces)
        for (const uint32_t v : b.mesh.triangle[face]) hold_vertex(v, scratch);
}
void hold_ring(const CrossedBody& b, HeldSurfacesScratch& scratch) {
    const size_t count = scratch.vertex.size();
    for (size_t i = 0; i < count; ++i) {
        const uint32_t v = scratch.vertex[i];
        for (uint32_t k = b.mesh.incident_first[v]; k < b.mesh.incident_first[v + 1]; ++k)
            for (const uint32_t w : b.mesh.triangle[b.mesh.incident[k]]) hold_vertex(w, scratch);
    }
}

// Whether none of the held vertices is fixed: they may go along with what carries them.
bool all_free(const CrossedBody& b, std::span<const uint32_t> vertices) {
    return std::ranges::all_of(vertices, [&](uint32_t v) { return b.start[v].w > 0; });
}

// Mean by mass over the held vertices. value(v): Vec3d.
template <typename Value>
Vec3d mean_of(const CrossedBody& b, std::span<const uint32_t> vertices, const Value& value) {
    Vec3d sum = Vec3d::Zero();
    double mass = 0;
    for (const uint32_t v : vertices) sum += value(v) / double{b.start[v].w}, mass += 1 / double{b.start[v].w};
    return sum / mass;
}

// The spin (rad/s, or rad) with an angular momentum of particles about their centre of mass; zero about axes on which all of them are.
// from_centre(v): m.
template <typename Place>
Vec3d spin_with(const CrossedBody& b, std::span<const uint32_t> vertices, const Place& from_centre, const Vec3d& momentum) {
    constexpr double kThin = 1e-6;  // of the greatest moment of inertia: of points on a line
    Eigen::Matrix3d inertia = Eigen::Matrix3d::Zero();
    for (const uint32_t v : vertices) {
        const Vec3d r = from_centre(v);
        inertia += (r.squaredNorm() * Eigen::Matrix3d::Identity() - r * r.transpose()) / double{b.start[v].w};
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> principal(inertia);
    Vec3d spin = Vec3d::Zero();
    for (int i = 0; i < 3; ++i)
        if (principal.eigenvalues()[i] > kThin * principal.eigenvalues()[2])
            spin += principal.eigenvectors().col(i) * (principal.eigenvectors().col(i).dot(momentum) / principal.eigenvalues()[i]);
    return spin;
}

Vec3d at(const Float4& p) { return {p.x, p.y, p.z}; }

// Distance of two edges p + s u, q + t v, m: clamped closest points (Ericson, Real-Time Collision Detection, 2005, 5.1.9).
double edge_distance(const Vec3d& p, const Vec3d& u, const Vec3d& q, const Vec3d& v) {
    const Vec3d r = p - q;
    const double a = u.squaredNorm(), e = v.squaredNorm(), f = v.dot(r), c = u.dot(r), b = u.dot(v), sine2 = a * e - b * b;
    const auto from = [&](double s) {
        const double t = e > 0 ? std::clamp((b * s + f) / e, 0.0, 1.0) : 0.0, best = a > 0 ? std::clamp((b * t - c) / a, 0.0, 1.0) : 0.0;
        return (r + best * u - t * v).norm();
    };
    return std::min({from(0), from(1), from(sine2 > 0 ? std::clamp((b * f - c * e) / sine2, 0.0, 1.0) : 0.0)});
}

// How far each vertex may go, from the surface at the start of the pass.
void measure_free_paths(const CrossedBody& b, HeldSurfacesScratch& scratch) {
    const double reach = kFarthestLook * b.mesh.info->mean_edge;
    build_feature_trees(b.mesh, b.start.data(), scratch.trees);
    find_near_features(b.mesh, b.start.data(), scratch.trees, scratch.trees, true, static_cast<float>(reach), scratch.near);
    std::vector<float>& path = scratch.free_path;
    path.assign(b.start.size(), std::numeric_limits<float>::infinity());  // of particles below the surface
    std::fill_n(path.begin(), b.mesh.position.size(), static_cast<float>(kFreeShare * reach));
    const auto limit = [&](uint32_t v, double distance) { path[v] = std::min(path[v], static_cast<float>(kFreeShare * distance)); };
    const auto place = [&](uint32_t v) { return at(b.start[v]); };
    for (const uint64_t pair : scratch.near.vertex_triangle) {
        const auto vertex = static_cast<uint32_t>(pair >> 32);
        const Triangle& t = b.mesh.triangle[static_cast<uint32_t>(pair)];
        const double distance = std::sqrt(closest_point_on_triangle(place(vertex), place(t[0]), place(t[1]), place(t[2])).squared_distance);
        for (const uint32_t v : {vertex, t[0], t[1], t[2]}) limit(v, distance);
    }
    for (const uint64_t pair : scratch.near.edge_edge) {
        const auto [p, q] = b.mesh.edge[static_cast<uint32_t>(pair >> 32)];
        const auto [r, s] = b.mesh.edge[static_cast<uint32_t>(pair)];
        const double distance = edge_distance(place(p), place(q) - place(p), place(r), place(s) - place(r));
        for (const uint32_t v : {p, q, r, s}) limit(v, distance);
    }
}

// How vertices are held.
struct Attempt {
    bool parts;   // faces that cross are parted; otherwise they go back along their displacement
    bool turn;    // what is held may turn as a rigid body; otherwise it only shifts
    double part;  // of the free paths; 0: the whole body goes back to where it started
};
// In this order: the first that adds no energy is taken, or else that which adds least. A patch that turns keeps its angular momentum, but
// where a body is pressed from outside, as by what it is linked to, that may stretch it more than a shift does.
constexpr Attempt kAttempts[] = {{true, true, 1},      {false, true, 1.0}, {false, true, 0.25}, {false, false, 1.0},
                                 {false, false, 0.25}, {false, true, 0},   {false, false, 0}};

// Leaves the held vertices within their free paths, those times a part, from where they were, moved along rigidly with all that are held.
void put_back(const CrossedBody& b, const Attempt& attempt, HeldSurfacesScratch& scratch) {
    const std::span<const uint32_t> held = scratch.vertex;
    const bool free = all_free(b, held);
    const Vec3d from = free ? mean_of(b, held, [&](uint32_t v) { return at(b.start[v]); }) : Vec3d(Vec3d::Zero());
    const Vec3d to = free ? mean_of(b, held, [&](uint32_t v) { return at(scratch.reached[v]); }) : from;
    const auto arm = [&](uint32_t v) -> Vec3d { return at(b.start[v]) - from; };
    Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();
    if (free && attempt.turn) {
        Vec3d momentum = Vec3d::Zero();  // of the displacements
        for (const uint32_t v : held) momentum += arm(v).cross(at(scratch.reached[v]) - to) / double{b.start[v].w};
        const Vec3d spin = spin_with(b, held, arm, momentum);
        if (spin.norm() > 0) turn = Eigen::AngleAxisd(spin.norm(), spin.normalized()).toRotationMatrix();
    }
    for (const uint32_t v : held) {
        const Vec3d along = to + turn * arm(v), own = at(scratch.reached[v]) - along;
        const double size = own.norm(), most = attempt.part * double{scratch.free_path[v]}, share = size <= most ? 1.0 : most / size;
        const Vec3d place = along + share * own;
        Float4& p = b.offset()[v];
        p.x = static_cast<float>(place.x()), p.y = static_cast<float>(place.y()), p.z = static_cast<float>(place.z());
        scratch.share[v] = static_cast<float>(share);
    }
}

// Velocities of vertices, relative to their common rigid motion, times their shares. If all are free, linear momentum is kept, and
// angular momentum with the places before (scratch.reached) and after.
void slow_down(const CrossedBody& b, std::span<const uint32_t> vertices, bool turn, const HeldSurfacesScratch& scratch) {
    if (vertices.empty()) return;
    const auto velocity = [&](uint32_t v) { return b.velocity(v); };
    const auto set = [&](uint32_t v, const Vec3d& to) { b.set_velocity(v, to); };
    if (!all_free(b, vertices)) {
        for (const uint32_t v : vertices) set(v, double{scratch.share[v]} * velocity(v));
        return;
    }
    const Vec3d centre = mean_of(b, vertices, [&](uint32_t v) { return at(b.offset()[v]); }), mean = mean_of(b, vertices, velocity);
    const auto arm = [&](uint32_t v) -> Vec3d { return at(b.offset()[v]) - centre; };
    if (!turn) {
        for (const uint32_t v : vertices) set(v, mean + double{scratch.share[v]} * (velocity(v) - mean));
        const Vec3d lost = mean - mean_of(b, vertices, velocity);
        for (const uint32_t v : vertices) set(v, velocity(v) + lost);
        return;
    }
    Vec3d momentum = Vec3d::Zero();  // about the centre that they have after
    for (const uint32_t v : vertices) momentum += (at(scratch.reached[v]) - centre).cross(velocity(v)) / double{b.start[v].w};
    const Vec3d spin = spin_with(b, vertices, arm, momentum);
    for (const uint32_t v : vertices) {
        const Vec3d along = mean + spin.cross(arm(v));
        set(v, along + double{scratch.share[v]} * (velocity(v) - along));
    }
    const Vec3d lost = mean - mean_of(b, vertices, velocity);
    for (const uint32_t v : vertices) momentum -= arm(v).cross(velocity(v)) / double{b.start[v].w};
    const Vec3d lost_spin = spin_with(b, vertices, arm, momentum);
    for (const uint32_t v : vertices) set(v, velocity(v) + lost + lost_spin.cross(arm(v)));
}

void hold_every_vertex(const CrossedBody& b, HeldSurfacesScratch& scratch) {
    for (uint32_t v = 0; v < b.start.size(); ++v)
        if (v < b.mesh.position.size() || b.start[v].w > 0) hold_vertex(v, scratch);  // not padding
}

// Puts the whole body back where it started.
void hold_all(const CrossedBody& b, bool turn, HeldSurfacesScratch& scratch) {
    hold_every_vertex(b, scratch);
    std::copy(b.start.begin(), b.start.end(), b.offset());
    scratch.share.assign(b.start.size(), 0);
    slow_down(b, scratch.vertex, turn, scratch);
}

std::array<uint32_t, 2> in_order(const std::array<uint32_t, 2>& pair) { return {std::min(pair[0], pair[1]), std::max(pair[0], pair[1])}; }

// Whether a pair of faces may cross at the end of a pass: it did at its start, or both faces are beside contours of then.
bool may_cross(const CrossedBody& b, const HeldSurfacesScratch& scratch, const std::array<uint32_t, 2>& pair) {
    if (std::ranges::binary_search(scratch.start_pairs, in_order(pair))) return true;
    return !scratch.strict && std::ranges::all_of(pair, [&](uint32_t t) {
        return std::ranges::any_of(b.mesh.triangle[t], [&](uint32_t v) { return scratch.beside[v] != 0; });
    });
}

// Finds the faces that cross and should not. Returns whether there are any.
bool find_new_crossings(const CrossedBody& b, HeldSurfacesScratch& scratch) {
    find_crossing_pairs(b.mesh.triangle, b.offset(), scratch.crossing, scratch.pairs);
    if (scratch.tangled) std::erase_if(scratch.pairs, [&](const auto& pair) { return may_cross(b, scratch, pair); });
    scratch.faces.clear();
    for (const auto& pair : scratch.pairs) scratch.faces.push_back(pair[0]), scratch.faces.push_back(pair[1]);
    return !scratch.faces.empty();
}

// Returns whether nothing crosses that should not.
bool hold_parts(const CrossedBody& b, const Attempt& attempt, HeldSurfacesScratch& scratch) {
    const auto crosses = [&] { return find_new_crossings(b, scratch); };
    scratch.held.assign(b.start.size(), 0);
    scratch.share.assign(b.start.size(), 1);
    scratch.vertex.clear();
    bool crossed = crosses();
    for (uint32_t ring = 0; crossed && ring <= kMostRings; ++ring) {
        if (ring == kMostRings)
            hold_every_vertex(b, scratch);
        else
            hold_faces(b, scratch), hold_ring(b, scratch);
        put_back(b, attempt, scratch);
        crossed = crosses();
    }
    slow_down(b, scratch.vertex, attempt.turn, scratch);
    return !crossed;
}

void put_place(const Vec3d& place, Float4& p) {
    p.x = static_cast<float>(place.x()), p.y = static_cast<float>(place.y()), p.z = static_cast<float>(place.z());
}

// Parts the faces that cross and should not, and stops their approach. Returns whether nothing crosses that should not.
bool part_crossings(const CrossedBody& b, HeldSurfacesScratch& scratch) {
    const size_t vertices = b.mesh.position.size();
    scratch.parted.clear(), scratch.place.resize(vertices);
    for (uint32_t v = 0; v < vertices; ++v) scratch.place[v] = at(scratch.reached[v]);
    const PartedSurface surface{b.mesh.triangle, b.start, scratch.place, kClearance * b.mesh.info->mean_edge};
    bool crossed = find_new_crossings(b, scratch);
    for (uint32_t round = 0; crossed && round < kPartingRounds; ++round) {
        for (const auto& pair : scratch.pairs) add_parted(surface, pair, scratch.parted);
        part_corners(surface, scratch.parted, kPartingSweeps);
        for (uint32_t v = 0; v < vertices; ++v) put_place(scratch.place[v], b.offset()[v]);
        crossed = find_new_crossings(b, scratch);
    }
    if (crossed) return false;
    scratch.free_velocity.resize(vertices);
    for (uint32_t v = 0; v < vertices; ++v) scratch.free_velocity[v] = b.velocity(v);
    stop_approach(surface, scratch.parted, scratch.free_velocity);
    for (uint32_t v = 0; v < vertices; ++v) b.set_velocity(v, scratch.free_velocity[v]);
    return true;
}

// Brakes vertices, relative to their common rigid motion, by no more than takes what the energy of the body is above `most` (J).
// Returns whether that sufficed.
bool brake(const EnergyInputs& inputs, const CrossedBody& b, std::span<const uint32_t> vertices, double most,
           HeldSurfacesScratch& scratch) {
    std::vector<Vec3d>& velocity = scratch.free_velocity;
    velocity.resize(b.start.size());
    for (const uint32_t v : vertices) velocity[v] = b.velocity(v);
    const auto energy_with = [&](double share) {
        for (const uint32_t v : vertices) b.set_velocity(v, velocity[v]), scratch.share[v] = static_cast<float>(share);
        slow_down(b, vertices, true, scratch);
        return energy_of(inputs, b.body, scratch.energy);
    };
    const double still = energy_with(0);
    if (still > most) return false;
    const double half = energy_with(0.5), whole = energy_with(1);
    if (whole <= most) return true;
    // still + a share + c share^2
    const double c = 2 * (whole - 2 * half + still), a = whole - still - c, root = std::sqrt(std::max(0.0, a * a + 4 * c * (most - still)));
    for (double share = c > 0 ? std::clamp((root - a) / (2 * c), 0.0, 1.0) : 0.0; energy_with(share) > most && share > 0;)
        share = share > 0.01 ? 0.99 * share : 0;  // rounding of floats
    return true;
}

// Parts what crosses, and pays for what that stretches with motion. Returns whether nothing crosses that should not.
bool part_and_brake(const EnergyInputs& inputs, const CrossedBody& b, double before, HeldSurfacesScratch& scratch) {
    scratch.held.assign(b.start.size(), 0);
    scratch.share.assign(b.start.size(), 1);
    scratch.vertex.clear();
    if (!part_crossings(b, scratch)) return false;
    for (const PartedCorners& c : scratch.parted)
        for (uint32_t k = 0; k < c.count[0] + c.count[1]; ++k) hold_vertex(c.vertex[k], scratch);
    const size_t parted = scratch.vertex.size();
    if (energy_of(inputs, b.body, scratch.energy) > before) {
        for (uint32_t ring = 0; ring < kBrakedRings; ++ring) hold_ring(b, scratch);
        if (!brake(inputs, b, scratch.vertex, before, scratch)) {
            hold_every_vertex(b, scratch);
            brake(inputs, b, scratch.vertex, before, scratch);
        }
    }
    scratch.share.assign(b.start.size(), 1);  // for Report::held_vertices
    for (const uint32_t v : std::span(scratch.vertex).first(parted)) scratch.share[v] = 0;
    return true;
}

void hold_body(const EnergyInputs& inputs, const CrossedBody& b, HeldSurfacesScratch& scratch) {
    const double before = energy_of(inputs, b.body, scratch.energy);
    Particles& p = b.particles;
    const auto rows = [&](std::vector<float>& column) { return std::span(column).subspan(b.first, b.start.size()); };
    scratch.reached.assign(b.offset(), b.offset() + b.start.size());
    for (size_t axis = 0; axis < 3; ++axis) {
        const auto from = rows(axis == 0 ? p.velocity_x : axis == 1 ? p.velocity_y : p.velocity_z);
        scratch.velocity[axis].assign(from.begin(), from.end());
    }
    scratch.free_path.clear();
    const auto start_again = [&] {
        std::ranges::copy(scratch.reached, b.offset());
        for (size_t axis = 0; axis < 3; ++axis)
            std::ranges::copy(scratch.velocity[axis], rows(axis == 0 ? p.velocity_x : axis == 1 ? p.velocity_y : p.velocity_z).begin());
    };
    const auto hold = [&](const Attempt& attempt) {
        start_again();
        if (attempt.parts) return part_and_brake(inputs, b, before, scratch);
        if (scratch.free_path.empty()) measure_free_paths(b, scratch);
        if (attempt.part > 0) return hold_parts(b, attempt, scratch);
        hold_all(b, attempt.turn, scratch);
        return true;
    };
    double least = std::numeric_limits<double>::infinity();
    Attempt best{false, false, 0};
    for (const Attempt& attempt : kAttempts) {
        if (!hold(attempt)) continue;
        const double energy = energy_of(inputs, b.body, scratch.energy);
        if (energy <= before) return;
        if (energy < least) least = energy, best = attempt;
    }
    if (!scratch.tangled) return void(hold(best));
    // A tangle may not be held at any price: held in every pass, it would pump energy. It crosses more, and is drawn apart.
    start_again();
    scratch.share.assign(b.start.size(), 1);
}

// Notes what crossed at the start of the pass. Returns the number of pairs of faces.
size_t note_tangle(const CrossedBody& b, HeldSurfacesScratch& scratch) {
    find_crossing_pairs(b.mesh.triangle, b.start.data(), scratch.crossing, scratch.start_pairs);
    for (auto& pair : scratch.start_pairs) pair = in_order(pair);
    std::ranges::sort(scratch.start_pairs);
    mark_beside(b.mesh.triangle, scratch.start_pairs, b.mesh.position.size(), scratch.ring, scratch.beside);
    return scratch.start_pairs.size();
}

}  // namespace

void note_start(const Surfaces& s, const Springs& springs, const Sleep& sleep, SelfContactStart& start) {
    start.body.clear(), start.particles.clear(), start.offset.clear();
    for (uint32_t body = 0; body < s.bodies.self_contact.size(); ++body) {
        const uint32_t mesh = s.bodies.mesh[body];
        if (!(s.bodies.self_contact[body] > 0) || mesh == kNone || !is_deformable(s.bodies, body) || is_asleep(sleep, body) ||
            springs.info[mesh].skin > 0)
            continue;
        const Range range = s.bodies.particles[body];
        start.body.push_back(body);
        start.particles.push_back({static_cast<uint32_t>(start.offset.size()), range.count});
        const auto from = s.particles.offset.begin() + range.first;
        start.offset.insert(start.offset.end(), from, from + range.count);
    }
}

void hold_surfaces(const SelfContactStart& start, const Meshes& meshes, const EnergyInputs& inputs, const Sleep& sleep, bool account_energy,
                   HeldSurfacesScratch& scratch, HeldSurfacesState state) {
    scratch.before = state.crossed;
    state.crossed.body.clear(), state.crossed.other.clear();
    for (size_t i = 0; i < scratch.before.body.size(); ++i)
        if (const uint32_t body = scratch.before.body[i];
            body == scratch.before.other[i] && is_asleep(sleep, body) && std::ranges::find(start.body, body) == start.body.end())
            state.crossed.body.push_back(body), state.crossed.other.push_back(body);
    for (size_t i = 0; i < start.body.size(); ++i) {
        const uint32_t body = start.body[i];
        const Range range = start.particles[i];
        const CrossedBody b{body, mesh_view(meshes, inputs.bodies.mesh[body]), std::span(start.offset).subspan(range.first, range.count),
                            state.particles, inputs.bodies.particles[body].first};
        bool before = false;
        for (size_t k = 0; k < scratch.before.body.size(); ++k) before |= scratch.before.body[k] == body && scratch.before.other[k] == body;
        const uint64_t crossings = count_crossing_faces(b.mesh.triangle, b.offset(), scratch.crossing);
        if (crossings == 0 && !before) continue;
        const uint64_t at_start = count_crossing_faces(b.mesh.triangle, b.start.data(), scratch.crossing) > 0 ? note_tangle(b, scratch) : 0;
        scratch.tangled = at_start > 0, scratch.strict = crossings > at_start;
        if (scratch.tangled) state.crossed.body.push_back(body), state.crossed.other.push_back(body);
        if (crossings == 0 || !find_new_crossings(b, scratch)) continue;
        const double energy = account_energy ? energy_of(inputs, body, scratch.energy) : 0;
        hold_body(inputs, b, scratch);
        stretch_links(inputs, body);
        state.report.held_vertices += std::ranges::count_if(scratch.vertex, [&](uint32_t v) { return scratch.share[v] < 1; });
        if (account_energy) state.energy.work_numeric += energy_of(inputs, body, scratch.energy) - energy;
    }
}

}  // namespace trocar
