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

// The first fault ends the checks.
struct Fault {
    std::string text;
};
template <typename... Text>
void require(bool holds, const Text&... complaint) {
    if (!holds) throw Fault{(std::string() + ... + complaint)};
}
template <typename... Text>
void require_inside(const Range& range, size_t size, const Text&... what) {
    require(holds(size, range), what..., " reach beyond their array");
}
template <typename T, typename... Text>
void require_below(const T& index, uint32_t count, const Text&... what) {
    if (index >= count) throw Fault{(std::string() + ... + what) + " " + std::to_string(index) + " of " + std::to_string(count)};
}
template <typename... Text>
void require_below_or_none(uint32_t index, uint32_t count, const Text&... what) {
    if (index != kNone) require_below(index, count, what...);
}

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
constexpr ActionKind last_of(ActionKind) { return ActionKind::kSuture; }
constexpr ActionTrigger last_of(ActionTrigger) { return ActionTrigger::kAlways; }
constexpr Admission last_of(Admission) { return Admission::kRefused; }
constexpr AnchorFrame last_of(AnchorFrame) { return AnchorFrame::kShape; }
constexpr DeepResponse last_of(DeepResponse) { return DeepResponse::kLastFree; }
constexpr EffectKind last_of(EffectKind) { return EffectKind::kMagnet; }
constexpr EffectTrigger last_of(EffectTrigger) { return EffectTrigger::kRelease; }
constexpr HapticEventKind last_of(HapticEventKind) { return HapticEventKind::kLimit; }
constexpr Integrator last_of(Integrator) { return Integrator::kBackwardEuler; }
constexpr LinkPhase last_of(LinkPhase) { return LinkPhase::kDone; }
constexpr Motion last_of(Motion) { return Motion::kFree; }
constexpr NodeBehaviour last_of(NodeBehaviour) { return NodeBehaviour::kDial; }
constexpr NodeEventKind last_of(NodeEventKind) { return NodeEventKind::kDetent; }
constexpr PivotKind last_of(PivotKind) { return PivotKind::kTip; }
constexpr RegionFrame last_of(RegionFrame) { return RegionFrame::kWorld; }
constexpr RegionKind last_of(RegionKind) { return RegionKind::kCapsule; }
constexpr ResponseDirection last_of(ResponseDirection) { return ResponseDirection::kThesis; }
constexpr ResponseShare last_of(ResponseShare) { return ResponseShare::kHalf; }
constexpr TissueLaw last_of(TissueLaw) { return TissueLaw::kNeoHookean; }
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
    std::span<const std::pair<std::string_view, size_t>> counts;
    std::string not_a_number = "";  // the first fault of that kind

    CountedIn counted_in(std::string_view kind) const {
        const size_t of = kind.find(" of ");
        if (of == kind.npos || (!kind.starts_with("index") && !kind.starts_with("range"))) return {};
        const bool or_none = kind.ends_with(" or none");
        const std::string_view what = kind.substr(of + 4, kind.size() - of - 4 - (or_none ? 8 : 0));
        const auto found = std::find_if(counts.begin(), counts.end(), [&](const auto& c) { return c.first == what; });
        TROCAR_ASSERT(found != counts.end());
        return {false, found->second, or_none};
    }
    template <typename T>
    void item(const FieldOf& field, const T& value, const CountedIn& in) {
        if constexpr (std::is_enum_v<T>) {
            if (value > last_of(T{})) throw Fault{field.text() + " is of no kind"};
        } else if constexpr (std::is_floating_point_v<T>) {
            if (std::isnan(value) && not_a_number.empty()) not_a_number = field.text() + " is not a number";
        } else if constexpr (std::is_same_v<T, Range>) {
            if (!in.none && !holds(in.rows, value)) throw Fault{field.text() + " reach beyond their array"};
        } else if constexpr (std::is_same_v<T, uint32_t> || std::is_same_v<T, uint64_t>) {
            if (!in.none && value >= in.rows && !(in.or_none && value == kNone))
                require_below(value, static_cast<uint32_t>(in.rows), field.text());
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
                require(rows == kNone || array.size() == rows, of.text(), ": arrays of different length");
                rows = array.size();
            });
        }
        each_field(group, [&](const FieldName& name, const auto& member) { item({&of, name.name}, member, counted_in(name.unit)); });
    }
};

// All fields from outside. Vertices and particles may have non-finite positions: admission and passes handle
// them.
template <typename World>
void check_fields(const World& w, std::string& not_a_number) {
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
                                                          {"tear faces", w.tears.face.size()},
                                                          {"actions", w.actions.action.size()},
                                                          {"action times", w.actions.time.size()},
                                                          {"cut vertices", w.action_state.cut.position.size()},
                                                          {"cut triangles", w.action_state.cut.triangle.size()},
                                                          {"lattice tetrahedra", w.actions.lattice_tetrahedron.size()},
                                                          {"lattice edges", w.actions.lattice_edge.size()},
                                                          {"lattice faces", w.actions.lattice_face.size()},
                                                          {"lattice anchors", w.actions.lattice_anchor.size()},
                                                          {"cut parts", w.action_state.lattice.part.size()},
                                                          {"cut nodes", w.action_state.lattice.node_of.size()},
                                                          {"lattice vertices", w.action_state.lattice.vertex.size()},
                                                          {"lattice triangles", w.action_state.lattice.triangle.size()},
                                                          {"heated nodes", w.actions.heat_volume.size()},
                                                          {"heat edges", w.actions.heat_edge.size()},
                                                          {"heat springs", w.actions.heat_spring.size()},
                                                          {"heat tetrahedra", w.actions.heat_tetrahedron.size()},
                                                          {"cut bodies", w.actions.cut_body.size()},
                                                          {"film bodies", w.fluids.body.size()},
                                                          {"film cells", w.fluid_state.volume.size()},
                                                          {"film edges", w.fluid_state.flow.size()},
                                                          {"wound spots", w.fluids.spot.size()},
                                                          {"threads", w.threads.thread.size()},
                                                          {"thread rows", w.thread_state.material.size()},
                                                          {"sewn bodies", w.threads.sewn.size()},
                                                          {"sewn vertices", w.thread_state.before.size()},
                                                          {"holds", w.thread_state.hold.size()}};
    FieldCheck check{counts};
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

