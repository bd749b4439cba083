#include "systems/output/picture_snapshot.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "engine/tissue/embedded_surface.hpp"
#include "engine/tissue/links.hpp"
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
        out.tool.push_back({state.device.position, proxy, haptics.tool[index].tip_radius, state.output.force, haptics.tool[index].body});
        out.force = std::max(out.force, state.output.force.norm());
    }
}

void copy_points(std::span<const PicturePoints> points, PictureSnapshot& out) {
    out.point.clear();
    for (const PicturePoints& alike : points)
        for (const Vec3d& p : alike.position) out.point.push_back({p, alike.radius, alike.colour});
}

// A staple of 4 mm: its crown on the outer surface, its legs into the other.
void add_rods(const Vec3d& at, const Vec3d& outward, const Vec3d& across, PictureSnapshot& out) {
    constexpr double kHalfCrown = 2e-3, kLeg = 2.5e-3, kRadius = 0.3e-3;  // m
    constexpr std::array<float, 3> kSteel{0.42f, 0.45f, 0.50f};
    const Vec3d in_plane = across - across.dot(outward) * outward;
    const Vec3d along = in_plane.norm() > 1e-3 ? Vec3d(in_plane.normalized()) : Vec3d(outward.unitOrthogonal());
    const Vec3d crown = at + kRadius * outward, left = crown - kHalfCrown * along, right = crown + kHalfCrown * along;
    out.rod.push_back({left, right, kRadius, kSteel});
    out.rod.push_back({left, left - kLeg * outward, kRadius, kSteel});
    out.rod.push_back({right, right - kLeg * outward, kRadius, kSteel});
}

void copy_staples(const PictureInputs& in, PictureSnapshot& out) {
    out.rod.clear();
    if (!in.links || !in.solids || !in.action_state) return;
    const Surfaces& s = in.surfaces;
    const auto particle = [&](uint32_t body, uint32_t node) {
        return s.bodies.particles[body].first + embedded_count(*in.solids, s.bodies.mesh[body]) + node;
    };
    const auto place = [&](uint32_t body, uint32_t p) {
        const Float4& o = s.particles.offset[p];
        return Vec3d(s.poses.origin[body] + Vec3d(o.x, o.y, o.z));
    };
    for (const ToolStaple& staple : in.action_state->staple) {
        const uint32_t group = find_link_group(*in.links, staple.group);
        if (group == kNone || in.links->group[group].links.count == 0) continue;
        const LinkGroup& g = in.links->group[group];
        const uint32_t link = g.links.first;
        if (!in.links->whole[link]) continue;
        const uint32_t p = particle(g.body, in.links->node[link]);
        const Vec3d at = place(g.body, p);
        const Vec3d far = is_deformable(s.bodies, g.holder) ? place(g.holder, particle(g.holder, in.links->far_node[link]))
                                                            : frame_to_world(s, g.holder, in.links->point[link]);
        Vec3d outward = p < in.normals.normal.size() ? in.normals.normal[p].cast<double>() : Vec3d(Vec3d::Zero());
        if (!(outward.norm() > 0.5)) outward = (at - far).norm() > 0 ? Vec3d((at - far).normalized()) : Vec3d(Vec3d::UnitZ());
        add_rods(at, (at - far).dot(outward) < 0 ? Vec3d(-outward) : outward, staple.across, out);
    }
}

