#include "systems/app/player/player_coder.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numeric>

#include "engine/draw/depth_colours.hpp"
#include "engine/tissue/embedded_surface.hpp"
#include "systems/app/player/player_code.hpp"
#include "systems/app/report/run_costs.hpp"
#include "systems/prepare/sleep.hpp"
namespace trocar {
namespace {

constexpr size_t kMostPairs = 20;
constexpr double kFarthest = 1e9;  // steps

int32_t in_steps(double value, double step, int32_t before) {
    const double steps = value / step;
    if (std::abs(steps) < kFarthest) return static_cast<int32_t>(std::lrint(steps));
    return std::isnan(steps) ? before : static_cast<int32_t>(std::copysign(kFarthest, steps));
}

// The steps from `last` to `now`, which takes its place.
void put_steps(std::vector<uint8_t>& out, std::span<const int32_t> now, int32_t* last) {
    constexpr size_t kMostBytes = 5;  // of a step
    const size_t size = out.size();
    out.resize(size + kMostBytes * now.size());
    uint8_t* at = out.data() + size;
    for (const int32_t x : now) {
        const int64_t step = int64_t{x} - *last;
        uint64_t value = static_cast<uint64_t>(step) << 1 ^ static_cast<uint64_t>(step >> 63);
        for (; value > 127; value >>= 7) *at++ = static_cast<uint8_t>(value | 128);
        *at++ = static_cast<uint8_t>(value);
        *last++ = x;
    }
    out.resize(static_cast<size_t>(at - out.data()));
}

double step_of(const MeshInfo& info, bool soft) { return std::max(info.radius, 1e-6) * PlayerCoder::kError * (soft ? 2 : 0.5); }

void put_vector(std::vector<uint8_t>& out, const Vec3d& v) {
    for (const double x : v) put_float(out, x);
}

void put_triangles(std::vector<uint8_t>& out, std::span<const Triangle> triangles) {
    put_number(out, triangles.size());
    int64_t before = 0;
    for (const Triangle& t : triangles)
        for (const uint32_t corner : t) put_signed(out, corner - before), before = corner;
}

double linear(uint8_t srgb) {
    const double x = srgb / 255.0;
    return x <= 0.04045 ? x / 12.92 : std::pow((x + 0.055) / 1.055, 2.4);
}

// Linear colour of a material at a texture coordinate.
Vec3d colour_at(const Material& material, Vec2 uv) {
    Vec3d colour(material.diffuse[0], material.diffuse[1], material.diffuse[2]);
    const Image& image = material.image;
    if (image.rgba.size() < size_t{4} * image.width * image.height || image.width == 0 || image.height == 0) return colour;
    const auto pixel = [](double share, uint32_t size) {
        const double at = (share - std::floor(share)) * size;
        return std::isfinite(at) ? std::min(size - 1, static_cast<uint32_t>(at)) : 0;
    };
    const size_t at =
        4 * (size_t{pixel(1.0 - static_cast<double>(uv.v), image.height)} * image.width + pixel(static_cast<double>(uv.u), image.width));
    for (int k = 0; k < 3; ++k) colour[k] *= linear(image.rgba[at + static_cast<size_t>(k)]);
    return colour;
}

// Three sRGB bytes per vertex: the mean of its triangles' materials and textures there.
void put_colours(std::vector<uint8_t>& out, const Meshes& meshes, uint32_t mesh, uint32_t vertices) {
    const MeshInfo& info = meshes.info[mesh];
    std::vector<Vec3d> sum(info.vertices.count, Vec3d::Zero());
    std::vector<uint32_t> count(info.vertices.count, 0);
    const Range materials = mesh < meshes.materials.size() ? meshes.materials[mesh] : Range{};
    const Material plain;
    for (uint32_t t = info.triangles.first; t < info.triangles.end(); ++t) {
        const uint32_t number = t < meshes.triangle_material.size() ? meshes.triangle_material[t] : 0;
        const Material& material = number < materials.count ? meshes.material[materials.first + number] : plain;
        for (size_t k = 0; k < 3; ++k) {
            const uint32_t vertex = meshes.triangle[t][k];
            sum[vertex] += colour_at(material, t < meshes.uv.size() ? meshes.uv[t][k] : Vec2{});
            ++count[vertex];
        }
    }
    for (size_t v = 0; v < sum.size(); ++v)
        for (const double x : sum[v]) out.push_back(srgb_byte(count[v] > 0 ? x / count[v] : 0.8));
    // vertices that cuts may add have the mean colour
    Vec3d all = Vec3d::Zero();
    double corners = 0;
    for (size_t v = 0; v < sum.size(); ++v) all += sum[v], corners += count[v];
    for (size_t v = sum.size(); v < vertices; ++v)
        for (const double x : all) out.push_back(srgb_byte(corners > 0 ? x / corners : 0.8));
}

// Vertices of a prototype, with those that cuts may add.
uint32_t most_vertices(const World& w, uint32_t mesh) {
    for (const CutBody& cut : w.actions.cut_body)
        if (w.bodies.mesh[cut.body] == mesh) return cut.vertices.count;
    for (const CutSolid& cut : w.actions.cut_solid)
        if (w.bodies.mesh[cut.body] == mesh) return cut.vertices.count;
    return w.meshes.info[mesh].vertices.count;
}

double opacity_of(const Meshes& meshes, uint32_t mesh) {
    const Range materials = mesh < meshes.materials.size() ? meshes.materials[mesh] : Range{};
    double opacity = materials.count > 0 ? 0 : 1;
    for (uint32_t m = materials.first; m < materials.end(); ++m)
        opacity = std::max(opacity, 1 - static_cast<double>(meshes.material[m].transparency));
    return opacity;
}

const char* kind_of(Motion motion) {
    switch (motion) {
        case Motion::kStatic:
            return "static";
        case Motion::kKinematic:
            return "rigid, moved by a path";
        case Motion::kHand:
            return "rigid, moved by a hand";
        case Motion::kDeformable:
            return "deformable";
        case Motion::kFree:
            return "rigid, free";
    }
    return "";
}

void put_costs(std::vector<uint8_t>& out, const Frame& frame, std::span<const uint64_t> stage_ns, PlayerLimits& limits) {
    put_number(out, stage_ns.size());
    for (const uint64_t ns : stage_ns) put_number(out, ns / 1000);
    uint64_t detection = 0;
    for (const uint32_t row : frame.detection_stages()) detection += row < stage_ns.size() ? stage_ns[row] : 0;
    std::vector<PairCost> pairs = stage_ns.empty() ? std::vector<PairCost>() : pair_costs(frame.world());
    std::stable_sort(pairs.begin(), pairs.end(), [](const PairCost& a, const PairCost& b) { return a.vertices > b.vertices; });
    pairs.resize(std::min(pairs.size(), kMostPairs));
    put_number(out, pairs.size());
    for (const PairCost& p : pairs) {
        put_number(out, p.a), put_number(out, p.b), put_number(out, p.vertices);
        put_number(out, static_cast<uint64_t>(1e-3 * p.share * static_cast<double>(detection)));
        limits.pair = std::max(limits.pair, 1e-6 * p.share * static_cast<double>(detection));
    }
}

// The deepest contacts, in their order.
std::vector<uint32_t> kept_contacts(const Contacts& c) {
    std::vector<uint32_t> rows(c.body.size());
    std::iota(rows.begin(), rows.end(), 0u);
    if (rows.size() <= PlayerCoder::kMostContacts) return rows;
    const auto last = rows.begin() + PlayerCoder::kMostContacts;
    std::nth_element(rows.begin(), last, rows.end(),
                     [&](uint32_t a, uint32_t b) { return std::pair(c.distance[a], a) < std::pair(c.distance[b], b); });
    rows.erase(last, rows.end());
    std::sort(rows.begin(), rows.end());
    return rows;
}

void put_contacts(std::vector<uint8_t>& out, const World& w, const Vec3d& origin, PlayerLimits& limits) {
    const Contacts& c = w.contacts;
    std::vector<uint32_t> constraint(c.body.size(), kNone);
    for (uint32_t i = 0; i < w.contact_constraints.contact.size(); ++i)
        if (w.contact_constraints.contact[i] < constraint.size()) constraint[w.contact_constraints.contact[i]] = i;
    const std::vector<uint32_t> rows = kept_contacts(c);
    put_number(out, c.body.size()), put_number(out, rows.size());
    for (const uint32_t i : rows) limits.depth = std::max(limits.depth, -c.distance[i]);
    // column by column, which compresses to two thirds
    const auto column = [&](const auto& value) {
        int64_t before = 0;
        for (const uint32_t i : rows) {
            const int64_t now = value(i);
            put_signed(out, now - std::exchange(before, now));
        }
    };
    column([&](uint32_t i) { return c.body[i]; });
    column([&](uint32_t i) { return c.other[i]; });
    column([&](uint32_t i) { return c.vertex[i][0]; });
    column([&](uint32_t i) { return int64_t{c.vertex[i][1]} - c.vertex[i][0]; });
    column([&](uint32_t i) { return c.third[i] == kNone ? 0 : int64_t{c.third[i]} + 1; });
    for (int k = 0; k < 3; ++k) column([&](uint32_t i) { return in_steps(c.point[i][k] - origin[k], PlayerCoder::kPointStep, 0); });
    for (int k = 0; k < 3; ++k) column([&](uint32_t i) { return in_steps(c.normal[i][k], PlayerCoder::kNormalStep, 0); });
    column([&](uint32_t i) { return in_steps(c.distance[i], PlayerCoder::kDepthStep, 0); });
    column([&](uint32_t i) { return constraint[i] != kNone; });
    const auto force_on = [&](uint32_t i) {
        return constraint[i] == kNone ? Vec3d(Vec3d::Zero())
                                      : Vec3d(w.contact_constraints.impulse[constraint[i]] / (1e-3 * w.clock.period));
    };
    column([&](uint32_t i) {
        const double push = force_on(i).dot(c.normal[i]);
        limits.push = std::max(limits.push, push);
        return in_steps(push, PlayerCoder::kForceStep, 0);
    });
    column([&](uint32_t i) {
        const Vec3d force = force_on(i);
        return in_steps((force - force.dot(c.normal[i]) * c.normal[i]).norm(), PlayerCoder::kForceStep, 0);
    });
}

void put_tools(std::vector<uint8_t>& out, const Haptics& haptics, const Vec3d& origin, PlayerLimits& limits) {
    put_number(out, haptics.state.size());
    for (const ToolState& s : haptics.state) {
        put_vector(out, s.device.position - origin);
        put_vector(out, (s.proxy_valid ? s.proxy : s.device.position) - origin);
        put_vector(out, s.output.force);
        limits.hand = std::max(limits.hand, s.output.force.norm());
    }
}

// World position of a node that links hold: nodes follow the vertices of an embedded surface.
Vec3d node_position(const World& w, uint32_t body, uint32_t node) {
    const Float4& o = w.particles.offset[w.bodies.particles[body].first + embedded_count(w.solids, w.bodies.mesh[body]) + node];
    return w.poses.origin[body] + Vec3d(o.x, o.y, o.z);
}

void put_links(std::vector<uint8_t>& out, const World& w, const Vec3d& origin) {
    std::vector<std::array<Vec3d, 2>> ends;
    for (const LinkGroup& g : w.links.group) {
        if (g.body == kNone) continue;
        for (uint32_t i = g.links.first; i < g.links.end() && ends.size() < PlayerCoder::kMostLinks; ++i) {
            if (!w.links.whole[i]) continue;
            const Vec3d far = w.links.far_node[i] != kNone ? node_position(w, g.holder, w.links.far_node[i])
                              : g.holder == kNone          ? w.links.point[i]
                                                           : frame_to_world(surfaces_of(w), g.holder, w.links.point[i]);
            ends.push_back({node_position(w, g.body, w.links.node[i]), far});
        }
    }
    put_number(out, ends.size());
    for (const auto& pair : ends)
        for (const Vec3d& end : pair) put_vector(out, end - origin);
}

void put_surface(std::vector<uint8_t>& out, const World& w, uint32_t body) {
    const Range triangles = w.meshes.info[w.bodies.mesh[body]].triangles;
    put_number(out, body + 1);
    put_triangles(out, std::span(w.meshes.triangle).subspan(triangles.first, triangles.count));
}

void put_cells(std::vector<uint8_t>& out, const Occupancy& cells, const Vec3d& origin) {
    const size_t kept = std::min(cells.cell_key.size(), PlayerCoder::kMostCells);
    put_number(out, cells.cell_key.size()), put_number(out, kept);
    put_float(out, cells.cell_size), put_vector(out, cells.origin - origin);
    for (size_t i = 0; i < kept; ++i)
        for (int k = 0; k < 3; ++k) put_number(out, cells.cell_key[i] >> (42 - 21 * k) & 0x1fffff);
}

// What the stages of a pass left for each other: how many of what, boxes of bodies, candidate pairs, islands.
void put_inspection(std::vector<uint8_t>& out, const World& w, const Vec3d& origin) {
    constexpr size_t kMostRows = PlayerCoder::kMostInspected;
    const auto rows = [&](size_t count) {
        put_number(out, count), put_number(out, std::min(count, kMostRows));
        return std::min(count, kMostRows);
    };
    const ContactConstraints& c = w.contact_constraints;
    const auto pushes = [](const Vec3d& impulse) { return impulse != Vec3d::Zero(); };
    const size_t loaded = static_cast<size_t>(std::ranges::count_if(c.impulse, pushes));
    for (const size_t count : {w.box_pairs.a.size(), w.candidates.triangle.size(), w.near.vertex.size(), c.contact.size(), loaded})
        put_number(out, count);
    const size_t boxes = rows(w.boxes.box.size());
    for (size_t b = 0; b < boxes; ++b) put_vector(out, w.boxes.box[b].min - origin), put_vector(out, w.boxes.box[b].max - origin);
    struct Found {
        uint64_t contacts = 0, constraints = 0;
        double depth = 0, force = 0;  // m, N
    };
    const size_t pairs = rows(w.pairs.a.size());
    std::vector<Found> found(w.pairs.a.size());
    for (const uint32_t pair : w.contacts.pair) ++found[pair].contacts;
    for (size_t i = 0; i < w.penetrations.pair.size(); ++i) found[w.penetrations.pair[i]].depth = std::max(0.0, w.penetrations.depth[i]);
    for (size_t i = 0; i < c.contact.size(); ++i) {
        if (c.contact[i] >= w.contacts.pair.size()) continue;  // of a surface with itself
        Found& f = found[w.contacts.pair[c.contact[i]]];
        ++f.constraints, f.force += c.impulse[i].norm() / (1e-3 * w.clock.period);
    }
    for (size_t p = 0; p < pairs; ++p) {
        put_number(out, w.pairs.a[p]), put_number(out, w.pairs.b[p]);
        put_number(out, p < w.candidates.pair.size() ? w.candidates.pair[p].count : 0);
        put_number(out, 2 * p + 1 < w.near.side.size() ? uint64_t{w.near.side[2 * p].count} + w.near.side[2 * p + 1].count : 0);
        put_number(out, found[p].contacts), put_number(out, found[p].constraints);
        put_float(out, found[p].depth), put_float(out, found[p].force);
    }
    const size_t islands = rows(w.islands.bodies.size());
    for (size_t i = 0; i < islands; ++i) put_number(out, w.islands.bodies[i].count), put_number(out, w.islands.constraints[i].count);
}

}  // namespace

PlayerCoder::PlayerCoder(const Frame& frame, bool with_cells)
    : with_cells_(with_cells),
      has_links_(frame.world().links.group.capacity() > 0),
      has_effects_(PlayerEffects::are_in(frame.world())),
      stages_(frame.stage_names()),
      tools_(frame.world().haptics.tool),
      order_(frame.world().tears.order),
      cut_(frame.world().action_state.cut.count),
      lattice_(frame.world().action_state.lattice.count) {
    const World& w = frame.world();
    origin_ = w.poses.origin.empty() ? Vec3d(Vec3d::Zero()) : w.poses.origin.front();
    for (uint32_t b = 0; b < w.bodies.mesh.size(); ++b) {
        const MeshInfo& info = w.meshes.info[w.bodies.mesh[b]];
        const bool soft = is_deformable(w.bodies, b);
        coordinates_.push_back(soft ? 3 * most_vertices(w, w.bodies.mesh[b]) : 7);
        bodies_.push_back(
            {w.bodies.name[b], w.bodies.mesh[b], w.bodies.motion[b], info.admission == Admission::kSheet, step_of(info, soft)});
    }
    last_.assign(std::accumulate(coordinates_.begin(), coordinates_.end(), size_t{0}), 0);
    add_meshes(w);
}

void PlayerCoder::add_meshes(const World& w) {
    std::vector<uint8_t> has_rigid(w.meshes.info.size(), 0);
    for (uint32_t b = 0; b < w.bodies.mesh.size(); ++b) has_rigid[w.bodies.mesh[b]] |= !is_deformable(w.bodies, b);
    mesh_count_ = w.meshes.info.size();
    for (uint32_t m = 0; m < mesh_count_; ++m) {
        const MeshInfo& info = w.meshes.info[m];
        put_number(meshes_, most_vertices(w, m)), put_number(meshes_, has_rigid[m]);
        const double step = step_of(info, false);
        put_double(meshes_, step), put_float(meshes_, opacity_of(w.meshes, m));
        std::array<int32_t, 3> before{};
        for (uint32_t v = info.vertices.first; has_rigid[m] && v < info.vertices.end(); ++v) {
            for (size_t k = 0; k < 3; ++k) {
                const int32_t at = in_steps(w.meshes.position[v][static_cast<int>(k)], step, 0);
                put_signed(meshes_, int64_t{at} - std::exchange(before[k], at));
            }
        }
        put_triangles(meshes_, std::span(w.meshes.triangle).subspan(info.triangles.first, info.triangles.count));
        put_colours(meshes_, w.meshes, m, most_vertices(w, m));
    }
}

PlayerFrame PlayerCoder::next(const Frame& frame, std::span<const uint64_t> stage_ns) {
    const World& w = frame.world();
    PlayerFrame out{static_cast<double>(w.clock.tick) * 1e-3,
                    std::accumulate(stage_ns.begin(), stage_ns.end(), uint64_t{0}) / 1000,
                    w.clock.pass,
                    {},
                    {},
                    {}};
    add_moves(w, out);
    add_surfaces(w, out);
    put_costs(out.findings, frame, stage_ns, limits_);
    put_contacts(out.findings, w, origin_, limits_);
    put_tools(out.findings, w.haptics, origin_, limits_);
    put_links(out.findings, w, origin_);
    if (has_effects_) effects_.put(out.findings, w, origin_, kPointStep);
    if (with_cells_) put_cells(out.findings, w.occupancy, origin_), put_inspection(out.findings, w, origin_);
    newest_ = {out.time, out.cost_us, out.pass, {}, {}, out.findings};
    return out;
}

PlayerFrame PlayerCoder::whole(const World& w) const {
    PlayerFrame out = newest_;
    std::vector<int32_t> zero;
    const int32_t* now = last_.data();
    for (uint32_t b = 0; b < coordinates_.size(); now += coordinates_[b++]) {
        zero.assign(coordinates_[b], 0);
        put_number(out.moves, b < state_.size() ? state_[b] << 1 | 1u : 1u);
        put_steps(out.moves, std::span(now, coordinates_[b]), zero.data());
    }
    for (const TearBody& tear : w.tears.body) put_surface(out.surfaces, w, tear.body);
    for (const CutBody& cut : w.actions.cut_body) put_surface(out.surfaces, w, cut.body);
    for (const CutSolid& cut : w.actions.cut_solid) put_surface(out.surfaces, w, cut.body);
    return out;
}

void PlayerCoder::add_moves(const World& w, PlayerFrame& out) {
    std::vector<uint32_t>& state = state_;
    state.assign(w.bodies.mesh.size(), static_cast<uint32_t>(PlayerState::kAwake));
    for (uint32_t i = 0; i < w.islands.bodies.size(); ++i)
        for (uint32_t k = w.islands.bodies[i].first; k < w.islands.bodies[i].end(); ++k)
            state[w.islands.body[k]] = static_cast<uint32_t>(PlayerState::kInIsland) + i;
    std::vector<int32_t> now;
    int32_t* last = last_.data();
    for (uint32_t b = 0; b < coordinates_.size(); last += coordinates_[b++]) {
        if (is_away(w.spawning, b) || is_off(w.node_state, b))
            state[b] = static_cast<uint32_t>(PlayerState::kAway);
        else if (is_asleep(w.sleep, b))
            state[b] = static_cast<uint32_t>(PlayerState::kAsleep);
        now.resize(coordinates_[b]);
        const double step = bodies_[b].step;
        const Vec3d place = w.poses.origin[b] - origin_;
        if (bodies_[b].motion == Motion::kDeformable) {
            const Float4* o = w.particles.offset.data() + w.bodies.particles[b].first;
            for (size_t i = 0; i < now.size(); i += 3, ++o) {
                now[i] = in_steps(place.x() + static_cast<double>(o->x), step, last[i]);
                now[i + 1] = in_steps(place.y() + static_cast<double>(o->y), step, last[i + 1]);
                now[i + 2] = in_steps(place.z() + static_cast<double>(o->z), step, last[i + 2]);
            }
        } else {
            const Quat& q = w.poses.orientation[b];
            const double turn[] = {q.w, q.x, q.y, q.z};
            for (int k = 0; k < 3; ++k) now[static_cast<size_t>(k)] = in_steps(place[k], step, last[k]);
            for (size_t k = 0; k < 4; ++k) now[3 + k] = in_steps(turn[k], kTurnStep, last[3 + k]);
        }
        const bool moves = !std::equal(now.begin(), now.end(), last);
        put_number(out.moves, state[b] << 1 | moves);
        if (moves) put_steps(out.moves, now, last);
    }
}

void PlayerCoder::add_surfaces(const World& w, PlayerFrame& out) {
    for (const TearBody& tear : w.tears.body) {
        const auto same = [&](uint32_t t) { return order_[t] == w.tears.order[t]; };
        bool torn = false;
        for (uint32_t t = tear.order.first; t < tear.order.end(); ++t) torn = torn || !same(t);
        if (!torn) continue;
        put_surface(out.surfaces, w, tear.body);
    }
    order_ = w.tears.order;
    for (size_t i = 0; i < cut_.size(); ++i)
        if (cut_[i] != w.action_state.cut.count[i]) put_surface(out.surfaces, w, w.actions.cut_body[i].body);
    cut_ = w.action_state.cut.count;
    for (size_t i = 0; i < lattice_.size(); ++i)
        if (lattice_[i] != w.action_state.lattice.count[i]) put_surface(out.surfaces, w, w.actions.cut_solid[i].body);
    lattice_ = w.action_state.lattice.count;
}

double PlayerCoder::worst_error() const {
    double worst = 0;
    for (const Body& body : bodies_)
        if (body.motion != Motion::kStatic) worst = std::max(worst, body.step * (body.motion == Motion::kDeformable ? 0.5 : 2));
    return worst;
}

std::vector<uint8_t> PlayerCoder::start(const std::string& scene, const Camera& camera, size_t frames) const {
    const auto list = [](const Vec3d& v) { return nlohmann::json{v.x(), v.y(), v.z()}; };
    nlohmann::json header{{"scene", scene}, {"frames", frames}, {"meshes", mesh_count_}};
    header["point_step"] = kPointStep, header["depth_step"] = kDepthStep, header["force_step"] = kForceStep;
    header["turn_step"] = kTurnStep, header["normal_step"] = kNormalStep, header["origin"] = list(origin_), header["cells"] = with_cells_,
    header["links"] = has_links_, header["stages"] = stages_;
    if (has_effects_)
        header["effects"] = {{"film_step", PlayerEffects::kFilmStep}, {"rise_step", PlayerEffects::kRiseStep}, {"up", list(effects_.up())}};
    header["limits"] = {{"depth", limits_.depth}, {"push", limits_.push}, {"hand", limits_.hand}, {"pair", limits_.pair}};
    header["camera"] = {{"orbit", camera.kind == CameraKind::kOrbit},
                        {"target", list(camera.target - origin_)},
                        {"up", list(camera.up)},
                        {"azimuth", camera.azimuth},
                        {"elevation", camera.elevation},
                        {"distance", camera.distance},
                        {"position", list(camera.position - origin_)},
                        {"field_of_view", camera.field_of_view}};
    if (camera.kind == CameraKind::kLaparoscope && camera.body != kNone)
        header["camera"]["held"] = {
            {"body", camera.body},   {"position", list(camera.position)}, {"shaft", list(camera.shaft)}, {"mark", list(camera.mark)},
            {"optic", camera.optic}, {"optic_roll", camera.optic_roll},   {"roll", camera.roll},         {"level", camera.level},
            {"light", camera.light}};
    for (int i = 0; i < 32; ++i) {
        const auto c = depth_colour(i / 31.0);
        header["depth_colours"].push_back({c[0], c[1], c[2]});
    }
    header["bodies"] = nlohmann::json::array(), header["tools"] = nlohmann::json::array();
    for (const Body& body : bodies_) {
        const bool soft = body.motion == Motion::kDeformable;
        header["bodies"].push_back({{"name", body.name},
                                    {"mesh", body.mesh},
                                    {"soft", soft},
                                    {"still", body.motion == Motion::kStatic},
                                    {"fitted", soft || body.motion == Motion::kFree},
                                    {"kind", std::string(kind_of(body.motion)) + (body.sheet ? ", sheet" : "")},
                                    {"step", body.step}});
    }
    for (const HandTool& tool : tools_) header["tools"].push_back({{"body", tool.body}, {"radius", tool.tip_radius}});
    const std::string text = header.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);  // names may be anything
    std::vector<uint8_t> out;
    put_number(out, text.size());
    out.insert(out.end(), text.begin(), text.end());
    out.insert(out.end(), meshes_.begin(), meshes_.end());
    return out;
}

void put_frames(std::vector<uint8_t>& out, std::span<const PlayerFrame> frames) {
    for (const PlayerFrame& f : frames) {
        put_double(out, f.time), put_number(out, f.pass), put_number(out, f.cost_us);
        out.insert(out.end(), f.moves.begin(), f.moves.end());
        out.insert(out.end(), f.surfaces.begin(), f.surfaces.end());
        put_number(out, 0);  // no further torn body
    }
    for (const PlayerFrame& f : frames) {
        put_number(out, f.findings.size());
        out.insert(out.end(), f.findings.begin(), f.findings.end());
    }
}

}  // namespace trocar
