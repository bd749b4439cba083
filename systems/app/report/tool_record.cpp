#include "systems/app/report/tool_record.hpp"

#include <algorithm>
#include <cmath>

#include "engine/draw/depth_colours.hpp"
#include "systems/app/console/format.hpp"
#include "systems/app/report/svg_plot.hpp"
#include "systems/frame/frame.hpp"
namespace trocar {
namespace {

constexpr uint32_t kCells = 40;  // along the longer side
constexpr size_t kLeastTouches = 30;
constexpr double kFarthest = 2.5;  // cells, distance up to which a sample contributes to a cell

// Projection of the world's x axis into the plane, or of y if the plane is perpendicular to x.
Vec3d right_of(const Vec3d& normal) {
    const Vec3d axis = std::abs(normal.x()) < 0.9 ? Vec3d::UnitX() : Vec3d::UnitY();
    return (axis - axis.dot(normal) * normal).normalized();
}

// Kernel-weighted mean of the samples near a point of the plane.
double felt_at(const ForceMap& map, std::span<const Vec3d> touch, double x, double y) {
    double sum = 0, weights = 0, nearest = INFINITY;
    for (const Vec3d& t : touch) {
        const double d2 = ((t.x() - x) * (t.x() - x) + (t.y() - y) * (t.y() - y)) / (map.cell * map.cell);
        nearest = std::min(nearest, d2);
        if (d2 > kFarthest * kFarthest) continue;
        const double w = std::exp(-0.5 * d2);
        sum += w * t.z(), weights += w;
    }
    return nearest > kFarthest * kFarthest ? NAN : sum / weights;
}

}  // namespace

void record_tools(const Frame& frame, std::vector<ToolSample>& samples) {
    const World& w = frame.world();
    const double seconds = 1e-3 * w.clock.period;
    for (uint32_t t = 0; t < w.haptics.tool.size(); ++t) {
        const ToolState& s = w.haptics.state[t];
        samples.push_back({1e-3 * static_cast<double>(w.clock.tick), t, s.device.position, s.proxy, s.output.force, s.output.torque,
                           s.contact_impulse / seconds, s.contacts, s.device.grip, s.grip_torque});
    }
}

std::string tools_csv(std::span<const ToolSample> samples, std::span<const std::string> tools) {
    std::string out =
        "time_s,tool,device_x_m,device_y_m,device_z_m,proxy_x_m,proxy_y_m,proxy_z_m,force_x_n,force_y_n,force_z_n,"
        "torque_x_nm,torque_y_nm,torque_z_nm,tissue_x_n,tissue_y_n,tissue_z_n,contacts,grip_rad,grip_nm\n";
    for (const ToolSample& s : samples) {
        out += format("%.3f,", s.time) + csv_field(tools[s.tool]);
        for (const Vec3d* v : {&s.device, &s.proxy, &s.force, &s.torque, &s.tissue})
            out += format(",%.9g,%.9g,%.9g", v->x(), v->y(), v->z());
        out += format(",%u,%.9g,%.9g\n", s.contacts, s.grip, s.grip_torque);
    }
    return out;
}

std::optional<ForceMap> force_map(std::span<const ToolSample> samples, uint32_t tool) {
    Vec3d mean = Vec3d::Zero();
    size_t touches = 0;
    for (const ToolSample& s : samples)
        if (s.tool == tool && s.contacts > 0) mean += s.force, ++touches;
    if (touches < kLeastTouches || mean.norm() == 0) return std::nullopt;
    ForceMap map;
    map.normal = mean.normalized();
    map.right = right_of(map.normal);
    map.up = map.normal.cross(map.right);
    std::vector<Vec3d> touch;  // right, up (m), force (N)
    Vec3d low = Vec3d::Constant(INFINITY), high = -low;
    for (const ToolSample& s : samples) {
        if (s.tool != tool || s.contacts == 0) continue;
        touch.emplace_back(s.proxy.dot(map.right), s.proxy.dot(map.up), s.force.dot(map.normal));
        low = low.cwiseMin(touch.back()), high = high.cwiseMax(touch.back());
    }
    const Vec3d size = high - low;
    if (std::min(size.x(), size.y()) < 0.25 * std::max(size.x(), size.y())) return std::nullopt;
    map.cell = std::max(size.x(), size.y()) / kCells;
    map.right_from = low.x(), map.up_from = low.y();
    map.columns = static_cast<uint32_t>(std::ceil(size.x() / map.cell)), map.rows = static_cast<uint32_t>(std::ceil(size.y() / map.cell));
    for (uint32_t j = 0; j < map.rows; ++j)
        for (uint32_t i = 0; i < map.columns; ++i)
            map.force.push_back(felt_at(map, touch, map.right_from + (i + 0.5) * map.cell, map.up_from + (j + 0.5) * map.cell));
    return map;
}

std::string svg_force_map(const std::string& title, const ForceMap& map) {
    double high = 0;
    for (const double f : map.force)
        if (f > high) high = f;
    const double side = 480.0 / std::max(map.columns, map.rows), left = 56, top = 34;
    const double width = side * map.columns, height = side * map.rows;
    const auto square = [&](double x, double y, double w, double h, double share) {
        const auto c = depth_colour(share);
        return format("<rect x=\"%.2f\" y=\"%.2f\" width=\"%.2f\" height=\"%.2f\" fill=\"rgb(%d,%d,%d)\"/>", x, y, w, h,
                      int{srgb_byte(c[0])}, int{srgb_byte(c[1])}, int{srgb_byte(c[2])});
    };
    const auto label = [&](double x, double y, const char* anchor, const std::string& text) {
        return format("<text class=\"n\" text-anchor=\"%s\" x=\"%.1f\" y=\"%.1f\">", anchor, x, y) + escape_html(text) + "</text>";
    };
    const double least = 16 + 8.5 * static_cast<double>(title.size());  // so that the title is not cut off
    std::string svg = format(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 %.0f %.0f\" role=\"img\" font-family=\"sans-serif\" font-size=\"12\">",
        std::max(left + width + 110, least), top + height + 44);
    svg += "<text class=\"t\" x=\"8\" y=\"18\">" + escape_html(title) + "</text>";
    for (uint32_t j = 0; j < map.rows; ++j) {
        for (uint32_t i = 0; i < map.columns; ++i) {
            const double f = map.force[j * map.columns + i];
            // slightly larger than the cell, so that no seams are visible
            if (!std::isnan(f))
                svg += square(left + i * side, top + (map.rows - 1 - j) * side, side + 0.3, side + 0.3, high > 0 ? f / high : 0);
        }
    }
    const auto mm = [](double metres) { return format("%.0f", 1e3 * metres); };
    svg += label(left, top + height + 16, "middle", mm(map.right_from)) +
           label(left + width, top + height + 16, "middle", mm(map.right_from + map.columns * map.cell));
    svg += label(left + width / 2, top + height + 34, "middle", "across, mm") + label(left - 6, top + height, "end", mm(map.up_from));
    svg += label(left - 6, top + 10, "end", mm(map.up_from + map.rows * map.cell));
    svg += format("<text class=\"n\" text-anchor=\"middle\" transform=\"translate(14,%.1f) rotate(-90)\">up, mm</text>", top + height / 2);
    constexpr int kSteps = 40;
    for (int k = 0; k < kSteps; ++k)
        svg += square(left + width + 20, top + height * (1 - (k + 1.0) / kSteps), 16, height / kSteps + 0.3, (k + 0.5) / kSteps);
    svg += label(left + width + 42, top + 10, "start", format("%.2f N", high)) + label(left + width + 42, top + height, "start", "0 N");
    return svg + "</svg>";
}

}  // namespace trocar
