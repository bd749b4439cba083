// A slice of the scene hernia_repair: scissors open the peritoneum, hands peel it off the wall.
#include <gtest/gtest.h>

#include <cmath>

#include "content/shapes/inguinal_region.hpp"
#include "engine/files/capture_file.hpp"
#include "frame/written_scene.hpp"
#include "reference/paths.hpp"
#include "systems/fluid/amounts.hpp"
namespace trocar {
namespace {

World hernia_world() {
    const std::vector<Override> coarse{{"wall.triangles", "2000"}, {"cord.triangles", "400"}, {"peritoneum.triangles", "700"}};
    return std::move(build_scene(read_scene_file(source_folder() / "content/scenes/hernia_repair.toml", coarse), Looks::kPlain).world);
}

double ledger_error_of(const World& w) {
    FluidShapeScratch scratch;
    return measure_fluids(surfaces_of(w), w.fluids, w.fluid_state, scratch).error;
}

// A state is checked before its cuts are laid: the mesh at load has fewer elements than its self-contacts name.
void expect_state_can_be_loaded(const World& w) {
    CaptureRecord record;
    World again = hernia_world();
    for (uint32_t r = 0; r < static_cast<uint32_t>(Resource::kCount); ++r) {
        if (resource_kind(static_cast<Resource>(r)) != ResourceKind::kState) continue;
        save_resource(w, static_cast<Resource>(r), record), load_resource(record, static_cast<Resource>(r), again);
    }
    bool beyond = false;
    for (size_t i = 0; i < w.self_contacts.body.size(); ++i) {
        const MeshInfo& info = again.meshes.info[w.bodies.mesh[w.self_contacts.other[i]]];
        beyond |= w.self_contacts.feature[i][1] >= (w.self_contacts.edges[i] ? info.edges.count : info.triangles.count);
    }
    EXPECT_TRUE(beyond);
    EXPECT_EQ(find_fault(again), "");
}

// Where the blade crosses the peritoneum, by bisection along its edge; the sheet is where it is at rest.
double blade_crosses_at(const World& w, const ToolAction& action) {
    const InguinalRegion r;
    const uint32_t tool = w.haptics.tool[action.tool].body;
    const auto place = [&](double t) {
        return frame_to_world(surfaces_of(w), tool, Vec3d(action.point + t * (action.edge - action.point)));
    };
    const auto depth = [&](const Vec3d& p) { return p.y() - r.inside(p.x(), p.z()) + r.gap; };
    double low = 0, high = 1;
    EXPECT_LT(depth(place(low)), 0);
    EXPECT_GT(depth(place(high)), 0);
    for (int i = 0; i < 40; ++i) (depth(place((low + high) / 2)) < 0 ? low : high) = (low + high) / 2;
    return place(low).x();
}

// Length of the sheet between two x at one height, m.
double arc(double from, double to, double z) {
    const InguinalRegion r;
    double length = 0;
    for (int i = 0; i < 1000; ++i) {
        const double a = from + (to - from) * i / 1000, b = from + (to - from) * (i + 1) / 1000;
        length += std::hypot(b - a, r.inside(b, z) - r.inside(a, z));
    }
    return length;
}

// The incision is as long as the way of the blade on the sheet from the first edge of a triangle that it crossed to the last, its new rim
// bleeds, and links hold until a hand pulls.
TEST(HerniaScene, TheIncisionFollowsTheBladeAndBleeds) {
    double start = 0, end = 0, area = 0, worst = 0;
    run(hernia_world(), 180, [&](Frame& frame, int pass) {
        const World& w = frame.world();
        const ToolAction* cut = nullptr;
        size_t index = 0;
        for (size_t i = 0; i < w.actions.action.size(); ++i)
            if (w.actions.action[i].kind == ActionKind::kCut) cut = &w.actions.action[i], index = i;
        ASSERT_NE(cut, nullptr);
        worst = std::max(worst, std::abs(ledger_error_of(w)));
        const ActionProgress& done = w.action_state.progress[index];
        if (start == 0 && !w.action_state.cut.front.empty()) start = blade_crosses_at(w, *cut);
        if (done.area > area) end = blade_crosses_at(w, *cut), area = done.area;
        if (pass < 179) return;
        EXPECT_EQ(find_fault(w), "");
        expect_state_can_be_loaded(w);
        const double length = done.area / w.actions.cut_body[0].thickness;
        const double way = arc(end, start, 0.046);
        std::printf("cut %.1f mm, way %.1f mm, bled %.4f ml\n", 1e3 * length, 1e3 * way, 1e6 * w.fluid_state.ledger.bled);
        EXPECT_GT(way, 0.03);
        EXPECT_NEAR(length, way, 0.003) << "the way of two passes, and where the cut goes through vertices beside it";
        EXPECT_EQ(done.refused, 0u);
        EXPECT_GT(w.fluid_state.ledger.bled, 0);
        EXPECT_EQ(w.report.broken_links, 0u);
    });
    EXPECT_LT(worst, 1e-12);
}

// The bits of cut, films and links do not depend on threads.
TEST(HerniaScene, HasTheSameBitsOnAnyNumberOfThreads) {
    uint64_t hash[2];
    for (const uint32_t threads : {1u, 3u})
        run(
            hernia_world(), 120,
            [&](Frame& frame, int pass) {
                if (pass == 109) hash[threads / 2] = state_hash(frame.world());
            },
            threads);
    EXPECT_EQ(hash[0], hash[1]);
}

}  // namespace
}  // namespace trocar
