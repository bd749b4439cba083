#include <cstring>
#include <span>

#include "engine/capture_file.hpp"
#include "engine/error.hpp"
#include "engine/state_hash.hpp"
#include "engine/world.hpp"
namespace trocar {
namespace {

// Rows whose bytes are all value, as so many equal elements: hashed and stored as they lie in memory.
struct Elements {
    ArrayType type = ArrayType::kCount;  // kCount = not such a row
    uint32_t columns = 1;
};
template <typename T>
constexpr Elements elements_of() {
    using A = ArrayType;
    if constexpr (std::is_enum_v<T> || std::is_same_v<T, bool>)
        return {A::kU8};
    else if constexpr (std::is_floating_point_v<T>)
        return {sizeof(T) == 4 ? A::kF32 : A::kF64};
    else if constexpr (std::is_arithmetic_v<T>)
        return {sizeof(T) == 1 ? A::kU8 : sizeof(T) == 2 ? A::kU16 : sizeof(T) == 4 ? A::kU32 : A::kU64};
    else if constexpr (std::is_same_v<T, Range> || std::is_same_v<T, Entity> || std::is_same_v<T, std::array<uint32_t, 2>>)
        return {A::kU32, 2};
    else if constexpr (std::is_same_v<T, Triangle>)
        return {A::kU32, 3};
    else if constexpr (std::is_same_v<T, Float4>)
        return {A::kF32, 4};
    else if constexpr (std::is_same_v<T, PackedBox>)
        return {A::kF32, 8};
    else if constexpr (std::is_same_v<T, Vec3> || std::is_same_v<T, std::array<float, 3>>)
        return {A::kF32, 3};
    else if constexpr (std::is_same_v<T, std::array<Vec2, 3>>)
        return {A::kF32, 6};
    else if constexpr (std::is_same_v<T, Vec3d>)
        return {A::kF64, 3};
    else if constexpr (std::is_same_v<T, Quat>)
        return {A::kF64, 4};
    else if constexpr (std::is_same_v<T, Box>)
        return {A::kF64, 6};
    else if constexpr (std::is_same_v<T, std::array<uint32_t, 2 * kSliceWidth>>)
        return {A::kU32, 2 * kSliceWidth};
    else if constexpr (std::is_same_v<T, std::array<uint32_t, 4 * kBatchWidth>>)
        return {A::kU32, 4 * kBatchWidth};
    else if constexpr (std::is_same_v<T, std::array<uint16_t, 2 * kSliceWidth>>)
        return {A::kU16, 2 * kSliceWidth};
    else if constexpr (std::is_same_v<T, std::array<uint32_t, 4>>)
        return {A::kU32, 4};
    else if constexpr (std::is_same_v<T, std::array<double, 4>>)
        return {A::kF64, 4};
    else if constexpr (std::is_same_v<T, std::array<float, kSliceWidth>>)
        return {A::kF32, kSliceWidth};
    else if constexpr (std::is_same_v<T, Tissue>)
        return {A::kF64, sizeof(Tissue) / sizeof(double)};
    else
        return {};
}
template <typename T>
constexpr bool is_plain_row = elements_of<T>().type != ArrayType::kCount;

template <typename T>
constexpr bool is_list = false;
template <typename T, size_t count>
constexpr bool is_list<std::array<T, count>> = true;

template <typename A, typename B>
constexpr bool is = std::is_same_v<std::remove_const_t<A>, B>;

// What the other rows are made of; one list for all visitors.
template <typename V, typename T>
void fields(V& v, T& t) {
    if constexpr (is<T, MeshInfo>) {
        v.item(t.vertices), v.item(t.triangles), v.item(t.edges), v.item(t.incident), v.item(t.components);
        v.item(t.admission), v.item(t.volume), v.item(t.area), v.item(t.mean_edge), v.item(t.max_edge);
        v.item(t.radius), v.item(t.box);
    } else if constexpr (is<T, RigidMass>) {
        v.item(t.body), v.item(t.mass), v.item(t.centre), v.item(t.moments), v.item(t.axes);
    } else if constexpr (is<T, SpringInfo>) {
        v.item(t.slices), v.item(t.mean_rest), v.item(t.mean_geometry), v.item(t.varied);
        v.item(t.skin), v.item(t.packed), v.item(t.rest_unit);
    } else if constexpr (is<T, SolidInfo>) {
        v.item(t.inner), v.item(t.tetrahedra), v.item(t.count), v.item(t.slices), v.item(t.nodes), v.item(t.skin), v.item(t.varied);
    } else if constexpr (is<T, Stepping>) {
        v.item(t.integrator), v.item(t.iterations), v.item(t.tolerance), v.item(t.step);
    } else if constexpr (is<T, Image>) {
        v.item(t.width), v.item(t.height), v.item(t.rgba);
    } else if constexpr (is<T, Material>) {
        v.item(t.name), v.item(t.diffuse), v.item(t.specular), v.item(t.shininess), v.item(t.transparency);
        v.item(t.texture), v.item(t.image);
    } else if constexpr (is<T, Keyframe>) {
        v.item(t.time), v.item(t.position), v.item(t.orientation), v.item(t.jump), v.item(t.grip);
    } else if constexpr (is<T, FastBody>) {
        v.item(t.body), v.item(t.sweep.pivot), v.item(t.sweep.place), v.item(t.sweep.velocity), v.item(t.sweep.orientation);
        v.item(t.sweep.spin);
    } else if constexpr (is<T, BodyJolt>) {
        v.item(t.low), v.item(t.high);
    } else if constexpr (is<T, PointKey>) {
        v.item(t.pair), v.item(t.point);
    } else if constexpr (is<T, DeviceState>) {
        v.item(t.time), v.item(t.position), v.item(t.orientation), v.item(t.velocity), v.item(t.buttons), v.item(t.grip);
    } else if constexpr (is<T, DeviceCommand>) {
        v.item(t.force), v.item(t.torque), v.item(t.at), v.item(t.stiffness);
    } else if constexpr (is<T, DeviceLimits>) {
        v.item(t.torque), v.item(t.force_slew), v.item(t.torque_slew), v.item(t.dissipation), v.item(t.turn_dissipation),
            v.item(t.surface_age);
    } else if constexpr (is<T, Workspace>) {
        v.item(t.origin), v.item(t.turn), v.item(t.scale), v.item(t.clutch);
    } else if constexpr (is<T, Pivot>) {
        v.item(t.kind), v.item(t.point), v.item(t.length), v.item(t.axis);
    } else if constexpr (is<T, HandModel>) {
        v.item(t.mass), v.item(t.damping), v.item(t.stiffness), v.item(t.arm_damping), v.item(t.friction), v.item(t.encoder);
        v.item(t.delay), v.item(t.tremor), v.item(t.tremor_rate);
    } else if constexpr (is<T, HandModelState>) {
        v.item(t.placed), v.item(t.position), v.item(t.velocity), v.item(t.force), v.item(t.reported), v.item(t.reported_velocity);
    } else if constexpr (is<T, HapticEffect>) {
        v.item(t.kind), v.item(t.trigger), v.item(t.start), v.item(t.duration), v.item(t.buttons), v.item(t.point);
        v.item(t.direction), v.item(t.stiffness), v.item(t.damping), v.item(t.force), v.item(t.impulse), v.item(t.frequency);
        v.item(t.mass), v.item(t.reach);
    } else if constexpr (is<T, EffectState>) {
        v.item(t.running), v.item(t.since);
    } else if constexpr (is<T, HapticEvent>) {
        v.item(t.kind), v.item(t.time), v.item(t.value);
    } else if constexpr (is<T, HapticEvents>) {
        v.item(t.last), v.item(t.total), v.item(t.count);
    } else if constexpr (is<T, SafetyState>) {
        v.item(t.contact_force), v.item(t.from_device), v.item(t.from_proxy), v.item(t.energy), v.item(t.lowest_energy);
        v.item(t.dissipated), v.item(t.started), v.item(t.gain), v.item(t.limiting), v.item(t.limited_ticks), v.item(t.safe_ticks);
        v.item(t.pull), v.item(t.pull_torque), v.item(t.contact_torque), v.item(t.from_device_turn), v.item(t.from_proxy_turn),
            v.item(t.turn_energy), v.item(t.lowest_turn_energy);
    } else if constexpr (is<T, ClutchState>) {
        v.item(t.started), v.item(t.offset), v.item(t.tool);
    } else if constexpr (is<T, DeviceTrace>) {
        v.item(t.sample);
    } else if constexpr (is<T, ToolState>) {
        v.item(t.device), v.item(t.motion.once), v.item(t.motion.twice), v.item(t.proxy), v.item(t.proxy_valid), v.item(t.contacts),
            v.item(t.command), v.item(t.output);
        v.item(t.coupling_force), v.item(t.contact_impulse), v.item(t.device_valid), v.item(t.time), v.item(t.ticks);
        v.item(t.model_age), v.item(t.gain), v.item(t.largest_force), v.item(t.rejected_samples), v.item(t.touched);
        v.item(t.last_pass.touched), v.item(t.last_pass.tip), v.item(t.last_pass.device), v.item(t.pierce.body), v.item(t.pierce.seen);
        v.item(t.link_force), v.item(t.link_force_before);
        v.item(t.hand), v.item(t.clutch), v.item(t.safety), v.item(t.effect_velocity), v.item(t.effect), v.item(t.events);
        v.item(t.proxy_turn), v.item(t.contact), v.item(t.device_spin), v.item(t.coupling_torque), v.item(t.contact_moment);
        v.item(t.sliding), v.item(t.carried), v.item(t.pull), v.item(t.pull_torque), v.item(t.grip_moment), v.item(t.grip_torque);
    } else if constexpr (is<T, HapticSurface>) {
        v.item(t.body), v.item(t.stiffness), v.item(t.damping), v.item(t.static_friction), v.item(t.dynamic_friction), v.item(t.texture);
        v.item(t.height), v.item(t.length), v.item(t.along), v.item(t.deformable);
        v.item(t.origin), v.item(t.orientation), v.item(t.velocity), v.item(t.spin);
    } else if constexpr (is<T, ToolJaw>) {
        v.item(t.body), v.item(t.pivot), v.item(t.closed), v.item(t.axis), v.item(t.share);
    } else if constexpr (is<T, NodeEvent>) {
        v.item(t.kind), v.item(t.time), v.item(t.place);
    } else if constexpr (is<T, NodeEvents>) {
        v.item(t.last), v.item(t.total), v.item(t.count);
    } else if constexpr (is<T, NodeDrive>) {
        v.item(t.node), v.item(t.body), v.item(t.behaviour), v.item(t.axis), v.item(t.pivot), v.item(t.origin), v.item(t.orientation);
        v.item(t.inertia), v.item(t.lowest), v.item(t.highest), v.item(t.stiffness), v.item(t.rest), v.item(t.damping);
        v.item(t.friction), v.item(t.detents), v.item(t.detent), v.item(t.click_at), v.item(t.click_width), v.item(t.click);
    } else if constexpr (is<T, DriveState>) {
        v.item(t.place), v.item(t.rate), v.item(t.friction_impulse), v.item(t.stop_impulse), v.item(t.pressed), v.item(t.notch);
        v.item(t.limit), v.item(t.events);
    } else if constexpr (is<T, NodeSwitch>) {
        v.item(t.node), v.item(t.to), v.item(t.time), v.item(t.tool), v.item(t.buttons), v.item(t.drive), v.item(t.event);
    } else if constexpr (is<T, ToolExchange>) {
        v.item(t.from), v.item(t.to), v.item(t.time), v.item(t.buttons);
    } else if constexpr (is<T, Region>) {
        v.item(t.kind), v.item(t.a), v.item(t.b), v.item(t.radius);
    } else if constexpr (is<T, LinkGroup>) {
        v.item(t.entity), v.item(t.name), v.item(t.body), v.item(t.holder), v.item(t.phase), v.item(t.region), v.item(t.frame),
            v.item(t.material);
        v.item(t.within), v.item(t.most), v.item(t.stiffness), v.item(t.rest), v.item(t.break_strain), v.item(t.gauge);
        v.item(t.begin), v.item(t.end), v.item(t.tool), v.item(t.rows), v.item(t.made), v.item(t.broken), v.item(t.impulse);
        v.item(t.largest_force), v.item(t.largest_strain);
    } else if constexpr (is<T, TearBody>) {
        v.item(t.body), v.item(t.break_strain), v.item(t.order), v.item(t.outer), v.item(t.faces), v.item(t.whole);
    } else if constexpr (is<T, TearFace>) {
        v.item(t.corner), v.item(t.tetrahedron);
    } else if constexpr (is<T, Cut>) {
        v.item(t.tear), v.item(t.time), v.item(t.region), v.item(t.material);
    } else if constexpr (is<T, HandTool>) {
        v.item(t.body), v.item(t.tip), v.item(t.tip_radius), v.item(t.coupling_stiffness), v.item(t.coupling_damping);
        v.item(t.max_force), v.item(t.friction), v.item(t.path), v.item(t.trace);
        v.item(t.pass_through), v.item(t.hand), v.item(t.workspace), v.item(t.pivot), v.item(t.limits), v.item(t.effects);
        v.item(t.jaws), v.item(t.grip_closed);
        v.item(t.shell), v.item(t.shell_radius), v.item(t.turn_stiffness), v.item(t.turn_damping), v.item(t.inertia),
            v.item(t.surface_stiffness), v.item(t.shell_jaw);
    } else if constexpr (is<T, ShellPoint>) {
        v.item(t.arm), v.item(t.inward), v.item(t.jaw);
    } else if constexpr (is<T, ShellContact>) {
        v.item(t.point), v.item(t.body), v.item(t.arm), v.item(t.force), v.item(t.slip), v.item(t.depth), v.item(t.side), v.item(t.sliding);
    } else if constexpr (is<T, SurfaceNode>) {
        v.item(t.low), v.item(t.high), v.item(t.velocity_low), v.item(t.velocity_high), v.item(t.speed), v.item(t.part), v.item(t.lanes);
    } else if constexpr (is<T, SurfaceTree>) {
        v.item(t.body), v.item(t.root), v.item(t.half_thickness);
    } else if constexpr (is<T, TriangleLanes>) {
        v.item(t.corner), v.item(t.velocity);
    } else if constexpr (is<T, GroupBalls>) {
        v.item(t.centre), v.item(t.velocity), v.item(t.radius), v.item(t.spread), v.item(t.speed);
    } else if constexpr (is<T, TriangleGroup>) {
        v.item(t.triangles), v.item(t.body), v.item(t.half_thickness), v.item(t.centre), v.item(t.radius), v.item(t.velocity),
            v.item(t.spread);
    } else if constexpr (is<T, LocalContactModel>) {
        v.item(t.time), v.item(t.sequence), v.item(t.from), v.item(t.to), v.item(t.reach), v.item(t.fastest);
        v.item(t.position), v.item(t.velocity), v.item(t.triangle), v.item(t.neighbour), v.item(t.body);
        v.item(t.half_thickness), v.item(t.lanes), v.item(t.group), v.item(t.block), v.item(t.cluster), v.item(t.ball),
            v.item(t.cluster_ball), v.item(t.give.body), v.item(t.give.share), v.item(t.give.normal);
        v.item(t.give.device), v.item(t.give.device_velocity), v.item(t.give.time), v.item(t.give.gap);
        v.item(t.pull), v.item(t.pull_before), v.item(t.period);
        v.item(t.shell.tip), v.item(t.shell.turn), v.item(t.shell.grip), v.item(t.shell.node), v.item(t.shell.tree), v.item(t.shell.clear),
            v.item(t.shell.nearest);
        v.item(t.shell.place), v.item(t.shell.speed), v.item(t.shell.around), v.item(t.shell.ahead);
        v.item(t.surface), v.item(t.in_hand);
    } else if constexpr (is<T, PictureBody>) {
        v.item(t.mesh), v.item(t.origin), v.item(t.orientation), v.item(t.motion), v.item(t.box), v.item(t.vertices), v.item(t.depths),
            v.item(t.removed), v.item(t.exposed);
    } else if constexpr (is<T, PictureWitness>) {
        v.item(t.point), v.item(t.closest), v.item(t.depth);
    } else if constexpr (is<T, PictureTool>) {
        v.item(t.device), v.item(t.proxy), v.item(t.radius), v.item(t.force);
    } else if constexpr (is_list<std::remove_const_t<T>>) {
        for (auto& element : t) v.item(element);
    } else {
        static_assert(is_plain_row<std::remove_const_t<T>>, "a row of an unknown kind");
    }
}

// Adds what a resource holds to a hash.
struct Hasher {
    StateHash hash;
    template <typename T>
    void array(const char*, const std::vector<T>& rows) {
        item(rows);
    }
    template <typename T>
    void value(const char*, const T& v) {
        item(v);
    }
    void item(const std::string& text) { hash.add_word(text.size()), hash.add_bytes(text.data(), text.size()); }
    template <typename T>
    void item(const std::vector<T>& rows) {
        hash.add_word(rows.size());
        if constexpr (is_plain_row<T>) {
            hash.add_bytes(rows.data(), rows.size() * sizeof(T));
        } else {
            for (const T& row : rows) item(row);
        }
    }
    template <typename T>
    void item(const T& v) {
        if constexpr (is_plain_row<T>)
            hash.add_bytes(&v, sizeof v);
        else
            fields(*this, v);
    }
};

// Empties what a resource holds: arrays to no rows, numbers to values that show when used.
struct Stripper {
    template <typename T>
    void array(const char*, std::vector<T>& rows) {
        rows.clear();
        rows.shrink_to_fit();
    }
    template <typename T>
    void value(const char*, T& v) {
        if constexpr (std::is_floating_point_v<T>)
            v = std::nan("");
        else
            v = T{};
    }
};

// Stores a resource as named arrays, over those of the record from row `at` on; rows that are not plain become one stream
// of bytes, their number first.
struct Saver {
    CaptureRecord& record;
    size_t at;
    std::vector<std::byte> stream;
    void store(const char* name, ArrayType type, uint64_t rows, uint32_t columns, const void* data) {
        if (at == record.arrays.size()) record.arrays.emplace_back();
        CaptureArray& a = record.arrays[at++];
        a.name = name, a.type = type, a.rows = rows, a.columns = columns;
        const std::byte* bytes = static_cast<const std::byte*>(data);
        a.bytes.assign(bytes, bytes + rows * columns * element_size(type));
    }
    template <typename T>
    void array(const char* name, const std::vector<T>& rows) {
        if constexpr (is_plain_row<T>) {
            constexpr Elements e = elements_of<T>();
            static_assert(sizeof(T) == e.columns * element_size(e.type));
            store(name, e.type, rows.size(), e.columns, rows.data());
        } else {
            value(name, rows);
        }
    }
    template <typename T>
    void value(const char* name, const T& v) {
        stream.clear();
        item(v);
        store(name, ArrayType::kU8, stream.size(), 1, stream.data());
    }
    void bytes(const void* data, size_t size) {
        const std::byte* from = static_cast<const std::byte*>(data);
        stream.insert(stream.end(), from, from + size);
    }
    void count(uint64_t rows) { bytes(&rows, sizeof rows); }
    void item(const std::string& text) { count(text.size()), bytes(text.data(), text.size()); }
    template <typename T>
    void item(const std::vector<T>& rows) {
        count(rows.size());
        for (const T& row : rows) item(row);
    }
    template <typename T>
    void item(const T& v) {
        if constexpr (is_plain_row<T>)
            bytes(&v, sizeof v);
        else
            fields(*this, v);
    }
};

// Reads back what Saver stored.
struct Loader {
    const CaptureRecord& record;
    const char* name = "";
    std::span<const std::byte> stream;
    template <typename T>
    void array(const char* field, std::vector<T>& rows) {
        if constexpr (is_plain_row<T>) {
            constexpr Elements e = elements_of<T>();
            const CaptureArray& a = find_array(record, field, e.type, e.columns);
            rows.resize(a.rows);
            if (a.rows > 0) std::memcpy(static_cast<void*>(rows.data()), a.bytes.data(), a.bytes.size());
        } else {
            value(field, rows);
        }
    }
    template <typename T>
    void value(const char* field, T& v) {
        name = field;
        stream = find_array(record, field, ArrayType::kU8, 1).bytes;
        item(v);
        if (!stream.empty()) refuse();
    }
    [[noreturn]] void refuse() const {
        throw InputError("record " + record.kind + ": array " + name + " is not what this program stores there");
    }
    void bytes(void* data, size_t size) {
        if (stream.size() < size) refuse();
        if (size > 0) std::memcpy(data, stream.data(), size);
        stream = stream.subspan(size);
    }
    size_t count() {
        uint64_t rows = 0;
        bytes(&rows, sizeof rows);
        if (rows > stream.size()) refuse();  // a row has a byte at least
        return rows;
    }
    void item(std::string& text) { text.resize(count()), bytes(text.data(), text.size()); }
    template <typename T>
    void item(std::vector<T>& rows) {
        rows.clear();
        for (size_t left = count(); left > 0; --left) item(rows.emplace_back());
    }
    void item(bool& v) {
        uint8_t byte = 0;
        bytes(&byte, 1);
        v = byte != 0;
    }
    template <typename T>
    void item(T& v) {
        if constexpr (is_plain_row<T>)
            bytes(static_cast<void*>(&v), sizeof v);
        else
            fields(*this, v);
    }
};

// A field of the world and its name in files.
#define FIELD(field) #field, w.field

// The one list of what belongs to which resource.
template <typename World, typename Visitor>
void visit_resource(World& w, Resource resource, Visitor& v) {
    switch (resource) {
        case Resource::kSettings:
            v.value(FIELD(settings.gravity[0])), v.value(FIELD(settings.gravity[1])), v.value(FIELD(settings.gravity[2])),
                v.value(FIELD(settings.substep)), v.value(FIELD(settings.sleep_speed)), v.value(FIELD(settings.sleep_after)),
                v.value(FIELD(settings.contact.tolerance)), v.value(FIELD(settings.contact.push_speed)),
                v.value(FIELD(settings.contact.cell_edges)), v.value(FIELD(settings.contact.iterations)),
                v.value(FIELD(settings.contact.row_capacity)), v.value(FIELD(settings.contact.share)),
                v.value(FIELD(settings.contact.direction)), v.value(FIELD(settings.contact.deep)), v.value(FIELD(settings.contact.faces)),
                v.value(FIELD(settings.contact.edges_ahead)), v.value(FIELD(settings.contact.contours)),
                v.value(FIELD(settings.contact.regions)), v.value(FIELD(settings.contact.cross_check));
            break;
        case Resource::kMeshes:
            v.array(FIELD(meshes.name)), v.array(FIELD(meshes.info)), v.array(FIELD(meshes.position)), v.array(FIELD(meshes.component)),
                v.array(FIELD(meshes.triangle)), v.array(FIELD(meshes.neighbour)), v.array(FIELD(meshes.triangle_edge)),
                v.array(FIELD(meshes.edge)), v.array(FIELD(meshes.edge_triangle)), v.array(FIELD(meshes.incident_first)),
                v.array(FIELD(meshes.incident)), v.array(FIELD(meshes.uv)), v.array(FIELD(meshes.triangle_material)),
                v.array(FIELD(meshes.materials)), v.array(FIELD(meshes.material));
            break;
        case Resource::kSprings:
            v.array(FIELD(springs.info)), v.array(FIELD(springs.slice_column)), v.array(FIELD(springs.neighbour)),
                v.array(FIELD(springs.rest_length)), v.array(FIELD(springs.colours)), v.array(FIELD(springs.colour)),
                v.array(FIELD(springs.batch)), v.array(FIELD(springs.batch_rest)), v.array(FIELD(springs.batch_factor)),
                v.array(FIELD(springs.factor)), v.array(FIELD(springs.packed)), v.array(FIELD(springs.area_share)),
                v.array(FIELD(springs.vertices)), v.array(FIELD(springs.fans.first)), v.array(FIELD(springs.fans.volume)),
                v.array(FIELD(springs.fans.column)), v.array(FIELD(springs.fans.corner)), v.array(FIELD(springs.hinges.groups)),
                v.array(FIELD(springs.hinges.vertex)), v.array(FIELD(springs.hinges.sine)), v.array(FIELD(springs.hinges.cosine)),
                v.array(FIELD(springs.hinges.weight)), v.array(FIELD(springs.hinges.cap)), v.array(FIELD(springs.hinges.first)),
                v.array(FIELD(springs.hinges.column)), v.array(FIELD(springs.hinges.slot)), v.array(FIELD(springs.batch_half_edge));
            break;
        case Resource::kSolids:
            v.array(FIELD(solids.info)), v.array(FIELD(solids.position)), v.array(FIELD(solids.corner[0])),
                v.array(FIELD(solids.corner[1])), v.array(FIELD(solids.corner[2])), v.array(FIELD(solids.corner[3])),
                v.array(FIELD(solids.rest)), v.array(FIELD(solids.per_rest)), v.array(FIELD(solids.factor)),
                v.array(FIELD(solids.slot_column)), v.array(FIELD(solids.colours)), v.array(FIELD(solids.colour)),
                v.array(FIELD(solids.batch)), v.array(FIELD(solids.batch_volume)), v.array(FIELD(solids.batch_factor)),
                v.array(FIELD(solids.batch_tetrahedron)), v.array(FIELD(solids.slot)), v.array(FIELD(solids.node_volume)),
                v.array(FIELD(solids.skin_node)), v.array(FIELD(solids.skin_weight));
            break;
        case Resource::kBodies:
            v.array(FIELD(bodies.entity)), v.array(FIELD(bodies.name)), v.array(FIELD(bodies.mesh)), v.array(FIELD(bodies.motion)),
                v.array(FIELD(bodies.particles)), v.array(FIELD(bodies.tree)), v.array(FIELD(bodies.anchor_frame)),
                v.array(FIELD(bodies.tissue)), v.array(FIELD(bodies.spring_stiffness)), v.array(FIELD(bodies.inv_mass)),
                v.array(FIELD(bodies.stable_dt)), v.array(FIELD(bodies.thickness)), v.array(FIELD(bodies.rigid_mass)),
                v.array(FIELD(bodies.stepping));
            break;
        case Resource::kAnchors:
            v.array(FIELD(anchors.stiffness)), v.array(FIELD(anchors.rest_x)), v.array(FIELD(anchors.rest_y)),
                v.array(FIELD(anchors.rest_z));
            break;
        case Resource::kPaths:
            v.array(FIELD(paths.body)), v.array(FIELD(paths.keys)), v.array(FIELD(paths.key));
            break;
        case Resource::kTools:
            v.array(FIELD(haptics.tool)), v.array(FIELD(haptics.trace)), v.array(FIELD(haptics.effect));
            v.array(FIELD(haptics.surface)), v.array(FIELD(haptics.jaw));
            break;
        case Resource::kClock:
            v.value(FIELD(clock.tick)), v.value(FIELD(clock.pass)), v.value(FIELD(clock.picture)), v.value(FIELD(clock.contact_rate)),
                v.value(FIELD(clock.display_rate)), v.value(FIELD(clock.period));
            {
                double unused = 1e-3;  // part of the format and of every hash
                v.value("clock.substep", unused);
            }
            break;
        case Resource::kPoses:
            v.array(FIELD(poses.origin)), v.array(FIELD(poses.orientation)), v.array(FIELD(poses.velocity)),
                v.array(FIELD(poses.angular_velocity));
            break;
        case Resource::kParticles:
            v.array(FIELD(particles.offset)), v.array(FIELD(particles.velocity_x)), v.array(FIELD(particles.velocity_y)),
                v.array(FIELD(particles.velocity_z)), v.array(FIELD(particles.last_dt));
            break;
        case Resource::kToolState:
            v.array(FIELD(haptics.state)), v.value(FIELD(haptics.ticks)), v.value(FIELD(haptics.max_force)),
                v.value(FIELD(haptics.rejected_samples));
            break;
        case Resource::kPairMemory:
            v.array(FIELD(pair_memory.a)), v.array(FIELD(pair_memory.b)), v.array(FIELD(pair_memory.direction));
            break;
        case Resource::kContactMemory:
            v.array(FIELD(contact_memory.body)), v.array(FIELD(contact_memory.other)), v.array(FIELD(contact_memory.vertex)),
                v.array(FIELD(contact_memory.along)), v.array(FIELD(contact_memory.force));
            break;
        case Resource::kBoxes:
            v.array(FIELD(boxes.box)), v.array(FIELD(boxes.margin)), v.array(FIELD(boxes.speed));
            break;
        case Resource::kPairs:
            v.array(FIELD(pairs.a)), v.array(FIELD(pairs.b));
            break;
        case Resource::kTrees:
            break;  // opaque: see resource_hash and strip_resources
        case Resource::kScreened:
            v.array(FIELD(screened.body)), v.array(FIELD(screened.triangle)), v.array(FIELD(screened.box)), v.array(FIELD(screened.tight));
            break;
        case Resource::kOccupancy:
            v.value(FIELD(occupancy.cell_size)), v.value(FIELD(occupancy.origin[0])), v.value(FIELD(occupancy.origin[1])),
                v.value(FIELD(occupancy.origin[2])), v.array(FIELD(occupancy.cell_key)), v.array(FIELD(occupancy.object_first)),
                v.array(FIELD(occupancy.object)), v.array(FIELD(occupancy.primitive_first)), v.array(FIELD(occupancy.primitive)),
                v.array(FIELD(occupancy.primitive_row)), v.array(FIELD(occupancy.oversize));
            break;
        case Resource::kCandidates:
            v.array(FIELD(candidates.pair)), v.array(FIELD(candidates.triangle)), v.array(FIELD(candidates.beside)),
                v.array(FIELD(candidates.side)), v.array(FIELD(candidates.near)), v.array(FIELD(candidates.near_corners));
            break;
        case Resource::kNear:
            v.array(FIELD(near.side)), v.array(FIELD(near.vertex)), v.array(FIELD(near.distance)), v.array(FIELD(near.triangle));
            break;
        case Resource::kContacts:
            v.array(FIELD(contacts.pair)), v.array(FIELD(contacts.body)), v.array(FIELD(contacts.other)), v.array(FIELD(contacts.vertex)),
                v.array(FIELD(contacts.along)), v.array(FIELD(contacts.third)), v.array(FIELD(contacts.across)),
                v.array(FIELD(contacts.point)), v.array(FIELD(contacts.closest)), v.array(FIELD(contacts.normal)),
                v.array(FIELD(contacts.distance)), v.array(FIELD(contacts.triangle)), v.array(FIELD(contacts.most));
            break;
        case Resource::kPenetrations:
            v.array(FIELD(penetrations.pair)), v.array(FIELD(penetrations.depth)), v.array(FIELD(penetrations.direction)),
                v.array(FIELD(penetrations.witness)), v.array(FIELD(penetrations.vertices_a_in_b)),
                v.array(FIELD(penetrations.vertices_b_in_a)), v.array(FIELD(penetrations.edge_contacts)),
                v.array(FIELD(penetrations.face_contacts)), v.array(FIELD(penetrations.saturated)), v.array(FIELD(penetrations.way_out)),
                v.array(FIELD(penetrations.surface_depth));
            break;
        case Resource::kContours:
            v.array(FIELD(contours.pair)), v.array(FIELD(contours.curve)), v.array(FIELD(contours.closed)),
                v.array(FIELD(contours.triangle)), v.array(FIELD(contours.end)), v.array(FIELD(contours.point)),
                v.array(FIELD(contours.edge)), v.array(FIELD(contours.edge_of_b)), v.array(FIELD(contours.pierced)),
                v.array(FIELD(contours.along)), v.array(FIELD(contours.outward));
            break;
        case Resource::kRegions:
            v.array(FIELD(regions.pair)), v.array(FIELD(regions.vertices_a)), v.array(FIELD(regions.vertices_b)),
                v.array(FIELD(regions.curves)), v.array(FIELD(regions.contour)), v.array(FIELD(regions.area)),
                v.array(FIELD(regions.volume)), v.array(FIELD(regions.depth)), v.array(FIELD(regions.direction)),
                v.array(FIELD(regions.witness));
            break;
        case Resource::kRows:
            v.array(FIELD(rows.contact)), v.array(FIELD(rows.body)), v.array(FIELD(rows.other)), v.array(FIELD(rows.vertex)),
                v.array(FIELD(rows.along)), v.array(FIELD(rows.third)), v.array(FIELD(rows.across)), v.array(FIELD(rows.triangle)),
                v.array(FIELD(rows.weight)), v.array(FIELD(rows.normal)), v.array(FIELD(rows.distance)), v.array(FIELD(rows.friction)),
                v.array(FIELD(rows.impulse)), v.array(FIELD(rows.carried));
            break;
        case Resource::kIslands:
            v.array(FIELD(islands.bodies)), v.array(FIELD(islands.body)), v.array(FIELD(islands.rows)), v.array(FIELD(islands.row));
            break;
        case Resource::kNormals:
            v.array(FIELD(normals.normal));
            break;
        case Resource::kLocalContact:
            v.array(FIELD(local_contact));
            break;
        case Resource::kPicture:
            v.value(FIELD(picture.number)), v.value(FIELD(picture.time)), v.array(FIELD(picture.body)), v.array(FIELD(picture.position)),
                v.array(FIELD(picture.normal)), v.array(FIELD(picture.contact_depth)), v.array(FIELD(picture.removed)),
                v.array(FIELD(picture.exposed)), v.array(FIELD(picture.witness)), v.array(FIELD(picture.tool)),
                v.value(FIELD(picture.depth)), v.value(FIELD(picture.force));
            break;
        case Resource::kEnergy:
            v.value(FIELD(energy.kinetic)), v.value(FIELD(energy.elastic)), v.value(FIELD(energy.pressure)), v.value(FIELD(energy.bending)),
                v.value(FIELD(energy.links)), v.value(FIELD(energy.gravity)), v.value(FIELD(energy.work_hand)),
                v.value(FIELD(energy.work_contact)), v.value(FIELD(energy.work_damping)), v.value(FIELD(energy.work_push)),
                v.value(FIELD(energy.work_numeric)), v.value(FIELD(energy.work_links)), v.value(FIELD(energy.balance));
            break;
        case Resource::kReport:
            v.value(FIELD(report.contact_passes)), v.value(FIELD(report.contact_events)), v.value(FIELD(report.dropped_contacts)),
                v.value(FIELD(report.oversize_triangles)), v.value(FIELD(report.tie_overflows)), v.value(FIELD(report.sign_disagreements)),
                v.value(FIELD(report.disagreements)), v.value(FIELD(report.ended_rows)), v.value(FIELD(report.opposing_planes)),
                v.value(FIELD(report.nonfinite_particles)), v.value(FIELD(report.deepest_residual)),
                v.value(FIELD(report.min_volume_ratio)), v.value(FIELD(report.runaway_bodies)), v.value(FIELD(report.awake_bodies)),
                v.value(FIELD(report.asleep_bodies)), v.value(FIELD(report.implicit_steps)), v.value(FIELD(report.implicit_iterations)),
                v.value(FIELD(report.links)), v.value(FIELD(report.broken_links)), v.value(FIELD(report.broken_springs)),
                v.value(FIELD(report.removed_triangles)), v.value(FIELD(report.removed_tetrahedra)), v.value(FIELD(report.opened_bodies)),
                v.value(FIELD(report.worst_implicit_residual));
            break;
        case Resource::kSleep:
            v.array(FIELD(sleep.still)), v.array(FIELD(sleep.group));
            break;
        case Resource::kLinks:
            v.array(FIELD(links.group)), v.array(FIELD(links.node)), v.array(FIELD(links.far_node)), v.array(FIELD(links.point)),
                v.array(FIELD(links.rest)), v.array(FIELD(links.stretch)), v.array(FIELD(links.whole)), v.array(FIELD(links.stable_dt));
            break;
        case Resource::kTears:
            v.array(FIELD(tears.body)), v.array(FIELD(tears.cut)), v.array(FIELD(tears.order)), v.array(FIELD(tears.face));
            break;
        case Resource::kTorn:
            v.array(FIELD(torn.spring)), v.array(FIELD(torn.triangle)), v.array(FIELD(torn.cut)), v.array(FIELD(torn.tetrahedron));
            break;
        case Resource::kTornSprings:
            v.array(FIELD(torn_springs.neighbour)), v.array(FIELD(torn_springs.rest_length)), v.array(FIELD(torn_springs.factor)),
                v.array(FIELD(torn_springs.rest)), v.array(FIELD(torn_springs.per_rest));
            break;
        case Resource::kPools:
            v.array(FIELD(pools.slots)), v.array(FIELD(pools.rate)), v.array(FIELD(pools.life)), v.array(FIELD(pools.orientation));
            break;
        case Resource::kLives:
            v.array(FIELD(lives.away)), v.array(FIELD(lives.generation)), v.array(FIELD(lives.since)), v.array(FIELD(lives.came));
            break;
        case Resource::kNodes:
            v.array(FIELD(nodes.name)), v.array(FIELD(nodes.parent)), v.array(FIELD(nodes.of_body)), v.array(FIELD(nodes.drive)),
                v.array(FIELD(nodes.toggle)), v.array(FIELD(nodes.exchange)), v.array(FIELD(nodes.apart));
            break;
        case Resource::kNodeState:
            v.array(FIELD(node_state.enabled)), v.array(FIELD(node_state.laid_down)), v.array(FIELD(node_state.off)),
                v.array(FIELD(node_state.seen)), v.array(FIELD(node_state.drive));
            break;
        case Resource::kDetail:
            v.array(FIELD(detail.body)), v.array(FIELD(detail.beyond)), v.array(FIELD(detail.seen)), v.array(FIELD(detail.near)),
                v.array(FIELD(detail.far)), v.array(FIELD(detail.eye));
            break;
        case Resource::kLiveDevices:
            v.array(FIELD(live_devices));
            break;
        case Resource::kEnergyStart:
            v.value(FIELD(energy_start.known)), v.value(FIELD(energy_start.sum));
            break;
        case Resource::kDevices:
            v.value(FIELD(devices.per_tool)), v.array(FIELD(devices.intended)), v.array(FIELD(devices.placed));
            break;
        case Resource::kFastBodies:
            v.array(FIELD(fast_bodies));
            break;
        case Resource::kImpactTimes:
            v.array(FIELD(impact_times));
            break;
        case Resource::kJoinedBodies:
            v.array(FIELD(joined_bodies));
            break;
        case Resource::kExcludedPairs:
            v.array(FIELD(excluded_pairs));
            break;
        case Resource::kBoxPairs:
            v.array(FIELD(box_pairs.a)), v.array(FIELD(box_pairs.b));
            break;
        case Resource::kDisplacementBounds:
            v.array(FIELD(displacement_bounds));
            break;
        case Resource::kMemoryOrder:
            v.array(FIELD(memory_order.order)), v.array(FIELD(memory_order.key));
            break;
        case Resource::kLoadedRows:
            v.array(FIELD(loaded_rows));
            break;
        case Resource::kHoldingGroups:
            v.array(FIELD(holding_groups.first)), v.array(FIELD(holding_groups.group));
            break;
        case Resource::kCount:
            break;
    }
}

#undef FIELD

}  // namespace

ResourceKind resource_kind(Resource resource) {
    switch (resource) {
        case Resource::kSettings:
        case Resource::kMeshes:
        case Resource::kSprings:
        case Resource::kSolids:
        case Resource::kBodies:
        case Resource::kAnchors:
        case Resource::kPaths:
        case Resource::kTears:
        case Resource::kTools:
        case Resource::kPools:
        case Resource::kNodes:
        case Resource::kDetail:
            return ResourceKind::kConstant;
        case Resource::kClock:
        case Resource::kPoses:
        case Resource::kParticles:
        case Resource::kToolState:
        case Resource::kPairMemory:
        case Resource::kContactMemory:
        case Resource::kLinks:
        case Resource::kTorn:
        case Resource::kSleep:
        case Resource::kLives:
        case Resource::kNodeState:
            return ResourceKind::kState;
        case Resource::kLiveDevices:
        case Resource::kEnergyStart:
            return ResourceKind::kRun;
        case Resource::kEnergy:
        case Resource::kReport:
            return ResourceKind::kBooks;
        case Resource::kBoxes:
        case Resource::kPairs:
        case Resource::kTrees:
        case Resource::kScreened:
        case Resource::kOccupancy:
        case Resource::kCandidates:
        case Resource::kNear:
        case Resource::kContacts:
        case Resource::kPenetrations:
        case Resource::kContours:
        case Resource::kRegions:
        case Resource::kRows:
        case Resource::kIslands:
        case Resource::kTornSprings:
        case Resource::kNormals:
        case Resource::kDevices:
        case Resource::kFastBodies:
        case Resource::kImpactTimes:
        case Resource::kJoinedBodies:
        case Resource::kExcludedPairs:
        case Resource::kBoxPairs:
        case Resource::kDisplacementBounds:
        case Resource::kMemoryOrder:
        case Resource::kLoadedRows:
        case Resource::kHoldingGroups:
            return ResourceKind::kDerived;
        case Resource::kLocalContact:
        case Resource::kPicture:
        case Resource::kCount:
            break;
    }
    return ResourceKind::kOutput;
}

const char* resource_name(Resource resource) {
    constexpr const char* kNames[] = {"settings",       "meshes",         "springs",
                                      "solids",         "bodies",         "anchors",
                                      "paths",          "tools",          "clock",
                                      "poses",          "particles",      "tool state",
                                      "pair memory",    "contact memory", "boxes",
                                      "pairs",          "trees",          "screened",
                                      "occupancy",      "candidates",     "near",
                                      "contacts",       "penetrations",   "contours",
                                      "regions",        "rows",           "islands",
                                      "normals",        "local contact",  "picture",
                                      "energy",         "report",         "sleep",
                                      "links",          "tears",          "torn",
                                      "torn springs",   "pools",          "lives",
                                      "nodes",          "node state",     "detail",
                                      "live devices",   "energy start",   "devices",
                                      "fast bodies",    "impact times",   "joined bodies",
                                      "excluded pairs", "box pairs",      "displacement bounds",
                                      "memory order",   "loaded rows",    "holding groups"};
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
            for (uint32_t v = 0; v < count; ++v) hasher.item(tree->vertex(v));
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

void save_resource(const World& world, Resource resource, CaptureRecord& record) {
    save_resource(world, resource, record, record.arrays.size());
}

size_t save_resource(const World& world, Resource resource, CaptureRecord& record, size_t at) {
    Saver saver{record, at, {}};
    visit_resource(world, resource, saver);
    return saver.at;
}

void load_resource(const CaptureRecord& record, Resource resource, World& world) {
    Loader loader{record, "", {}};
    visit_resource(world, resource, loader);
}

uint64_t state_hash(const World& world) {
    Hasher hasher;
    for (uint32_t r = 0; r < static_cast<uint32_t>(Resource::kCount); ++r)
        if (resource_kind(static_cast<Resource>(r)) == ResourceKind::kState) visit_resource(world, static_cast<Resource>(r), hasher);
    return hasher.hash.value;
}

}  // namespace trocar
