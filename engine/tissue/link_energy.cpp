#include "engine/tissue/link_energy.hpp"

#include <cmath>

#include "engine/mesh/surfaces.hpp"
#include "engine/tissue/embedded_surface.hpp"
namespace trocar {
namespace {

struct LinkEnd {
    Vec3d place, velocity;  // m, m/s
};

LinkEnd end_of_link(const EnergyInputs& in, uint32_t body, uint32_t node, const Vec3d& point) {
    const Poses& poses = in.poses;
    if (body == kNone) return {point, Vec3d::Zero()};  // of the world
    if (!is_deformable(in.bodies, body)) {
        const Vec3d arm = rotate(poses.orientation[body], point);
        return {poses.origin[body] + arm, poses.velocity[body] + poses.angular_velocity[body].cross(arm)};
    }
    const Particles& p = in.particles;
    const uint32_t at =
        in.bodies.particles[body].first + (in.other.solids ? embedded_count(*in.other.solids, in.bodies.mesh[body]) : 0) + node;
    const Float4& o = p.offset[at];
    return {poses.origin[body] + Vec3d(o.x, o.y, o.z), {p.velocity_x[at], p.velocity_y[at], p.velocity_z[at]}};
}

struct LinkEnds {
    LinkEnd near, far;
};
LinkEnds ends_of_link(const EnergyInputs& in, const LinkGroup& g, uint32_t link) {
    const Links& links = *in.other.links;
    return {end_of_link(in, g.body, links.node[link], Vec3d::Zero()), end_of_link(in, g.holder, links.far_node[link], links.point[link])};
}

// visit(group, link) for all whole links at a body or at another.
template <typename Visit>
void each_link_at(const Links& links, uint32_t body, uint32_t other, const Visit& visit) {
    for (const LinkGroup& g : links.group) {
        if (g.body != body && g.holder != body && g.body != other && g.holder != other) continue;
        for (uint32_t link = g.links.first; link < g.links.end(); ++link)
            if (links.whole[link]) visit(g, link);
    }
}

}  // namespace

double stretch_of_link(const EnergyInputs& in, const LinkGroup& g, uint32_t link) {
    if (!in.other.links->whole[link]) return 0;
    const auto [near, far] = ends_of_link(in, g, link);
    const double back = 0.5 * in.particles.last_dt[g.body],
                 far_back = g.holder != kNone && is_deformable(in.bodies, g.holder) ? 0.5 * in.particles.last_dt[g.holder] : back;
    return (far.place - far_back * far.velocity - near.place + back * near.velocity).norm() - double{in.other.links->rest[link]};
}

double squared_stretch_rate(const EnergyInputs& in, const LinkGroup& g, uint32_t link) {
    const auto [near, far] = ends_of_link(in, g, link);
    const Vec3d rate = far.velocity - near.velocity, along = far.place - near.place;
    if (in.other.links->rest[link] == 0) return rate.squaredNorm();
    const double length = along.norm();
    return length > 0 ? std::pow(rate.dot(along) / length, 2) : 0.0;
}

double energy_of_links(const EnergyInputs& in, uint32_t body, uint32_t other) {
    if (!in.other.links) return 0;
    double sum = 0;
    each_link_at(*in.other.links, body, other, [&](const LinkGroup& g, uint32_t link) {
        const double stretch = stretch_of_link(in, g, link);
        sum += 0.5 * g.stiffness * stretch * stretch;
        if (!in.other.actions) return;
        const double step = in.particles.last_dt[g.body];
        sum -= 0.125 * step * step * g.stiffness * squared_stretch_rate(in, g, link);
    });
    return sum;
}

void stretch_links(const EnergyInputs& in, uint32_t body) {
    if (!in.other.links) return;
    Links& links = *in.other.links;
    each_link_at(links, body, body, [&](const LinkGroup& g, uint32_t link) { links.stretch[link] = stretch_of_link(in, g, link); });
}

}  // namespace trocar
