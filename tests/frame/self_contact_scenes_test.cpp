#include <gtest/gtest.h>

#include "frame/written_scene.hpp"
#include "reference/paths.hpp"
#include "systems/output/self_crossings.hpp"
#include "tests/reference/closed_surface.hpp"

// The scenes of surfaces that touch themselves, run through, coarser than users run them: nothing crosses in any pass.
namespace trocar {
namespace {

Mesh surface_of(const World& w, uint32_t body) {
    Mesh mesh;
    const MeshView view = mesh_view(w.meshes, w.bodies.mesh[body]);
    mesh.triangle.assign(view.triangle.begin(), view.triangle.end());
    for (uint32_t v = 0; v < view.position.size(); ++v) mesh.position.push_back(vertex_position(surfaces_of(w), body, v));
    return mesh;
}

uint32_t deformable_body(const World& w) {
    for (uint32_t body = 0; body < w.bodies.mesh.size(); ++body)
        if (is_deformable(w.bodies, body)) return body;
    return kNone;
}

// What a scene showed: lowest and highest point (m) of the surface at each tenth of a second.
struct Seen {
    std::vector<Vec3d> low, high;
    std::vector<Mesh> surface;
    uint64_t contacts = 0, passes = 0;
};

// Exact crossing tests of the engine after each pass, those of the reference in double each tenth of a second.
Seen run_through(const std::string& name, double seconds, const std::vector<Override>& overrides) {
    World world = std::move(build_scene(read_scene_file(source_folder() / "content/scenes" / (name + ".toml"), overrides), Looks::kPlain).world);
    const auto passes = static_cast<int>(std::lround(seconds * world.clock.contact_rate));
    const int tenth = static_cast<int>(world.clock.contact_rate) / 10;
    Seen seen;
    CrossingFacesScratch scratch;
    run(std::move(world), passes, [&](Frame& frame, int pass) {
        const World& w = frame.world();
        const uint32_t body = deformable_body(w);
        EXPECT_EQ(count_self_crossings(surfaces_of(w), body, scratch), 0u) << name << " pass " << pass;
        ++seen.passes;
        seen.contacts = w.report.self_contacts;
        if ((pass + 1) % tenth != 0) return;
        const Mesh mesh = surface_of(w, body);
        EXPECT_EQ(reference::count_crossings(mesh), 0u) << name << " pass " << pass;
        Vec3d low = mesh.position[0], high = low;
        for (const Vec3d& p : mesh.position) low = low.cwiseMin(p), high = high.cwiseMax(p);
        seen.low.push_back(low), seen.high.push_back(high), seen.surface.push_back(mesh);
    });
    return seen;
}

// The round end goes through the ring, whose middle is in z = 0, and comes back out of it.
TEST(SelfContactScenes, ASacGoesThroughARingAndComesOut) {
    const Seen seen = run_through("sac", 3, {{"sac.triangles", "1000"}});
    EXPECT_LT(seen.low[15].z(), -0.03);
    EXPECT_GT(seen.low.back().z(), 0.004);
    EXPECT_GT(seen.contacts, 1000u);
}

TEST(SelfContactScenes, ABowelIsFoldedOnItself) {
    const Seen seen = run_through("fold", 3, {{"bowel.triangles", "1200"}});
    EXPECT_GT(seen.contacts, 1000u);
    EXPECT_GT(seen.high[20].z(), 0.035);  // one limb on another: each is 28 mm wide
    EXPECT_GT(seen.low.back().z(), -1e-3);
}

// Wound around a rod whose axis is 50 mm high, then within the cannula, whose wall ends at x = -0.047, and out of it.
TEST(LongSelfContactScenes, AMeshIsRolledIntoACannulaAndComesOut) {
    const Seen seen = run_through("roll", 6, {});
    EXPECT_LT(seen.low[1].z(), 0.015);                      // hangs from the rod at first
    EXPECT_GT(seen.low[17].z(), 0.038);                     // is wound
    EXPECT_LT(seen.low[30].x(), -0.07);                     // in the cannula
    EXPECT_LT(seen.high[30].x(), -0.03);
    EXPECT_GT(seen.low[42].x(), -0.03);                     // out of it
    EXPECT_LT(seen.low.back().z(), seen.low[42].z() - 5e-3);  // opens
    EXPECT_GT(seen.contacts, 10000u);
}

}  // namespace
}  // namespace trocar
