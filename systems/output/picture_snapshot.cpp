#include "systems/output/picture_snapshot.hpp"

#include <algorithm>

namespace trocar {
namespace {

// Vertex ranges of all bodies, one body after another. True if they are unchanged.
bool lay_out(const Surfaces& surfaces, PictureSnapshot& out) {
    const Bodies& bodies = surfaces.bodies;
    bool as_before = out.body.size() == bodies.mesh.size();
    out.body.resize(bodies.mesh.size());
    uint32_t first = 0;
    for (uint32_t index = 0; index < out.body.size(); ++index) {
        const bool shown = bodies.mesh[index] != kNone && is_deformable(bodies, index);
        const Range range{shown ? first : 0, shown ? surfaces.meshes.info[bodies.mesh[index]].vertices.count : 0};
        as_before = as_before && range.first == out.body[index].vertices.first && range.count == out.body[index].vertices.count;
        out.body[index].vertices = range;
        first += range.count;
    }
    as_before = as_before && out.position.size() == first && out.normal.size() == first;
    out.position.resize(first);
    out.normal.resize(first);
    return as_before;
}

void copy_shape(const Surfaces& surfaces, const SurfaceNormals& normals, uint32_t index, PictureSnapshot& out) {
    PictureBody& body = out.body[index];
    const uint32_t from = surfaces.bodies.particles[index].first;
    for (uint32_t v = 0; v < body.vertices.count; ++v) {
        const Float4& o = surfaces.particles.offset[from + v];
        out.position[body.vertices.first + v] = {o.x, o.y, o.z};
        grow(body.box, Vec3d(o.x, o.y, o.z));
    }
    std::copy_n(normals.normal.begin() + from, body.vertices.count, out.normal.begin() + body.vertices.first);
}

PictureMotion picture_motion(Motion motion) {
    switch (motion) {
        case Motion::kStatic:
            return PictureMotion::kStill;
        case Motion::kFree:
            return PictureMotion::kFree;
        case Motion::kDeformable:
            return PictureMotion::kSoft;
        default:
            return PictureMotion::kGuided;
    }
}

void copy_bodies(const Surfaces& surfaces, const SurfaceNormals& normals, const SleepingBodies& sleeping_bodies, PictureSnapshot& out) {
    const Bodies& bodies = surfaces.bodies;
    if (!lay_out(surfaces, out)) std::fill(sleeping_bodies.seen.begin(), sleeping_bodies.seen.end(), 0);
    for (uint32_t index = 0; index < out.body.size(); ++index) {
        PictureBody& body = out.body[index];
        const bool seen = was_seen(sleeping_bodies, index);
        const Range vertices = body.vertices;
        const Box box = body.box;
        body = {};
        body.mesh = bodies.mesh[index];
        if (body.mesh == kNone) continue;
        body.vertices = vertices;
        body.motion = picture_motion(bodies.motion[index]);
        body.origin = surfaces.poses.origin[index];
        if (!is_deformable(bodies, index)) {
            body.orientation = surfaces.poses.orientation[index];
            body.box = surfaces.meshes.info[body.mesh].box;
        } else if (seen) {
            body.box = box;
        } else {
            copy_shape(surfaces, normals, index, out);
        }
    }
}

void copy_depths(const Surfaces& surfaces, const Contacts& contacts, PictureSnapshot& out) {
    out.contact_depth.clear();
    for (size_t index = 0; index < contacts.body.size(); ++index) {
        const float depth = static_cast<float>(-contacts.distance[index]);
        PictureBody& body = out.body[contacts.body[index]];
        if (!(depth > 0) || body.mesh == kNone) continue;
        if (body.depths.count == 0) {
            body.depths = {static_cast<uint32_t>(out.contact_depth.size()), surfaces.meshes.info[body.mesh].vertices.count};
            out.contact_depth.resize(out.contact_depth.size() + body.depths.count, 0.0f);
        }
        for (const uint32_t vertex : contacts.vertex[index]) {
            float& deepest = out.contact_depth[body.depths.first + vertex];
            deepest = std::max(deepest, depth);
        }
        if (const uint32_t third = contacts.third[index]; third != kNone) {
            float& deepest = out.contact_depth[body.depths.first + third];
            deepest = std::max(deepest, depth);
        }
    }
}

void copy_witnesses(const Contacts& contacts, const Penetrations& penetrations, PictureSnapshot& out) {
    out.witness.clear();
    out.depth = 0;
    for (size_t index = 0; index < penetrations.depth.size(); ++index) {
        out.depth = std::max(out.depth, penetrations.depth[index]);
        const uint32_t contact = penetrations.witness[index];
        if (contact >= contacts.point.size()) continue;
        out.witness.push_back({contacts.point[contact], contacts.closest[contact], penetrations.depth[index]});
    }
}

void copy_tools(const Haptics& haptics, PictureSnapshot& out) {
    out.tool.clear();
    out.force = 0;
    for (size_t index = 0; index < haptics.state.size(); ++index) {
        const ToolState& state = haptics.state[index];
        const Vec3d proxy = state.proxy_valid ? state.proxy : state.device.position;
        out.tool.push_back({state.device.position, proxy, haptics.tool[index].tip_radius, state.output.force});
        out.force = std::max(out.force, state.output.force.norm());
    }
}

void copy_points(std::span<const PicturePoints> points, PictureSnapshot& out) {
    out.point.clear();
    for (const PicturePoints& alike : points)
        for (const Vec3d& p : alike.position) out.point.push_back({p, alike.radius, alike.colour});
}

// Absent triangles follow the present ones; numbers from tear.outer on were interior at load.
void copy_removed(const Surfaces& surfaces, const Tears* tears, PictureSnapshot& out) {
    out.removed.clear(), out.exposed.clear();
    for (size_t t = 0; tears && t < tears->body.size(); ++t) {
        const TearBody& tear = tears->body[t];
        const Range left = surfaces.meshes.info[surfaces.bodies.mesh[tear.body]].triangles;
        const auto removed = static_cast<uint32_t>(out.removed.size()), exposed = static_cast<uint32_t>(out.exposed.size());
        for (uint32_t i = 0; i < tear.order.count; ++i) {
            const bool outer = tears->order[tear.order.first + i] < tear.outer, there = i < left.count;
            if (outer == there) continue;
            (outer ? out.removed : out.exposed).push_back(surfaces.meshes.triangle[left.first + i]);
        }
        out.body[tear.body].removed = {removed, static_cast<uint32_t>(out.removed.size()) - removed};
        out.body[tear.body].exposed = {exposed, static_cast<uint32_t>(out.exposed.size()) - exposed};
    }
}

void hide_absent(const PictureInputs& in, PictureSnapshot& out) {
    for (uint32_t body = 0; in.spawning && body < in.spawning->away.size(); ++body)
        if (is_away(*in.spawning, body)) out.body[body].mesh = kNone;
    for (uint32_t body = 0; in.node_state && body < in.node_state->off.size(); ++body)
        if (is_off(*in.node_state, body)) out.body[body].mesh = kNone;
}

}  // namespace

void write_picture_snapshot(const PictureInputs& inputs, PictureSnapshot& out, const SleepingBodies& sleeping_bodies) {
    out.number = inputs.number;
    out.time = inputs.time;
    copy_bodies(inputs.surfaces, inputs.normals, sleeping_bodies, out);
    copy_depths(inputs.surfaces, inputs.contacts, out);
    copy_witnesses(inputs.contacts, inputs.penetrations, out);
    copy_tools(inputs.haptics, out);
    copy_points(inputs.points, out);
    copy_removed(inputs.surfaces, inputs.tears, out);
    hide_absent(inputs, out);
}

}  // namespace trocar
