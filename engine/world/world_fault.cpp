#include <algorithm>
#include <cmath>
#include <span>

#include "engine/base/check.hpp"
#include "engine/mesh/mass_properties.hpp"
#include "engine/mesh/mesh_view.hpp"
#include "engine/mesh/surfaces.hpp"
#include "engine/tissue/bending_forces.hpp"
#include "engine/tissue/embedded_surface.hpp"
#include "engine/tissue/pressure_force.hpp"
#include "engine/tissue/tet_forces.hpp"
#include "engine/world/world.hpp"
namespace trocar {
namespace {

constexpr double kShortestStep = 1e-8;  // s; a pass of 17 ms would take millions of substeps

// [first, first + count) is within `size` elements.
bool holds(size_t size, const Range& range) { return range.first <= size && range.count <= size - range.first; }

// Keeps the first fault.
struct Faults {
    std::string first;
    void require(bool holds, const std::string& complaint) {
        if (!holds && first.empty()) first = complaint;
    }
    bool inside(const Range& range, size_t size, const std::string& what) {
        require(holds(size, range), what + " reach beyond their array");
        return holds(size, range);
    }
    template <typename T>
    void below(const T& index, uint32_t count, bool or_none, const std::string& what) {
        require(index < count || (or_none && index == kNone), what + " " + std::to_string(index) + " of " + std::to_string(count));
    }
};

// Whether every array of a group except the named ones has this many elements.
template <typename T>
bool all_have(const T& group, size_t rows, std::initializer_list<std::string_view> but = {}) {
    bool fit = true;
    each_field(group, [&](const FieldName& field, const auto& array) {
        fit = fit && (array.size() == rows || std::find(but.begin(), but.end(), field.name) != but.end());
    });
    return fit;
}

// Last value of the enums in files; an enum without one does not compile.
constexpr Admission last_of(Admission) { return Admission::kRefused; }
constexpr AnchorFrame last_of(AnchorFrame) { return AnchorFrame::kShape; }
constexpr DeepResponse last_of(DeepResponse) { return DeepResponse::kLastFree; }
constexpr EffectKind last_of(EffectKind) { return EffectKind::kMagnet; }
constexpr EffectTrigger last_of(EffectTrigger) { return EffectTrigger::kRelease; }
constexpr HapticEventKind last_of(HapticEventKind) { return HapticEventKind::kLimit; }
constexpr Integrator last_of(Integrator) { return Integrator::kMidpoint; }
constexpr LinkPhase last_of(LinkPhase) { return LinkPhase::kDone; }
constexpr Motion last_of(Motion) { return Motion::kFree; }
constexpr NodeBehaviour last_of(NodeBehaviour) { return NodeBehaviour::kDial; }
constexpr NodeEventKind last_of(NodeEventKind) { return NodeEventKind::kDetent; }
constexpr PivotKind last_of(PivotKind) { return PivotKind::kTip; }
constexpr RegionFrame last_of(RegionFrame) { return RegionFrame::kWorld; }
constexpr RegionKind last_of(RegionKind) { return RegionKind::kCapsule; }
constexpr ResponseDirection last_of(ResponseDirection) { return ResponseDirection::kThesis; }
constexpr ResponseShare last_of(ResponseShare) { return ResponseShare::kHalf; }
constexpr TreeSearch last_of(TreeSearch) { return TreeSearch::kEmbree; }
constexpr TextureKind last_of(TextureKind) { return TextureKind::kNoise; }

// Name of a field within its structs: "haptics.tool.body".
struct FieldOf {
    const FieldOf* holder;
    std::string_view name;
    std::string text() const { return (holder ? holder->text() + "." : "") + std::string(name); }
};

// The arrays that index fields refer to.
struct CountedIn {
    bool none = true;  // none: the field is not an index
    size_t rows = 0;
    bool or_none = false;
};

// Checks every field of a group by its type and its entry in the field list: enums have one of their values,
// indices are within their arrays, and numbers are not NaN.
struct FieldCheck {
    Faults& faults;
    std::span<const std::pair<std::string_view, size_t>> counts;
    std::string not_a_number = "";  // the first fault of that kind

