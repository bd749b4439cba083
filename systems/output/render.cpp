#include "systems/output/render.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <string_view>

#include "engine/draw/depth_colours.hpp"
#include "engine/draw/text_overlay.hpp"
#include "engine/geometry/quaternion.hpp"

namespace trocar {
namespace {

bool holds_something(const Box& box) { return box.min.allFinite() && box.max.allFinite() && (box.min.array() <= box.max.array()).all(); }

Vec3d corner_of(const Box& box, uint32_t k) {
    return {(k & 1 ? box.max : box.min).x(), (k & 2 ? box.max : box.min).y(), (k & 4 ? box.max : box.min).z()};
}

Vec3d unit_or(const Vec3d& v, const Vec3d& otherwise) {
    const double length = v.norm();
    return length > 0 && std::isfinite(length) ? Vec3d(v / length) : otherwise;
}

Vec3d perpendicular_to(const Vec3d& v) {
    return v.cross(std::abs(v.z()) < 0.9 ? Vec3d(Vec3d::UnitZ()) : Vec3d(Vec3d::UnitX())).normalized();
}

struct CameraFrame {
    Vec3d eye, forward, right, up;
};

// Azimuth 0: the eye is on the side of the world's x axis (y, where up is x), whatever the elevation.
CameraFrame camera_frame(const Camera& camera) {
    CameraFrame frame;
    const Vec3d sky = unit_or(camera.up, Vec3d::UnitZ());
    if (camera.kind == CameraKind::kOrbit) {
        const Vec3d axis = std::abs(sky.x()) < 0.9 ? Vec3d(Vec3d::UnitX()) : Vec3d(Vec3d::UnitY());
        const Vec3d ahead = (axis - axis.dot(sky) * sky).normalized(), side = sky.cross(ahead);
        const Vec3d flat = std::cos(camera.azimuth) * ahead + std::sin(camera.azimuth) * side;
        const Vec3d back = std::cos(camera.elevation) * flat + std::sin(camera.elevation) * sky;
        frame.forward = -back;
        frame.eye = camera.target + camera.distance * back;
        frame.right = sky.cross(flat);
    } else {
        frame.eye = camera.position;
        frame.forward = unit_or(camera.target - camera.position, -sky);
        frame.right = unit_or(frame.forward.cross(sky), perpendicular_to(frame.forward));
    }
    frame.up = frame.right.cross(frame.forward);
    return frame;
}

constexpr double kFill = 0.88;             // fraction of the picture that a fitted scene spans
constexpr double kFillWithRoom = 0.72;     // with room for instruments
constexpr double kNearestDistance = 1e-3;  // m

double half_tangent(const Camera& camera) { return std::tan(0.5 * std::clamp(camera.field_of_view, 0.01, 3.0)); }

// Tangents of half the picture, times `fill` and, if the picture is large enough, less a margin.
std::array<double, 2> usable_tangents(const Camera& camera, double fill, uint32_t width, uint32_t height, uint32_t margin) {
    const double tan_y = half_tangent(camera), free = std::max(1 - 2.0 * margin / width, 0.4);
    return {std::min(fill, free) * tan_y * width / height, fill * tan_y};
}

// Least distance of the camera from its target, in its direction, at which a point is inside the picture.
double distance_for(const Vec3d& p, const Camera& camera, const CameraFrame& frame, double tan_x, double tan_y) {
    const Vec3d c = p - camera.target;
    const double nearer = -c.dot(frame.forward);
    return nearer + std::max(std::abs(c.dot(frame.right)) / tan_x, std::abs(c.dot(frame.up)) / tan_y);
}

template <typename Visit>
void visit_vertices(const PictureSnapshot& snapshot, const PictureBody& body, const Visit& visit) {
    for (uint32_t v = body.vertices.first; v < body.vertices.end(); ++v)
        if (snapshot.position[v].allFinite()) visit(body.origin + snapshot.position[v].cast<double>());
}

template <typename Visit>
void visit_corners(const PictureBody& body, const Visit& visit) {
    for (uint32_t k = 0; k < 8 && holds_something(body.box); ++k) visit(body.origin + rotate(body.orientation, corner_of(body.box, k)));
}

// Bodies that a picture is fitted to: the first kind that the scene has.
enum class Fitted : uint8_t {
    kMovers,  // deformable and free bodies
    kGuided,  // bodies moved by scripts, joints and hands
    kAll,
};

bool is_fitted(const PictureBody& body, Fitted fitted) {
    if (body.mesh == kNone) return false;
    if (fitted == Fitted::kMovers) return body.motion == PictureMotion::kSoft || body.motion == PictureMotion::kFree;
    return fitted == Fitted::kAll || body.motion == PictureMotion::kGuided;
}

// Calls visit(world point) for the vertices of deformable bodies and the box corners of rigid ones.
template <typename Visit>
void visit_points(const PictureSnapshot& snapshot, Fitted fitted, const Visit& visit) {
    for (const PictureBody& body : snapshot.body) {
        if (!is_fitted(body, fitted)) continue;
        if (body.vertices.count > 0)
            visit_vertices(snapshot, body, visit);
        else
            visit_corners(body, visit);
    }
}

Box box_to_fit(const PictureSnapshot& snapshot, Fitted& fitted) {
    Box box;
    for (const Fitted each : {Fitted::kMovers, Fitted::kGuided, Fitted::kAll}) {
        fitted = each;
        visit_points(snapshot, each, [&](const Vec3d& p) { grow(box, p); });
        if (holds_something(box)) break;
    }
    return box;
}

// Around the centre of `scene`, below `all`.
void lay_floor_under(const Box& scene, const Box& all, Camera& camera) {
    const Vec3d sky = unit_or(camera.up, Vec3d::UnitZ());
    const Vec3d middle = 0.5 * (scene.min + scene.max);
    const double size = (scene.max - scene.min).norm();
    double lowest = 0;
    for (uint32_t k = 0; k < 8; ++k) lowest = std::min(lowest, (corner_of(all, k) - middle).dot(sky));
    camera.floor = middle + (lowest - 0.02 * size) * sky;
    camera.floor_radius = 2.5 * size;
}

// Everything that must be between the near and the far plane.
Box drawn_box(const PictureSnapshot& snapshot) {
    Box box;
    for (const PictureBody& body : snapshot.body) {
        if (body.mesh == kNone || !holds_something(body.box)) continue;
        for (uint32_t k = 0; k < 8; ++k) grow(box, body.origin + rotate(body.orientation, corner_of(body.box, k)));
    }
    return box;
}

// Shadow of a body's box: the covariance of its points (h^2/3 per axis) projected on the floor, wider with
// height.
GroundShadow make_shadow(const PictureBody& body, const Ground& ground, const Vec3d& sky, double blur) {
    const Vec3d middle = body.origin + rotate(body.orientation, 0.5 * (body.box.min + body.box.max)) - ground.centre;
    const Vec3d half = 0.5 * (body.box.max - body.box.min);
    double xx = 0, xy = 0, yy = 0, reach = 0;
    for (uint32_t axis = 0; axis < 3; ++axis) {
        const Vec3d h = half[axis] * rotate(body.orientation, Vec3d::Unit(axis));
        const double hx = h.dot(ground.axis_x), hy = h.dot(ground.axis_y);
        xx += hx * hx / 2.2;
        xy += hx * hy / 2.2;
        yy += hy * hy / 2.2;
        reach += std::abs(h.dot(sky));
    }
    const double gap = std::max(0.0, middle.dot(sky) - reach);
    const double soft = blur + 0.35 * gap;
    const double bare = std::sqrt(std::max(xx * yy - xy * xy, 0.0));
    xx += soft * soft;
    yy += soft * soft;
    const double area = xx * yy - xy * xy;
    if (!(area > 0)) return {};
    const auto f = [](double d) { return static_cast<float>(d); };
    return {f(middle.dot(ground.axis_x)),
            f(middle.dot(ground.axis_y)),
            f(yy / area),
            f(-xy / area),
            f(xx / area),
            f(kDarkest * std::sqrt(std::min(1.0, (bare + 0.3 * soft * std::sqrt(bare)) / std::sqrt(area))))};
}

void place_ground(const PictureParams& params, const Camera& camera, const PictureSnapshot& snapshot, std::vector<GroundShadow>& shadows,
                  Ground& ground) {
    shadows.clear();
    const Vec3d sky = unit_or(camera.up, Vec3d::UnitZ());
    // seen from below, the floor would hide the bodies
    const bool from_above = (camera_frame(camera).eye - camera.floor).dot(sky) > 0;
    ground.on = params.ground && camera.kind == CameraKind::kOrbit && camera.floor_radius > 0 && from_above;
    if (!ground.on) return;
    ground.centre = camera.floor;
    ground.axis_x = perpendicular_to(sky);
    ground.axis_y = sky.cross(ground.axis_x);
    ground.radius = camera.floor_radius;
    for (const PictureBody& body : snapshot.body)
        if (body.mesh != kNone && holds_something(body.box)) shadows.push_back(make_shadow(body, ground, sky, 0.012 * ground.radius));
    make_ground_shade(shadows, static_cast<float>(ground.radius), ground.shade);
}

// Marker sizes are fractions of the picture's height at their position.
void place_markers(const PictureParams& params, const Camera& camera, const PictureSnapshot& snapshot, std::vector<Marker>& markers) {
    constexpr double kLeastShown = 5e-6;  // m, the status prints in units of 0.01 mm
    markers.clear();
    const CameraFrame frame = camera_frame(camera);
    const auto height_at = [&](const Vec3d& p) { return 2 * half_tangent(camera) * std::max((p - frame.eye).dot(frame.forward), 0.0); };
    if (params.witnesses)
        for (const PictureWitness& w : snapshot.witness) {
            if (w.depth < kLeastShown) continue;
            const double size = height_at(w.point), radius = std::clamp(0.08 * w.depth, 0.0025 * size, 0.0075 * size);
            markers.push_back({Marker::Kind::kArrow, w.point, w.closest, radius, {0.95f, 0.72f, 0.08f, 1.0f}});
        }
    // spheres after all arrows: consecutive markers of one kind and colour are drawn at once
    for (size_t i = 0, arrows = markers.size(); i < arrows; ++i) {
        const Marker arrow = markers[i];
        markers.push_back({Marker::Kind::kSphere, arrow.from, arrow.from, 1.8 * arrow.radius, arrow.colour});
    }
    for (const PicturePoint& p : snapshot.point)
        markers.push_back({Marker::Kind::kSphere, p.position, p.position, p.radius, {p.colour[0], p.colour[1], p.colour[2], 1.0f}});
    for (const PictureRod& r : snapshot.rod)
        markers.push_back({Marker::Kind::kRod, r.from, r.to, r.radius, {r.colour[0], r.colour[1], r.colour[2], 1.0f}});
    if (!params.tools) return;
    for (const PictureTool& tool : snapshot.tool) {
        if (camera.body != kNone && tool.body == camera.body) continue;  // they would be before the lens
        const double radius = std::max(tool.radius, 0.005 * height_at(tool.proxy));
        // without contact both coincide with the visible tip
        if (!((tool.device - tool.proxy).norm() > 0.02 * radius)) continue;
        markers.push_back({Marker::Kind::kSphere, tool.device, tool.device, radius, {0.90f, 0.10f, 0.08f, 0.75f}});
        markers.push_back({Marker::Kind::kSphere, tool.proxy, tool.proxy, 1.02 * radius, {0.06f, 0.55f, 0.28f, 0.75f}});
    }
}

constexpr OverlayColour kPanelColour{12, 16, 22, 150};
constexpr OverlayColour kTextColour{236, 240, 244, 255};
constexpr OverlayColour kLabelColour{150, 162, 176, 255};

// Label and value pairs on one panel, lower left.
void draw_status(const PictureSnapshot& snapshot, Image& out) {
    const uint32_t scale = std::max(1u, out.height / 240);
    const auto pixels = [scale](double n) { return static_cast<int32_t>(n * scale); };
    char value[3][24];
    std::snprintf(value[0], sizeof value[0], "%.2f s", snapshot.time);
    std::snprintf(value[1], sizeof value[1], "%.2f mm", 1e3 * snapshot.depth);
    std::snprintf(value[2], sizeof value[2], "%.2f N", snapshot.force);
    const std::string_view label[] = {"time", "depth", "force"};
    const uint32_t lines = snapshot.tool.empty() ? 2 : 3;
    const int32_t x = pixels(6), height = pixels(5 + 11 * lines), width = pixels(6 * 15 + 10);
    const int32_t y = static_cast<int32_t>(out.height) - height - pixels(6);
    draw_panel(out, x, y, static_cast<uint32_t>(width), static_cast<uint32_t>(height), 4 * scale, kPanelColour);
    for (uint32_t i = 0; i < lines; ++i) {
        const int32_t line = y + pixels(5 + 11.0 * i);
        draw_text(out, x + pixels(6), line, scale, kLabelColour, label[i]);
        const int32_t right = x + width - pixels(6);
        draw_text(out, right - static_cast<int32_t>(text_width(value[i], scale)), line, scale, kTextColour, value[i]);
    }
}

constexpr uint32_t kLegendWidth = 52, kLegendGap = 6;  // at scale 1

// Colour bar of contact depth, right edge.
void draw_legend(const PictureParams& params, Image& out) {
    const uint32_t scale = std::max(1u, out.height / 240);
    const auto pixels = [scale](double n) { return static_cast<int32_t>(n * scale); };
    const int32_t bar = pixels(96), width = pixels(kLegendWidth), height = bar + pixels(26);
    const int32_t x = static_cast<int32_t>(out.width) - width - pixels(kLegendGap);
    const int32_t y = (static_cast<int32_t>(out.height) - height) / 2;
    draw_panel(out, x, y, static_cast<uint32_t>(width), static_cast<uint32_t>(height), 4 * scale, kPanelColour);
    draw_text(out, x + pixels(6), y + pixels(5), scale, kLabelColour, "depth");
    const int32_t top = y + pixels(18);
    for (int32_t row = 0; row < bar; ++row) {
        const auto c = depth_colour(1.0 - (row + 0.5) / bar);
        draw_panel(out, x + pixels(6), top + row, static_cast<uint32_t>(pixels(8)), 1, 0,
                   {srgb_byte(c[0]), srgb_byte(c[1]), srgb_byte(c[2]), 255});
    }
    for (uint32_t i = 0; i <= 2; ++i) {
        char text[16];
        std::snprintf(text, sizeof text, i == 2 ? "%.3g mm" : "%.3g", 1e3 * params.depth_scale * i / 2);
        const int32_t line = top + bar - bar * static_cast<int32_t>(i) / 2 - pixels(i == 0 ? 6 : i == 1 ? 3.5 : 1);
        draw_text(out, x + pixels(17), line, scale, kTextColour, text);
    }
}

}  // namespace

void lay_floor(const PictureSnapshot& snapshot, Camera& camera) {
    Fitted fitted = Fitted::kAll;
    const Box box = box_to_fit(snapshot, fitted);
    if (holds_something(box)) lay_floor_under(box, drawn_box(snapshot), camera);
}

uint32_t legend_width(const PictureParams& params) {
    return params.depth_colours ? (kLegendWidth + 2 * kLegendGap) * std::max(1u, params.height / 240) : 0;
}

void fit_camera(const PictureSnapshot& snapshot, uint32_t width, uint32_t height, Camera& camera, uint32_t margin) {
    if (camera.kind != CameraKind::kOrbit) return;
    Fitted fitted = Fitted::kAll;
    const Box box = box_to_fit(snapshot, fitted);
    if (!holds_something(box)) return;
    camera.target = 0.5 * (box.min + box.max);
    const CameraFrame frame = camera_frame(camera);
    const auto tangents = usable_tangents(camera, fitted == Fitted::kAll ? kFill : kFillWithRoom, width, height, margin);
    camera.distance = kNearestDistance;
    visit_points(snapshot, fitted, [&](const Vec3d& p) {
        camera.distance = std::max(camera.distance, distance_for(p, camera, frame, tangents[0], tangents[1]));
    });
    lay_floor_under(box, drawn_box(snapshot), camera);
}

void keep_in_picture(const PictureSnapshot& snapshot, uint32_t width, uint32_t height, Camera& camera, uint32_t margin) {
    if (camera.kind != CameraKind::kOrbit || !(camera.floor_radius > 0)) return;
    const CameraFrame frame = camera_frame(camera);
    const Vec3d sky = unit_or(camera.up, Vec3d::UnitZ());
    const auto tangents = usable_tangents(camera, kFill, width, height, margin);
    const double placed = camera.distance;
    const auto needed = [&](const Vec3d& p) { return distance_for(p, camera, frame, tangents[0], tangents[1]); };
    for (const PictureBody& body : snapshot.body) {
        if (!is_fitted(body, Fitted::kMovers)) continue;
        bool leaves = false, gone = false;
        visit_corners(body, [&](const Vec3d& p) {
            const Vec3d from = p - camera.floor;
            const double height = from.dot(sky);
            gone = gone || height < 0 || (from - height * sky).norm() > camera.floor_radius;
            leaves = leaves || needed(p) > placed;
        });
        const auto back_off = [&](const Vec3d& p) { camera.distance = std::max(camera.distance, needed(p)); };
        if (leaves && !gone) body.vertices.count > 0 ? visit_vertices(snapshot, body, back_off) : visit_corners(body, back_off);
    }
}

Camera placed_camera(const Camera& camera, const PictureSnapshot& snapshot) {
    if (camera.kind != CameraKind::kLaparoscope || camera.body >= snapshot.body.size()) return camera;
    const PictureBody& body = snapshot.body[camera.body];
    Camera placed = camera;
    placed.position = body.origin + rotate(body.orientation, camera.position);
    const Vec3d along = unit_or(rotate(body.orientation, camera.shaft), Vec3d::UnitZ());
    // unit, perpendicular to the shaft, at an angle about it from what is up
    const auto about_shaft = [&](const Vec3d& up, double angle) {
        const Vec3d top = unit_or(up - up.dot(along) * along, perpendicular_to(along));
        return Vec3d(std::cos(angle) * top + std::sin(angle) * along.cross(top));
    };
    const Vec3d mark = rotate(body.orientation, camera.mark);
    const Vec3d view = std::cos(camera.optic) * along + std::sin(camera.optic) * about_shaft(mark, camera.optic_roll);
    const Vec3d top = about_shaft(camera.level ? camera.up : mark, camera.roll);
    placed.target = placed.position + std::max(camera.light, 1e-3) * view;
    placed.up = unit_or(top - top.dot(view) * view, perpendicular_to(view));
    return placed;
}

View make_view(const Camera& camera, const Box& box, uint32_t width, uint32_t height) {
    const CameraFrame frame = camera_frame(camera);
    View view;
    view.eye = frame.eye;
    view.forward = to_floats(frame.forward);
    view.right = to_floats(frame.right);
    view.up = to_floats(frame.up);
    view.sky = to_floats(unit_or(camera.up, Vec3d::UnitZ()));
    view.light_at_eye = camera.kind == CameraKind::kLaparoscope;
    view.light_distance = static_cast<float>(std::max((camera.target - frame.eye).norm(), 1e-3));
    if (camera.lamp != 0) view.lamp = to_floats(camera.lamp * frame.up);
    view.hidden = camera.body;
    double nearest = 1e-3, farthest = 1;
    if (holds_something(box)) {
        nearest = std::numeric_limits<double>::infinity();
        farthest = 0;
        for (uint32_t k = 0; k < 8; ++k) {
            const double depth = (corner_of(box, k) - frame.eye).dot(frame.forward);
            nearest = std::min(nearest, depth);
            farthest = std::max(farthest, depth);
        }
    }
    farthest = std::max(1.05 * farthest, 1e-3);
    nearest = std::clamp(0.9 * nearest, 2e-3 * farthest, 0.5 * farthest);
    view.near_plane = static_cast<float>(nearest);
    view.far_plane = static_cast<float>(farthest);
    const double tan_y = half_tangent(camera), tan_x = tan_y * width / height;
    view.tan_x = static_cast<float>(tan_x);
    view.tan_y = static_cast<float>(tan_y);
    const double a = (farthest + nearest) / (farthest - nearest), b = -2 * farthest * nearest / (farthest - nearest);
    for (uint32_t axis = 0; axis < 3; ++axis) {
        view.view_projection[4 * axis + 0] = static_cast<float>(frame.right[axis] / tan_x);
        view.view_projection[4 * axis + 1] = static_cast<float>(frame.up[axis] / tan_y);
        view.view_projection[4 * axis + 2] = static_cast<float>(a * frame.forward[axis]);
        view.view_projection[4 * axis + 3] = static_cast<float>(frame.forward[axis]);
    }
    view.view_projection[14] = static_cast<float>(b);
    return view;
}

void render_picture(const PictureParams& params, const Camera& held, const PictureSnapshot& snapshot, GlRenderer& renderer,
                    RenderScratch& scratch, Image& out) {
    const Camera camera = placed_camera(held, snapshot);
    Box box = drawn_box(snapshot);
    place_ground(params, camera, snapshot, scratch.shadows, scratch.ground);
    place_markers(params, camera, snapshot, scratch.markers);
    if (params.tools)
        for (const PictureTool& tool : snapshot.tool) {
            grow(box, tool.device);
            grow(box, tool.proxy);
        }
    View view = make_view(camera, box, params.width, params.height);
    view.liquid_up = snapshot.up;
    renderer.draw(params, view, snapshot, scratch.markers, scratch.ground, out);
    if (params.smooth_edges) smooth_edges(scratch.smooth, out);
    if (camera.body != kNone && snapshot.fog > 0) fog_picture(snapshot.fog, scratch.fog, out);
    if (params.depth_colours) draw_legend(params, out);
    if (params.text) draw_status(snapshot, out);
}

}  // namespace trocar