void check_mesh(const Meshes& m, uint32_t prototype) {
    const MeshInfo& info = m.info[prototype];
    const std::string name = "mesh " + std::to_string(prototype) + ": ";
    require_inside(info.vertices, m.position.size(), name, "vertices");
    require_inside(info.vertices, m.component.size(), name, "components");
    require_inside(info.triangles, m.triangle.size(), name, "triangles");
    require_inside(info.triangles, m.neighbour.size(), name, "neighbours");
    require_inside(info.triangles, m.triangle_edge.size(), name, "edges of triangles");
    require_inside(info.triangles, m.uv.size(), name, "texture coordinates");
    require_inside(info.triangles, m.triangle_material.size(), name, "materials of triangles");
    require_inside(info.edges, m.edge.size(), name, "edges");
    require_inside(info.edges, m.edge_triangle.size(), name, "triangles of edges");
    require_inside(info.incident, m.incident.size(), name, "incident triangles");
    require_inside({info.vertices.first + prototype, info.vertices.count + 1}, m.incident_first.size(), name, "vertices");
    require_inside(m.materials[prototype], m.material.size(), name, "materials");
    require(std::isfinite(info.mean_edge) && std::isfinite(info.radius), name, "no such surface");
    const uint32_t materials = std::max(1u, m.materials[prototype].count);
    for (uint32_t t = info.triangles.first; t < info.triangles.end(); ++t) {
        for (int k = 0; k < 3; ++k) {
            require_below(m.triangle[t][k], info.vertices.count, name, "vertex");
            require_below_or_none(m.neighbour[t][k], info.triangles.count, name, "neighbour");
            require_below(m.triangle_edge[t][k], info.edges.count, name, "edge");
        }
        require_below(m.triangle_material[t], materials, name, "material");
    }
    for (uint32_t e = info.edges.first; e < info.edges.end(); ++e) {
        for (int k = 0; k < 2; ++k) {
            require_below(m.edge[e][k], info.vertices.count, name, "vertex of an edge");
            require_below_or_none(m.edge_triangle[e][k], info.triangles.count, name, "triangle of an edge");
        }
    }
    for (uint32_t v = 0; v < info.vertices.count; ++v) {
        const uint32_t* row = m.incident_first.data() + info.vertices.first + prototype + v;
        require(row[0] <= row[1] && row[1] <= info.incident.count, name, "incident triangles of a vertex");
        require_below(m.component[info.vertices.first + v], info.components, name, "component");
    }
    for (uint32_t i = info.incident.first; i < info.incident.end(); ++i)
        require_below(m.incident[i], info.triangles.count, name, "incident triangle");
}

void check_meshes(const Meshes& m) {
    require(m.materials.size() == m.info.size() && m.name.size() == m.info.size(), "meshes: names and materials do not fit");
    for (uint32_t p = 0; p < m.info.size(); ++p) check_mesh(m, p);
    for (const Material& material : m.material)
        require(material.image.rgba.size() == size_t{4} * material.image.width * material.image.height,
                "a texture is not as large as it says");
}

// Packed columns match the others.
void check_packed(const Springs& s, uint32_t prototype) {
    const SpringInfo& info = s.info[prototype];
    if (info.packed == kNone) return;
    const uint32_t* column = s.slice_column.data() + info.slices.first + prototype;
    const std::string name = "packed springs of mesh " + std::to_string(prototype);
    require_inside({info.packed, column[info.slices.count] - column[0]}, s.packed.size(), name);
    for (uint32_t slice = 0; slice < info.slices.count; ++slice) {
        for (uint32_t c = column[slice]; c < column[slice + 1]; ++c) {
            const auto& packed = s.packed[info.packed + c - column[0]];
            for (uint32_t lane = 0; lane < kSliceWidth; ++lane) {
                const size_t h = size_t{c} * kSliceWidth + lane;
                require(packed[lane] + kSliceWidth * slice - 32768u == s.neighbour[h] &&
                            static_cast<float>(packed[kSliceWidth + lane]) * info.rest_unit == s.rest_length[h],
                        name, " differ");
            }
        }
    }
}

// Columns of slices that start at element `first` of a prototype's table of neighbours, `width` entries per
// column, all below `limit`.
void check_columns(std::span<const uint32_t> column, std::span<const uint32_t> entry, uint32_t first, uint32_t slices, uint64_t width,
                   uint64_t limit, const std::string& name) {
    require_inside({first, slices + 1}, column.size(), name);
    for (uint32_t slice = first; slice < first + slices; ++slice) {
        require(column[slice] <= column[slice + 1] && column[slice + 1] * width <= entry.size(), name, ": columns");
        for (uint64_t i = column[slice] * width; i < column[slice + 1] * width; ++i) require(entry[i] < limit, name, ": entry");
    }
}

void check_springs(const World& w, uint32_t prototype) {
    const Springs& s = w.springs;
    const std::string name = "springs of mesh " + std::to_string(prototype);
    require(prototype < s.info.size() && prototype < s.vertices.size(), name, " are missing");
    const SpringInfo& info = s.info[prototype];
    const Range slices = info.slices;
    const uint64_t padded = uint64_t{slices.count} * kSliceWidth, skin = info.skin;
    require(skin % kSliceWidth == 0 && s.vertices[prototype].count == padded + skin, name, " do not fit its vertices");
    require(skin == (prototype < w.solids.info.size() ? embedded_count(w.solids.info[prototype]) : 0), name, " do not fit its skin");
    require_inside(s.vertices[prototype], s.area_share.size(), name);
    require(s.neighbour.size() == s.rest_length.size(), name, " do not fit together");
    check_columns(s.slice_column, s.neighbour, slices.first + prototype, slices.count, kSliceWidth, padded, name);
    const uint64_t end = uint64_t{s.slice_column[slices.end() + prototype]} * kSliceWidth;
    require(!info.varied || end <= s.factor.size(), name, ": stiffnesses are missing");
    check_packed(s, prototype);
}