    CountedIn counted_in(std::string_view kind) const {
        const size_t of = kind.find(" of ");
        if (of == kind.npos || !kind.starts_with("row")) return {};
        const bool or_none = kind.ends_with(" or none");
        const std::string_view what = kind.substr(of + 4, kind.size() - of - 4 - (or_none ? 8 : 0));
        const auto found = std::find_if(counts.begin(), counts.end(), [&](const auto& c) { return c.first == what; });
        TROCAR_ASSERT(found != counts.end());
        return {false, found->second, or_none};
    }
    template <typename T>
    void item(const FieldOf& field, const T& value, const CountedIn& in) {
        if constexpr (std::is_enum_v<T>) {
            if (value > last_of(T{})) faults.require(false, field.text() + " is of no kind");
        } else if constexpr (std::is_floating_point_v<T>) {
            if (std::isnan(value) && not_a_number.empty()) not_a_number = field.text() + " is not a number";
        } else if constexpr (std::is_same_v<T, Range>) {
            if (!in.none && !holds(in.rows, value)) faults.require(false, field.text() + " reach beyond their array");
        } else if constexpr (std::is_same_v<T, uint32_t> || std::is_same_v<T, uint64_t>) {
            if (!in.none && value >= in.rows && !(in.or_none && value == kNone))
                faults.require(false, field.text() + " " + std::to_string(value) + " of " + std::to_string(in.rows));
        } else if constexpr (requires { T::kFields; }) {
            group(field, value);
        } else if constexpr (!std::is_same_v<T, std::string> && requires { value.begin(); }) {
            for (const auto& element : value) item(field, element, in);
        }
    }
    template <typename T>
    void group(const FieldOf& of, const T& group) {
        if constexpr (requires { T::kColumns; }) {
            size_t rows = kNone;
            each_field(group, [&](const FieldName&, const auto& array) {
                faults.require(rows == kNone || array.size() == rows, of.text() + ": arrays of different length");
                rows = array.size();
            });
        }
        each_field(group, [&](const FieldName& name, const auto& member) { item({&of, name.name}, member, counted_in(name.unit)); });
    }
};

// All fields from outside. Vertices and particles may have non-finite positions: admission and passes handle
// them.
template <typename World>
void check_fields(const World& w, Faults& f, std::string& not_a_number) {
    const std::pair<std::string_view, size_t> counts[] = {{"bodies", w.bodies.mesh.size()},
                                                          {"meshes", w.meshes.info.size()},
                                                          {"particles", w.particles.offset.size()},
                                                          {"paths", w.paths.body.size()},
                                                          {"keys", w.paths.key.size()},
                                                          {"tools", w.haptics.tool.size()},
                                                          {"traces", w.haptics.trace.size()},
                                                          {"effects", w.haptics.effect.size()},
                                                          {"jaws", w.haptics.jaw.size()},
                                                          {"links", w.links.node.size()},
                                                          {"nodes", w.nodes.name.size()},
                                                          {"drives", w.nodes.drive.size()},
                                                          {"tears", w.tears.body.size()},
                                                          {"tear triangles", w.tears.order.size()},
                                                          {"tear faces", w.tears.face.size()}};
    FieldCheck check{f, counts};
#define TROCAR_CHECK_RESOURCE(bit, member, name, kind)                                                                \
    if constexpr (ResourceKind::kind == ResourceKind::kConstant || ResourceKind::kind == ResourceKind::kState) {      \
        const std::string before = check.not_a_number;                                                                \
        check.group({nullptr, #member}, w.member);                                                                    \
        if (Resource::bit == Resource::kMeshes || Resource::bit == Resource::kParticles) check.not_a_number = before; \
    }
    TROCAR_RESOURCES(TROCAR_CHECK_RESOURCE)
#undef TROCAR_CHECK_RESOURCE
    not_a_number = check.not_a_number;
}

void check_mesh(const Meshes& m, uint32_t prototype, Faults& f) {
    const MeshInfo& info = m.info[prototype];
    const std::string name = "mesh " + std::to_string(prototype) + ": ";
    const bool whole =
        f.inside(info.vertices, m.position.size(), name + "vertices") && f.inside(info.vertices, m.component.size(), name + "components") &&
        f.inside(info.triangles, m.triangle.size(), name + "triangles") &&
        f.inside(info.triangles, m.neighbour.size(), name + "neighbours") &&
        f.inside(info.triangles, m.triangle_edge.size(), name + "edges of triangles") &&
        f.inside(info.triangles, m.uv.size(), name + "texture coordinates") &&
        f.inside(info.triangles, m.triangle_material.size(), name + "materials of triangles") &&
        f.inside(info.edges, m.edge.size(), name + "edges") && f.inside(info.edges, m.edge_triangle.size(), name + "triangles of edges") &&
        f.inside(info.incident, m.incident.size(), name + "incident triangles") &&
        f.inside({info.vertices.first + prototype, info.vertices.count + 1}, m.incident_first.size(), name + "vertex rows") &&
        f.inside(m.materials[prototype], m.material.size(), name + "materials");
    if (!whole) return;
    f.require(std::isfinite(info.mean_edge) && std::isfinite(info.radius), name + "no such surface");
    const uint32_t materials = std::max(1u, m.materials[prototype].count);
    for (uint32_t t = info.triangles.first; t < info.triangles.end(); ++t) {
        for (int k = 0; k < 3; ++k) {
            f.below(m.triangle[t][k], info.vertices.count, false, name + "vertex");
            f.below(m.neighbour[t][k], info.triangles.count, true, name + "neighbour");
            f.below(m.triangle_edge[t][k], info.edges.count, false, name + "edge");
        }
        f.below(m.triangle_material[t], materials, false, name + "material");
    }
    for (uint32_t e = info.edges.first; e < info.edges.end(); ++e) {
        for (int k = 0; k < 2; ++k) {
            f.below(m.edge[e][k], info.vertices.count, false, name + "vertex of an edge");
            f.below(m.edge_triangle[e][k], info.triangles.count, true, name + "triangle of an edge");
        }
    }
    for (uint32_t v = 0; v < info.vertices.count; ++v) {
        const uint32_t* row = m.incident_first.data() + info.vertices.first + prototype + v;
        f.require(row[0] <= row[1] && row[1] <= info.incident.count, name + "incident triangles of a vertex");
        f.below(m.component[info.vertices.first + v], info.components, false, name + "component");
    }
    for (uint32_t i = info.incident.first; i < info.incident.end(); ++i)
        f.below(m.incident[i], info.triangles.count, false, name + "incident triangle");
}

void check_meshes(const Meshes& m, Faults& f) {
    f.require(m.materials.size() == m.info.size() && m.name.size() == m.info.size(), "meshes: names and materials do not fit");
    if (!f.first.empty()) return;
    for (uint32_t p = 0; p < m.info.size() && f.first.empty(); ++p) check_mesh(m, p, f);
    for (const Material& material : m.material)
        f.require(material.image.rgba.size() == size_t{4} * material.image.width * material.image.height,
                  "a texture is not as large as it says");
}

// Packed columns match the others.
void check_packed(const Springs& s, uint32_t prototype, Faults& f) {
    const SpringInfo& info = s.info[prototype];
    if (info.packed == kNone || !f.first.empty()) return;
    const uint32_t* column = s.slice_column.data() + info.slices.first + prototype;
    const std::string name = "packed springs of mesh " + std::to_string(prototype);
    if (!f.inside({info.packed, column[info.slices.count] - column[0]}, s.packed.size(), name)) return;
    for (uint32_t slice = 0; slice < info.slices.count; ++slice) {
        for (uint32_t c = column[slice]; c < column[slice + 1]; ++c) {
            const auto& packed = s.packed[info.packed + c - column[0]];
            for (uint32_t lane = 0; lane < kSliceWidth; ++lane) {
                const size_t h = size_t{c} * kSliceWidth + lane;
                f.require(packed[lane] + kSliceWidth * slice - 32768u == s.neighbour[h] &&
                              static_cast<float>(packed[kSliceWidth + lane]) * info.rest_unit == s.rest_length[h],
                          name + " differ");
            }
        }
    }
}

void check_springs(const World& w, uint32_t prototype, Faults& f) {
    const Springs& s = w.springs;
    const std::string name = "springs of mesh " + std::to_string(prototype);
    f.require(prototype < s.info.size() && prototype < s.vertices.size(), name + " are missing");
    if (!f.first.empty()) return;
    const Range slices = s.info[prototype].slices;
    const uint64_t padded = uint64_t{slices.count} * kSliceWidth, skin = s.info[prototype].skin;
    f.require(skin % kSliceWidth == 0 && s.vertices[prototype].count == padded + skin, name + " do not fit its vertices");
    f.require(skin == (prototype < w.solids.info.size() ? embedded_count(w.solids.info[prototype]) : 0), name + " do not fit its skin");
    const bool whole = f.inside(s.vertices[prototype], s.area_share.size(), name) &&
                       f.inside({slices.first + prototype, slices.count + 1}, s.slice_column.size(), name);
    if (!whole || s.neighbour.size() != s.rest_length.size()) return f.require(false, name + " do not fit together");
    const uint32_t* column = s.slice_column.data() + slices.first + prototype;
    for (uint32_t slice = 0; slice < slices.count; ++slice) {
        f.require(column[slice] <= column[slice + 1] && uint64_t{column[slice + 1]} * kSliceWidth <= s.neighbour.size(),
                  name + ": columns");
        if (!f.first.empty()) return;
        for (uint64_t h = uint64_t{column[slice]} * kSliceWidth; h < uint64_t{column[slice + 1]} * kSliceWidth; ++h)
            f.require(s.neighbour[h] < padded, name + ": far end");
        if (s.info[prototype].varied)
            f.require(uint64_t{column[slice + 1]} * kSliceWidth <= s.factor.size(), name + ": stiffnesses are missing");
    }
    check_packed(s, prototype, f);
}

void check_solid(const World& w, uint32_t prototype, uint32_t particles, Faults& f) {
    const Solids& s = w.solids;
    if (!has_own_nodes(s, prototype)) return;
    const SolidInfo& info = s.info[prototype];
    const std::string name = "solid of mesh " + std::to_string(prototype) + ": ";
    const bool shell = info.count == 0;  // with an embedded surface
    bool whole = f.inside(info.inner, s.position.size(), name + "inner nodes") &&
                 f.inside(info.nodes, s.node_volume.size(), name + "volumes of nodes") &&
                 f.inside(info.tetrahedra, s.rest.size(), name + "tetrahedra") &&
                 f.inside(info.tetrahedra, s.per_rest.size(), name + "tetrahedra") &&
                 f.inside({info.slices.first + prototype, info.slices.count + 1}, s.slot_column.size(), name + "slices");
    for (const auto& corner : s.corner) whole = whole && f.inside(info.tetrahedra, corner.size(), name + "corners");
    if (info.varied) whole = whole && f.inside(info.tetrahedra, s.factor.size(), name + "stiffnesses");
    const uint32_t tets = info.tetrahedra.count;
    f.require(info.count <= tets && tets % kSliceWidth == 0 &&
                  (shell || uint64_t{info.slices.count} * kSliceWidth + embedded_count(info) == particles) && tets < kNone / 4 &&
                  info.nodes.count + embedded_count(info) <= particles &&
                  uint64_t{surface_nodes(w.meshes, info, prototype)} + info.inner.count == info.nodes.count,
              name + "nodes and tetrahedra do not fit");
    if (!whole || !f.first.empty() || !f.inside(info.skin, s.embedding_node.size(), name + "skin") ||
        !f.inside(info.skin, s.embedding_weight.size(), name + "skin"))
        return;
    f.require(info.skin.count == 0 || info.skin.count == w.meshes.info[prototype].vertices.count, name + "skin does not fit the surface");
    for (uint32_t row = info.skin.first; row < info.skin.end(); ++row) {
        for (const uint32_t node : s.embedding_node[row]) f.below(node, info.nodes.count, false, name + "node of the skin");
        for (const double weight : s.embedding_weight[row]) f.require(std::isfinite(weight), name + "weight of the skin");
    }
    for (const auto& corner : s.corner)
        for (uint32_t t = 0; t < tets; ++t) f.below(corner[info.tetrahedra.first + t], info.nodes.count, false, name + "corner");
    const uint32_t* column = s.slot_column.data() + info.slices.first + prototype;
    for (uint32_t slice = 0; slice < info.slices.count; ++slice) {
        f.require(column[slice] <= column[slice + 1] && uint64_t{column[slice + 1]} * kSliceWidth <= s.slot.size(), name + "columns");
        if (!f.first.empty()) return;
        for (uint64_t h = uint64_t{column[slice]} * kSliceWidth; h < uint64_t{column[slice + 1]} * kSliceWidth; ++h)
            f.below(s.slot[h], 4 * tets + 1, false, name + "slot");
    }
}

// Columns of slices that start at element `first` of a prototype's table of neighbours, `width` entries per
// column, all below `limit`.
void check_columns(std::span<const uint32_t> column, std::span<const uint32_t> entry, uint32_t first, uint32_t slices, uint64_t width,
                   uint64_t limit, const std::string& name, Faults& f) {
    if (!f.inside({first, slices + 1}, column.size(), name)) return;
    for (uint32_t slice = first; slice < first + slices; ++slice) {
        f.require(column[slice] <= column[slice + 1] && column[slice + 1] * width <= entry.size(), name + ": columns");
        if (!f.first.empty()) return;
        for (uint64_t i = column[slice] * width; i < column[slice + 1] * width; ++i) f.require(entry[i] < limit, name + ": entry");
    }
}

void check_fans(const World& w, uint32_t prototype, Faults& f) {
    const Fans& fans = w.springs.fans;
    const std::string name = "fans of mesh " + std::to_string(prototype);
    f.require(prototype < fans.first.size() && fans.volume.size() == fans.first.size() && fans.volume[prototype] != 0,
              name + " are missing");
    if (!f.first.empty()) return;
    const uint32_t slices = w.springs.info[prototype].slices.count;
    check_columns(fans.column, fans.corner, fans.first[prototype], slices, 2 * kSliceWidth, uint64_t{slices} * kSliceWidth, name, f);
}

void check_hinges(const World& w, uint32_t prototype, Faults& f) {
    const Hinges& h = w.springs.hinges;
    const std::string name = "hinges of mesh " + std::to_string(prototype);
    f.require(prototype < h.first.size() && h.groups.size() == h.first.size(), name + " are missing");
    if (!f.first.empty()) return;
    const Range groups = h.groups[prototype];
    const size_t all = h.weight.size() / 8;
    f.require(h.weight.size() == 8 * all && h.sine.size() == 8 * all && h.cosine.size() == 8 * all && h.cap.size() == 16 * all &&
                  h.vertex.size() == 32 * all,
              name + " do not fit together");
    if (!f.first.empty() || !f.inside(groups, all, name)) return;
    const uint32_t slices = w.springs.info[prototype].slices.count;
    for (size_t i = size_t{32} * groups.first; i < size_t{32} * groups.end(); ++i)
        f.below(h.vertex[i], slices * kSliceWidth, false, name + ": vertex");
    check_columns(h.column, h.slot, h.first[prototype], slices, kSliceWidth, uint64_t{32} * groups.count + 1, name, f);
}

void check_body(const World& w, uint32_t body, Faults& f) {
    const Bodies& b = w.bodies;
    const std::string name = "body " + std::to_string(body);
    f.require(b.stable_dt[body] > kShortestStep && b.thickness[body] >= 0 && b.inv_mass[body] >= 0,
              name + " has no step, mass or thickness");
    if (!f.first.empty() || !is_deformable(b, body)) return;
    check_springs(w, b.mesh[body], f);
    if (f.first.empty() && has_pressure(b, body)) check_fans(w, b.mesh[body], f);
    if (f.first.empty() && has_bending(b, body)) check_hinges(w, b.mesh[body], f);
    if (!f.first.empty()) return;
    const Stepping stepping = stepping_of(b, body);
    f.require(stepping.step > kShortestStep && stepping.iterations <= 10000, name + " is stepped in no known way");
    f.require(b.particles[body].count == w.springs.vertices[b.mesh[body]].count && b.particles[body].first % kSliceWidth == 0 &&
                  b.particles[body].count >= w.meshes.info[b.mesh[body]].vertices.count,
              name + ": particles do not fit its mesh");
    if (f.first.empty()) check_solid(w, b.mesh[body], b.particles[body].count, f);
}

bool body_rows_fit(const World& w) {
    const size_t n = w.bodies.mesh.size();
    return all_have(w.bodies, n, {"rigid_mass", "stepping"}) && all_have(w.poses, n);
}

void check_pose(const Poses& poses, uint32_t body, Faults& f) {
    const Quat& q = poses.orientation[body];
    const double square = q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z;
    f.require(poses.origin[body].allFinite() && poses.velocity[body].allFinite() && poses.angular_velocity[body].allFinite(),
              "body " + std::to_string(body) + ": place or velocity is not finite");
    f.require(std::abs(square - 1) < 1e-3, "body " + std::to_string(body) + ": orientation is no unit quaternion");
}

void check_bodies(const World& w, Faults& f) {
    const Bodies& b = w.bodies;
    const size_t n = b.mesh.size();
    f.require(body_rows_fit(w), "bodies and poses: arrays of different length");
    f.require(std::all_of(b.name.begin(), b.name.end(), is_body_name), "the name of a body is no name");
    for (uint32_t body = 0; body < n && f.first.empty(); ++body) check_pose(w.poses, body, f);
    if (!f.first.empty()) return;
    f.require(b.stepping.size() <= n, "bodies: more steppings than bodies");
    std::vector<bool> has_mass(n);
    for (const RigidMass& mass : b.rigid_mass) {
        f.require(b.motion[mass.body] == Motion::kFree && !has_mass[mass.body] && mass.mass > 0 && (mass.moments.array() > 0).all() &&
                      w.particles.last_dt.size() > mass.body,
                  "mass of a body that is not free, or has one already");
        has_mass[mass.body] = true;
    }
    for (size_t body = 0; body < b.motion.size() && body < n; ++body)
        f.require(b.motion[body] != Motion::kFree || has_mass[body], "a free body without a mass");
    f.require(all_have(w.sleep, w.sleep.still.empty() ? 0 : n), "sleep: not one per body");
    const size_t slots = w.spawning.away.size(), pools = w.pools.slots.size();
    f.require(slots == (pools > 0 ? n : 0) && all_have(w.spawning, slots, {"came"}) && w.spawning.came.size() == pools &&
                  all_have(w.pools, pools, {"orientation"}) && w.pools.orientation.size() == slots &&
                  (pools == 0 || w.settings.sleep_speed > 0),
              "pools and lives do not fit the bodies");
    for (size_t pool = 0; pool < pools && f.first.empty(); ++pool) {
        f.require(std::isfinite(w.pools.rate[pool]) && w.pools.rate[pool] > 0 && w.pools.life[pool] > 0, "a pool without a rate or a life");
        for (uint32_t slot = w.pools.slots[pool].first; f.first.empty() && slot < w.pools.slots[pool].end(); ++slot)
            f.require(is_deformable(b, slot) && w.spawning.since[slot] <= w.clock.tick,
                      "a slot that is not deformable, or younger than now");
    }
    const size_t particles = w.particles.offset.size();
    f.require(all_have(w.particles, particles, {"last_dt"}) && all_have(w.anchors, particles), "particles: arrays of different length");
    f.require(w.particles.last_dt.size() <= n, "particles: more steps than bodies");
    for (uint32_t body = 0; body < n && f.first.empty(); ++body) {
        check_body(w, body, f);
        if (is_deformable(b, body)) f.require(w.particles.last_dt.size() > body, "particles: steps of bodies are missing");
    }
}

void check_links(const World& w, Faults& f) {
    const Links& l = w.links;
    const size_t rows = l.node.size();
    const uint32_t bodies = static_cast<uint32_t>(w.bodies.mesh.size());
    f.require(all_have(l, rows, {"group", "stable_dt"}), "links: arrays of different length");
    f.require(l.stable_dt.empty() || l.stable_dt.size() == bodies, "links: steps are not one per body");
    for (const double dt : l.stable_dt) f.require(dt > kShortestStep, "links: a step is too short");
    uint64_t first = 0;
    for (uint32_t g = 0; g < l.group.size(); ++g) {
        const LinkGroup& group = l.group[g];
        f.require(group.entity.index == g && group.links.first == first, "links: groups do not fit their rows");
        first += group.links.count;
        if (!f.first.empty()) return;
        if (group.body == kNone) {
            f.require(group.links.count == 0, "links: rows of no group");
            continue;
        }
        f.below(group.holder, bodies, false, "link to body");
        if (!f.first.empty()) return;
        f.require(is_deformable(w.bodies, group.body) && group.body != group.holder && group.stiffness > 0 &&
                      std::isfinite(group.stiffness) && group.gauge > 0 && group.break_strain > 0,
                  "link group " + std::to_string(g) + " holds in no known way");
        const bool nodes = is_deformable(w.bodies, group.holder);
        for (uint32_t row = group.links.first; row < group.links.end(); ++row) {
            f.below(l.node[row], w.bodies.particles[group.body].count, false, "link of node");
            if (nodes) f.below(l.far_node[row], w.bodies.particles[group.holder].count, false, "link to node");
            f.require(l.rest[row] >= 0 && std::isfinite(l.stretch[row]), "links: no length");
        }
    }
    f.require(first == rows, "links: rows of no group");
}

void check_tear_faces(const World& w, const TearBody& t, uint32_t prototype, Faults& f) {
    const SolidInfo& info = w.solids.info[prototype];
    f.require(t.faces.count == t.order.count && t.outer <= t.faces.count && info.tetrahedra.end() <= w.torn.tetrahedron.size(),
              "tears: faces of a solid are missing");
    if (!f.first.empty()) return;
    for (uint32_t i = t.faces.first; i < t.faces.end(); ++i) {
        const TearFace& face = w.tears.face[i];
        for (const uint32_t v : face.corner) f.below(v, w.meshes.info[prototype].vertices.count, false, "vertex of a face");
        for (int k = 0; k < 3; ++k) f.below(face.tetrahedron[k], info.count, k == 2, "tetrahedron of a face");
    }
    uint32_t whole = 0;
    for (uint32_t row = info.tetrahedra.first; row < info.tetrahedra.first + info.count; ++row) whole += w.torn.tetrahedron[row] == 0;
    f.require(whole > 0, "tears: a solid without a tetrahedron");
}

void check_tears(const World& w, Faults& f) {
    f.require(w.torn.cut.size() == w.tears.cut.size(), "cuts: not one state each");
    const size_t rows = w.torn.spring.size();
    f.require(rows <= w.springs.neighbour.size() && rows % kSliceWidth == 0, "torn springs: more than there are");
    f.require(w.torn.tetrahedron.size() <= w.solids.rest.size(), "lost tetrahedra: more than there are");
    for (const TearBody& t : w.tears.body) {
        f.require(is_deformable(w.bodies, t.body) && t.break_strain > 0, "tears of a body that has no springs");
        if (!f.first.empty()) return;
        const uint32_t prototype = w.bodies.mesh[t.body];
        const Range slices = w.springs.info[prototype].slices;
        f.require(size_t{w.springs.slice_column[slices.end() + prototype]} * kSliceWidth <= rows, "tears: springs are missing");
        std::vector<bool> seen(t.order.count);
        for (uint32_t i = t.order.first; i < t.order.end(); ++i) {
            f.below(w.tears.order[i], t.order.count, false, "tears: triangle");
            if (!f.first.empty()) return;
            f.require(!seen[w.tears.order[i]], "tears: a triangle twice");
            seen[w.tears.order[i]] = true;
        }
        if (is_solid(w.solids, prototype)) check_tear_faces(w, t, prototype, f);
        if (!f.first.empty()) return;
        const MeshInfo& info = w.meshes.info[prototype];
        f.require(info.triangles.count <= t.order.count, "tears: more triangles than at load");
        if (!f.inside({info.triangles.first, t.order.count}, w.meshes.triangle.size(), "removed triangles")) return;
        for (uint32_t i = info.triangles.end(); i < info.triangles.first + t.order.count; ++i)
            for (const uint32_t v : w.meshes.triangle[i]) f.below(v, info.vertices.count, false, "vertex of a removed triangle");
    }
    for (const auto& [tear, triangle] : w.torn.triangle) {
        f.below(tear, static_cast<uint32_t>(w.tears.body.size()), false, "removed triangle of");
        if (!f.first.empty()) return;
        f.below(triangle, w.tears.body[tear].order.count, false, "removed triangle");
    }
}

void check_tools(const World& w, Faults& f) {
    f.require(w.paths.keys.size() == w.paths.body.size(), "paths: keys do not fit");
    for (const Range& keys : w.paths.keys) f.require(keys.count > 0, "a path has no key");
    f.require(w.haptics.tool.size() <= kMaxTools && w.haptics.state.size() == w.haptics.tool.size(), "tools and their states do not fit");
    for (const HandTool& tool : w.haptics.tool) {
        f.require(tool.path != kNone || tool.trace != kNone, "a tool has no device");
        f.require(tool.effects.count <= kMaxEffects, "a tool has too many effects");
        f.require(tool.hand.delay <= kMostHandDelay, "a hand is too late");
        f.require(tool.point_shell.empty() || (tool.turn_stiffness > 0 && tool.surface_stiffness > 0 && tool.coupling_stiffness > 0),
                  "a tool that feels with all of its body has no stiffness");
    }
    for (size_t j = 0; j < w.haptics.jaw.size(); ++j) {
        const uint32_t body = w.haptics.jaw[j].body;
        const auto holds = [&](const HandTool& tool) { return j >= tool.jaws.first && j < tool.jaws.end(); };
        f.require(std::count_if(w.haptics.tool.begin(), w.haptics.tool.end(), holds) == 1, "a jaw is not of one tool");
        f.require(std::none_of(w.haptics.tool.begin(), w.haptics.tool.end(), [&](const HandTool& tool) { return tool.body == body; }),
                  "a jaw is a tool");
    }
    for (const HapticSurface& s : w.haptics.surface)
        f.require(s.stiffness >= 0 && s.damping >= 0 && s.height >= 0 && s.length > 0, "a surface feels in no known way");
    for (const DeviceTrace& trace : w.haptics.trace) f.require(!trace.sample.empty(), "a device trace is empty");
}

void check_nodes(const World& w, Faults& f) {
    const Nodes& n = w.nodes;
    const NodeState& s = w.node_state;
    const uint32_t nodes = static_cast<uint32_t>(n.name.size()), bodies = static_cast<uint32_t>(w.bodies.mesh.size());
    const uint32_t tools = static_cast<uint32_t>(w.haptics.tool.size()), drives = static_cast<uint32_t>(n.drive.size());
    f.require(n.parent.size() == nodes && s.enabled.size() == nodes && n.of_body.size() == (nodes > 0 ? bodies : 0) &&
                  s.drive.size() == drives && s.seen.size() == n.toggle.size() + n.exchange.size() &&
                  s.laid_down.size() == (n.exchange.empty() ? 0 : tools) && s.off.size() == (nodes > 0 || !n.exchange.empty() ? bodies : 0),
              "nodes: arrays that do not fit together");
    if (!f.first.empty()) return;
    for (uint32_t node = 0; node < nodes; ++node) f.below(n.parent[node], node, true, "parent of a node");
    uint64_t next = 0;
    for (uint32_t i = 0; i < drives && f.first.empty(); ++i) {
        const NodeDrive& d = n.drive[i];
        f.require(d.body >= next && w.bodies.motion[d.body] == Motion::kFree && d.behaviour != NodeBehaviour::kNone && d.inertia > 0 &&
                      std::isfinite(d.inertia) && d.lowest < d.highest && d.damping >= 0 && d.friction >= 0 && d.axis.allFinite() &&
                      (d.click == 0 || d.click_width > 0) && std::isfinite(s.drive[i].coordinate) && std::isfinite(s.drive[i].rate),
                  "body " + std::to_string(d.body) + " is driven in no known way");
        next = uint64_t{d.body} + 1;
    }
    for (const NodeSwitch& t : n.toggle) f.require(t.to <= 2 && t.event < NodeEventKind::kCount, "a switch is of no kind");
}

void check_contact_memory(const World& w, Faults& f) {
    const ContactMemory& m = w.contact_memory;
    const uint32_t rows = static_cast<uint32_t>(m.body.size());
    f.require(all_have(m, rows), "contact memory: arrays of different length");
    for (uint32_t i = 0; i < rows && f.first.empty(); ++i) {
        const uint32_t vertices = w.meshes.info[w.bodies.mesh[m.body[i]]].vertices.count;
        for (const uint32_t v : m.vertex[i]) f.below(v, vertices, false, "contact memory of vertex");
        f.require(m.along[i] >= 0 && m.along[i] <= 1 && m.force[i].allFinite(), "contact memory: out of range");
    }
}

void check_clock_and_settings(const World& w, Faults& f) {
    const ContactParams& c = w.settings.contact;
    f.require(w.settings.gravity.allFinite(), "settings: gravity is not finite");
    f.require(w.settings.substep > kShortestStep, "settings: substep must be longer than 1e-8 s");
    f.require(c.tolerance > 0 && c.cell_edges > 0 && std::isfinite(c.cell_edges) && c.push_speed >= 0 && c.iterations < 1000,
              "settings: contact tolerance, cell_edges, push_speed or iterations is out of range");
    f.require(w.settings.sleep_speed >= 0 && w.settings.sleep_after >= 0, "settings: sleep_speed or sleep_after is negative");
    const uint32_t rate = w.clock.contact_rate;
    f.require(is_contact_rate(rate), "clock: contact_rate must be 30, 60, 90 ... 240 (Hz)");
    if (!f.first.empty()) return;
    f.require(w.clock.display_rate == 30 && w.clock.tick == pass_tick(w.clock.pass, rate), "clock: does not fit its passes");
}

}  // namespace

std::string find_fault(const World& w) {
    Faults f;
    std::string not_a_number;
    check_fields(w, f, not_a_number);
    if (f.first.empty()) check_meshes(w.meshes, f);
    if (f.first.empty()) check_bodies(w, f);
    if (f.first.empty()) check_tools(w, f);
    if (f.first.empty()) check_nodes(w, f);
    if (f.first.empty()) check_links(w, f);
    if (f.first.empty()) check_tears(w, f);
    f.require(all_have(w.pair_memory, w.pair_memory.a.size()), "pair memory: arrays of different length");
    if (f.first.empty()) check_contact_memory(w, f);
    check_clock_and_settings(w, f);
    f.require(not_a_number.empty(), not_a_number);
    return f.first;
}

std::string find_unfinished(const World& w) {
    Faults f;
    check_clock_and_settings(w, f);
    const Bodies& b = w.bodies;
    f.require(body_rows_fit(w), "bodies: arrays of different length; add_body fills them");
    for (uint32_t body = 0; body < b.mesh.size() && f.first.empty(); ++body) {
        const std::string name = "body " + std::to_string(body) + " \"" + b.name[body] + "\" ";
        const Range rows = b.particles[body];
        f.require(b.mesh[body] < w.meshes.info.size(), name + "is of no mesh");
        f.require(!is_deformable(b, body) || (rows.count > 0 && rows.end() <= w.particles.offset.size() && rows.end() >= rows.first &&
                                              body < w.particles.last_dt.size() && b.mesh[body] < w.springs.info.size()),
                  name + "has no particles: make_deformable is missing");
        f.require(b.motion[body] != Motion::kFree || (find_rigid_mass(b, body) && body < w.particles.last_dt.size()),
                  name + "has no mass: set_rigid_mass is missing");
        if (!f.first.empty()) break;
        const uint32_t tree = b.tree[body];
        f.require(tree < w.trees.size() && w.trees[tree] && w.trees[tree]->looks_at(mesh_view(w.meshes, b.mesh[body])),
                  name + "has no closest-point tree, or one made before the last prototype: make_trees is missing");
    }
    return f.first;
}

}  // namespace trocar
