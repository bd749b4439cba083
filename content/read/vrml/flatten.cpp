#include "content/read/vrml/flatten.hpp"

#include <algorithm>
#include <cmath>

#include "content/read/vrml/lexer.hpp"
#include "content/read/vrml/parser.hpp"
#include "content/read/vrml/surfaces.hpp"
#include "content/read/vrml/x3d.hpp"
#include "engine/base/error.hpp"
namespace trocar::vrml {
namespace {

enum class Restore : uint8_t { kNothing, kTransform, kAll };

// A list of nodes being traversed.
struct Visit {
    NodeId owner;  // parent of the nodes; node kNone for a file
    NodeId named;  // the nearest node at or above them that has a DEF name; node kNone if none has
    uint64_t named_visit = 0;
    uint32_t file = 0;
    uint32_t scope = 0;
    Range refs;
    uint32_t next = 0;
    uint32_t inlined = 0;  // nesting depth of files
    Restore restore = Restore::kNothing;
    State saved;
};

struct Walk {
    Scene& scene;
    State state{};
    std::vector<Visit> stack{};
    std::vector<Instance> instances{};
    std::set<NodeId> checked{};                                    // coordinate nodes
    std::map<std::pair<NodeId, NodeId>, uint64_t> triangles_of{};  // triangles per geometry and points
    NodeId named{};                                                // of the node being visited, as in Visit
    uint64_t named_visit = 0;
    uint64_t visits = 0, visit_limit = 0, triangles = 0;
};

std::string describe_path(const Walk& w, NodeId last) {
    std::vector<std::string> types;
    for (const Visit& visit : w.stack) {
        if (visit.owner.node != kNone) types.push_back(type_of(w.scene, visit.owner));
    }
    types.push_back(type_of(w.scene, last));
    return vrml::describe_path(types);
}

[[noreturn]] void fail(const Walk& w, NodeId id, const std::string& reason) {
    throw InputError(position_of(w.scene, id) + ": " + reason + describe_path(w, id));
}

Placement translation(const Vec3d& t) { return {Eigen::Matrix3d::Identity(), t}; }

Placement scaling(const Vec3d& s) { return {s.asDiagonal(), Vec3d::Zero()}; }

// Rotation about an axis by an angle in radians; the identity if the axis has no length.
Placement rotation(const Vec3d& axis, double angle) {
    if (!(axis.norm() > 0)) return {};
    return {Eigen::AngleAxisd(angle, axis / axis.norm()).toRotationMatrix(), Vec3d::Zero()};
}

// The numbers of a field, or `otherwise` if there are fewer.
template <size_t Count>
std::array<double, Count> values(const Walk& w, NodeId id, std::string_view name, std::array<double, Count> otherwise) {
    const Value value = find_value(w.scene, id, name);
    const std::span<const double> numbers = numbers_of(value, Count);
    if (numbers.size() < Count) return otherwise;
    for (uint32_t k = 0; k < Count; ++k) {
        otherwise[k] = numbers[k];
        if (!std::isfinite(numbers[k])) {
            throw InputError(location_of_number(value, k) + ": a number that is not finite" + describe_path(w, id));
        }
    }
    return otherwise;
}

Vec3d vector_of(const Walk& w, NodeId id, std::string_view name, double otherwise) {
    const auto v = values<3>(w, id, name, {otherwise, otherwise, otherwise});
    return {v[0], v[1], v[2]};
}

Placement rotation_of(const Walk& w, NodeId id, std::string_view name, double sign) {
    const auto r = values<4>(w, id, name, {0, 0, 1, 0});
    return rotation({r[0], r[1], r[2]}, sign * r[3]);
}

// Inventor's RotationXYZ: axis X, Y or Z, X by default.
Placement rotation_about_axis(const Walk& w, NodeId id) {
    const std::string name = text_of(find_value(w.scene, id, "axis"));
    const int axis = name == "Y" ? 1 : name == "Z" ? 2 : 0;
    return rotation(Vec3d::Unit(axis), values<1>(w, id, "angle", {0})[0]);
}

// T C R SR S -SR -C of the VRML97 standard, section 6.52; VRML 1.0 is the same.
Placement transform_of(const Walk& w, NodeId id) {
    const std::string_view scale = find_value(w.scene, id, "scale") ? "scale" : "scaleFactor";
    const Vec3d center = vector_of(w, id, "center", 0);
    Placement p = translation(vector_of(w, id, "translation", 0));
    p = combine(p, translation(center));
    p = combine(p, rotation_of(w, id, "rotation", 1));
    p = combine(p, rotation_of(w, id, "scaleOrientation", 1));
    p = combine(p, scaling(vector_of(w, id, scale, 1)));
    p = combine(p, rotation_of(w, id, "scaleOrientation", -1));
    return combine(p, translation(-center));
}

// VRML 1.0 multiplies row vectors by matrices, so the translation is the last row; the node of X3D browsers is the same.
Placement matrix_of(const Walk& w, NodeId id) {
    const auto rows = values<16>(w, id, "matrix", {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1});
    const Eigen::Map<const Eigen::Matrix4d> matrix(rows.data());
    return {matrix.topLeftCorner<3, 3>(), matrix.col(3).head<3>()};
}

void push_list(Walk& w, NodeId owner, const Value& list, Range refs, Restore restore) {
    Visit visit;
    visit.owner = owner;
    visit.named = w.named;
    visit.named_visit = w.named_visit;
    visit.file = list ? list.file : owner.document;
    visit.scope = list ? list.scope : owner.scope;
    visit.refs = refs;
    visit.inlined = w.stack.back().inlined;
    visit.restore = restore;
    visit.saved = w.state;
    w.stack.push_back(visit);
}

// Pushes the children, below a placement of their own: those in the children field, or those without a field name
// (VRML 1.0), then those in the fields of humanoids, faces of CAD parts and sets of layers. The joints, segments and
// sites of a humanoid repeat those of its skeleton.
void push_children(Walk& w, NodeId id, Restore restore, const Placement& inner = {}) {
    Placement outer = combine(w.state.placement, inner);
    for (const std::string_view name : {"layers", "shape", "skin", "humanoidBody", "skeleton", "children"}) {  // the last is visited first
        const Value list = find_value(w.scene, id, name);
        if (!list && name != "children") continue;
        push_list(w, id, list, list ? list.field->nodes : node_of(w.scene, id).children, restore);
        w.state.placement = outer;
    }
}

// Pushes one child of a switch, by index; all children for -3.
void push_choice(Walk& w, NodeId id, int which, std::string_view field) {
    Value list = find_value(w.scene, id, field);
    if (!list) list = find_value(w.scene, id, "children");
    Range refs = list ? list.field->nodes : node_of(w.scene, id).children;
    if (which != -3) {
        if (which < 0 || static_cast<uint32_t>(which) >= refs.count) return;
        refs = {refs.first + static_cast<uint32_t>(which), 1};
    }
    push_list(w, id, list, refs, Restore::kNothing);
}

void visit_switch(Walk& w, NodeId id) {
    const std::string_view field = find_value(w.scene, id, "whichChild") ? "whichChild" : "whichChoice";
    const double which = values<1>(w, id, field, {-1})[0];
    if (which >= -3 && which <= 1e9) push_choice(w, id, static_cast<int>(which), "choice");
}

void visit_inline(Walk& w, NodeId id) {
    Value url = find_value(w.scene, id, "url");
    if (!url) url = find_value(w.scene, id, "name");
    if (!flag_of(find_value(w.scene, id, "load"), true)) {
        if (first_time(w.scene, "load")) w.scene.warnings.push_back(position_of(w.scene, id) + ": a file is not read: load is FALSE");
        return;
    }
    const uint32_t row = load_first(w.scene, url);
    if (row == kNone) return;
    const uint32_t inlined = w.stack.back().inlined + 1;
    if (inlined > kInlineLimit) fail(w, id, "files inline files deeper than the limit of " + std::to_string(kInlineLimit));
    const NodeId root{row, kNone, 0};
    push_list(w, id, {}, w.scene.file[row]->document.roots, Restore::kAll);
    w.stack.back().file = root.document;
    w.stack.back().scope = 0;
    w.stack.back().inlined = inlined;
    const Placement placement = w.state.placement;
    w.state = {};
    w.state.placement = placement;
}

bool has_name(const Scene& scene, NodeId id) { return id.node != kNone && node_of(scene, id).name.count > 0; }

void name_node(Walk& w, NodeId id) {
    if (has_name(w.scene, id) && id != w.named) w.named = id, w.named_visit = w.visits;
}

void add_surface(Walk& w, const State& state, NodeId id) {
    const Role role = role_of(w.scene, id);
    if (role == Role::kUnsupported) {
        const std::string type = type_of(w.scene, id);
        if (first_time(w.scene, "surface " + type)) {
            w.scene.warnings.push_back(position_of(w.scene, id) + ": " + type + " is not built" + describe_path(w, id));
        }
        return;
    }
    Instance instance{state, id, w.named, w.named_visit};
    if (takes_points(role)) {
        const NodeId own = first_node(w.scene, find_value(w.scene, id, "coord"));
        if (own.node != kNone && role_of(w.scene, own) == Role::kCoordinate) instance.state.coordinate = own;
        const NodeId texture_coordinate = first_node(w.scene, find_value(w.scene, id, "texCoord"));
        if (texture_coordinate.node != kNone && role_of(w.scene, texture_coordinate) == Role::kTextureCoordinate) {
            instance.state.texture_coordinate = texture_coordinate;
        }
        const NodeId coordinate = instance.state.coordinate;
        if (coordinate.node == kNone) {
            if (first_time(w.scene, "no coordinates")) {
                w.scene.warnings.push_back(position_of(w.scene, id) + ": a face set without coordinates is passed over" +
                                           describe_path(w, id));
            }
            return;
        }
        if (w.checked.insert(coordinate).second) {
            try {
                check_points(w.scene, coordinate, 3);
            } catch (const InputError& error) {
                throw InputError(error.what() + describe_path(w, coordinate));
            }
        }
    } else if (role == Role::kElevationGrid) {
        instance.state.texture_coordinate = first_node(w.scene, find_value(w.scene, id, "texCoord"));
    } else if (role == Role::kExtrusion) {
        instance.state.texture_coordinate = {};
    } else if (!is_primitive(role)) {
        return;  // no geometry
    }
    const auto [known, fresh] = w.triangles_of.try_emplace({id, instance.state.coordinate}, 0);
    if (fresh) known->second = count_triangles(w.scene, instance);
    w.triangles += known->second;
    if (w.triangles > kTriangleLimit) {
        fail(w, id, "more than the limit of " + std::to_string(kTriangleLimit) + " triangles");
    }
    w.instances.push_back(instance);
}

void visit_shape(Walk& w, NodeId id) {
    State state = w.state;
    const NodeId appearance = first_node(w.scene, find_value(w.scene, id, "appearance"));
    if (appearance.node != kNone && role_of(w.scene, appearance) == Role::kAppearance) {
        state.material = first_node(w.scene, find_value(w.scene, appearance, "material"));
        state.texture = first_node(w.scene, find_value(w.scene, appearance, "texture"));
        state.texture_transform = first_node(w.scene, find_value(w.scene, appearance, "textureTransform"));
    }
    const NodeId geometry = first_node(w.scene, find_value(w.scene, id, "geometry"));
    if (geometry.node == kNone) return;
    name_node(w, geometry);
    add_surface(w, state, geometry);
}

void visit_transform(Walk& w, NodeId id, const Placement& own) {
    const bool group = w.scene.file[id.document]->language != Language::kOne || find_value(w.scene, id, "children") ||
                       node_of(w.scene, id).children.count > 0;
    if (group) return push_children(w, id, Restore::kAll, own);
    w.state.placement = combine(w.state.placement, own);
}

// The part of the state that a property node replaces, if it is one (VRML 1.0).
NodeId* property_of(State& state, Role role) {
    switch (role) {
        case Role::kCoordinate:
            return &state.coordinate;
        case Role::kTextureCoordinate:
            return &state.texture_coordinate;
        case Role::kMaterial:
            return &state.material;
        case Role::kMaterialBinding:
            return &state.material_binding;
        case Role::kTexture:
            return &state.texture;
        case Role::kTextureTransform:
            return &state.texture_transform;
        default:
            return nullptr;
    }
}

void visit_node(Walk& w, NodeId id) {
    if (++w.visits > w.visit_limit) {
        fail(w, id, "USE and PROTO expand to more than the limit of " + std::to_string(kExpansionLimit) + " nodes");
    }
    name_node(w, id);
    id = resolve(w.scene, id);
    name_node(w, id);
    const auto place = [&w](const Placement& next) { w.state.placement = combine(w.state.placement, next); };
    const Role role = role_of(w.scene, id);
    switch (role) {
        case Role::kGroup:
            return push_children(w, id, Restore::kAll);
        case Role::kOpenGroup:
            return push_children(w, id, Restore::kNothing);
        case Role::kTransformGroup:
            return push_children(w, id, Restore::kTransform);
        case Role::kTransform:
            return visit_transform(w, id, transform_of(w, id));
        case Role::kMatrix:
            return visit_transform(w, id, matrix_of(w, id));
        case Role::kTranslation:
            return place(translation(vector_of(w, id, "translation", 0)));
        case Role::kRotation:
            return place(rotation_of(w, id, "rotation", 1));
        case Role::kRotationXYZ:
            return place(rotation_about_axis(w, id));
        case Role::kScale:
            return place(scaling(vector_of(w, id, "scaleFactor", 1)));
        case Role::kResetTransform:
            w.state.placement = {};
            return;
        case Role::kSwitch:
            return visit_switch(w, id);
        case Role::kLevels:
            return push_choice(w, id, 0, "level");
        case Role::kInline:
            return visit_inline(w, id);
        case Role::kShape:
            return visit_shape(w, id);
        case Role::kShapeHints:
            w.state.clockwise = text_of(find_value(w.scene, id, "vertexOrdering")) == "CLOCKWISE";
            return;
        default:
            if (NodeId* const property = property_of(w.state, role)) *property = id;
            if (role == Role::kUnsupported || takes_points(role) || is_primitive(role)) add_surface(w, w.state, id);
            return;
    }
}

void walk_scene(Walk& w) {
    const Document& main = w.scene.file[0]->document;
    w.visit_limit = main.node.size() + kExpansionLimit;
    Visit root;
    root.refs = main.roots;
    w.stack.push_back(root);
    while (!w.stack.empty()) {
        Visit& visit = w.stack.back();
        if (visit.next < visit.refs.count) {
            w.named = visit.named, w.named_visit = visit.named_visit;
            const NodeRef ref = w.scene.file[visit.file]->document.ref[visit.refs.first + visit.next++];
            visit_node(w, {visit.file, ref.node, visit.scope});
            continue;
        }
        if (visit.restore == Restore::kAll) w.state = visit.saved;
        if (visit.restore == Restore::kTransform) w.state.placement = visit.saved.placement;
        w.stack.pop_back();
    }
}

std::string name_of(const Scene& scene, NodeId id) {
    if (!has_name(scene, id)) return "";
    const Document& document = scene.file[id.document]->document;
    return printable(text_of(document, document.node[id.node].name));
}

std::string plural(uint64_t count, const std::string& one) { return std::to_string(count) + " " + one + (count == 1 ? "" : "s"); }

}  // namespace

bool looks_like_vrml(std::string_view text) {
    if (looks_like_x3d(text)) return true;
    if (text.starts_with("\xef\xbb\xbf")) text.remove_prefix(3);
    std::string head;
    for (const char c : text.substr(0, 64)) head += c >= 'A' && c <= 'Z' ? static_cast<char>(c | 0x20) : c;
    const size_t first = head.find_first_not_of(" \t\r\n");
    if (first == std::string::npos) return false;
    for (const char* header : {"#vrml", "#inventor", "#x3d v"}) {
        if (std::string_view(head).substr(first).starts_with(header)) return true;
    }
    // without a header: accept a node type with a brace, or DEF and a name
    Lexer lexer{text.substr(0, std::min<size_t>(text.size(), 1u << 20)), 0};
    try {
        const Token type = next_token(lexer);
        if (type.kind != TokenKind::kWord) return false;
        const std::string_view word = text.substr(type.offset, type.length);
        const Token next = next_token(lexer);
        if (next.kind == TokenKind::kOpenBrace) return true;
        return (word == "DEF" || word == "PROTO" || word == "EXTERNPROTO") && next.kind == TokenKind::kWord;
    } catch (const LexicalFault&) {
        return false;
    }
}

LoadedMesh flatten_document(Document document, const LoadOptions& options) {
    LoadedMesh loaded;
    Scene scene;
    scene.roots = options.roots;
    const std::string path = document.path.string();
    add_file(scene, std::move(document));
    Walk walk{scene};
    walk_scene(walk);
    SurfaceBuilder builder{scene, loaded.mesh};
    builder.report = [&] {
        const double done = static_cast<double>(loaded.mesh.triangle.size()) / static_cast<double>(walk.triangles + 1);
        if (options.progress) options.progress(kTextShare + (1 - kTextShare) * done);
    };
    loaded.mesh.triangle.reserve(walk.triangles);
    loaded.mesh.triangle_material.reserve(walk.triangles);
    for (size_t i = 0; i < walk.instances.size(); ++i) {
        const auto first = static_cast<uint32_t>(loaded.mesh.triangle.size());
        const Instance& instance = walk.instances[i];
        build_surface(builder, instance);
        const auto count = static_cast<uint32_t>(loaded.mesh.triangle.size()) - first;
        const bool same = i > 0 && instance.visit > 0 && instance.visit == walk.instances[i - 1].visit;
        if (same)
            loaded.parts.back().count += count;
        else
            loaded.parts.push_back({name_of(scene, instance.named), first, count});
    }

    loaded.unused_points = count_unused_points(builder);
    loaded.format = scene.file[0]->format;
    loaded.warnings = std::move(scene.warnings);
    const auto note = [&](uint64_t count, const std::string& one, const std::string& what) {
        if (count > 0) loaded.warnings.push_back(path + ": " + plural(count, one) + " " + what);
    };
    note(builder.faces_outside, "face", "dropped: a corner is not among the points (first at " + builder.first_outside + ")");
    note(builder.faces_short, "face", "dropped: fewer than three corners");
    note(builder.faces_fanned, "polygon", "cut as a fan: crossing itself or without area");
    note(builder.corners_without_uv, "corner", "without a texture coordinate");
    return loaded;
}

}  // namespace trocar::vrml
