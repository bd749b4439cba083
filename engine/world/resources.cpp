#include <cmath>
#include <cstdio>
#include <cstring>
#include <span>

#include "engine/base/check.hpp"
#include "engine/base/error.hpp"
#include "engine/files/capture_file.hpp"
#include "engine/files/state_hash.hpp"
#include "engine/world/arrays.hpp"
#include "engine/world/world.hpp"
namespace trocar {
namespace {

// Element types without padding, as so many equal numbers: hashed and stored as they are in memory.
struct Elements {
    ArrayType type = ArrayType::kCount;  // kCount = not such a type
    uint32_t columns = 1;
};
template <typename T, typename... Others>
constexpr bool is_one_of = (std::is_same_v<T, Others> || ...);

template <typename T>
constexpr Elements elements_of() {
    using A = ArrayType;
    const auto all = [](A type) { return Elements{type, static_cast<uint32_t>(sizeof(T) / element_size(type))}; };
    if constexpr (std::is_floating_point_v<T>)
        return {sizeof(T) == 4 ? A::kF32 : A::kF64};
    else if constexpr (std::is_enum_v<T> || std::is_arithmetic_v<T>)
        return {sizeof(T) == 1 ? A::kU8 : sizeof(T) == 2 ? A::kU16 : sizeof(T) == 4 ? A::kU32 : A::kU64};
    else if constexpr (is_one_of<T, std::array<uint16_t, 2 * kSliceWidth>>)
        return all(A::kU16);
    else if constexpr (is_one_of<T, Range, Entity, Triangle, std::array<uint32_t, 2>, std::array<uint32_t, 4>,
                                 std::array<uint32_t, 2 * kSliceWidth>>)
        return all(A::kU32);
    else if constexpr (is_one_of<T, Float4, PackedBox, Vec3, std::array<float, 3>, std::array<Vec2, 3>, std::array<float, kSliceWidth>>)
        return all(A::kF32);
    else if constexpr (is_one_of<T, Vec3d, Quat, Box, std::array<double, 4>, Tissue>)
        return all(A::kF64);
    else
        return {};
}
template <typename T>
constexpr bool is_plain_row = elements_of<T>().type != ArrayType::kCount;

template <typename T>
constexpr bool is_list = false;
template <typename T, size_t count>
constexpr bool is_list<std::array<T, count>> = true;

template <typename T>
constexpr bool is_vector = false;
template <typename T>
constexpr bool is_vector<std::vector<T>> = true;
template <typename T>
constexpr bool is_plain_array = false;
template <typename T>
constexpr bool is_plain_array<std::vector<T>> = is_plain_row<T>;

// each_field of a struct whose lists are complete.
template <typename T, typename Visit>
void each_member(T& t, const Visit& visit) {
    static_assert(lists_every_member<std::remove_const_t<T>>(), "a member is missing in TROCAR_FIELDS of this struct");
    each_field(t, visit);
}
static_assert(lists_every_member<Tissue>());  // a plain element

// Passes the members of an element that is not plain to a visitor.
template <typename Visitor, typename T>
void visit_items(Visitor& v, T& entry) {
    if constexpr (is_list<std::remove_const_t<T>>) {
        for (auto& element : entry) v.item(element);
    } else {
        each_member(entry, [&](const FieldName&, auto& member) { v.item(member); });
    }
}

// Adds the data of a resource to a hash.
struct Hasher {
    StateHash hash;
    template <typename T>
    void member(const char*, const T& v) {
        item(v);
    }
    void item(const std::string& text) { hash.add_word(text.size()), hash.add_bytes(text.data(), text.size()); }
    template <typename T>
    void item(const std::vector<T>& elements) {
        hash.add_word(elements.size());
        if constexpr (is_plain_row<T>) {
            hash.add_bytes(elements.data(), elements.size() * sizeof(T));
        } else {
            for (const T& entry : elements) item(entry);
        }
    }
    template <typename T>
    void item(const T& v) {
        if constexpr (is_plain_row<T>)
            hash.add_bytes(&v, sizeof v);
        else
            visit_items(*this, v);
    }
};

// Clears the data of a resource: arrays become empty, numbers get values that are noticed when used.
struct Stripper {
    template <typename T>
    void member(const char*, T& v) {
        v = T{};
        if constexpr (std::is_floating_point_v<T>) v = std::nan("");
    }
};

// Stores a resource as named arrays, over those of the record from index `at` on; elements that are not plain
// become one stream of bytes, preceded by their number.
struct Saver {
    CaptureRecord& record;
    size_t at;
    std::vector<std::byte> stream;
    void store(const char* name, ArrayType type, uint64_t elements, uint32_t columns, const void* data) {
        if (at == record.arrays.size()) record.arrays.emplace_back();
        CaptureArray& a = record.arrays[at++];
        a.name = name, a.type = type, a.rows = elements, a.columns = columns;
        const std::byte* bytes = static_cast<const std::byte*>(data);
        a.bytes.assign(bytes, bytes + elements * columns * element_size(type));
    }
    template <typename T>
    void member(const char* name, const T& v) {
        if constexpr (is_plain_array<T>) {
            constexpr Elements e = elements_of<typename T::value_type>();
            static_assert(sizeof v[0] == e.columns * element_size(e.type));
            store(name, e.type, v.size(), e.columns, v.data());
        } else {
            stream.clear();
            item(v);
            store(name, ArrayType::kU8, stream.size(), 1, stream.data());
        }
    }
    void bytes(const void* data, size_t size) {
        const std::byte* from = static_cast<const std::byte*>(data);
        stream.insert(stream.end(), from, from + size);
    }
    void count(uint64_t elements) { bytes(&elements, sizeof elements); }
    void item(const std::string& text) { count(text.size()), bytes(text.data(), text.size()); }
    template <typename T>
    void item(const std::vector<T>& elements) {
        count(elements.size());
        for (const T& entry : elements) item(entry);
    }
    template <typename T>
    void item(const T& v) {
        if constexpr (is_plain_row<T>)
            bytes(&v, sizeof v);
        else
            visit_items(*this, v);
    }
};

// Reads back what Saver stored.
struct Loader {
    const CaptureRecord& record;
    const char* name = "";
    std::span<const std::byte> stream;
    template <typename T>
    void member(const char* field, T& v) {
        if constexpr (is_plain_array<T>) {
            constexpr Elements e = elements_of<typename T::value_type>();
            const CaptureArray& a = find_array(record, field, e.type, e.columns);
            v.resize(a.rows);
            if (a.rows > 0) std::memcpy(static_cast<void*>(v.data()), a.bytes.data(), a.bytes.size());
        } else {
            name = field;
            stream = find_array(record, field, ArrayType::kU8, 1).bytes;
            item(v);
            if (!stream.empty()) refuse();
        }
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
        uint64_t elements = 0;
        bytes(&elements, sizeof elements);
        if (elements > stream.size()) refuse();  // an element has at least one byte
        return elements;
    }
    void item(std::string& text) { text.resize(count()), bytes(text.data(), text.size()); }
    template <typename T>
    void item(std::vector<T>& elements) {
        elements.clear();
        for (size_t left = count(); left > 0; --left) item(elements.emplace_back());
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
            visit_items(*this, v);
    }
};

// Tells where the data of a resource lies.
struct Lister {
    static constexpr bool kInMemory = true;
    void (*visit)(void*, const WorldArray&);
    void* user;
    WorldArray found;
    std::string_view unit;
    template <typename T>
    void member(const char* name, const T& v) {
        if constexpr (is_plain_array<T>) {
            constexpr Elements e = elements_of<typename T::value_type>();
            tell(name, e, v.size(), v.data(), found.fixed);
        } else if constexpr (is_plain_row<T>) {
            tell(name, elements_of<T>(), 1, &v, true);
        }
    }
    void tell(const char* name, const Elements& e, size_t rows, const void* data, bool fixed) {
        WorldArray array = found;
        array.name = name, array.unit = unit, array.type = e.type, array.rows = rows, array.columns = e.columns;
        array.data = data, array.fixed = fixed;
        visit(user, array);
    }
};

// Tells a visitor that asks for it the unit of the next member.
template <typename Visitor>
void set_unit(Visitor& v, std::string_view unit) {
    if constexpr (requires { v.unit; }) v.unit = unit;
}

// Name of a member of World in files, as in C++: "springs.fans.first", "solids.corner[0]".
struct FieldPath {
    std::array<char, 64> text{};
    FieldPath with(const char* between, std::string_view name, const char* after = "") const {
        FieldPath path;
        const int size = std::snprintf(path.text.data(), path.text.size(), "%s%s%.*s%s", text.data(), between,
                                       static_cast<int>(name.size()), name.data(), after);
        TROCAR_ASSERT(size > 0 && static_cast<size_t>(size) < path.text.size());
        return path;
    }
};

template <typename Visitor, typename T>
void visit_group(Visitor& v, const FieldPath& path, T& group);

// Passes a member of World to a visitor: an array, a value, or all members of a group.
template <typename Visitor, typename T>
void visit_member(Visitor& v, const FieldPath& path, T& member) {
    using Member = std::remove_const_t<T>;
    if constexpr (is_vector<Member>) {
        v.member(path.text.data(), member);
    } else if constexpr (is_list<Member>) {
        for (size_t k = 0; k < member.size(); ++k) visit_member(v, path.with("[", std::to_string(k), "]"), member[k]);
    } else if constexpr (std::is_same_v<Member, Vec3d>) {
        for (int k = 0; k < 3; ++k) visit_member(v, path.with("[", std::to_string(k), "]"), member[k]);
    } else if constexpr (is_plain_row<Member>) {
        v.member(path.text.data(), member);
    } else {
        visit_group(v, path, member);
    }
}

template <typename Visitor, typename T>
void visit_group(Visitor& v, const FieldPath& path, T& group) {
    each_member(group, [&](const FieldName& field, auto& member) {
        set_unit(v, field.unit);
        visit_member(v, path.with(".", field.name), member);
    });
}

// The part of a member of World that belongs to a resource.
template <typename Visitor, typename T>
void visit_part(Visitor& v, Resource resource, const FieldPath& path, T& part) {
    using Part = std::remove_const_t<T>;
    if constexpr (std::is_same_v<Part, decltype(World::trees)>) {
        // opaque: see resource_hash and strip_resources
    } else if constexpr (std::is_same_v<Part, Haptics>) {
        size_t at = 0;
        each_member(part, [&](const FieldName& field, auto& member) {
            set_unit(v, field.unit);
            if ((at++ < Haptics::kConstantFields) == (resource == Resource::kTools)) visit_member(v, path.with(".", field.name), member);
        });
    } else if constexpr (std::is_same_v<Part, Report>) {
        each_number(part, kStored, [&](const ReportNumber& n, auto& value) {
            set_unit(v, n.unit);
            v.member(path.with(".", n.name).text.data(), value);
        });
    } else {
        set_unit(v, "");
        visit_member(v, path, part);
    }
    if constexpr (std::is_same_v<Part, Clock> && !requires { Visitor::kInMemory; }) {
        double unused = 1e-3;  // part of the format and of every hash
        v.member("clock.substep", unused);
    }
}

constexpr size_t kResources = static_cast<size_t>(Resource::kCount);
static_assert(has_members<World>(std::make_index_sequence<kResources - 1>{}) && !has_members<World>(std::make_index_sequence<kResources>{}),
              "a member of World is no resource; haptics alone is two");

template <typename World, typename Visitor>
void visit_resource(World& w, Resource resource, Visitor& v) {
    switch (resource) {
#define TROCAR_VISIT_RESOURCE(bit, member, ...) \
    case Resource::bit:                         \
        return visit_part(v, resource, FieldPath{}.with("", #member), w.member);
        TROCAR_RESOURCES(TROCAR_VISIT_RESOURCE)
#undef TROCAR_VISIT_RESOURCE
        case Resource::kCount:
            break;
    }
}

struct ResourceRow {
    const char* name;
    ResourceKind kind;
};
constexpr ResourceRow kResourceRows[] = {
#define TROCAR_RESOURCE_ROW(bit, member, name, kind) {name, ResourceKind::kind},
    TROCAR_RESOURCES(TROCAR_RESOURCE_ROW)
#undef TROCAR_RESOURCE_ROW
};

}  // namespace

ResourceKind resource_kind(Resource resource) { return kResourceRows[static_cast<size_t>(resource)].kind; }
const char* resource_name(Resource resource) { return kResourceRows[static_cast<size_t>(resource)].name; }

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

void each_array(const World& world, void (*visit)(void*, const WorldArray&), void* user) {
    const bool tears = !world.tears.body.empty();  // they change meshes and springs
    for (uint32_t r = 0; r < static_cast<uint32_t>(Resource::kCount); ++r) {
        const Resource resource = static_cast<Resource>(r);
        const bool constant = resource_kind(resource) == ResourceKind::kConstant && resource != Resource::kTools && !tears;
        Lister lister{visit, user, {}, {}};
        lister.found.resource = resource;
        lister.found.fixed = constant || (mask(resource) & mask(Resource::kPoses, Resource::kParticles)) != 0;
        visit_resource(world, resource, lister);
    }
}

std::optional<WorldArray> find_array(const World& world, std::string_view name) {
    struct Search {
        std::string_view name;
        std::optional<WorldArray> found;
    } search{name, {}};
    each_array(
        world,
        [](void* user, const WorldArray& array) {
            Search& s = *static_cast<Search*>(user);
            if (array.name == s.name) s.found = array;
        },
        &search);
    return search.found;
}

uint64_t state_hash(const World& world) {
    Hasher hasher;
    for (uint32_t r = 0; r < static_cast<uint32_t>(Resource::kCount); ++r) {
        if (resource_kind(static_cast<Resource>(r)) != ResourceKind::kState) continue;
        // where no instrument acts there is nothing to hash, not even the lengths of empty arrays
        if (static_cast<Resource>(r) == Resource::kActionState && world.actions.action.empty()) continue;
        if (static_cast<Resource>(r) == Resource::kLenses && world.lenses.lens.empty()) continue;
        if (static_cast<Resource>(r) == Resource::kSelfContacts && world.self_contacts.body.empty()) continue;  // nothing touches itself
        if (static_cast<Resource>(r) == Resource::kFluidState && world.fluids.body.empty()) continue;           // nothing is wet
        if (static_cast<Resource>(r) == Resource::kRelaxation && world.relaxation.body.empty()) continue;       // nothing relaxes
        if (static_cast<Resource>(r) == Resource::kThreadState && world.threads.thread.empty()) continue;  // nothing is sewn
        if (static_cast<Resource>(r) == Resource::kCrossedSurfaces && world.crossed_surfaces.body.empty()) continue;
        visit_resource(world, static_cast<Resource>(r), hasher);
    }
    return hasher.hash.value;
}

}  // namespace trocar
