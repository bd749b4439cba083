#pragma once
#include <array>
#include <vector>

#include "components/math.hpp"
#include "engine/spring_kernels.hpp"
namespace trocar {

// A deformable body of the island during a call.
struct AdvanceBody {
    uint32_t body = kNone;
    Range particles;
    uint32_t slices = 0;
    uint32_t buffer = 0;          // row of its first particle in the offset buffers
    bool shape = false;           // anchors are the best-fit rigid copy
    double damping = 0;           // 1/s
    double last_dt = 0;           // s
    Vec3d origin;                 // m
    Quat orientation;             // at the start of the call
    const Float4* now = nullptr;  // offsets at the start of the substep
    Float4* next = nullptr;       // and at its end
    SpringStep step;
};

// A rigid body that the island's rows touch, or a hand of the island: where it is at both ends of a substep.
struct AdvanceRigid {
    uint32_t body = kNone;
    uint32_t path = kNone;  // row of Paths, if scripted
    uint32_t tool = kNone;  // row of tools, if a hand with a device
    uint32_t node = kNone;  // of the hand's translation
    Quat orientation[2];
    std::array<Vec3d, 3> turn[2];   // rows of the rotation matrix
    Vec3d origin[2];                // m
    Vec3d velocity;                 // m/s, of the origin; zero for a hand, whose node has it
    std::array<Vec3d, 3> spin;      // 1/s, rows of (turn[1] - turn[0]) / dt
    Vec3d target, target_velocity;  // m, m/s: where a hand's origin would be if it were in the hand, at the end
};

// A particle or a hand that contact rows act on.
struct ContactNode {
    Vec3d place;     // m, world, at the start of the substep
    Vec3d after;     // m, world, at its end
    Vec3d velocity;  // m/s
    double inv_mass = 0;
    uint32_t particle = kNone;  // row of Particles; kNone for a hand
    uint32_t owner = 0;         // row of body, or of rigid for a hand
};
struct ContactNodeChange {
    Vec3d before;        // m/s, before the kick of this substep
    Vec3d kicked;        // m/s, after it
    Vec3d change;        // m, of the place by push-out
    Vec3d first_normal;  // of the first active row
    uint32_t rows = 0;   // active rows
    bool opposed = false;
    bool pushed = false;
};

// What stays the same about a contact row during a call.
struct ContactPlan {
    uint32_t row = kNone;
    uint32_t rigid_a = kNone, rigid_b = kNone;  // rows of rigid, or kNone
    std::array<uint32_t, 2> node_a;             // if deformable; equal for a vertex
    std::array<uint32_t, 3> node_b;             // if deformable
    std::array<double, 2> weight_a;
    std::array<double, 3> weight_b;
    Vec3d point_a;      // m, body frame, if rigid
    Vec3d point_b;      // m, body frame, if rigid
    Vec3d normal;       // body frame if b is rigid, else world
    double offset = 0;  // m, half the thickness of a sheet
    double friction = 0;
};

// A row that acts in this substep.
struct ContactActive {
    uint32_t plan = 0;
    uint32_t nodes = 0;
    bool pushed = false;
    uint32_t point_nodes = 0;  // how many of them, the first, are on the side of the point
    std::array<uint32_t, 5> node;
    std::array<double, 5> weight;  // of the relative velocity: + for the point, - for the plane
    Vec3d normal;
    Vec3d rigid_velocity;       // m/s, what rigid sides add to the relative velocity besides their nodes
    double least_velocity = 0;  // m/s, along the normal
    double inv_sum = 0;         // kg, 1 / sum of weight^2 * inverse mass
    double normal_impulse = 0;  // N s
    Vec3d friction_impulse;     // N s
};

// Reused memory of advance_island, one per thread that may run it. Its content means nothing between calls.
struct AdvanceScratch {
    std::vector<Float4> offset_a, offset_b;  // the two buffers of a substep, bodies of the island one after the other
    std::vector<float> remainder;            // 3 fields, rows as the buffers; for bodies that carry_remainder
    std::vector<AdvanceBody> body;
    std::vector<AdvanceRigid> rigid;
    std::vector<double> sums;        // per chunk of slices: 16 lanes of damping work
    std::vector<double> shape_sums;  // per chunk of slices: kShapeSums * 16
    std::vector<ContactNode> node;
    std::vector<ContactNodeChange> change;   // as node
    std::vector<uint32_t> node_of_particle;  // row of node or kNone, one per particle of the world
    std::vector<uint32_t> slot_of_body;      // row of body or of rigid or kNone, one per body of the world
    std::vector<ContactPlan> plan;
    std::vector<ContactActive> active;
    std::vector<uint32_t> touched;  // nodes with an active row
};

}  // namespace trocar