void check_solid(const World& w, uint32_t prototype, uint32_t particles) {
    const Solids& s = w.solids;
    if (!has_own_nodes(s, prototype)) return;
    const SolidInfo& info = s.info[prototype];
    const std::string name = "solid of mesh " + std::to_string(prototype) + ": ";
    const bool shell = info.count == 0;  // with an embedded surface
    require_inside(info.inner, s.position.size(), name, "inner nodes");
    require_inside(info.nodes, s.node_volume.size(), name, "volumes of nodes");
    require_inside(info.tetrahedra, s.rest.size(), name, "tetrahedra");
    require_inside(info.tetrahedra, s.per_rest.size(), name, "tetrahedra");
    for (const auto& corner : s.corner) require_inside(info.tetrahedra, corner.size(), name, "corners");
    if (info.varied) require_inside(info.tetrahedra, s.factor.size(), name, "stiffnesses");
    const uint32_t tets = info.tetrahedra.count;
    require(info.count <= tets && tets % kSliceWidth == 0 &&
                (shell || uint64_t{info.slices.count} * kSliceWidth + embedded_count(info) == particles) && tets < kNone / 4 &&
                info.nodes.count + embedded_count(info) <= particles &&
                uint64_t{surface_nodes(w.meshes, info, prototype)} + info.inner.count == info.nodes.count,
            name, "nodes and tetrahedra do not fit");
    require_inside(info.skin, s.embedding_node.size(), name, "skin");
    require_inside(info.skin, s.embedding_weight.size(), name, "skin");
    require(info.skin.count == 0 || info.skin.count >= w.meshes.info[prototype].vertices.count, name, "skin does not fit the surface");
    for (uint32_t row = info.skin.first; row < info.skin.end(); ++row) {
        for (const uint32_t node : s.embedding_node[row]) require_below(node, info.nodes.count, name, "node of the skin");
        for (const double weight : s.embedding_weight[row]) require(std::isfinite(weight), name, "weight of the skin");
    }
    for (const auto& corner : s.corner)
        for (uint32_t t = 0; t < tets; ++t) require_below(corner[info.tetrahedra.first + t], info.nodes.count, name, "corner");
    check_columns(s.slot_column, s.slot, info.slices.first + prototype, info.slices.count, kSliceWidth, uint64_t{4} * tets + 1,
                  name + "slots");
}

void check_fans(const World& w, uint32_t prototype) {
    const Fans& fans = w.springs.fans;
    const std::string name = "fans of mesh " + std::to_string(prototype);
    require(prototype < fans.first.size() && fans.volume.size() == fans.first.size() && fans.volume[prototype] != 0, name, " are missing");
    const uint32_t slices = w.springs.info[prototype].slices.count;
    check_columns(fans.column, fans.corner, fans.first[prototype], slices, 2 * kSliceWidth, uint64_t{slices} * kSliceWidth, name);
}

void check_hinges(const World& w, uint32_t prototype) {
    const Hinges& h = w.springs.hinges;
    const std::string name = "hinges of mesh " + std::to_string(prototype);
    require(prototype < h.first.size() && h.groups.size() == h.first.size(), name, " are missing");
    const Range groups = h.groups[prototype];
    const size_t all = h.weight.size() / 8;
    require(h.weight.size() == 8 * all && h.sine.size() == 8 * all && h.cosine.size() == 8 * all && h.cap.size() == 16 * all &&
                h.vertex.size() == 32 * all,
            name, " do not fit together");
    require_inside(groups, all, name);
    const uint32_t slices = w.springs.info[prototype].slices.count;
    for (size_t i = size_t{32} * groups.first; i < size_t{32} * groups.end(); ++i)
        require_below(h.vertex[i], slices * kSliceWidth, name, ": vertex");
    check_columns(h.column, h.slot, h.first[prototype], slices, kSliceWidth, uint64_t{32} * groups.count + 1, name);
}

// What a law needs beyond springs: see give_law.
void check_law(const World& w, uint32_t body, const std::string& name) {
    const Bodies& b = w.bodies;
    const TissueLaw law = law_of(b, body);
    const Prony prony = prony_of(b, body);
    const uint32_t prototype = b.mesh[body], branches = prony.branches();
    if (law == TissueLaw::kSprings && branches == 0) return;
    require(is_solid(w.solids, prototype) && w.springs.info[prototype].varied, name, " has a law for solids");
    for (uint32_t i = 0; i < Prony::kMost; ++i)
        require(i < branches ? prony.time[i] > 0 && prony.share[i] > 0 && std::isfinite(prony.share[i])
                             : prony.time[i] == 0 && prony.share[i] == 0,
                name, ": a relaxation time and its share must be positive");
    require(law == TissueLaw::kSprings || w.solids.metric.size() >= size_t{6} * w.solids.info[prototype].tetrahedra.end(), name,
            ": its law lacks data (give_law)");
    if (branches == 0) return;
    const RelaxingBody* relaxing = find_relaxing(w.relaxation, body);
    const Range slices = w.springs.info[prototype].slices;
    const uint32_t* column = w.springs.slice_column.data() + slices.first + prototype;
    require(relaxing && relaxing->branches == branches && relaxing->count == kSliceWidth * (column[slices.count] - column[0]) &&
                size_t{relaxing->first} + relaxing->count <= w.relaxation.stretch.size() &&
                relaxing->first_branch + size_t{branches} * relaxing->count <= w.relaxation.overstretch.size(),
            name, ": its Maxwell elements do not fit its springs (give_law)");
}

