#pragma once
#include <vector>

#include "engine/contact/contact_inputs.hpp"
#include "engine/mesh/convex_contact.hpp"
namespace trocar {

// Reused memory.
struct ConvexManifoldsScratch {
    // A contact of a pair, in world axes.
    struct Found {
        uint32_t pair = 0;
        bool of_b = false;
        std::array<uint32_t, 2> vertex{};  // local vertices
        float along = 0;
        Vec3d point = Vec3d::Zero(), normal = Vec3d::Zero();  // m; unit
        double distance = 0;                                  // m
        uint32_t triangle = 0;                                // of the body that does not own the point
    };
    struct Chunk {
        HullContactScratch hulls;
        std::vector<Found> found;
    };
    std::vector<Chunk> chunk;
    std::vector<uint32_t> before;  // per contact found: index of the contact that it comes before
};

// Inserts up to four contacts for every pair that touches as hulls (touch_as_hulls) and is nearer than its speculative margin, in the
// order of Contacts: find_hull_contacts. The distances are those from the separating plane, so the depth of such a pair is
// that of the shortest way out.
void find_convex_manifolds(const ContactInputs& in, ConvexManifoldsScratch& scratch, Contacts& contacts);

}  // namespace trocar
