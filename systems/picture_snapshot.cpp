#include "systems/picture_snapshot.hpp"

#include <algorithm>

namespace trocar {
namespace {

// Rows of the vertices of all bodies, one body after the other. True if they lie as they did.
bool lay_out(const Surfaces& surfaces, PictureSnapshot& out) {
    const Bodies& bodies = surfaces.bodies;
    bool as_before = out.body.size() == bodies.mesh.size();
    out.body.resize(bodies.mesh.size());
    uint32_t first = 0;
    for (uint32_t row = 0; row < out.body.size(); ++row) {
        const bool shown = bodies.mesh[row] != kNone && is_deformable(bodies, row);
        const Range rows{shown ? first : 0, shown ? surfaces.meshes.info[bodies.mesh[row]].vertices.count : 0};
        as_before = as_before && rows.first == out.body[row].vertices.first && rows.count == out.body[row].vertices.count;
        out.body[row].vertices = rows;
        first += rows.count;
    }
    as_before = as_before && out.position.size() == first && out.normal.size() == first;
    out.position.resize(first);
    out.normal.resize(first);
    return as_before;
}

void copy_shape(const Surfaces& surfaces, const SurfaceNormals& normals, uint32_t row, PictureSnapshot& out) {
    PictureBody& body = out.body[row];
    const uint32_t from = surfaces.bodies.particles[row].first;
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

void copy_bodies(const Surfaces& surfaces, const SurfaceNormals& normals, const Sleepers& sleepers, PictureSnapshot& out) {
    const Bodies& bodies = surfaces.bodies;
    if (!lay_out(surfaces, out)) std::fill(sleepers.seen.begin(), sleepers.seen.end(), 0);
    for (uint32_t row = 0; row < out.body.size(); ++row) {
        PictureBody& body = out.body[row];
        const bool seen = was_seen(sleepers, row);
        const Range vertices = body.vertices;
        const Box box = body.box;
        body = {};
        body.mesh = bodies.mesh[row];
        if (body.mesh == kNone) continue;
        body.vertices = vertices;
        body.motion = picture_motion(bodies.motion[row]);
        body.origin = surfaces.poses.origin[row];
        if (!is_deformable(bodies, row)) {
            body.orientation = surfaces.poses.orientation[row];
            body.box = surfaces.meshes.info[body.mesh].box;
        } else if (seen) {
            body.box = box;
        } else {
            copy_shape(surfaces, normals, row, out);
        }
    }
}

void copy_depths(const Surfaces& surfaces, const Contacts& contacts, PictureSnapshot& out) {
    out.contact_depth.clear();
    for (size_t row = 0; row < contacts.body.size(); ++row) {
        const float depth = static_cast<float>(-contacts.distance[row]);
        PictureBody& body = out.body[contacts.body[row]];
        if (!(depth > 0) || body.mesh == kNone) continue;
        if (body.depths.count == 0) {
            body.depths = {static_cast<uint32_t>(out.contact_depth.size()), surfaces.meshes.info[body.mesh].vertices.count};
            out.contact_depth.resize(out.contact_depth.size() + body.depths.count, 0.0f);
        }
        for (const uint32_t vertex : contacts.vertex[row]) {
            float& deepest = out.contact_depth[body.depths.first + vertex];
            deepest = std::max(deepest, depth);
        }
        if (const uint32_t third = contacts.third[row]; third != kNone) {
            float& deepest = out.contact_depth[body.depths.first + third];
            deepest = std::max(deepest, depth);
        }
    }
}

void copy_witnesses(const Contacts& contacts, const Penetrations& penetrations, PictureSnapshot& out) {
    out.witness.clear();
    out.depth = 0;
    for (size_t row = 0; row < penetrations.depth.size(); ++row) {
        out.depth = std::max(out.depth, penetrations.depth[row]);
        const uint32_t contact = penetrations.witness[row];
        if (contact >= contacts.point.size()) continue;
        out.witness.push_back({contacts.point[contact], contacts.closest[contact], penetrations.depth[row]});
    }
}

void copy_tools(const Haptics& haptics, PictureSnapshot& out) {
    out.tool.clear();
    out.force = 0;
    for (size_t row = 0; row < haptics.state.size(); ++row) {
        const ToolState& state = haptics.state[row];
        const Vec3d proxy = state.proxy_valid ? state.proxy : state.device.position;
        out.tool.push_back({state.device.position, proxy, haptics.tool[row].tip_radius, state.command.force});
        out.force = std::max(out.force, state.command.force.norm());
    }
}

// Triangles that are not there lie behind those that are; numbers from tear.outer on were inside at load.
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
    for (uint32_t body = 0; in.lives && body < in.lives->away.size(); ++body)
        if (is_away(*in.lives, body)) out.body[body].mesh = kNone;
    for (uint32_t body = 0; in.node_state && body < in.node_state->off.size(); ++body)
        if (is_off(*in.node_state, body)) out.body[body].mesh = kNone;
}

}  // namespace

void write_picture_snapshot(const PictureInputs& inputs, PictureSnapshot& out, const Sleepers& sleepers) {
    out.number = inputs.number;
    out.time = inputs.time;
    copy_bodies(inputs.surfaces, inputs.normals, sleepers, out);
    copy_depths(inputs.surfaces, inputs.contacts, out);
    copy_witnesses(inputs.contacts, inputs.penetrations, out);
    copy_tools(inputs.haptics, out);
    copy_removed(inputs.surfaces, inputs.tears, out);
    hide_absent(inputs, out);
}

}  // namespace trocar