void check_body(const World& w, uint32_t body) {
    const Bodies& b = w.bodies;
    const std::string name = "body " + std::to_string(body);
    require(b.stable_dt[body] > kShortestStep && b.thickness[body] >= 0 && b.inv_mass[body] >= 0, name, " has no step, mass or thickness");
    if (!is_deformable(b, body)) return;
    check_springs(w, b.mesh[body]);
    if (has_pressure(b, body)) check_fans(w, b.mesh[body]);
    if (has_bending(b, body)) check_hinges(w, b.mesh[body]);
    const Stepping stepping = stepping_of(b, body);
    require(stepping.step > kShortestStep && stepping.iterations <= 10000, name,
            ": its step must be positive, its iterations at most 10000");
    require(stepping.integrator == Integrator::kLeapfrog || !is_solid(w.solids, b.mesh[body]), name, " is a solid stepped implicitly");
    require(b.particles[body].count == w.springs.vertices[b.mesh[body]].count && b.particles[body].first % kSliceWidth == 0 &&
                b.particles[body].count >= w.meshes.info[b.mesh[body]].vertices.count,
            name, ": particles do not fit its mesh");
    check_solid(w, b.mesh[body], b.particles[body].count);
    check_law(w, body, name);
    require(w.particles.last_dt.size() > body, "particles: steps of bodies are missing");
}

bool body_rows_fit(const World& w) {
    const size_t n = w.bodies.mesh.size();
    return all_have(w.bodies, n, {"rigid_mass", "stepping", "self_contact", "law", "prony"}) && all_have(w.poses, n);
}

void check_pose(const Poses& poses, uint32_t body) {
    const Quat& q = poses.orientation[body];
    const double square = q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z;
    const std::string name = "body " + std::to_string(body);
    require(poses.origin[body].allFinite() && poses.velocity[body].allFinite() && poses.angular_velocity[body].allFinite(), name,
            ": place or velocity is not finite");
    require(std::abs(square - 1) < 1e-3, name, ": orientation is no unit quaternion");
}

void check_pools(const World& w) {
    const size_t n = w.bodies.mesh.size(), slots = w.spawning.away.size(), pools = w.pools.slots.size();
    require(slots == (pools > 0 ? n : 0) && all_have(w.spawning, slots, {"came"}) && w.spawning.came.size() == pools &&
                all_have(w.pools, pools, {"orientation"}) && w.pools.orientation.size() == slots &&
                (pools == 0 || w.settings.sleep_speed > 0),
            "pools and lives do not fit the bodies");
    for (size_t pool = 0; pool < pools; ++pool) {
        require(std::isfinite(w.pools.rate[pool]) && w.pools.rate[pool] > 0 && w.pools.life[pool] > 0, "a pool without a rate or a life");
        for (uint32_t slot = w.pools.slots[pool].first; slot < w.pools.slots[pool].end(); ++slot)
            require(is_deformable(w.bodies, slot) && w.spawning.since[slot] <= w.clock.tick,
                    "a slot that is not deformable, or younger than now");
    }
}

void check_bodies(const World& w) {
    const Bodies& b = w.bodies;
    const size_t n = b.mesh.size();
    require(body_rows_fit(w), "bodies and poses: arrays of different length");
    require(std::all_of(b.name.begin(), b.name.end(), is_body_name), "the name of a body is no name");
    for (uint32_t body = 0; body < n; ++body) check_pose(w.poses, body);
    require(b.stepping.size() <= n, "bodies: more steppings than bodies");
    std::vector<bool> has_mass(n);
    for (const RigidMass& mass : b.rigid_mass) {
        require(b.motion[mass.body] == Motion::kFree && !has_mass[mass.body] && mass.mass > 0 && (mass.moments.array() > 0).all() &&
                    w.particles.last_dt.size() > mass.body,
                "mass of a body that is not free, or has one already");
        has_mass[mass.body] = true;
    }
    for (size_t body = 0; body < n; ++body) require(b.motion[body] != Motion::kFree || has_mass[body], "a free body without a mass");
    require(all_have(w.sleep, w.sleep.still.empty() ? 0 : n), "sleep: not one per body");
    check_pools(w);
    const size_t particles = w.particles.offset.size();
    require(all_have(w.particles, particles, {"last_dt"}) && all_have(w.anchors, particles), "particles: arrays of different length");
    require(w.particles.last_dt.size() <= n, "particles: more steps than bodies");
    for (uint32_t body = 0; body < n; ++body) check_body(w, body);
}

void check_links(const World& w) {
    const Links& l = w.links;
    const size_t rows = l.node.size();
    const uint32_t bodies = static_cast<uint32_t>(w.bodies.mesh.size());
    require(all_have(l, rows, {"group", "stable_dt"}), "links: arrays of different length");
    require(l.stable_dt.empty() || l.stable_dt.size() == bodies, "links: steps are not one per body");
    for (const double dt : l.stable_dt) require(dt > kShortestStep, "links: a step is too short");
    uint64_t first = 0;
    for (uint32_t g = 0; g < l.group.size(); ++g) {
        const LinkGroup& group = l.group[g];
        require(group.entity.index == g && group.links.first == first, "links: groups do not fit their ranges");
        first += group.links.count;
        if (group.body == kNone) {
            require(group.links.count == 0, "links: some belong to no group");
            continue;
        }
        require_below_or_none(group.holder, bodies, "link to body");
        require(is_deformable(w.bodies, group.body) && group.body != group.holder && group.stiffness > 0 &&
                    std::isfinite(group.stiffness) && group.gauge > 0 && group.break_strain > 0,
                "link group ", std::to_string(g),
                ": it holds a deformable body, by a stiffness, a gauge and a breaking strain that are positive");
        const bool nodes = group.holder != kNone && is_deformable(w.bodies, group.holder);
        for (uint32_t row = group.links.first; row < group.links.end(); ++row) {
            require_below(l.node[row], w.bodies.particles[group.body].count, "link of node");
            if (nodes) require_below(l.far_node[row], w.bodies.particles[group.holder].count, "link to node");
            require(l.rest[row] >= 0 && std::isfinite(l.stretch[row]), "links: no length");
        }
    }
    require(first == rows, "links: some belong to no group");
}

