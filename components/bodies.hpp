#pragma once
#include <algorithm>
#include <array>
#include <limits>
#include <numeric>
#include <string>
#include <string_view>
#include <vector>

#include "components/entity.hpp"
#include "components/fields.hpp"
#include "components/math.hpp"
namespace trocar {

enum class Motion : uint8_t {
    kStatic,      // never moves
    kKinematic,   // rigid, follows a scripted path
    kHand,        // rigid, follows a device through the virtual coupling
    kDeformable,  // particles and springs
    kFree,        // rigid, moved by forces: RigidMass
};

enum class AnchorFrame : uint8_t {
    kWorld,  // goals are rest positions under the body's rest pose: tissue held by its surroundings
    kShape,  // goals are the best-fit rigid copy of the rest shape: a free body that keeps its shape
};

enum class Integrator : uint8_t {
    kLeapfrog,       // explicit, second order; stable up to Bodies::stable_dt
    kBackwardEuler,  // implicit, first order: for stiff shells and sheets
};

// Time integration of a deformable body.
struct Stepping {
    Integrator integrator = Integrator::kLeapfrog;
    uint32_t iterations = 10;  // backward Euler: most solutions in a step
    double tolerance = 1e-3;   // backward Euler: largest change relative to the largest displacement at which iteration stops
    double step = std::numeric_limits<double>::infinity();  // s, upper limit; leapfrog also obeys stable_dt and the settings
    TROCAR_FIELDS(integrator, iterations, tolerance, step, "s");
};

// Material of a deformable body. SI units.
struct Tissue {
    double youngs_modulus = 10e3;  // Pa
    double density = 1050;         // kg/m^3
    double wall = 2e-3;            // m, thickness of the elastic membrane modelled by the surface springs
    double depth = 40e-3;          // m, depth of the elastic foundation behind the membrane, modelled by the anchors
    double poisson = 0.45;         // Poisson ratio, 0.25 (springs alone) up to 0.5; solids only
    double damping = 2;            // 1/s, decay rate of the velocity relative to the anchor frame
    double friction = 0.1;         // Coulomb coefficient
    double pressure_modulus = 0;   // Pa, K of an enclosed volume's energy 1/2 K (V - V0)^2 / V0; 0 = volume is free
    double bending = 0;            // Pa, Young's modulus of the membrane in bending; 0 = no bending stiffness
    double restitution = 0;        // coefficient of restitution, 0..1; between rigid bodies
    TROCAR_FIELDS(youngs_modulus, "Pa", density, "kg/m^3", wall, "m", depth, "m", poisson, damping, "1/s", friction, pressure_modulus, "Pa",
                  bending, "Pa", restitution);
};

// Elastic law of a solid: see engine/tissue/tet_forces.hpp.
enum class TissueLaw : uint8_t {
    kSprings,     // springs along the edges of the tetrahedra, and a penalty on their volumes
    kNeoHookean,  // stable neo-Hookean tetrahedra (Smith, de Goes, Kim, ACM TOG 37(2), 2018)
};

// Prony series of a solid: next to each edge of its tetrahedra Maxwell elements of share * the stiffness of an edge spring, which
// relax with the times. Long after a change only the elastic law is left.
struct Prony {
    static constexpr uint32_t kMost = 4;
    std::array<double, kMost> share{};  // of the long-term shear modulus
    std::array<double, kMost> time{};   // s, relaxation times; 0 = no branch, the last ones
    TROCAR_FIELDS(share, time, "s");
    uint32_t branches() const {
        return static_cast<uint32_t>(std::ranges::count_if(time, [](double t) { return t > 0; }));
    }
    double sum() const { return std::accumulate(share.begin(), share.end(), 0.0); }
};

// Mass of a free body. Its inertia tensor about the centre of mass is diagonal in the principal frame.
struct RigidMass {
    uint64_t body = kNone;
    double mass = 0;                     // kg
    Vec3d centre = Vec3d::Zero();        // m, centre of mass, body frame
    Vec3d moments = Vec3d::Constant(1);  // kg m^2, principal moments of inertia
    Quat axes;                           // principal frame to body frame
    TROCAR_FIELDS(body, "index of bodies", mass, "kg", centre, "m", moments, "kg m^2", axes);
};

// Identity and material of every body. Constant while a scene runs (spawning and removal aside). One element each.
struct Bodies {
    std::vector<Entity> entity;
    std::vector<std::string> name;  // see is_body_name
    std::vector<uint32_t> mesh;     // prototype
    std::vector<Motion> motion;
    std::vector<Range> particles;  // deformable: range of Particles; else empty
    std::vector<uint32_t> tree;    // index into World::trees
    std::vector<AnchorFrame> anchor_frame;
    std::vector<Tissue> tissue;
    std::vector<float> spring_stiffness;  // N/m, one k per body
    std::vector<double> inv_mass;         // 1/kg, rigid: of the translation; 0 = immovable by contact
    std::vector<double> stable_dt;        // s, stability limit of the explicit step; infinity for rigid bodies
    std::vector<Stepping> stepping;       // empty = leapfrog for all
    std::vector<double> thickness;        // m, sheets only
    std::vector<double> self_contact;     // m, distance that a surface keeps from itself, 0 = may pass through itself; empty = all may
    std::vector<RigidMass> rigid_mass;    // one element per free body, ascending by body
    std::vector<TissueLaw> law;           // solids; empty or shorter = springs
    std::vector<Prony> prony;             // solids; empty or shorter = nothing relaxes
    TROCAR_FIELDS(entity, name, mesh, "index of meshes", motion, particles, "range of particles", tree, anchor_frame, tissue,
                  spring_stiffness, "N/m", inv_mass, "1/kg", stable_dt, "s", thickness, "m", self_contact, "m", rigid_mass, stepping, law,
                  prony);
};

// Names become parts of file names and messages: at most 80 bytes, without /, \, " and control characters.
inline bool is_body_name(std::string_view name) {
    const auto is_bad = [](char c) { return (c >= 0 && c < ' ') || c == 127 || c == '/' || c == '\\' || c == '"'; };
    return name.size() <= 80 && std::none_of(name.begin(), name.end(), is_bad);
}

inline double self_contact_of(const Bodies& bodies, uint32_t body) {
    return body < bodies.self_contact.size() ? bodies.self_contact[body] : 0;
}

inline Stepping stepping_of(const Bodies& bodies, uint32_t body) {
    return body < bodies.stepping.size() ? bodies.stepping[body] : Stepping{};
}

inline TissueLaw law_of(const Bodies& bodies, uint32_t body) { return body < bodies.law.size() ? bodies.law[body] : TissueLaw::kSprings; }
inline Prony prony_of(const Bodies& bodies, uint32_t body) { return body < bodies.prony.size() ? bodies.prony[body] : Prony{}; }

// Poses of the bodies, one element each. Rigid: position and orientation of the body frame. Deformable:
// origin of the offsets and orientation of the anchors: constant for kWorld, the best-fit rigid copy for
// kShape.
struct Poses {
    std::vector<Vec3d> origin;  // m
    std::vector<Quat> orientation;
    std::vector<Vec3d> velocity;          // m/s, rigid: of the origin; free: half a step behind the position (leapfrog)
    std::vector<Vec3d> angular_velocity;  // rad/s, rigid, world axes
    TROCAR_FIELDS(origin, "m", orientation, velocity, "m/s", angular_velocity, "rad/s");
};

// Box of every body in this contact pass, enlarged by its speculative margin.
struct BodyBoxes {
    std::vector<Box> box;
    std::vector<double> margin;  // m, fastest vertex * period + 0.05 mean edge
    std::vector<double> speed;   // m/s, of rigid bodies: how fast the origin may get in the pass; 0 for deformable ones
    TROCAR_FIELDS(box, "m", margin, "m", speed, "m/s");
};

}  // namespace trocar
