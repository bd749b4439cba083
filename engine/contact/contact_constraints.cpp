#include "engine/contact/contact_constraints.hpp"

#include <algorithm>
#include <cmath>

#include "engine/contact/columns.hpp"
namespace trocar {

void resize_constraints(ContactConstraints& constraints, size_t count) {
    each_field(constraints, [&](const FieldName& field, auto& column) {
        if (field.name != "warm_start" && field.name != "gap") column.resize(count);
    });
    constraints.impulse.assign(count, Vec3d::Zero());
}

void remove_constraints(std::span<const uint8_t> dropped, ContactConstraints& constraints) {
    const uint32_t count = uint32_t(constraints.body.size());
    if (std::find(dropped.begin(), dropped.begin() + count, 1) == dropped.begin() + count) return;
    each_column(constraints, count, [&](std::string_view name, auto& column) {
        if (name == "impulse" || name == "warm_start" || name == "gap") return;  // written later
        uint32_t kept = 0;  // branchless: every element is copied, because which ones stay cannot be predicted
        for (uint32_t constraint = 0; constraint < count; ++constraint) {
            column[kept] = column[constraint];
            kept += !dropped[constraint];
        }
    });
    resize_constraints(constraints, count - uint32_t(std::count(dropped.begin(), dropped.begin() + count, 1)));
}

std::array<float, 3> barycentric_weights(const Vec3d& p, const Vec3d& a, const Vec3d& b, const Vec3d& c) {
    const Vec3d u = b - a, v = c - a, w = p - a;
    const double uu = u.dot(u), uv = u.dot(v), vv = v.dot(v), wu = w.dot(u), wv = w.dot(v);
    const double area = uu * vv - uv * uv;
    double y = 0, z = 0;
    if (area > 1e-12 * uu * vv) {
        y = (vv * wu - uv * wv) / area;
        z = (uu * wv - uv * wu) / area;
    } else if (std::max(uu, vv) > 0) {
        // a sliver: along its longer side from a
        (uu >= vv ? y : z) = uu >= vv ? wu / uu : wv / vv;
    }
    y = std::clamp(y, 0.0, 1.0);
    z = std::clamp(z, 0.0, 1.0 - y);
    const double unit = 1 << 23;
    const double fy = std::floor(y * unit) / unit, fz = std::floor(z * unit) / unit;
    return {float(1.0 - fy - fz), float(fy), float(fz)};
}

}  // namespace trocar
