#include "systems/output/render.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

#include "engine/draw/depth_colours.hpp"
#include "tests/reference/picture_scene.hpp"
#include "tests/reference/sample_meshes.hpp"

namespace trocar {
namespace {

using reference::make_square;
using reference::PictureScene;

struct Pixel {
    int red, green, blue, alpha;
    friend bool operator==(const Pixel&, const Pixel&) = default;
};

Pixel pixel(const Image& image, double x, double y) {
    const size_t row = static_cast<size_t>(y), column = static_cast<size_t>(x);
    const uint8_t* p = &image.rgba[4 * (row * image.width + column)];
    return {p[0], p[1], p[2], p[3]};
}

// surfaces only, so that every pixel has a known colour
PictureParams bare() {
    PictureParams params;
    params.width = 320;
    params.height = 240;
    params.text = params.ground = params.witnesses = params.tools = params.smooth_edges = false;
    return params;
}

// straight down, picture axes = world x (right) and y (up)
Camera from_above(double height) {
    Camera camera;
    camera.elevation = 1.5707963267948966;
    camera.azimuth = -1.5707963267948966;
    camera.distance = height;
    return camera;
}

Image draw(PictureScene& scene, const PictureParams& params, const Camera& camera) {
    GlRenderer renderer(scene.meshes);
    RenderScratch scratch;
    Image out;
    render_picture(params, camera, scene.snapshot(), renderer, scratch, out);
    return out;
}

double linear(int byte) {
    const double e = byte / 255.0;
    return e <= 0.04045 ? e / 12.92 : std::pow((e + 0.055) / 1.055, 2.4);
}

bool greenish(const Pixel& p) { return p.green > p.red + 40 && p.green > p.blue + 40; }

struct Projection {
    double x, y;
};

// Pixel position by the textbook: the orbit's angles in double, independent of the renderer's matrices.
Projection project(const Vec3d& p, const Camera& camera, const PictureParams& params) {
    const double ca = std::cos(camera.azimuth), sa = std::sin(camera.azimuth);
    const double ce = std::cos(camera.elevation), se = std::sin(camera.elevation);
    const Vec3d c = p - camera.target;
    const double depth = camera.distance - (ce * (ca * c.x() + sa * c.y()) + se * c.z());
    const double across = -sa * c.x() + ca * c.y();
    const double above = ce * c.z() - se * (ca * c.x() + sa * c.y());
    const double pixels = 0.5 * params.height / std::tan(0.5 * camera.field_of_view);
    return {0.5 * params.width + pixels * across / depth, 0.5 * params.height - pixels * above / depth};
}

// Signed distance of a pixel's centre to a convex counter-clockwise (seen in the picture) outline, < 0 inside, in
// pixels.
double distance_to_outline(double x, double y, const std::vector<Projection>& corner) {
    double farthest = -1e9;
    for (size_t i = 0; i < corner.size(); ++i) {
        const Projection &a = corner[i], &b = corner[(i + 1) % corner.size()];
        const double ex = b.x - a.x, ey = b.y - a.y;
        // rows grow downwards: the outside of a counter-clockwise edge is to the right of its direction
        farthest = std::max(farthest, (-ey * (x - a.x) + ex * (y - a.y)) / std::hypot(ex, ey));
    }
    return farthest;
}

// Every pixel more than one pixel inside the outline is green, every one more than one pixel outside is not.
void expect_covered(const Image& image, const std::vector<Projection>& corner) {
    uint32_t inside = 0, wrong = 0;
    for (uint32_t y = 0; y < image.height; ++y)
        for (uint32_t x = 0; x < image.width; ++x) {
            const double d = distance_to_outline(x + 0.5, y + 0.5, corner);
            inside += d < -1;
            if (std::abs(d) > 1) wrong += greenish(pixel(image, x, y)) != (d < 0);
        }
    EXPECT_GT(inside, 2000u);
    EXPECT_EQ(wrong, 0u);
}

// fails when the projection, the flip of rows, the aspect, the pose or the camera's angles are off by a pixel
TEST(Render, CoversThePixelsThatADoubleProjectionSays) {
    PictureParams params = bare();
    const Quat turn = from_rotation_vector({0.4, -0.3, 0.7});
    const Vec3d origin(0.02, -0.01, 0.03);
    for (const Motion motion : {Motion::kStatic, Motion::kDeformable})
        for (const Vec3d& far : {Vec3d(0, 0, 0), Vec3d(3e5, -2e5, 1e5)})
            for (const double azimuth : {-2.3, -1.2, -0.4}) {
                PictureScene scene;
                const uint32_t mesh = scene.add_mesh(make_square(0.1, {0, 1, 0}));
                const bool rigid = motion == Motion::kStatic;
                scene.add_body(mesh, motion, far + origin, rigid ? turn : Quat{});
                Camera camera;
                camera.target = far + Vec3d(0.01, 0.02, 0);
                camera.azimuth = azimuth;
                camera.elevation = 0.8;
                camera.distance = 0.6;
                std::vector<Projection> corner;
                for (const Vec3d& p : make_square(0.1, {}).position)
                    corner.push_back(project(far + origin + (rigid ? rotate(turn, p) : p), camera, params));
                SCOPED_TRACE(testing::Message() << "rigid " << rigid << " azimuth " << azimuth << " at " << far.x());
                expect_covered(draw(scene, params, camera), corner);
            }
}

TEST(Render, ShowsTheNearerSurfaceWhateverTheOrder) {
    for (const bool red_first : {true, false}) {
        PictureScene scene;
        const uint32_t red = scene.add_mesh(make_square(0.05, {1, 0, 0}));
        const uint32_t blue = scene.add_mesh(make_square(0.05, {0, 0, 1}));
        // red is 1 mm nearer to the eye
        scene.add_body(red_first ? red : blue, Motion::kStatic, {0, 0, red_first ? 0.001 : 0});
        scene.add_body(red_first ? blue : red, Motion::kStatic, {0, 0, red_first ? 0 : 0.001});
        const Pixel p = pixel(draw(scene, bare(), from_above(0.5)), 160, 120);
        EXPECT_GT(p.red, 2 * p.blue);
    }
}

// fails when v is not flipped, rows are mirrored, or red and blue are swapped
TEST(Render, PutsTheTextureWhereItsCoordinatesSay) {
    for (const Motion motion : {Motion::kStatic, Motion::kDeformable}) {
        PictureScene scene;
        Mesh square = make_square(0.1, {1, 1, 1});
        // top row: red green, bottom row: blue white
        square.material[0].image = {2, 2, {255, 0, 0, 255, 0, 255, 0, 255, 0, 0, 255, 255, 255, 255, 255, 255}};
        scene.add_body(scene.add_mesh(square), motion);
        const Image image = draw(scene, bare(), from_above(0.5));
        const Camera camera = from_above(0.5);
        const auto at = [&](double x, double y) {
            const Projection p = project({x, y, 0}, camera, bare());
            return pixel(image, p.x, p.y);
        };
        const double q = 0.05;  // middle of a texel
        const Pixel red = at(-q, q), green = at(q, q), blue = at(-q, -q), white = at(q, -q);
        EXPECT_GT(red.red, 2 * std::max(red.green, red.blue));
        EXPECT_GT(green.green, 2 * std::max(green.red, green.blue));
        EXPECT_GT(blue.blue, 2 * std::max(blue.red, blue.green));
        EXPECT_GT(std::min({white.red, white.green, white.blue}), 150);
    }
}

// a sheet is lit on the visible side: reversing its triangles changes nothing
TEST(Render, LightsBothSidesOfASheetAlike) {
    PictureScene front, back;
    Mesh square = make_square(0.1, {0, 1, 0});
    front.add_body(front.add_mesh(square), Motion::kDeformable);
    for (Triangle& t : square.triangle) std::swap(t[1], t[2]);
    for (auto& uv : square.uv) std::swap(uv[1], uv[2]);
    back.add_body(back.add_mesh(square), Motion::kDeformable);
    const Image a = draw(front, bare(), from_above(0.5)), b = draw(back, bare(), from_above(0.5));
    ASSERT_TRUE(greenish(pixel(a, 160, 120)));
    EXPECT_EQ(a.rgba, b.rgba);
}

// lit from above, so a normal that points down is dark: fails when normals are not used or not rotated with
// the body
TEST(Render, ShadesByTheVertexNormals) {
    PictureScene scene;
    scene.add_body(scene.add_mesh(reference::make_sphere({0, 0, 0}, 0.1, 4), Admission::kSolid), Motion::kDeformable);
    Camera camera;
    camera.elevation = 0;
    const Image image = draw(scene, bare(), camera);
    const auto level = [](const Pixel& p) { return p.red + p.green + p.blue; };
    EXPECT_GT(level(pixel(image, 150, 80)), level(pixel(image, 165, 160)) + 90);
    // the same sphere as a rigid body upside down looks the same within rounding
    PictureScene turned;
    turned.add_body(turned.add_mesh(reference::make_sphere({0, 0, 0}, 0.1, 4), Admission::kSolid), Motion::kStatic, Vec3d::Zero(),
                    from_rotation_vector({0, 3.141592653589793, 0}));
    const Image other = draw(turned, bare(), camera);
    double difference = 0;
    for (size_t i = 0; i < image.rgba.size(); ++i) difference += std::abs(int{image.rgba[i]} - int{other.rgba[i]});
    EXPECT_LT(difference / static_cast<double>(image.rgba.size()), 0.5);
}

TEST(Render, DrawsScenesWithNothingInThem) {
    PictureScene nothing, no_triangles;
    Mesh points;
    points.position = {{0, 0, 0}, {0.1, 0, 0}, {0, 0.1, 0}};
    const uint32_t mesh = no_triangles.add_mesh(points, Admission::kRefused);
    no_triangles.add_body(mesh, Motion::kStatic);
    no_triangles.add_body(mesh, Motion::kDeformable);
    PictureParams params = bare();
    params.wireframe = params.depth_colours = params.text = params.ground = true;
    for (PictureScene* scene : {&nothing, &no_triangles}) {
        Camera camera;
        fit_camera(scene->snapshot(), params.width, params.height, camera);
        const Image image = draw(*scene, params, camera);
        ASSERT_EQ(image.rgba.size(), size_t{4} * 320 * 240);
        for (size_t i = 3; i < image.rgba.size(); i += 4) ASSERT_EQ(image.rgba[i], 255);
        EXPECT_FALSE(greenish(pixel(image, 160, 120)));
    }
}

// triangles around the non-finite vertex are omitted, all others stay, and no trace is left when the vertex
// is finite again
TEST(Render, LeavesOutTrianglesOfNonFiniteVertices) {
    PictureScene scene;
    Mesh squares = make_square(0.04, {0, 1, 0});
    for (Vec3d& p : squares.position) p.x() -= 0.06;
    for (int i = 0; i < 4; ++i) squares.position.push_back(squares.position[static_cast<size_t>(i)] + Vec3d(0.12, 0, 0));
    squares.triangle.insert(squares.triangle.end(), {{4, 5, 6}, {4, 6, 7}});
    squares.uv.insert(squares.uv.end(), squares.uv.begin(), squares.uv.begin() + 2);
    const uint32_t body = scene.add_body(scene.add_mesh(squares), Motion::kDeformable);
    GlRenderer renderer(scene.meshes);
    RenderScratch scratch;
    const Camera camera = from_above(0.5);
    const auto picture = [&] {
        Image out;
        render_picture(bare(), camera, scene.snapshot(), renderer, scratch, out);
        return out;
    };
    const auto shown = [&](const Image& image, double x) {
        const Projection p = project({x, 0.0, 0}, camera, bare());
        return greenish(pixel(image, p.x, p.y));
    };
    const Image whole = picture();
    EXPECT_TRUE(shown(whole, -0.06) && shown(whole, 0.06));
    Float4& lost = scene.particles.offset[scene.bodies.particles[body].first];  // in both triangles of the left square
    const Float4 kept = lost;
    for (const float bad : {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()}) {
        lost.y = bad;
        const Image damaged = picture();
        EXPECT_FALSE(shown(damaged, -0.06));
        EXPECT_TRUE(shown(damaged, 0.06));
    }
    lost = kept;
    EXPECT_EQ(picture().rgba, whole.rgba);
}

PictureScene busy_scene() {
    PictureScene scene;
    Mesh sphere = reference::make_sphere({0, 0, 0}, 0.08, 4);
    sphere.material.resize(1);
    sphere.material[0].image = {4, 4, std::vector<uint8_t>(64, 200)};
    for (size_t i = 0; i < 64; i += 12) sphere.material[0].image.rgba[i] = 30;
    for (const Triangle& t : sphere.triangle) {
        std::array<Vec2, 3> uv;
        for (uint32_t k = 0; k < 3; ++k)
            uv[k] = {static_cast<float>(20 * sphere.position[t[k]].x()), static_cast<float>(20 * sphere.position[t[k]].z())};
        sphere.uv.push_back(uv);
    }
    const uint32_t mesh = scene.add_mesh(sphere, Admission::kSolid);
    scene.add_body(mesh, Motion::kDeformable);
    scene.add_body(mesh, Motion::kDeformable, {0.05, 0.02, 0.1});
    scene.add_body(scene.add_mesh(reference::make_box({0, 0, 0}, {0.01, 0.01, 0.2})), Motion::kHand, {-0.05, 0, 0});
    scene.add_contact(0, {7, 7}, -0.004);
    scene.penetrations.depth = {0.004};
    scene.penetrations.witness = {0};
    scene.haptics.tool.resize(1);
    scene.haptics.state.resize(1);
    return scene;
}

PictureParams everything() {
    PictureParams params;
    params.width = 320;
    params.height = 240;
    params.wireframe = params.depth_colours = true;
    return params;
}

uint64_t picture_hash() {
    PictureScene scene = busy_scene();
    Camera camera;
    fit_camera(scene.snapshot(), 320, 240, camera);
    uint64_t hash = 14695981039346656037ull;
    for (const uint8_t byte : draw(scene, everything(), camera).rgba) hash = (hash ^ byte) * 1099511628211ull;
    return hash;
}

// fails when a picture depends on what the renderer drew earlier: sizes, options, cameras, damaged vertices
TEST(Render, GivesTheSameBytesAgain) {
    PictureScene scene = busy_scene();
    GlRenderer renderer(scene.meshes);
    RenderScratch scratch;
    Camera orbit, scope;
    fit_camera(scene.snapshot(), 320, 240, orbit);
    scope.kind = CameraKind::kLaparoscope;
    scope.field_of_view = 1.2;
    const auto picture = [&](const PictureParams& params, const Camera& camera) {
        Image out;
        render_picture(params, camera, scene.snapshot(), renderer, scratch, out);
        return out.rgba;
    };
    const auto first = picture(everything(), orbit);
    EXPECT_EQ(picture(everything(), orbit), first);
    PictureParams large = bare();
    large.width = 500;
    EXPECT_NE(picture(large, scope), first);
    EXPECT_NE(picture(everything(), scope), first);
    EXPECT_EQ(picture(everything(), orbit), first);
    PictureScene again = busy_scene();
    EXPECT_EQ(draw(again, everything(), orbit).rgba, first);
}

TEST(RenderChild, DISABLED_PrintsItsHash) { std::printf("hash=%016lx\n", picture_hash()); }

// Mesa reads the variable once per process, so every count gets a process of its own that runs no shard of
// the tests
TEST(Render, GivesTheSameBytesForAnyNumberOfMesaThreads) {
    char program[4096];
    const ssize_t length = readlink("/proc/self/exe", program, sizeof program);
    ASSERT_GT(length, 0);
    const std::string name(program, static_cast<size_t>(length));
    std::vector<std::string> hashes;
    for (const char* threads : {"0", "1", "2"}) {
        const std::string command = "env -u GTEST_TOTAL_SHARDS -u GTEST_SHARD_INDEX LP_NUM_THREADS=" + std::string(threads) + " '" + name +
                                    "' --gtest_also_run_disabled_tests --gtest_filter=RenderChild.*";
        FILE* child = popen(command.c_str(), "r");
        ASSERT_NE(child, nullptr);
        char line[256];
        while (std::fgets(line, sizeof line, child))
            if (std::string(line).starts_with("hash=")) hashes.emplace_back(line);
        pclose(child);
    }
    ASSERT_EQ(hashes.size(), 3u);
    EXPECT_EQ(hashes[0], hashes[1]);
    EXPECT_EQ(hashes[0], hashes[2]);
}

// a square at contact depths from zero (left) to twice the scale (right)
TEST(Render, ColoursByContactDepth) {
    PictureScene scene;
    const uint32_t body = scene.add_body(scene.add_mesh(reference::make_sheet(20)), Motion::kDeformable);
    for (Float4& p : scene.particles.offset) p = {0.2f * p.x - 0.1f, 0.2f * p.y - 0.1f, 0, 1};
    for (uint32_t v = 0; v < scene.bodies.particles[body].count; ++v)
        if (v < scene.meshes.position.size() && scene.meshes.position[v].x() > 0.5) scene.add_contact(body, {v, v}, -0.010);
    PictureParams params = bare();
    params.depth_colours = true;
    params.depth_scale = 0.005;
    const Image image = draw(scene, params, from_above(0.5));
    const Camera camera = from_above(0.5);
    const auto at = [&](double x) {
        const Projection p = project({x, 0.0, 0}, camera, params);
        return pixel(image, p.x, p.y);
    };
    const Pixel calm = at(-0.06), deep = at(0.06);
    EXPECT_LT(std::abs(calm.red - calm.blue), 25);  // grey where nothing touches
    const auto violet = depth_colour(1);
    ASSERT_GT(violet[0], violet[2]);  // the end of the scale: red over blue over green
    ASSERT_GT(violet[2], violet[1]);
    EXPECT_GT(deep.red, deep.blue);
    EXPECT_GT(deep.blue, deep.green);
    EXPECT_LT(deep.green, calm.green - 30);
}

TEST(Render, DrawsWiresOnEdgesOnly) {
    PictureScene scene;
    scene.add_body(scene.add_mesh(make_square(0.1, {0, 1, 0})), Motion::kDeformable);
    PictureParams params = bare();
    const Image plain = draw(scene, params, from_above(0.5));
    params.wireframe = true;
    const Image wired = draw(scene, params, from_above(0.5));
    const Camera camera = from_above(0.5);
    // the diagonal from lower left to upper right is an edge; the line is one pixel wide
    const Projection middle = project({0.03, 0.03, 0}, camera, params);
    int darkest = 255;
    for (int dx = -1; dx <= 1; ++dx) darkest = std::min(darkest, pixel(wired, middle.x + dx, middle.y).green);
    EXPECT_LT(darkest, pixel(plain, middle.x, middle.y).green - 25);
    const Projection off = project({-0.04, 0.04, 0}, camera, params);
    EXPECT_EQ(pixel(wired, off.x, off.y), pixel(plain, off.x, off.y));
}

// the remaining part of a torn body keeps its wires; where the triangle was removed there are none
TEST(Render, DrawsWiresOfTornTissue) {
    PictureScene scene;
    const Mesh square = make_square(0.1, {0, 1, 0});
    scene.add_body(scene.add_mesh(square), Motion::kDeformable);
    PictureSnapshot s = scene.snapshot();
    s.removed = {square.triangle[1]};
    s.body[0].removed = {0, 1};
    GlRenderer renderer(scene.meshes);
    RenderScratch scratch;
    PictureParams params = bare();
    Image plain, wired;
    render_picture(params, from_above(0.5), s, renderer, scratch, plain);
    params.wireframe = true;
    render_picture(params, from_above(0.5), s, renderer, scratch, wired);
    Vec3d middle[2];
    for (const size_t t : {0u, 1u}) {
        middle[t] = Vec3d::Zero();
        for (const uint32_t v : square.triangle[t]) middle[t] += square.position[v] / 3;
    }
    const auto darkened = [&](const Vec3d& p) {
        const Projection at = project(p, from_above(0.5), params);
        int most = 0;
        for (int dx = -2; dx <= 2; ++dx)
            for (int dy = -2; dy <= 2; ++dy)
                most = std::max(most, pixel(plain, at.x + dx, at.y + dy).green - pixel(wired, at.x + dx, at.y + dy).green);
        return most;
    };
    // the corner opposite the diagonal is the sum of a triangle's corners
    EXPECT_GT(darkened(Vec3d::Zero()), 25) << "the diagonal";
    EXPECT_EQ(darkened(middle[0]), 0);
    EXPECT_EQ(darkened(middle[1]), 0);
    EXPECT_EQ(darkened(3 * middle[1]), 0) << "the corner that is gone";
    EXPECT_GT(darkened(2.97 * middle[0]), 25) << "the corner that stays";
}

// blending does not depend on the order of bodies, nor on that of the triangles of a closed one
TEST(Render, BlendsFromFarToNear) {
    const auto glass = [](Mesh mesh, float red, float blue) {
        mesh.material.resize(1);
        mesh.material[0].diffuse = {red, 0, blue};
        mesh.material[0].transparency = 0.5f;
        return mesh;
    };
    const auto picture = [&](bool turned) {
        PictureScene scene;
        Mesh sphere = glass(reference::make_sphere({0, 0, 0}, 0.06, 3), 1, 1);
        if (turned) std::reverse(sphere.triangle.begin(), sphere.triangle.end());
        const uint32_t ball = scene.add_mesh(sphere, Admission::kSolid);
        const uint32_t red = scene.add_mesh(glass(make_square(0.1, {}), 1, 0)), blue = scene.add_mesh(glass(make_square(0.1, {}), 0, 1));
        if (turned) scene.add_body(ball, Motion::kDeformable);
        scene.add_body(turned ? blue : red, Motion::kStatic, {0, 0, turned ? 0.1 : -0.1});
        scene.add_body(turned ? red : blue, Motion::kStatic, {0, 0, turned ? -0.1 : 0.1});
        if (!turned) scene.add_body(ball, Motion::kDeformable);
        return draw(scene, bare(), from_above(0.5));
    };
    EXPECT_EQ(picture(false).rgba, picture(true).rgba);
}

// Smoke before a square: each pixel's light is dimmed by exp(-depth) and gains what the smoke scatters, by the column through a Gaussian
// in double. Breaks when smoke is blended in encoded colours, or dims by another law than Beer-Lambert's.
TEST(Render, SmokeDimsByBeerLambert) {
    PictureScene scene;
    scene.add_body(scene.add_mesh(make_square(0.2, {0, 1, 0})), Motion::kStatic);
    const PictureParams params = bare();
    const Camera camera = from_above(0.3);
    GlRenderer renderer(scene.meshes);
    RenderScratch scratch;
    const auto with_smoke = [&](double extinction) {
        PictureSnapshot snapshot = scene.snapshot();
        if (extinction > 0) snapshot.puff.push_back({Vec3d(0, 0, 0.05), 0.01, extinction});
        Image out;
        render_picture(params, camera, snapshot, renderer, scratch, out);
        return out;
    };
    const Image clear = with_smoke(0), dim = with_smoke(3e-4), thick = with_smoke(1);
    uint32_t compared = 0;
    double worst = 0;
    for (uint32_t y = 0; y < dim.height; ++y) {
        for (uint32_t x = 0; x < dim.width; ++x) {
            const double pixels = 0.5 * params.height / std::tan(0.5 * camera.field_of_view);
            const Vec3d ray = Vec3d((x + 0.5 - 0.5 * params.width) / pixels, (y + 0.5 - 0.5 * params.height) / pixels, 1).normalized();
            const double along = ray.z() * 0.25, b2 = 0.25 * 0.25 - along * along;
            if (b2 > 0.02 * 0.02) continue;
            const double left = std::exp(-3e-4 / (2 * M_PI * 1e-4) * std::exp(-b2 / 2e-4));
            const double before = linear(pixel(clear, x, y).green), grey = linear(pixel(thick, x, y).green);
            worst = std::max(worst, std::abs(linear(pixel(dim, x, y).green) - left * before - (1 - left) * grey));
            ++compared;
        }
    }
    EXPECT_GT(compared, 1000u);
    EXPECT_LT(worst, 0.012) << "of 1; a step of 8 bits is up to 0.008 here";
}

// a picture has no holes, whatever the alpha of a texture: the background is visible there
TEST(Render, ShowsWhatIsBehindAHoleOfATexture) {
    PictureScene scene;
    Mesh square = make_square(0.1, {1, 1, 1});
    square.material[0].image = {1, 1, {255, 255, 255, 0}};
    scene.add_body(scene.add_mesh(square), Motion::kStatic, {0, 0, 0.01});
    scene.add_body(scene.add_mesh(make_square(0.1, {0, 1, 0})), Motion::kStatic);
    const Pixel p = pixel(draw(scene, bare(), from_above(0.5)), 160, 100);
    EXPECT_EQ(p.alpha, 255);
    EXPECT_TRUE(greenish(p));
}

// from below, a floor between the eye and the bodies hides nothing: it is not drawn
TEST(Render, DrawsNoFloorSeenFromBelow) {
    PictureScene scene;
    scene.add_body(scene.add_mesh(reference::make_sphere({0, 0, 0}, 0.05, 2)), Motion::kDeformable);
    PictureParams params = bare();
    for (const double elevation : {-0.7, 0.7}) {
        Camera camera;
        camera.elevation = elevation;
        fit_camera(scene.snapshot(), params.width, params.height, camera);
        params.ground = false;
        const Image without = draw(scene, params, camera);
        params.ground = true;
        EXPECT_EQ(draw(scene, params, camera).rgba == without.rgba, elevation < 0) << elevation;
    }
}

// the deepest point is inside tissue; its arrow must be visible
TEST(Render, ShowsWitnessesAndToolsThroughTheSurface) {
    PictureScene scene;
    scene.add_body(scene.add_mesh(make_square(0.1, {0, 0.3f, 0})), Motion::kDeformable);
    PictureSnapshot s = scene.snapshot();
    s.witness.push_back({{-0.05, 0, -0.02}, {-0.05, 0, -0.01}, 0.01});
    s.tool.push_back({{0.05, 0, 0.02}, {0.05, 0, 0.021}, 0.01, {0, 0, 0}});
    GlRenderer renderer(scene.meshes);
    RenderScratch scratch;
    PictureParams params = bare();
    Image without, with;
    const Camera camera = from_above(0.5);
    render_picture(params, camera, s, renderer, scratch, without);
    params.witnesses = params.tools = true;
    render_picture(params, camera, s, renderer, scratch, with);
    for (const Vec3d& p : {Vec3d(-0.05, 0, -0.015), Vec3d(0.05, 0, 0.02)}) {
        const Projection at = project(p, camera, params);
        const Pixel a = pixel(without, at.x, at.y), b = pixel(with, at.x, at.y);
        EXPECT_GT(std::abs(a.red - b.red) + std::abs(a.green - b.green) + std::abs(a.blue - b.blue), 20);
    }
    EXPECT_EQ(pixel(with, 160, 60), pixel(without, 160, 60));
}

// the hidden part of a tool's sphere is a ring: the tissue in front of its centre must be visible unchanged.
// Fails when the sphere is painted over the tissue, or not shown at all
TEST(Render, OutlinesTheToolsThatTissueHides) {
    PictureScene scene;
    scene.add_body(scene.add_mesh(make_square(0.1, {0, 0.3f, 0})), Motion::kDeformable);
    PictureSnapshot s = scene.snapshot();
    s.tool.push_back({{0, 0, -0.042}, {0, 0, -0.04}, 0.03, {0, 0, 0}});
    GlRenderer renderer(scene.meshes);
    RenderScratch scratch;
    PictureParams params = bare();
    Image without, with;
    const Camera camera = from_above(0.5);
    render_picture(params, camera, s, renderer, scratch, without);
    params.tools = true;
    render_picture(params, camera, s, renderer, scratch, with);
    for (const double share : {0.0, 0.3, 0.6}) {
        const Projection at = project({share * 0.03, 0, -0.04}, camera, params);
        EXPECT_EQ(pixel(with, at.x, at.y), pixel(without, at.x, at.y)) << share;
    }
    // no contact: nothing to show
    s.tool[0].device = s.tool[0].proxy;
    Image free;
    render_picture(params, camera, s, renderer, scratch, free);
    EXPECT_EQ(free.rgba, without.rgba);
    const Projection rim = project({0.97 * 1.02 * 0.03, 0, -0.04}, camera, params);
    const Pixel a = pixel(without, rim.x, rim.y), b = pixel(with, rim.x, rim.y);
    EXPECT_GT(std::abs(a.red - b.red) + std::abs(a.green - b.green) + std::abs(a.blue - b.blue), 20);
}

// one light beside the lens: relative to the centre of the view, 1.5 times the distance gets 1 / 2.25 of the
// light. Fails when the fall-off is not quadratic, or when bytes are not sRGB
TEST(Render, LaparoscopeLightFallsOffWithTheSquareOfTheDistance) {
    double light[2];
    for (const int k : {0, 1}) {
        PictureScene scene;
        scene.add_body(scene.add_mesh(make_square(0.2, {0.2f, 0.2f, 0.2f})), Motion::kStatic, {0, 0, k == 0 ? 0.0 : -0.05});
        Camera camera;
        camera.kind = CameraKind::kLaparoscope;
        camera.position = {0, 0, 0.1};
        camera.target = {0, 0, 0};
        camera.field_of_view = 1.2;
        const Image image = draw(scene, bare(), camera);
        light[k] = linear(pixel(image, 160, 120).green);
        for (const auto& [x, y] : {std::pair{2, 2}, {317, 2}, {2, 237}, {317, 237}}) {
            const Pixel corner = pixel(image, x, y);
            EXPECT_LE(std::max({corner.red, corner.green, corner.blue}), 3);  // round picture
        }
    }
    EXPECT_NEAR(light[0] / light[1], 2.25, 0.06);
}

TEST(Render, FitsTheOrganAndFillsThePicture) {
    for (const auto& [width, height] : {std::pair{640u, 480u}, {300u, 500u}}) {
        PictureScene scene;
        scene.add_body(scene.add_mesh(reference::make_sphere({0, 0, 0}, 0.07, 3)), Motion::kDeformable, {1, 2, 3});
        scene.add_body(scene.add_mesh(reference::make_box({0, 0, 0}, {0.01, 0.01, 5})), Motion::kHand);
        PictureParams params;
        params.width = width;
        params.height = height;
        Camera camera;
        const PictureSnapshot s = scene.snapshot();
        fit_camera(s, width, height, camera);
        double reach = 0;
        for (const Vec3& p : s.position) {
            const Projection at = project(Vec3d(1, 2, 3) + p.cast<double>(), camera, params);
            reach = std::max({reach, std::abs(at.x - 0.5 * width) / (0.5 * width), std::abs(at.y - 0.5 * height) / (0.5 * height)});
        }
        EXPECT_NEAR(reach, 0.72, 0.01);
    }
}

// fails when the legend hides part of the tissue that it explains
TEST(Render, FitsTheOrganBesideTheLegend) {
    PictureScene scene;
    scene.add_body(scene.add_mesh(reference::make_box({-0.1, -0.1, -0.01}, {0.1, 0.1, 0.01})), Motion::kDeformable);
    PictureParams params;
    params.width = 640, params.height = 480;
    params.depth_colours = true;
    PictureSnapshot s = scene.snapshot();
    Camera camera;
    fit_camera(s, 640, 480, camera, legend_width(params));
    const auto rightmost = [&] {
        double x = 0;
        for (const Vec3& p : s.position) x = std::max(x, project(s.body[0].origin + p.cast<double>(), camera, params).x);
        return x;
    };
    EXPECT_LE(rightmost(), 640.0 - legend_width(params) + 1e-6);
    EXPECT_GE(rightmost(), 640.0 - legend_width(params) - 40);
    s.body[0].origin = {0.03, 0.05, 0};
    keep_in_picture(s, 640, 480, camera, legend_width(params));
    EXPECT_LE(rightmost(), 640.0 - legend_width(params) + 1e-6);
    // the panel begins at legend_width
    camera.target = {9, 9, 9};
    const Image with = draw(scene, params, camera);
    params.depth_colours = false;
    const Image without = draw(scene, params, camera);
    EXPECT_EQ(legend_width(params), 0u);
    uint32_t left = 640;
    for (uint32_t y = 0; y < 480; ++y)
        for (uint32_t x = 0; x < left; ++x)
            if (pixel(with, x, y) != pixel(without, x, y)) left = x;
    EXPECT_NEAR(left, 640 - 116, 1);
}

// Two free spheres on a wide floor beside a long instrument: the spheres fill the picture. Without them the
// instrument does, and fixed bodies fill it only if there is nothing else.
TEST(Render, FitsWhatMovesBeforeWhatIsGuidedBeforeWhatIsStill) {
    const auto reach_of = [](const PictureScene& from, uint32_t body) {
        PictureScene scene = from;
        Camera camera;
        PictureParams params;
        params.width = 640, params.height = 480;
        const PictureSnapshot s = scene.snapshot();
        fit_camera(s, 640, 480, camera);
        const Box box = s.body[body].box;
        double reach = 0;
        for (uint32_t k = 0; k < 8; ++k) {
            const Vec3d corner(k & 1 ? box.min.x() : box.max.x(), k & 2 ? box.min.y() : box.max.y(), k & 4 ? box.min.z() : box.max.z());
            const Projection at = project(s.body[body].origin + corner, camera, params);
            reach = std::max({reach, std::abs(at.x - 320) / 320, std::abs(at.y - 240) / 240});
        }
        return reach;
    };
    PictureScene still;
    still.add_body(still.add_mesh(reference::make_box({-10, -10, -0.1}, {10, 10, 0})), Motion::kStatic);
    EXPECT_NEAR(reach_of(still, 0), 0.88, 0.01);
    PictureScene guided = still;
    guided.add_body(guided.add_mesh(reference::make_box({-0.01, -0.01, 0}, {0.01, 0.01, 0.5})), Motion::kHand, {0, 0, 0.2});
    EXPECT_NEAR(reach_of(guided, 1), 0.72, 0.01);
    PictureScene moving = guided;
    const uint32_t ball = moving.add_mesh(reference::make_sphere({0, 0, 0}, 0.025, 3));
    moving.add_body(ball, Motion::kFree, {-0.1, 0, 0.025});
    moving.add_body(ball, Motion::kFree, {0.1, 0, 0.025});
    EXPECT_NEAR(std::max(reach_of(moving, 2), reach_of(moving, 3)), 0.72, 0.01);
    PictureScene mixed = moving;
    mixed.add_body(ball, Motion::kDeformable, {0.3, 0, 0.025});
    EXPECT_LE(reach_of(mixed, 2), 0.73) << "beside tissue it is in the picture too";
    EXPECT_GT(reach_of(mixed, 2), 0.5);
}

// A free sphere is followed like one of tissue.
TEST(Render, KeepsFreeBodiesInThePicture) {
    PictureScene scene;
    const uint32_t ball = scene.add_mesh(reference::make_sphere({0, 0, 0}, 0.02, 3));
    scene.add_body(ball, Motion::kFree, {0, 0, 0});
    scene.add_body(ball, Motion::kFree, {0, 0, 0.09});
    Camera camera;
    fit_camera(scene.snapshot(), 640, 480, camera);
    const double fitted = camera.distance;
    PictureSnapshot s = scene.snapshot();
    keep_in_picture(s, 640, 480, camera);
    EXPECT_EQ(camera.distance, fitted);
    s.body[1].origin = {0.12, 0.12, 0.05};
    keep_in_picture(s, 640, 480, camera);
    EXPECT_GT(camera.distance, 1.1 * fitted);
}

// A body that leaves the picture is followed by moving back, never forward; a body that falls below the floor
// is ignored
TEST(Render, KeepsInThePictureWhatMoves) {
    PictureScene scene;
    scene.add_body(scene.add_mesh(reference::make_sphere({0, 0, 0}, 0.07, 3)), Motion::kDeformable, {0, 0, 0});
    scene.add_body(scene.add_mesh(reference::make_sphere({0, 0, 0}, 0.02, 3)), Motion::kDeformable, {0, 0, 0.09});
    PictureParams params;
    params.width = 640, params.height = 480;
    Camera camera;
    fit_camera(scene.snapshot(), 640, 480, camera);
    const double fitted = camera.distance;
    const auto reach_at = [&](const Vec3d& origin) {
        PictureSnapshot s = scene.snapshot();
        s.body[1].origin = origin;
        keep_in_picture(s, 640, 480, camera);
        double reach = 0;
        for (uint32_t v = s.body[1].vertices.first; v < s.body[1].vertices.end(); ++v) {
            const Projection at = project(origin + s.position[v].cast<double>(), camera, params);
            reach = std::max({reach, std::abs(at.x - 320) / 320, std::abs(at.y - 240) / 240});
        }
        return reach;
    };
    reach_at({0, 0, 0.09});
    EXPECT_EQ(camera.distance, fitted);
    EXPECT_NEAR(reach_at({0.12, 0.12, 0.05}), 0.88, 0.01);
    const double back = camera.distance;
    EXPECT_GT(back, 1.1 * fitted);
    reach_at({0, 0, 0.09});
    EXPECT_EQ(camera.distance, back);
    reach_at({0.3, 0.3, -1});
    EXPECT_EQ(camera.distance, back);
    reach_at({40, 0, 0.1});
    EXPECT_EQ(camera.distance, back);
}

// the floor is just below the lowest body, rigid ones included, for any camera position
TEST(Render, LaysTheFloorUnderEverything) {
    PictureScene scene;
    scene.add_body(scene.add_mesh(reference::make_sphere({0, 0, 0}, 0.07, 3)), Motion::kDeformable, {1, 2, 3});
    scene.add_body(scene.add_mesh(reference::make_box({-0.3, -0.3, -0.02}, {0.3, 0.3, 0})), Motion::kStatic, {1, 2, 2.93});
    for (const bool fitted : {true, false}) {
        Camera camera;
        if (fitted) fit_camera(scene.snapshot(), 640, 480, camera);
        if (!fitted) lay_floor(scene.snapshot(), camera);
        EXPECT_NEAR(camera.floor.x(), 1, 1e-6);
        EXPECT_NEAR(camera.floor.y(), 2, 1e-6);
        EXPECT_LT(camera.floor.z(), 2.91);
        EXPECT_GT(camera.floor.z(), 2.90);
        EXPECT_GT(camera.floor_radius, 0.1);
    }
}

TEST(Render, WritesTextAndLegendOnlyWhenAsked) {
    PictureScene scene = busy_scene();
    PictureParams params = bare();
    const Camera camera = from_above(2);
    const Image plain = draw(scene, params, camera);
    params.text = true;
    const Image text = draw(scene, params, camera);
    int brightest = 0;
    for (uint32_t y = 190; y < 240; ++y)
        for (uint32_t x = 0; x < 110; ++x) brightest = std::max(brightest, pixel(text, x, y).green);
    EXPECT_GT(brightest, 220);
    EXPECT_EQ(pixel(text, 300, 20), pixel(plain, 300, 20));
}

}  // namespace
}  // namespace trocar