void check_tear_faces(const World& w, const TearBody& t, uint32_t prototype) {
    const SolidInfo& info = w.solids.info[prototype];
    require(t.faces.count == t.order.count && t.outer <= t.faces.count && info.tetrahedra.end() <= w.torn.tetrahedron.size(),
            "tears: faces of a solid are missing");
    for (uint32_t i = t.faces.first; i < t.faces.end(); ++i) {
        const TearFace& face = w.tears.face[i];
        for (const uint32_t v : face.corner) require_below(v, w.meshes.info[prototype].vertices.count, "vertex of a face");
        for (int k = 0; k < 2; ++k) require_below(face.tetrahedron[k], info.count, "tetrahedron of a face");
        require_below_or_none(face.tetrahedron[2], info.count, "tetrahedron of a face");
    }
    const auto lost = w.torn.tetrahedron.begin() + info.tetrahedra.first;
    require(std::count(lost, lost + info.count, 0) > 0, "tears: a solid without a tetrahedron");
}

// The pieces of a solid that instruments may cut.
void check_pieces(const World& w, uint32_t index) {
    const CutSolid& limits = w.actions.cut_solid[index];
    const CutLattices& state = w.action_state.lattice;
    const std::string name = "cut solid " + std::to_string(index) + ": ";
    require_below(limits.body, static_cast<uint32_t>(w.bodies.mesh.size()), name, "body");
    const auto& [nodes, parts, vertices, triangles] = state.count[index];
    require(limits.nodes <= nodes && nodes <= limits.copies.count && limits.tetrahedra.count <= parts && parts <= limits.parts.count &&
                vertices > 0 && vertices <= limits.vertices.count && triangles > 0 && triangles <= limits.triangles.count &&
                limits.anchors.count == limits.nodes,
            name, "more or less than there may be");
    for (uint32_t t = limits.tetrahedra.first; t < limits.tetrahedra.end(); ++t) {
        for (const uint32_t n : w.actions.lattice_tetrahedron[t]) require_below(n, limits.nodes, name, "node");
        for (const uint32_t n : w.actions.lattice_neighbour[t]) require_below_or_none(n, limits.tetrahedra.count, name + "neighbour");
    }
    for (uint32_t e = limits.edges.first; e < limits.edges.end(); ++e)
        require(w.actions.lattice_edge[e][0] < w.actions.lattice_edge[e][1] && w.actions.lattice_edge[e][1] < limits.nodes, name, "edge");
    for (uint32_t f = limits.faces.first; f < limits.faces.end(); ++f)
        require_below(w.actions.lattice_face[f].tetrahedron, limits.tetrahedra.count, name, "face");
    for (uint32_t n = 0; n < nodes; ++n) require_below(state.node_of[limits.copies.first + n], limits.nodes, name, "copy");
    std::vector<uint32_t> owned(limits.tetrahedra.count, 0);
    for (uint32_t p = 0; p < parts; ++p) {
        const CutPart& part = state.part[limits.parts.first + p];
        require_below(part.tetrahedron, limits.tetrahedra.count, name, "tetrahedron of a part");
        require(part.owned > 0 && part.owned < 16 && !(owned[part.tetrahedron] & part.owned), name, "corners of a part");
        owned[part.tetrahedron] |= part.owned;
        for (const uint32_t n : part.node) require_below(n, nodes, name, "node of a part");
    }
    for (const uint32_t all : owned) require(all == 15, name, "a corner that no part owns");
    for (uint32_t v = 0; v < vertices; ++v)
        for (const uint32_t n : state.vertex[limits.vertices.first + v].node) require_below(n, nodes, name, "node of a vertex");
    for (uint32_t t = 0; t < triangles; ++t)
        for (const uint32_t v : state.triangle[limits.triangles.first + t]) require_below(v, vertices, name, "vertex of a triangle");
}

void check_lattices(const World& w) {
    const Actions& a = w.actions;
    const CutLattices& state = w.action_state.lattice;
    require(state.count.size() == a.cut_solid.size() && state.cut_at.size() == a.lattice_edge.size() &&
                a.lattice_neighbour.size() == a.lattice_tetrahedron.size() && a.lattice_uv.size() == a.lattice_face.size() &&
                a.lattice_material.size() == a.lattice_face.size() && state.before.size() == state.node_of.size() &&
                state.uv.size() == state.triangle.size() && state.material.size() == state.triangle.size(),
            "cut solids: arrays of different length");
    for (const auto& [action, solid] : a.solid_cuts)
        require(action < a.action.size() && solid < a.cut_solid.size(), "cut solids: a cut of nothing");
    for (uint32_t index = 0; index < a.cut_solid.size(); ++index) check_pieces(w, index);
}

void check_tears(const World& w) {
    require(w.torn.cut.size() == w.tears.cut.size(), "cuts: not one state each");
    const size_t rows = w.torn.spring.size();
    require(rows <= w.springs.neighbour.size() && rows % kSliceWidth == 0, "torn springs: more than there are");
    require(w.torn.tetrahedron.size() <= w.solids.rest.size(), "lost tetrahedra: more than there are");
    for (const TearBody& t : w.tears.body) {
        require(is_deformable(w.bodies, t.body) && t.break_strain > 0, "tears of a body that has no springs");
        const uint32_t prototype = w.bodies.mesh[t.body];
        const Range slices = w.springs.info[prototype].slices;
        require(size_t{w.springs.slice_column[slices.end() + prototype]} * kSliceWidth <= rows, "tears: springs are missing");
        std::vector<bool> seen(t.order.count);
        for (uint32_t i = t.order.first; i < t.order.end(); ++i) {
            require_below(w.tears.order[i], t.order.count, "tears: triangle");
            require(!seen[w.tears.order[i]], "tears: a triangle twice");
            seen[w.tears.order[i]] = true;
        }
        if (is_solid(w.solids, prototype)) check_tear_faces(w, t, prototype);
        const MeshInfo& info = w.meshes.info[prototype];
        require(info.triangles.count <= t.order.count, "tears: more triangles than at load");
        require_inside({info.triangles.first, t.order.count}, w.meshes.triangle.size(), "removed triangles");
        for (uint32_t i = info.triangles.end(); i < info.triangles.first + t.order.count; ++i)
            for (const uint32_t v : w.meshes.triangle[i]) require_below(v, info.vertices.count, "vertex of a removed triangle");
    }
    for (const auto& [tear, triangle] : w.torn.triangle) {
        require_below(tear, static_cast<uint32_t>(w.tears.body.size()), "removed triangle of");
        require_below(triangle, w.tears.body[tear].order.count, "removed triangle");
    }
}