// A thread as rods between places on the Catmull-Rom curve through its points.
void copy_threads(const PictureInputs& in, PictureSnapshot& out) {
    constexpr uint32_t kParts = 3;
    if (!in.threads) return;
    for (uint32_t t = 0; t < in.threads->thread.size(); ++t) {
        const Thread& thread = in.threads->thread[t];
        const Vec3d* x = in.thread_state->position.data() + thread.rows.first;
        const uint32_t count = in.thread_state->count[t];
        const std::array<float, 3> colour{static_cast<float>(thread.colour[0]), static_cast<float>(thread.colour[1]),
                                          static_cast<float>(thread.colour[2])};
        for (uint32_t i = 0; i + 1 < count; ++i) {
            const Vec3d before = x[i > 0 ? i - 1 : i], after = x[std::min(i + 2, count - 1)];
            Vec3d from = x[i];
            for (uint32_t part = 1; part <= kParts; ++part) {
                const double u = static_cast<double>(part) / kParts;
                const Vec3d to =
                    part == kParts
                        ? x[i + 1]
                        : Vec3d(0.5 * (2 * x[i] + u * (x[i + 1] - before) + u * u * (2 * before - 5 * x[i] + 4 * x[i + 1] - after) +
                                       u * u * u * (3 * x[i] - before - 3 * x[i + 1] + after)));
                out.rod.push_back({from, to, thread.radius, colour});
                from = to;
            }
        }
        if (thread.knot && count > 0) out.point.push_back({x[0], 4 * thread.radius, colour});
        for (uint32_t i = 0; i < count; ++i) {
            const uint32_t h = in.thread_state->held[thread.rows.first + i];
            if (h == kNone || !in.thread_state->hold[h].slides || in.thread_state->hold[h].tied == kNone) continue;
            out.point.push_back({x[i], (2 + in.thread_state->hold[h].throws) * thread.radius, colour});
        }
    }
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

// A surface that was cut is drawn as its present triangles alone; it has more vertices than at load.
void copy_cut_surfaces(const PictureInputs& in, PictureSnapshot& out) {
    if (!in.actions || !in.action_state) return;
    for (PictureBody& body : out.body) body.inner = {};
    const auto copy = [&](uint32_t action, uint32_t of, uint32_t wall) {
        PictureBody& body = out.body[of];
        if (!(in.action_state->progress[action].area > 0) || body.exposed.count > 0) return;
        const MeshInfo& info = in.surfaces.meshes.info[body.mesh];
        const auto from = in.surfaces.meshes.triangle.begin() + info.triangles.first;
        body.exposed = {static_cast<uint32_t>(out.exposed.size()), info.triangles.count};
        out.exposed.insert(out.exposed.end(), from, from + info.triangles.count);
        // the new surface of a solid comes last
        const auto material = in.surfaces.meshes.triangle_material.begin() + info.triangles.first;
        const auto inner = static_cast<uint32_t>(std::count(material, material + info.triangles.count, wall));
        body.inner = {body.exposed.end() - inner, inner};
    };
    for (const auto& [action, index] : in.actions->cuts) copy(action, in.actions->cut_body[index].body, kNone);
    for (const auto& [action, index] : in.actions->solid_cuts)
        copy(action, in.actions->cut_solid[index].body, in.actions->cut_solid[index].wall);
}

// 1 - exp(-damage), the part of the proteins that denatured, at the vertices of heated bodies.
void copy_burnt(const PictureInputs& in, PictureSnapshot& out) {
    out.burnt.clear();
    if (!in.actions || !in.action_state || !in.solids) return;
    for (const HeatBody& heat : in.actions->heat_body) {
        const double* damage = in.action_state->heat.damage.data() + heat.nodes.first;
        if (*std::max_element(damage, damage + heat.nodes.count) < 0.01) continue;
        PictureBody& body = out.body[heat.body];
        const uint32_t vertices = in.surfaces.meshes.info[in.surfaces.bodies.mesh[heat.body]].vertices.count;
        const uint32_t prototype = in.surfaces.bodies.mesh[heat.body];
        const Range skin = prototype < in.solids->info.size() ? in.solids->info[prototype].skin : Range{};
        body.burnt = {static_cast<uint32_t>(out.burnt.size()), vertices};
        const auto share = [&](uint32_t node) { return 1 - std::exp(-damage[node]); };
        for (uint32_t v = 0; v < vertices; ++v) {
            double sum = 0;
            for (int c = 0; c < 4 && skin.count > 0; ++c)
                sum += in.solids->embedding_weight[skin.first + v][c] * share(in.solids->embedding_node[skin.first + v][c]);
            out.burnt.push_back(static_cast<float>(std::clamp(skin.count > 0 ? sum : share(v), 0.0, 1.0)));
        }
    }
}

// Films of wet bodies, and drops as spheres.
void copy_liquids(const PictureInputs& in, PictureSnapshot& out) {
    out.liquid.clear();
    out.puff.clear();
    if (!in.fluids || in.fluids->body.empty()) return;
    const FluidState& state = *in.fluid_state;
    out.up = -down_of(in.fluids->params.gravity);
    const Puffs& puffs = state.puffs;
    for (size_t i = 0; i < puffs.mass.size(); ++i)
        out.puff.push_back({puffs.position[i], std::sqrt(puffs.variance[i]), in.fluids->params.smoke_extinction * puffs.mass[i]});
    for (const FilmBody& film : in.fluids->body) {
        PictureBody& body = out.body[film.body];
        const auto volume = std::span(state.volume).subspan(film.cells.first, film.cells.count);
        if (body.mesh == kNone || std::all_of(volume.begin(), volume.end(), [](double v) { return v == 0; })) continue;
        FilmShape& shape = in.liquid->shape;
        find_film_shape(in.surfaces, film.body, film.cells.count, -out.up, in.liquid->scratch, shape);
        body.liquid = {static_cast<uint32_t>(out.liquid.size()), in.surfaces.meshes.info[body.mesh].vertices.count};
        for (uint32_t v = 0; v < body.liquid.count; ++v) {
            const float h = static_cast<float>(volume[v]) * shape.inverse_area[v];
            const float share = volume[v] > 0 ? static_cast<float>(state.blood[film.cells.first + v] / volume[v]) : 0.0f;
            const float level = shape.upright[v] > 0 ? levelness(h, shape.relief[v]) : 0.0f;
            out.liquid.push_back({h, liquid_rise(h, shape.upright[v], shape.relief[v]), level, share});
        }
    }
    constexpr std::array<float, 3> kBlood{0.15f, 0.006f, 0.007f}, kWater{0.55f, 0.60f, 0.62f};
    const Drops& drops = state.drops;
    for (size_t i = 0; i < drops.volume.size(); ++i) {
        const float share = drops.volume[i] > 0 ? static_cast<float>(drops.blood[i] / drops.volume[i]) : 0.0f;
        std::array<float, 3> colour;
        for (size_t k = 0; k < 3; ++k) colour[k] = kWater[k] + std::min(4 * share, 1.0f) * (kBlood[k] - kWater[k]);
        out.point.push_back({drops.position[i], std::cbrt(0.75 / std::numbers::pi * drops.volume[i]), colour});
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
    out.fog = inputs.fog;
    copy_bodies(inputs.surfaces, inputs.normals, sleeping_bodies, out);
    copy_depths(inputs.surfaces, inputs.contacts, out);
    copy_witnesses(inputs.contacts, inputs.penetrations, out);
    copy_tools(inputs.haptics, out);
    copy_removed(inputs.surfaces, inputs.tears, out);
    copy_cut_surfaces(inputs, out);
    write_picture_effects(inputs, out);
    hide_absent(inputs, out);
}

void write_picture_effects(const PictureInputs& inputs, PictureSnapshot& out) {
    copy_points(inputs.points, out);
    copy_staples(inputs, out);
    copy_threads(inputs, out);
    copy_burnt(inputs, out);
    copy_liquids(inputs, out);
}

}  // namespace trocar
