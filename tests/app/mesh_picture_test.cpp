#include "systems/app/pictures/mesh_picture.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "content/shapes/shape_library.hpp"
#include "engine/base/error.hpp"
#include "reference/picture_scene.hpp"
namespace trocar {
namespace {

// Extent of the strongly red pixels in a tile, in columns and rows.
struct Extent {
    uint32_t left = kNone, right = 0, top = kNone, bottom = 0, count = 0;
};
Extent red_pixels(const Image& image) {
    Extent e;
    for (uint32_t y = 0; y < image.height; ++y) {
        for (uint32_t x = 0; x < image.width; ++x) {
            const uint8_t* p = &image.rgba[(size_t(y) * image.width + x) * 4];
            if (p[0] < 90 || p[0] < 2 * p[1] || p[0] < 2 * p[2]) continue;
            e.left = std::min(e.left, x), e.right = std::max(e.right, x);
            e.top = std::min(e.top, y), e.bottom = std::max(e.bottom, y);
            ++e.count;
        }
    }
    return e;
}

Image draw_one(const Mesh& mesh, double azimuth, double elevation, uint32_t width = 200, uint32_t height = 160) {
    MeshPictureParams params;
    params.width = width, params.height = height;
    const MeshTile tile{0, azimuth, elevation, ""};
    return draw_meshes(params, std::span(&mesh, 1), std::span(&tile, 1));
}

TEST(MeshPicture, ASheetIsFittedAndLitFromBothSidesInAnyUnitAtAnyPlace) {
    Mesh square = reference::make_square(1, {0.9f, 0.02f, 0.02f});
    for (const double unit : {1.0, 1e-6, 1e6}) {
        Mesh moved = square;
        for (Vec3d& p : moved.position) p = unit * (p + Vec3d(1e4, 0, -1e4));
        for (const double elevation : {M_PI / 2, -M_PI / 2}) {
            const Extent e = red_pixels(draw_one(moved, -M_PI / 2, elevation));
            // a square box seen face on spans 0.86 of the height, centred
            EXPECT_NEAR(e.bottom - e.top + 1.0, 0.86 * 160, 2) << unit << " " << elevation;
            EXPECT_NEAR(e.right - e.left + 1.0, 0.86 * 160, 2) << unit << " " << elevation;
            EXPECT_NEAR(e.left + e.right, 199, 2);
            EXPECT_NEAR(e.top + e.bottom, 159, 2);
        }
    }
}

// Fails when a number is cut off at the edge of a small tile.
TEST(MeshPicture, LeavesOutSizesThatDoNotFit) {
    const Mesh block = make_shape("box", 48);
    const MeshTile tile{0, 0, 0, ""};
    for (const uint32_t width : {60u, 300u}) {
        MeshPictureParams params;
        params.width = width, params.height = 80;
        const Image without = draw_meshes(params, std::span(&block, 1), std::span(&tile, 1));
        params.sizes = true;
        EXPECT_EQ(draw_meshes(params, std::span(&block, 1), std::span(&tile, 1)).rgba == without.rgba, width == 60) << width;
    }
}

TEST(MeshPicture, TilesFillTheGridAndViewsShowTheirSide) {
    // 1 x 2 x 3: its three faces have different proportions
    Mesh block = make_shape("box", 48);
    for (Vec3d& p : block.position) p = p.cwiseProduct(Vec3d(1, 2, 3));
    block.material[0].diffuse = {0.9f, 0.02f, 0.02f};
    const std::array<double, 3> wide_over_high{1.0 / 3.0, 2.0 / 3.0, 1.0 / 2.0};
    const std::vector<MeshTile> views = four_views(0);
    ASSERT_EQ(views.size(), 4u);
    for (uint32_t i = 0; i < 3; ++i) {
        const Extent e = red_pixels(draw_one(block, views[i].azimuth, views[i].elevation, 400, 400));
        EXPECT_NEAR((e.right - e.left + 1.0) / (e.bottom - e.top + 1.0), wide_over_high[i], 0.02) << views[i].label;
    }
    MeshPictureParams params;
    params.width = 203, params.height = 161, params.sizes = true;
    const Image sheet = draw_meshes(params, std::span(&block, 1), views);
    ASSERT_EQ(sheet.rgba.size(), size_t{203} * 161 * 4);
    for (uint32_t tile = 0; tile < 4; ++tile) {
        uint32_t red = 0;
        for (uint32_t y = tile / 2 * 80; y < tile / 2 * 80 + 80; ++y)
            for (uint32_t x = tile % 2 * 101; x < tile % 2 * 101 + 101; ++x) {
                const uint8_t* p = &sheet.rgba[(size_t(y) * 203 + x) * 4];
                red += p[0] > 90 && p[0] > 2 * p[1];
            }
        EXPECT_GT(red, 500u) << tile;
    }
    EXPECT_EQ(draw_meshes(params, std::span(&block, 1), views).rgba, sheet.rgba);
}

TEST(MeshPicture, WireframeDarkensEdgesOfOpaqueAndTranslucentMeshes) {
    for (const float transparency : {0.0f, 0.3f}) {
        Mesh block = make_shape("box", 48);
        block.material[0].transparency = transparency;
        MeshPictureParams params;
        params.width = params.height = 200;
        const std::vector<MeshTile> tile{{0, 0.3, 0.3, ""}};
        const Image plain = draw_meshes(params, std::span(&block, 1), tile);
        params.wireframe = true;
        const Image wired = draw_meshes(params, std::span(&block, 1), tile);
        uint32_t darker = 0, lighter = 0;
        for (size_t i = 0; i < plain.rgba.size(); ++i) {
            darker += wired.rgba[i] + 20 < plain.rgba[i];
            lighter += wired.rgba[i] > plain.rgba[i] + 20;
        }
        EXPECT_GT(darker, 2000u) << transparency;
        EXPECT_LT(lighter, darker / 20) << transparency;
    }
}

TEST(MeshPicture, TilesAreAsLargeAsTheyCanBe) {
    // three tiles of a wide picture are side by side: all red, in thirds
    Mesh square = reference::make_square(1, {0.9f, 0.02f, 0.02f});
    MeshPictureParams params;
    params.width = 300, params.height = 60;
    const std::vector<MeshTile> tiles(3, MeshTile{0, -M_PI / 2, M_PI / 2, ""});
    const Extent e = red_pixels(draw_meshes(params, std::span(&square, 1), tiles));
    EXPECT_NEAR(e.bottom - e.top + 1.0, 0.86 * 60, 2);
    EXPECT_NEAR(e.right - e.left + 1.0, 200 + 0.86 * 60, 2);
}

TEST(MeshPicture, NothingToDrawIsRefusedByName) {
    Mesh square = reference::make_square(1, {1, 0, 0});
    square.name = "dot";
    for (Vec3d& p : square.position) p = Vec3d::Constant(2);
    EXPECT_THROW(draw_one(square, 0, 0), InputError);
    for (Vec3d& p : square.position) p = Vec3d::Constant(std::numeric_limits<double>::quiet_NaN());
    EXPECT_THROW(draw_one(square, 0, 0), InputError);
    square.triangle.clear();
    square.uv.clear();
    try {
        draw_one(square, 0, 0);
        FAIL();
    } catch (const InputError& error) {
        EXPECT_NE(std::string(error.what()).find("dot"), std::string::npos);
    }
}

}  // namespace
}  // namespace trocar