void check_tools(const World& w) {
    require(w.paths.keys.size() == w.paths.body.size(), "paths: keys do not fit");
    for (const Range& keys : w.paths.keys) require(keys.count > 0, "a path has no key");
    require(w.haptics.tool.size() <= kMaxTools && w.haptics.state.size() == w.haptics.tool.size(), "tools and their states do not fit");
    for (const HandTool& tool : w.haptics.tool) {
        require(tool.path != kNone || tool.trace != kNone, "a tool has no device");
        require(tool.effects.count <= kMaxEffects, "a tool has too many effects");
        require(tool.hand.delay <= kMostHandDelay, "a hand is too late");
        require(tool.point_shell.empty() || (tool.turn_stiffness > 0 && tool.surface_stiffness > 0 && tool.coupling_stiffness > 0),
                "a tool that feels with all of its body has no stiffness");
    }
    for (size_t j = 0; j < w.haptics.jaw.size(); ++j) {
        const uint32_t body = w.haptics.jaw[j].body;
        const auto holds = [&](const HandTool& tool) { return j >= tool.jaws.first && j < tool.jaws.end(); };
        require(std::ranges::count_if(w.haptics.tool, holds) == 1, "a jaw is not of one tool");
        require(std::ranges::count(w.haptics.tool, body, &HandTool::body) == 0, "a jaw is a tool");
    }
    for (const HapticSurface& s : w.haptics.surface)
        require(s.stiffness >= 0 && s.damping >= 0 && s.height >= 0 && s.length > 0,
                "a haptic surface: stiffness, damping and height must not be below 0, its length above it");
    for (const DeviceTrace& trace : w.haptics.trace) require(!trace.sample.empty(), "a device trace is empty");
}

void check_nodes(const World& w) {
    const Nodes& n = w.nodes;
    const NodeState& s = w.node_state;
    const uint32_t nodes = static_cast<uint32_t>(n.name.size()), bodies = static_cast<uint32_t>(w.bodies.mesh.size());
    const uint32_t tools = static_cast<uint32_t>(w.haptics.tool.size()), drives = static_cast<uint32_t>(n.drive.size());
    require(n.parent.size() == nodes && s.enabled.size() == nodes && n.of_body.size() == (nodes > 0 ? bodies : 0) &&
                s.drive.size() == drives && s.seen.size() == n.toggle.size() + n.exchange.size() &&
                s.laid_down.size() == (n.exchange.empty() ? 0 : tools) && s.off.size() == (nodes > 0 || !n.exchange.empty() ? bodies : 0),
            "nodes: arrays that do not fit together");
    for (uint32_t node = 0; node < nodes; ++node) require_below_or_none(n.parent[node], node, "parent of a node");
    uint64_t next = 0;
    for (uint32_t i = 0; i < drives; ++i) {
        const NodeDrive& d = n.drive[i];
        require(d.body >= next && w.bodies.motion[d.body] == Motion::kFree && d.behaviour != NodeBehaviour::kNone && d.inertia > 0 &&
                    std::isfinite(d.inertia) && d.lowest < d.highest && d.damping >= 0 && d.friction >= 0 && d.axis.allFinite() &&
                    (d.click == 0 || d.click_width > 0) && std::isfinite(s.drive[i].coordinate) && std::isfinite(s.drive[i].rate),
                "body ", std::to_string(d.body), ": a driven body is free, with a behaviour, an inertia and limits in order");
        next = uint64_t{d.body} + 1;
    }
    for (const NodeSwitch& t : n.toggle) require(t.to <= 2 && t.event < NodeEventKind::kCount, "a switch is of no kind");
}

// Elements that the surface of a body may have: those of its mesh, or those reserved if instruments cut it. A state is checked before its
// cuts are laid.
struct Elements {
    uint32_t vertices, triangles, edges;
};
Elements elements_of(const World& w, uint32_t body) {
    const MeshInfo& info = w.meshes.info[w.bodies.mesh[body]];
    if (const auto cut = std::ranges::find(w.actions.cut_body, body, &CutBody::body); cut != w.actions.cut_body.end())
        return {cut->vertices.count, cut->triangles.count, cut->edges};
    if (const auto cut = std::ranges::find(w.actions.cut_solid, body, &CutSolid::body); cut != w.actions.cut_solid.end())
        return {cut->vertices.count, cut->triangles.count, cut->mesh_edges};
    return {info.vertices.count, info.triangles.count, info.edges.count};
}

void check_contact_memory(const World& w) {
    const ContactMemory& m = w.contact_memory;
    require(all_have(m, m.body.size()), "contact memory: arrays of different length");
    for (uint32_t i = 0; i < m.body.size(); ++i) {
        for (const uint32_t v : m.vertex[i]) require_below(v, elements_of(w, m.body[i]).vertices, "contact memory of vertex");
        require(m.along[i] >= 0 && m.along[i] <= 1 && m.force[i].allFinite(), "contact memory: out of range");
    }
}

