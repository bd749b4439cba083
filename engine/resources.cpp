#include <cmath>

#include "engine/state_hash.hpp"
#include "engine/world.hpp"
namespace trocar {
namespace {

// Rows whose bytes are all value: hashed as they lie in memory.
template <typename T>
constexpr bool is_plain_row =
    std::is_arithmetic_v<T> || std::is_enum_v<T> || std::is_same_v<T, Vec3> || std::is_same_v<T, Vec3d> ||
    std::is_same_v<T, Float4> || std::is_same_v<T, Quat> || std::is_same_v<T, Range> || std::is_same_v<T, Box> || std::is_same_v<T, PackedBox> ||
    std::is_same_v<T, Entity> || std::is_same_v<T, Triangle> || std::is_same_v<T, std::array<uint32_t, 2>> ||
    std::is_same_v<T, std::array<float, 3>> || std::is_same_v<T, std::array<Vec2, 3>> || std::is_same_v<T, Tissue> ||
    std::is_same_v<T, Keyframe> || std::is_same_v<T, std::array<uint32_t, 2 * kSliceWidth>> || std::is_same_v<T, std::array<float, kSliceWidth>> || std::is_same_v<T, Stepping>;

// Adds what a resource holds to a hash.
struct Hasher {
    StateHash hash;
    template <typename T>
    void array(const std::vector<T>& rows) {
        hash.add_word(rows.size());
        if constexpr (is_plain_row<T>) {
            hash.add_bytes(rows.data(), rows.size() * sizeof(T));
        } else {
            for (const T& row : rows) value(row);
        }
    }
    void value(const std::string& text) { hash.add_bytes(text.data(), text.size()); }
    template <typename T>
    requires is_plain_row<T>
    void value(const T& v) { hash.add_bytes(&v, sizeof v); }
    void value(const MeshInfo& m) {
        for (const Range& r : {m.vertices, m.triangles, m.edges, m.incident}) value(r);
        value(m.components), value(m.admission), value(m.volume), value(m.area);
        value(m.mean_edge), value(m.max_edge), value(m.radius), value(m.box);
    }
    void value(const SpringInfo& s) { value(s.slices), value(s.mean_rest); }
    void value(const Material& m) { value(m.name), value(m.diffuse), value(m.texture); }
    void value(const DeviceState& d) {
        value(d.time), value(d.position), value(d.orientation), value(d.velocity), value(d.buttons);
    }
    void value(const DeviceTrace& t) { array(t.sample); }
    void value(const ToolState& t) {
        value(t.device), value(t.proxy), value(t.proxy_valid), value(t.contacts), value(t.command.force);
        value(t.coupling_force), value(t.contact_impulse), value(t.device_valid), value(t.time), value(t.ticks);
        value(t.model_age), value(t.gain), value(t.largest_force), value(t.rejected_samples);
    }
    void value(const HandTool& t) {
        value(t.body), value(t.tip), value(t.tip_radius), value(t.coupling_stiffness), value(t.coupling_damping);
        value(t.max_force), value(t.friction), value(t.path), value(t.trace);
    }
    void value(const TriangleGroup& g) {
        value(g.triangles), value(g.centre), value(g.radius), value(g.velocity), value(g.spread);
    }
    void value(const LocalContactModel& m) {
        value(m.time), value(m.sequence), value(m.from), value(m.to), value(m.reach), value(m.fastest);
        array(m.position), array(m.velocity), array(m.triangle), array(m.neighbour), array(m.body), array(m.half_thickness), array(m.group);
    }
    void value(const PictureBody& b) {
        value(b.mesh), value(b.origin), value(b.orientation), value(b.box), value(b.vertices), value(b.depths);
    }
    void value(const PictureWitness& w) { value(w.point), value(w.closest), value(w.depth); }
    void value(const PictureTool& t) { value(t.device), value(t.proxy), value(t.radius), value(t.force); }
};

// Empties what a resource holds: arrays to no rows, numbers to values that show when used.
struct Stripper {
    template <typename T>
    void array(std::vector<T>& rows) {
        rows.clear();
        rows.shrink_to_fit();
    }
    template <typename T>
    void value(T& v) {
        if constexpr (std::is_floating_point_v<T>)
            v = std::nan("");
        else
            v = T{};
    }
};

// The one list of what belongs to which resource.
template <typename World, typename Visitor>
void visit_resource(World& w, Resource resource, Visitor& v) {
    switch (resource) {
        case Resource::kSettings:
            v.value(w.settings.gravity[0]), v.value(w.settings.gravity[1]), v.value(w.settings.gravity[2]),
                v.value(w.settings.substep), v.value(w.settings.sleep_speed), v.value(w.settings.sleep_after), v.value(w.settings.contact.tolerance),
                v.value(w.settings.contact.push_speed), v.value(w.settings.contact.cell_edges);
            break;
        case Resource::kMeshes:
            v.array(w.meshes.name), v.array(w.meshes.info), v.array(w.meshes.position), v.array(w.meshes.component),
                v.array(w.meshes.triangle), v.array(w.meshes.neighbour), v.array(w.meshes.triangle_edge),
                v.array(w.meshes.edge), v.array(w.meshes.edge_triangle), v.array(w.meshes.incident_first),
                v.array(w.meshes.incident), v.array(w.meshes.uv), v.array(w.meshes.triangle_material),
                v.array(w.meshes.materials), v.array(w.meshes.material);
            break;
        case Resource::kSprings:
            v.array(w.springs.info), v.array(w.springs.slice_column), v.array(w.springs.neighbour),
                v.array(w.springs.rest_length), v.array(w.springs.area_share), v.array(w.springs.vertices),
                v.array(w.springs.colours), v.array(w.springs.colour), v.array(w.springs.batch), v.array(w.springs.batch_rest);
            break;
        case Resource::kBodies:
            v.array(w.bodies.entity), v.array(w.bodies.name), v.array(w.bodies.mesh), v.array(w.bodies.motion),
                v.array(w.bodies.particles), v.array(w.bodies.tree), v.array(w.bodies.anchor_frame),
                v.array(w.bodies.tissue), v.array(w.bodies.spring_stiffness), v.array(w.bodies.inv_mass),
                v.array(w.bodies.stable_dt), v.array(w.bodies.thickness),
                v.array(w.bodies.stepping);
            break;
        case Resource::kAnchors:
            v.array(w.anchors.stiffness), v.array(w.anchors.rest_x), v.array(w.anchors.rest_y),
                v.array(w.anchors.rest_z);
            break;
        case Resource::kPaths:
            v.array(w.paths.body), v.array(w.paths.keys), v.array(w.paths.key);
            break;
        case Resource::kTools:
            v.array(w.haptics.tool), v.array(w.haptics.trace);
            break;
        case Resource::kClock:
            v.value(w.clock.tick), v.value(w.clock.pass), v.value(w.clock.picture), v.value(w.clock.contact_rate),
                v.value(w.clock.display_rate), v.value(w.clock.period), v.value(w.clock.substep);
            break;
        case Resource::kPoses:
            v.array(w.poses.origin), v.array(w.poses.orientation), v.array(w.poses.velocity),
                v.array(w.poses.angular_velocity);
            break;
        case Resource::kParticles:
            v.array(w.particles.offset), v.array(w.particles.velocity_x), v.array(w.particles.velocity_y),
                v.array(w.particles.velocity_z), v.array(w.particles.last_dt);
            break;
        case Resource::kToolState:
            v.array(w.haptics.state), v.value(w.haptics.ticks), v.value(w.haptics.max_force),
                v.value(w.haptics.rejected_samples);
            break;
        case Resource::kBoxes:
            v.array(w.boxes.box), v.array(w.boxes.margin);
            break;
        case Resource::kPairs:
            v.array(w.pairs.a), v.array(w.pairs.b);
            break;
        case Resource::kTrees:
            break;  // opaque: see resource_hash and strip_resources
        case Resource::kScreened:
            v.array(w.screened.body), v.array(w.screened.triangle), v.array(w.screened.box), v.array(w.screened.tight);
            break;
        case Resource::kOccupancy:
            v.value(w.occupancy.cell_size), v.value(w.occupancy.origin[0]), v.value(w.occupancy.origin[1]),
                v.value(w.occupancy.origin[2]), v.array(w.occupancy.cell_key), v.array(w.occupancy.object_first),
                v.array(w.occupancy.object), v.array(w.occupancy.primitive_first), v.array(w.occupancy.primitive),
                v.array(w.occupancy.primitive_row), v.array(w.occupancy.oversize);
            break;
        case Resource::kCandidates:
            v.array(w.candidates.pair), v.array(w.candidates.triangle), v.array(w.candidates.side),
                v.array(w.candidates.near);
            break;
        case Resource::kNear:
            v.array(w.near.side), v.array(w.near.vertex), v.array(w.near.distance), v.array(w.near.triangle);
            break;
        case Resource::kContacts:
            v.array(w.contacts.pair), v.array(w.contacts.body), v.array(w.contacts.other), v.array(w.contacts.vertex),
                v.array(w.contacts.along), v.array(w.contacts.point), v.array(w.contacts.closest),
                v.array(w.contacts.normal), v.array(w.contacts.distance), v.array(w.contacts.triangle);
            break;
        case Resource::kPenetrations:
            v.array(w.penetrations.pair), v.array(w.penetrations.depth), v.array(w.penetrations.direction),
                v.array(w.penetrations.witness), v.array(w.penetrations.vertices_a_in_b),
                v.array(w.penetrations.vertices_b_in_a), v.array(w.penetrations.edge_contacts);
            break;
        case Resource::kRows:
            v.array(w.rows.contact), v.array(w.rows.body), v.array(w.rows.other), v.array(w.rows.vertex),
                v.array(w.rows.along), v.array(w.rows.triangle), v.array(w.rows.weight), v.array(w.rows.normal),
                v.array(w.rows.distance), v.array(w.rows.friction), v.array(w.rows.impulse);
            break;
        case Resource::kIslands:
            v.array(w.islands.bodies), v.array(w.islands.body), v.array(w.islands.rows), v.array(w.islands.row);
            break;
        case Resource::kNormals:
            v.array(w.normals.normal);
            break;
        case Resource::kLocalContact:
            v.array(w.local_contact);
            break;
        case Resource::kPicture:
            v.value(w.picture.number), v.value(w.picture.time), v.array(w.picture.body), v.array(w.picture.position),
                v.array(w.picture.normal), v.array(w.picture.contact_depth), v.array(w.picture.witness),
                v.array(w.picture.tool), v.value(w.picture.depth), v.value(w.picture.force);
            break;
        case Resource::kEnergy:
            v.value(w.energy.kinetic), v.value(w.energy.elastic), v.value(w.energy.gravity),
                v.value(w.energy.work_hand), v.value(w.energy.work_contact), v.value(w.energy.work_damping),
                v.value(w.energy.work_push), v.value(w.energy.work_numeric), v.value(w.energy.balance);
            break;
        case Resource::kReport:
            v.value(w.report.contact_passes), v.value(w.report.contact_events), v.value(w.report.dropped_contacts),
                v.value(w.report.oversize_triangles), v.value(w.report.tie_overflows),
                v.value(w.report.sign_disagreements), v.value(w.report.ended_rows), v.value(w.report.opposing_planes),
                v.value(w.report.nonfinite_particles), v.value(w.report.deepest_residual),
                v.value(w.report.runaway_bodies), v.value(w.report.awake_bodies), v.value(w.report.asleep_bodies),
                v.value(w.report.implicit_steps), v.value(w.report.implicit_iterations),
                v.value(w.report.worst_implicit_residual);
            break;
        case Resource::kSleep:
            v.array(w.sleep.still), v.array(w.sleep.group);
            break;
        case Resource::kCount:
            break;
    }
}

}  // namespace

const char* resource_name(Resource resource) {
    constexpr const char* kNames[] = {
        "settings", "meshes",    "springs",       "bodies",     "anchors",  "paths",        "tools",
        "clock",    "poses",     "particles",     "tool state", "boxes",    "pairs",        "trees",
        "screened", "occupancy", "candidates",    "near",       "contacts", "penetrations", "rows",
        "islands",  "normals",   "local contact", "picture",    "energy",   "report",
        "sleep"};
    static_assert(std::size(kNames) == static_cast<size_t>(Resource::kCount));
    return kNames[static_cast<size_t>(resource)];
}

uint64_t resource_hash(const World& world, Resource resource) {
    Hasher hasher;
    visit_resource(world, resource, hasher);
    if (resource == Resource::kTrees) {
        for (uint32_t body = 0; body < world.bodies.mesh.size(); ++body) {
            const auto& tree = world.trees[world.bodies.tree[body]];
            if (!tree) continue;
            const uint32_t count = world.meshes.info[world.bodies.mesh[body]].vertices.count;
            for (uint32_t v = 0; v < count; ++v) hasher.value(tree->vertex(v));
        }
    }
    return hasher.hash.value;
}

void strip_resources(World& world, ResourceMask keep) {
    Stripper stripper;
    for (uint32_t r = 0; r < static_cast<uint32_t>(Resource::kCount); ++r) {
        const Resource resource = static_cast<Resource>(r);
        if (keep & mask(resource)) continue;
        visit_resource(world, resource, stripper);
        if (resource == Resource::kTrees) world.trees.clear();
    }
}

uint64_t state_hash(const World& world) {
    Hasher hasher;
    for (const Resource r : {Resource::kClock, Resource::kPoses, Resource::kParticles, Resource::kToolState, Resource::kSleep})
        visit_resource(world, r, hasher);
    return hasher.hash.value;
}

}  // namespace trocar
