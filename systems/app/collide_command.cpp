#include <cstdio>
#include <nlohmann/json.hpp>

#include "content/build_scene.hpp"
#include "content/make_prototype.hpp"
#include "engine/closest_point.hpp"
#include "engine/error.hpp"
#include "engine/trace.hpp"
#include "engine/whole_file.hpp"
#include "systems/app/commands.hpp"
#include "systems/app/load_file.hpp"
#include "systems/app/standard_streams.hpp"
#include "systems/frame.hpp"
namespace trocar {
namespace {

uint32_t load_prototype(World& world, const std::string& file) {
    LoadedMesh loaded = load_file(file);
    for (const std::string& warning : loaded.warnings)
        std::fprintf(stderr, "trocar: warning: %s\n", warning.c_str());
    // file units stand for metres; nothing is moved
    const Prototype made = make_prototype(world.meshes, std::move(loaded.mesh), PrototypeOptions{});
    if (made.row == kNone) throw InputError(file + ": " + made.judgement.reason);
    if (made.judgement.admitted_as != Admission::kSolid)
        std::fprintf(stderr, "trocar: warning: %s: %s\n", file.c_str(), made.judgement.reason.c_str());
    return made.row;
}

nlohmann::ordered_json row(const Vec3d& v) { return {v.x(), v.y(), v.z()}; }

}  // namespace

int collide_command(const CollideOptions& options) {
    World world;
    const uint32_t mesh_a = load_prototype(world, options.a), mesh_b = load_prototype(world, options.b);
    add_body(world, options.a, mesh_a, Motion::kStatic);
    const uint32_t b = add_body(world, options.b, mesh_b, Motion::kHand);  // can be pushed, so the pair is looked at
    world.poses.origin[b] = options.move_b;
    world.poses.orientation[b] = options.rotate_b;
    const auto diagonal = [&](uint32_t body) {
        const Box& box = world.meshes.info[world.bodies.mesh[body]].box;
        return (box.max - box.min).norm();
    };
    world.settings.contact.cross_check = options.cross_check;
    make_trees(world);
    world.settings.contact.tolerance =
        options.tolerance > 0 ? options.tolerance : 1e-4 * std::min(diagonal(0), diagonal(1));
    world.settings.contact.row_capacity = UINT32_MAX;
    const uint64_t start = now_ns();
    detect_contacts(world);
    const double time_ms = static_cast<double>(now_ns() - start) * 1e-6;

    const Penetrations& p = world.penetrations;
    const bool overlap = !p.pair.empty();
    nlohmann::ordered_json j = {{"a", options.a}, {"b", options.b}, {"overlap", overlap}};
    j["depth"] = overlap ? p.depth[0] : 0.0;
    j["direction"] = overlap ? row(p.direction[0]) : nlohmann::ordered_json(nullptr);
    j["witness"] = overlap ? nlohmann::ordered_json{{"point", row(world.contacts.point[p.witness[0]])},
                                                    {"closest", row(world.contacts.closest[p.witness[0]])}}
                           : nlohmann::ordered_json(nullptr);
    j["vertices_a_in_b"] = overlap ? p.vertices_a_in_b[0] : 0u;
    j["vertices_b_in_a"] = overlap ? p.vertices_b_in_a[0] : 0u;
    j["edge_contacts"] = overlap ? p.edge_contacts[0] : 0u;
    if (options.cross_check) j["disagreements"] = world.report.disagreements;
    j["time_ms"] = time_ms;
    if (options.json) {
        write_standard_output(j.dump() + "\n");
    } else if (!overlap) {
        write_standard_output("no overlap\n");
    } else {
        char text[512];
        const Vec3d& d = p.direction[0];
        const Vec3d& w = world.contacts.point[p.witness[0]];
        std::snprintf(
            text, sizeof text,
            "overlap, depth %.6g (file units)\n  B leaves along (%.4f, %.4f, %.4f); deepest point (%.6g, %.6g, %.6g)\n"
            "  %u vertices of A in B, %u of B in A, %u edge contacts; %.2f ms\n",
            p.depth[0], d.x(), d.y(), d.z(), w.x(), w.y(), w.z(), p.vertices_a_in_b[0], p.vertices_b_in_a[0],
            p.edge_contacts[0], time_ms);
        write_standard_output(text);
    }
    if (options.cross_check && !options.json)
        write_standard_output("  " + std::to_string(world.report.disagreements) +
                              " signs differ from the winding number\n");
    return kDone;
}

}  // namespace trocar