void check_self_contacts(const World& w) {
    for (const double distance : w.bodies.self_contact) require(distance >= 0, "bodies: a distance of self-contact is negative");
    require(w.bodies.self_contact.size() <= w.bodies.mesh.size(), "bodies: distances of self-contact of no body");
    const SelfContacts& c = w.self_contacts;
    for (uint32_t i = 0; i < c.body.size(); ++i) {
        const Elements first = elements_of(w, c.body[i]), second = elements_of(w, c.other[i]);
        require_below(c.feature[i][0], c.edges[i] ? first.edges : first.vertices, "self-contact of feature");
        require_below(c.feature[i][1], c.edges[i] ? second.edges : second.triangles, "self-contact with feature");
        require(c.force[i].allFinite() && c.normal[i].allFinite(), "self-contact: a force or a normal is not finite");
    }
}

void check_clock_and_settings(const World& w) {
    const ContactParams& c = w.settings.contact;
    require(w.settings.gravity.allFinite(), "settings: gravity is not finite");
    require(w.settings.substep > kShortestStep, "settings: substep must be longer than 1e-8 s");
    require(c.tolerance > 0 && c.cell_edges > 0 && std::isfinite(c.cell_edges) && c.push_speed >= 0 && c.iterations < 1000,
            "settings: contact tolerance, cell_edges, push_speed or iterations is out of range");
    require(w.settings.sleep_speed >= 0 && w.settings.sleep_after >= 0, "settings: sleep_speed or sleep_after is negative");
    const uint32_t rate = w.clock.contact_rate;
    require(is_contact_rate(rate), "clock: contact_rate must be 30, 60, 90 ... 240 (Hz)");
    require(w.clock.display_rate == 30 && w.clock.tick == pass_tick(w.clock.pass, rate), "clock: does not fit its passes");
}

// Films fit their bodies; amounts and material are possible.
void check_fluids(const World& w) {
    const Fluids& f = w.fluids;
    const FluidState& s = w.fluid_state;
    const size_t cells = s.volume.size(), edges = s.flow.size();
    require(s.blood.size() == cells && s.rise.size() == cells && s.crowding.size() == cells && s.from.size() == edges &&
                s.to.size() == edges && s.conductance.size() == edges && f.share.size() == f.spot.size() &&
                s.triangles.size() == f.body.size() && s.bleeding.size() == f.wound.size() &&
                (s.heat.empty() || s.heat.size() == w.actions.action.size()),
            "fluids: arrays of different length");
    const FluidParams& p = f.params;
    require(p.blood_density > 0 && p.blood_viscosity > 0 && p.water_density > 0 && p.water_viscosity > 0 && p.surface_tension > 0 &&
                p.smoke_diffusion >= 0 && p.smoke_cooling > 0 && p.smoke_clearing >= 0 && p.smoke_extinction >= 0,
            "fluids: densities, viscosities, the surface tension and the times of smoke must be above 0");
    for (const FilmBody& film : f.body) {
        const MeshInfo& info = w.meshes.info[w.bodies.mesh[film.body]];
        const auto fits = [](uint32_t padded, uint32_t count) { return padded % 8 == 0 && padded >= count; };
        require(fits(film.cells.count, info.vertices.count) && fits(film.edges.count, info.edges.count),
                "fluids: a film does not fit its body");
        require(film.cells.first % 8 == 0 && film.edges.first % 8 == 0, "fluids: a film is not aligned");
        for (uint32_t e = film.edges.first; e < film.edges.end(); ++e)
            require(s.from[e] < film.cells.count && s.to[e] < film.cells.count && s.conductance[e] >= 0, "fluids: an edge of a film");
    }
    for (const Wound& wound : f.wound)
        for (uint32_t i = wound.spots.first; i < wound.spots.end(); ++i)
            require(f.spot[i] < f.body[wound.film].cells.count && f.share[i] >= 0 && wound.rate >= 0 && wound.area > 0, "fluids: a wound");
    for (size_t cell = 0; cell < cells; ++cell)
        require(s.volume[cell] >= 0 && s.blood[cell] >= 0, "fluid state: less than nothing in a cell");
    for (const double volume : s.drops.volume) require(volume >= 0, "fluid state: a drop of less than nothing");
    for (const BleedingEdge& edge : s.edge)
        require(edge.a < f.body[edge.film].cells.count && edge.b < f.body[edge.film].cells.count && edge.rate >= 0,
                "fluid state: an edge that bleeds");
    for (size_t i = 0; i < s.puffs.mass.size(); ++i)
        require(s.puffs.mass[i] >= 0 && s.puffs.variance[i] > 0, "fluid state: smoke of less than nothing");
}

