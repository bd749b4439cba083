#include "content/scene/fit_tip.hpp"

#include <gtest/gtest.h>

#include "content/scene/make_prototype.hpp"
#include "content/shapes/shape_library.hpp"
#include "engine/world/add_body.hpp"
namespace trocar {
namespace {

struct Tip {
    HandTool tool;
    std::string warning;
};

Tip fit(const std::string& shape, uint32_t triangles, double scale, bool given, const Vec3d& tip, double radius) {
    World w;
    const Prototype made = make_prototype(w.meshes, make_shape(shape, triangles), {.scale = scale});
    add_body(w, "instrument", made.row, Motion::kHand);
    Tip t;
    t.tool.body = 0;
    t.tool.tip = tip, t.tool.tip_radius = radius;
    t.warning = fit_tip(w, given, t.tool);
    return t;
}

// Balls of many sizes and resolutions: the radius is the ball's, from its centre or from anywhere outside.
TEST(FitTip, ABallGivesItsRadius) {
    for (const uint32_t triangles : {300u, 1000u, 5000u})
        for (const double scale : {1e-3, 7e-3, 0.02, 0.3}) {
            const double radius = fit("sphere", triangles, scale, false, Vec3d::Zero(), 0).tool.tip_radius;
            const Tip right = fit("sphere", triangles, scale, true, Vec3d::Zero(), radius);
            EXPECT_EQ(right.warning, "");
            for (const double wrong : {0.5, 0.9, 1.1, 2.0}) {
                const Tip off = fit("sphere", triangles, scale, true, Vec3d::Zero(), wrong * radius);
                EXPECT_NE(off.warning.find("\"instrument\""), std::string::npos) << wrong;
                EXPECT_EQ(off.tool.tip_radius, wrong * radius);
            }
            const Tip found = fit("sphere", triangles, scale, false, Vec3d(0, 0, 3 * radius), 0);
            EXPECT_LT(found.tool.tip.norm(), 0.05 * radius);
            EXPECT_NEAR(found.tool.tip_radius, radius, 0.05 * radius);
        }
}

// The probe's tip is a ball of 7 mm at its origin.
TEST(FitTip, TheProbeHasItsPublishedTip) {
    for (const uint32_t triangles : {600u, 1000u, 4000u}) {
        const Tip probe = fit("probe", triangles, 1, false, Vec3d::Zero(), 0);
        EXPECT_NEAR(probe.tool.tip_radius, 7e-3, 0.02 * 7e-3) << triangles;
        EXPECT_EQ(fit("probe", triangles, 1, false, Vec3d::Zero(), 7e-3).warning, "") << triangles;
        EXPECT_NE(fit("probe", triangles, 1, false, Vec3d::Zero(), 5e-3).warning, "") << triangles;
    }
}

TEST(FitTip, ATipOutsideItsMeshIsNamed) {
    const Tip tip = fit("box", 300, 0.02, true, Vec3d(0, 0, 0.05), 5e-3);
    EXPECT_NE(tip.warning.find("outside its mesh"), std::string::npos);
    EXPECT_EQ(tip.tool.tip, Vec3d(0, 0, 0.05));
}

// A box: the largest ball around its centre touches its faces.
TEST(FitTip, ABoxGivesTheBallInside) {
    const Tip box = fit("box", 12, 1, false, Vec3d::Zero(), 0);
    World w;
    make_prototype(w.meshes, make_shape("box", 12), {.scale = 1});
    double half = 0;
    for (const Vec3d& p : w.meshes.position) half = std::max(half, p.z());
    EXPECT_NEAR(box.tool.tip_radius, half, 1e-12);
}

}  // namespace
}  // namespace trocar
