// A laparoscope that a body holds: where it looks, against a pinhole with an oblique axis in double; its light against the stated
// formula; what fogs its lens.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "engine/draw/fogged_picture.hpp"
#include "engine/world/capture_record.hpp"
#include "systems/output/render.hpp"
#include "tests/reference/picture_scene.hpp"
namespace trocar {
namespace {

using reference::make_square;
using reference::PictureScene;

constexpr double kDegree = std::numbers::pi / 180;

PictureParams scope_params() {
    PictureParams params;
    params.width = 320, params.height = 240;
    params.text = params.ground = params.witnesses = params.tools = params.smooth_edges = false;
    return params;
}

Camera scope_on(uint32_t body) {
    Camera camera;
    camera.kind = CameraKind::kLaparoscope;
    camera.body = body;
    camera.position = Vec3d(0.001, -0.002, 0.003);
    camera.field_of_view = 66 * kDegree;
    camera.light = 0.08;
    return camera;
}

Image drawn(PictureScene& scene, const Camera& camera, const PictureSnapshot& snapshot) {
    GlRenderer renderer(scene.meshes);
    RenderScratch scratch;
    Image out;
    render_picture(scope_params(), camera, snapshot, renderer, scratch, out);
    return out;
}

// Pixels to the right and up of the middle, of a pinhole whose axis is turned by `optic` from the shaft; by rotation matrices.
Eigen::Vector2d pinhole(const Vec3d& point, const PictureBody& body, const Camera& c, const PictureParams& params) {
    const Eigen::Quaterniond q(body.orientation.w, body.orientation.x, body.orientation.y, body.orientation.z);
    const Eigen::Matrix3d turn = q.toRotationMatrix();
    const Vec3d eye = body.origin + turn * c.position, shaft = turn * c.shaft;
    const auto across = [&](const Vec3d& v) { return Vec3d((v - v.dot(shaft) * shaft).normalized()); };
    const Vec3d lean = Eigen::AngleAxisd(c.optic_roll, shaft) * across(turn * c.mark);
    const Vec3d view = Eigen::AngleAxisd(c.optic, shaft.cross(lean)) * shaft;
    const Vec3d head = Eigen::AngleAxisd(c.roll, shaft) * across(c.level ? c.up : Vec3d(turn * c.mark));
    const Vec3d right = view.cross(head).normalized(), up = right.cross(view), from = point - eye;
    const double pixels = 0.5 * params.height / std::tan(0.5 * c.field_of_view);
    return {pixels * from.dot(right) / from.dot(view), pixels * from.dot(up) / from.dot(view)};
}

TEST(Laparoscope, PointsAreWhereAnObliquePinholeHasThem) {
    const PictureParams params = scope_params();
    PictureScene scene;
    const uint32_t body = scene.add_body(scene.add_mesh(make_square(0.01, {1, 1, 1})), Motion::kStatic);
    int seen = 0;
    for (const double optic : {0.0, 30.0, 45.0})
        for (const double lean : {0.0, 50.0, 180.0})
            for (const double roll : {0.0, -25.0})
                for (const bool level : {false, true})
                    for (const Vec3d& far : {Vec3d(0, 0, 0), Vec3d(2e4, -1e4, 3e3)}) {
                        scene.poses.origin[body] = far + Vec3d(0.02, -0.05, 0.03);
                        scene.poses.orientation[body] = from_rotation_vector({0.7, -0.4, 0.9});
                        const PictureSnapshot snapshot = scene.snapshot();
                        Camera camera = scope_on(body);
                        camera.shaft = Vec3d(0.2, 0.1, 1).normalized(), camera.mark = Vec3d(0, 1, 0.3).normalized();
                        camera.optic = optic * kDegree, camera.optic_roll = lean * kDegree, camera.roll = roll * kDegree;
                        camera.level = level;
                        const View view = make_view(placed_camera(camera, snapshot), {far, far + Vec3d(0.1, 0.1, 0.1)}, params.width,
                                                    params.height);
                        for (int k = 0; k < 27; ++k) {
                            const Vec3d p = far + 0.1 * Vec3d(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1) + Vec3d(0.01, 0.02, 0.013);
                            const Vec3 from = (p - view.eye).cast<float>();
                            const auto clip = [&](int row) {
                                return view.view_projection[row] * from.x() + view.view_projection[4 + row] * from.y() +
                                       view.view_projection[8 + row] * from.z() + view.view_projection[12 + row];
                            };
                            if (clip(3) < 0.03f) continue;  // behind the lens
                            ++seen;
                            const Eigen::Vector2d exact = pinhole(p, snapshot.body[body], camera, params);
                            EXPECT_NEAR(0.5 * params.width * clip(0) / clip(3), exact.x(), 2e-3);
                            EXPECT_NEAR(0.5 * params.height * clip(1) / clip(3), exact.y(), 2e-3);
                        }
                    }
    EXPECT_GT(seen, 400);
    // a straight look along the shaft, and by 30 degrees above it: the point on the shaft comes to lie below the middle
    scene.poses.origin[body].setZero(), scene.poses.orientation[body] = {};
    Camera camera = scope_on(body);
    camera.position.setZero();
    for (const double optic : {0.0, 30.0}) {
        camera.optic = optic * kDegree;
        const View view = make_view(placed_camera(camera, scene.snapshot()), {}, params.width, params.height);
        EXPECT_NEAR(view.view_projection[9] / view.view_projection[11], -std::tan(camera.optic) / std::tan(33 * kDegree), 1e-6);
        EXPECT_NEAR(view.view_projection[8], 0, 1e-6);
    }
}

// What it sees is what a camera sees that stands there, to the pixel, and not the body that holds it, in which the lens is.
TEST(Laparoscope, SeesWhatACameraInItsPlaceSees) {
    PictureScene scene;
    const uint32_t wall = scene.add_mesh(make_square(0.05, {0.8, 0.5, 0.4})), front = scene.add_mesh(make_square(0.004, {0, 1, 0}));
    scene.add_body(wall, Motion::kDeformable, {0, 0, -0.06});
    // its square is before the lens
    const uint32_t scope = scene.add_body(front, Motion::kStatic, {0.01, 0, 0.02}, from_rotation_vector({std::numbers::pi, 0, 0}));
    Camera camera = scope_on(scope);
    camera.position = Vec3d(0, 0, -0.01);
    camera.optic = 30 * kDegree, camera.optic_roll = 200 * kDegree, camera.lamp = 0.004;
    const PictureSnapshot snapshot = scene.snapshot();
    const Image held = drawn(scene, camera, snapshot);
    Camera standing = placed_camera(camera, snapshot);
    standing.body = kNone;
    EXPECT_NE(drawn(scene, standing, snapshot).rgba, held.rgba) << "the square must be in the way";
    PictureSnapshot alone = snapshot;
    alone.body[scope].mesh = kNone;
    EXPECT_EQ(drawn(scene, standing, alone).rgba, held.rgba);
    camera.body = 77;  // not in the picture: stands where it is
    EXPECT_EQ(placed_camera(camera, snapshot).position, camera.position);
}

double linear_of(int byte) {
    const double e = byte / 255.0;
    return e <= 0.04045 ? e / 12.92 : std::pow((e + 0.055) / 1.055, 2.4);
}
double smoothstep(double a, double b, double x) {
    const double t = std::clamp((x - a) / (b - a), 0.0, 1.0);
    return t * t * (3 - 2 * t);
}

// The red light of a point of a grey wall, by the stated formula: a spot light with the square of the distance, the wall's cosine, a
// highlight (Blinn's half vector, Schlick's Fresnel factor), the mask of the round picture.
double lit_wall(double x, double y, double distance, double lamp, const Camera& c, const PictureParams& params, double grey) {
    const double pixel = 2 * std::tan(0.5 * c.field_of_view) * distance / params.height;
    const Vec3d p(x * pixel, y * pixel, distance), to_lamp = Vec3d(0, lamp, 0) - p, l = to_lamp.normalized(), e = -p.normalized();
    const Vec3d n(0, 0, -1), h = (l + e).normalized();
    const double fall = std::min(c.light * c.light / to_lamp.squaredNorm(), 2.2) * (0.25 + 0.75 * smoothstep(0.55, 0.98, -l.z()));
    const double fresnel = std::pow(1 - h.dot(e), 5), shine = 16;
    const double highlight = (0.06 + 0.94 * fresnel) * (shine * 0.022 + 0.4) * std::exp(shine * (n.dot(h) - 1));
    double v = grey * (fall * (0.08 + 0.92 * n.dot(l)) + 0.012) + fall * highlight;
    const double over = std::max(v - 0.75, 0.0);
    v = std::min(v, 0.75) + over / (1 + 4 * over);
    return v * (1 - 0.6 * smoothstep(0.5, 1.05, std::hypot(x, y) / (0.535 * params.height)));
}

TEST(Laparoscope, LightComesFromBesideTheLens) {
    PictureScene scene;
    Mesh wall = make_square(0.2, {0.3f, 0.3f, 0.3f});
    wall.material[0].specular = {0, 0, 0}, wall.material[0].shininess = 0;
    scene.add_body(scene.add_mesh(wall), Motion::kDeformable);
    const uint32_t scope = scene.add_body(scene.add_mesh(make_square(0.001, {1, 1, 1})), Motion::kStatic);
    const PictureParams params = scope_params();
    // looks down; up in the picture is +y of the world
    for (const double distance : {0.06, 0.12})
        for (const double lamp : {0.0, 0.02, -0.02}) {
            scene.poses.origin[scope] = Vec3d(0, 0, distance), scene.poses.orientation[scope] = from_rotation_vector({std::numbers::pi, 0, 0});
            Camera camera = scope_on(scope);
            camera.position.setZero(), camera.mark = -Vec3d::UnitY(), camera.lamp = lamp;
            const Image picture = drawn(scene, camera, scene.snapshot());
            for (const int x : {-60, 0, 50})
                for (const int y : {-80, -30, 0, 30, 80}) {
                    const size_t pixel = size_t{4} * (static_cast<size_t>(119 - y) * 320 + static_cast<size_t>(160 + x));
                    const double exact = lit_wall(x + 0.5, y + 0.5, distance, lamp, camera, params, 0.3), seen = linear_of(picture.rgba[pixel]);
                    EXPECT_NEAR(seen, exact, 0.01 * exact + 0.004) << distance << " " << lamp << " at " << x << " " << y;
                }
        }
}

// Without fog nothing changes; fog takes contrast and keeps the brightness of what is around; nothing outside of the round picture.
TEST(Laparoscope, FogScattersTheLight) {
    Image picture;
    picture.width = 160, picture.height = 120;
    for (uint32_t i = 0; i < 160 * 120; ++i)
        for (const int byte : {i % 160 / 8 % 2 ? 200 : 40, 90, 60, 255}) picture.rgba.push_back(static_cast<uint8_t>(byte));
    FogScratch scratch;
    Image same = picture;
    fog_picture(0, scratch, same);
    EXPECT_EQ(same.rgba, picture.rgba);
    double before = 0;
    for (const double fog : {0.0, 0.25, 0.5, 0.75, 1.0}) {
        Image fogged = picture;
        fog_picture(fog, scratch, fogged);
        EXPECT_TRUE(std::equal(fogged.rgba.begin(), fogged.rgba.begin() + 4 * 30, picture.rgba.begin())) << "a corner";
        const size_t row = size_t{4} * 160 * 60;
        double lowest = 255, highest = 0;
        for (uint32_t x = 50; x < 110; ++x) {
            lowest = std::min<double>(lowest, fogged.rgba[row + 4 * x]), highest = std::max<double>(highest, fogged.rgba[row + 4 * x]);
            EXPECT_EQ(fogged.rgba[row + 4 * x + 3], 255);
            // green is the same everywhere: the blur leaves it, the veil (90 + 190) / 2 takes half of what is scattered
            EXPECT_NEAR(fogged.rgba[row + 4 * x + 1], 90 + 0.5 * fog * (140 - 90), 1);
        }
        if (fog > 0) {
            EXPECT_LT(highest - lowest, before) << fog;
        }
        before = highest - lowest;
    }
    EXPECT_LT(before, 60) << "of 160";
}

TEST(Laparoscope, ACaptureHasTheCamera) {
    CaptureHeader header;
    header.camera = scope_on(3);
    header.camera.shaft = Vec3d(0, 0.6, 0.8), header.camera.mark = Vec3d(1, 0, 0), header.camera.level = true;
    header.camera.optic = 0.5, header.camera.optic_roll = 0.6, header.camera.roll = 0.7, header.camera.lamp = 0.01;
    const Camera read = read_header(to_record(header)).camera;
    EXPECT_EQ(read.body, 3u);
    EXPECT_TRUE(read.level);
    EXPECT_EQ(read.shaft, header.camera.shaft);
    EXPECT_EQ(read.mark, header.camera.mark);
    for (double Camera::*number : {&Camera::optic, &Camera::optic_roll, &Camera::roll, &Camera::lamp, &Camera::light, &Camera::field_of_view})
        EXPECT_EQ(read.*number, header.camera.*number);
    EXPECT_EQ(read_header(to_record(CaptureHeader{})).camera.body, kNone);
}

}  // namespace
}  // namespace trocar