// Threads have points that ascend, and hang on nodes that there are.
void check_threads(const World& w) {
    const ThreadState& s = w.thread_state;
    const size_t rows = s.material.size();
    require(s.count.size() == w.threads.thread.size() && s.progress.size() == s.count.size() && s.position.size() == rows &&
                s.velocity.size() == rows && s.held.size() == rows && s.touching.size() == kTouchesPerPoint * rows &&
                (s.stable_dt.empty() || s.stable_dt.size() == w.bodies.mesh.size()),
            "threads: arrays of different length");
    for (size_t t = 0; t < s.count.size(); ++t) {
        const Thread& thread = w.threads.thread[t];
        require(thread.radius > 0 && thread.youngs_modulus > 0 && thread.density > 0 && thread.spacing > 0 && thread.damping >= 0 &&
                    thread.friction >= 0,
                "threads: radius, modulus, density and spacing must be above 0");
        require(s.count[t] >= 2 && s.count[t] <= thread.rows.count, "threads: one with fewer than two points");
        for (uint32_t i = thread.rows.first; i < thread.rows.first + s.count[t]; ++i) {
            require(s.held[i] == kNone || (s.held[i] < s.hold.size() && s.hold[s.held[i]].thread == t),
                    "threads: a point that nothing holds");
            for (const uint32_t touch : std::span(s.touching).subspan(size_t{kTouchesPerPoint} * i, kTouchesPerPoint))
                require(touch == kNone || (touch < s.touch.size() && s.touch[touch].thread == t), "threads: a point that touches nothing");
            require(i == thread.rows.first || s.material[i] > s.material[i - 1], "threads: points that do not ascend");
        }
    }
    for (const double dt : s.stable_dt) require(dt > kShortestStep, "threads: a step is too short");
    const auto fits = [&](uint32_t body, const std::array<uint32_t, 4>& nodes) {
        const bool soft = body != kNone && is_deformable(w.bodies, body);
        const uint32_t count = soft ? w.bodies.particles[body].count - embedded_count(w.solids, w.bodies.mesh[body]) : 0;
        return std::all_of(nodes.begin(), nodes.end(), [&](uint32_t n) { return n == kNone || n < count; });
    };
    size_t before = 0;
    for (const SewnBody& sewn : w.threads.sewn) {
        require(is_deformable(w.bodies, sewn.body) && sewn.vertices.count == w.meshes.info[w.bodies.mesh[sewn.body]].vertices.count &&
                    sewn.vertices.first == before,
                "threads: what is sewn does not fit its surface");
        before += sewn.vertices.count;
    }
    require(s.before.size() == before, "threads: what is sewn does not fit its surface");
    size_t grips = 0;
    for (const ThreadHold& hold : s.hold) {
        require(hold.thread < s.count.size() && (hold.body == kNone || hold.body < w.bodies.mesh.size()),
                "threads: a hold of a thread or by a body that there is not");
        require(fits(hold.body, hold.node) && hold.stiffness >= 0, "threads: a node that its body does not have");
        const bool soft = hold.body != kNone && is_deformable(w.bodies, hold.body);
        require((hold.node[0] != kNone) == soft && (soft || (hold.action == kNone)), "threads: a hold that no tissue bears");
        const size_t index = static_cast<size_t>(&hold - s.hold.data());
        require(hold.tied == kNone || (hold.body == kNone && hold.tied < s.hold.size() && s.hold[hold.tied].tied == index),
                "threads: a knot of one strand");
        require(hold.action == kNone || hold.action < w.actions.action.size(), "threads: a hold of an action that there is not");
        const bool grip = hold.action != kNone && !hold.slides;  // engine/thread/needle_grip.hpp
        if (grip && !hold.left) {
            require(grips < s.hole.size() && s.hole[grips].sewn < w.threads.sewn.size(), "threads: a grip in no hole");
            const NeedleHole& hole = s.hole[grips++];
            const SewnBody& sewn = w.threads.sewn[hole.sewn];
            require(hold.thread == sewn.thread && hold.body == sewn.body && hold.action == sewn.action && hold.node == hole.node &&
                        hold.weight == hole.weight,
                    "threads: a grip that is not that of its hole");
        }
        require(!(hold.upper < 0) && !std::isnan(hold.upper), "threads: a hold that bears less than nothing");
        require(!grip || w.threads.thread[hold.thread].tool != kNone, "threads: tissue holds a needle that there is not");
    }
    require(grips == s.hole.size(), "threads: holes without what holds the needle in them");
    for (const ThreadTouch& touch : s.touch)
        require(fits(touch.body, touch.node) && (touch.node[0] != kNone) == is_deformable(w.bodies, touch.body) && touch.friction >= 0,
                "threads: touched at a node that its body does not have, or with friction below 0");
    for (const NeedleHole& hole : s.hole) {
        require(hole.sewn < w.threads.sewn.size(), "threads: a hole in nothing");
        const uint32_t body = w.threads.sewn[hole.sewn].body;
        require(fits(body, hole.node), "threads: a hole at a node that its body does not have");
        for (const uint32_t v : hole.corner)
            require(v < w.meshes.info[w.bodies.mesh[body]].vertices.count, "threads: a hole at a vertex that its body does not have");
    }
}

void check_world(const World& w) {
    std::string not_a_number;
    check_fields(w, not_a_number);
    check_meshes(w.meshes);
    check_bodies(w);
    check_tools(w);
    check_nodes(w);
    check_links(w);
    check_tears(w);
    check_lattices(w);
    require(all_have(w.pair_memory, w.pair_memory.a.size()), "pair memory: arrays of different length");
    check_contact_memory(w);
    check_self_contacts(w);
    check_fluids(w);
    check_threads(w);
    check_clock_and_settings(w);
    require(not_a_number.empty(), not_a_number);
}

void check_finished(const World& w) {
    check_clock_and_settings(w);
    const Bodies& b = w.bodies;
    require(body_rows_fit(w), "bodies: arrays of different length; add_body fills them");
    for (uint32_t body = 0; body < b.mesh.size(); ++body) {
        const std::string name = "body " + std::to_string(body) + " \"" + b.name[body] + "\" ";
        const Range rows = b.particles[body];
        require(b.mesh[body] < w.meshes.info.size(), name, "is of no mesh");
        require(!is_deformable(b, body) || (rows.count > 0 && rows.end() <= w.particles.offset.size() && rows.end() >= rows.first &&
                                            body < w.particles.last_dt.size() && b.mesh[body] < w.springs.info.size()),
                name, "has no particles: make_deformable is missing");
        require(b.motion[body] != Motion::kFree || (find_rigid_mass(b, body) && body < w.particles.last_dt.size()), name,
                "has no mass: set_rigid_mass is missing");
        const uint32_t tree = b.tree[body];
        require(tree < w.trees.size() && w.trees[tree] && w.trees[tree]->looks_at(mesh_view(w.meshes, b.mesh[body])), name,
                "has no closest-point tree, or one made before the last prototype: make_trees is missing");
    }
}

std::string first_fault(void (*check)(const World&), const World& world) {
    try {
        check(world);
        return "";
    } catch (const Fault& fault) {
        return fault.text;
    }
}

}  // namespace

std::string find_fault(const World& world) { return first_fault(check_world, world); }

std::string find_unfinished(const World& world) { return first_fault(check_finished, world); }

}  // namespace trocar
