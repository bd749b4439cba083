#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <numeric>

#include "content/scene/build_scene.hpp"
#include "content/scene/make_prototype.hpp"
#include "engine/base/error.hpp"
#include "engine/distance/closest_point.hpp"
#include "engine/files/whole_file.hpp"
#include "engine/jobs/trace.hpp"
#include "systems/app/commands/cells_file.hpp"
#include "systems/app/console/commands.hpp"
#include "systems/app/console/format.hpp"
#include "systems/app/console/load_file.hpp"
#include "systems/app/console/standard_streams.hpp"
#include "systems/detect/narrow/common_points.hpp"
#include "systems/detect/narrow/separation.hpp"
#include "systems/frame/frame.hpp"
namespace trocar {
namespace {

uint32_t load_prototype(World& world, const std::string& file, const FileRoots& roots) {
    LoadedMesh loaded = load_file(file, roots);
    // file units are treated as metres; the mesh is not moved
    const Prototype made = make_prototype(world.meshes, std::move(loaded.mesh), PrototypeOptions{});
    if (made.row == kNone) throw InputError(file + ": " + made.judgement.reason);
    if (made.judgement.admitted_as != Admission::kSolid)
        std::fprintf(stderr, "trocar: warning: %s: %s\n", file.c_str(), made.judgement.reason.c_str());
    return made.row;
}

nlohmann::ordered_json row(const Vec3d& v) { return {v.x(), v.y(), v.z()}; }

// Which body lies entirely inside the other, if any.
nlohmann::ordered_json contained(const World& w) {
    if (w.penetrations.pair.empty() || !w.contours.curve.empty()) return nullptr;
    const auto inside = [&](uint32_t body, uint32_t vertices) {
        return vertices > 0 && vertices == w.meshes.info[w.bodies.mesh[body]].vertices.count;
    };
    if (inside(0, w.penetrations.vertices_a_in_b[0])) return "a";
    if (inside(1, w.penetrations.vertices_b_in_a[0])) return "b";
    return nullptr;
}

nlohmann::ordered_json witness(const World& w, uint32_t contact) {
    if (contact == kNone) return nullptr;
    return {{"point", row(w.contacts.point[contact])}, {"closest", row(w.contacts.closest[contact])}};
}

bool share_a_point(const World& w) {
    return share_a_point(surfaces_of(w), 0, 1, w.candidates.triangle, w.penetrations.pair.empty() ? 0 : w.penetrations.depth[0]);
}

// The separation query with b displaced by `move`; restores the world.
SeparationAnswer look_at(World& w, const Vec3d& move) {
    const Vec3d home = w.poses.origin[1];
    w.poses.origin[1] = home + move;
    detect_contacts(w);
    SeparationAnswer answer;
    answer.free = !share_a_point(w);
    if (!w.penetrations.pair.empty()) answer.depth = w.penetrations.depth[0];
    for (uint32_t i = 0; i < w.contacts.pair.size(); ++i) {
        const Vec3d& n = w.contacts.normal[i];
        if (w.contacts.distance[i] < 0) answer.directions.push_back({w.contacts.body[i] == 0 ? Vec3d(-n) : n, -w.contacts.distance[i]});
    }
    w.poses.origin[1] = home;
    return answer;
}

// Lower and upper bound on the shortest translation of b that separates it from a.
nlohmann::ordered_json separation(World& w) {
    const Surfaces surfaces = surfaces_of(w);
    std::array<SeparatedBody, 2> bodies;
    for (uint32_t body = 0; body < 2; ++body) {
        if (!has_inside(surfaces, body)) throw InputError(w.bodies.name[body] + ": --separate needs closed surfaces");
        bodies[body] = separated_body(surfaces, *w.trees[w.bodies.tree[body]], body);
    }
    const Separation s = find_separation({}, bodies, [&](const Vec3d& move) { return look_at(w, move); });
    w.report = {};  // count only the pair itself, not the search
    detect_contacts(w);
    return {{"lower", s.lower}, {"upper", s.upper}, {"translation", row(s.translation)}, {"probes", s.probes}};
}

// Regions, deepest first.
std::vector<uint32_t> sorted_regions(const OverlapRegions& r) {
    std::vector<uint32_t> order(r.pair.size());
    std::iota(order.begin(), order.end(), 0u);
    std::stable_sort(order.begin(), order.end(), [&](uint32_t x, uint32_t y) { return r.depth[x] > r.depth[y]; });
    return order;
}

nlohmann::ordered_json regions(const World& w) {
    nlohmann::ordered_json list = nlohmann::ordered_json::array();
    const OverlapRegions& r = w.regions;
    for (const uint32_t i : sorted_regions(r)) {
        const bool seen = r.witness[i] != kNone;
        list.push_back({{"vertices_a", r.vertices_a[i]},
                        {"vertices_b", r.vertices_b[i]},
                        {"contour", {{"curves", r.curves[i]}, {"length", r.contour[i]}}},
                        {"area", r.area[i]},
                        {"volume", r.volume[i]},
                        {"depth", r.depth[i]},
                        {"direction", seen ? row(r.direction[i]) : nlohmann::ordered_json(nullptr)},
                        {"witness", witness(w, r.witness[i])}});
    }
    return list;
}

// Writes the intersection contours as lines of an .obj file, one object per curve.
void write_contours(const World& w, const std::filesystem::path& file) {
    std::string text = "# intersection curves of the surfaces\n";
    for (const Vec3d& p : w.contours.point) {
        text += format("v %.17g %.17g %.17g\n", p.x(), p.y(), p.z());
    }
    for (size_t i = 0; i < w.contours.curve.size(); ++i) {
        const Range curve = w.contours.curve[i];
        text += "o curve_" + std::to_string(i) + "\nl";
        for (uint32_t s = curve.first; s < curve.end(); ++s) text += " " + std::to_string(w.contours.end[s][0] + 1);
        text += " " + std::to_string(w.contours.end[curve.end() - 1][1] + 1) + "\n";
    }
    write_whole_file(file, text);
}

}  // namespace

int collide_command(const CollideOptions& options) {
    if (!options.contours.empty() && options.contours.extension() != ".obj")
        throw InputError(options.contours.string() + ": contours are written as .obj");
    if (!(options.move_b.cwiseAbs().maxCoeff() <= kFarthestCoordinate)) throw InputError("--move-b: at most 1e30");
    World world;
    const uint32_t mesh_a = load_prototype(world, options.a, options.roots), mesh_b = load_prototype(world, options.b, options.roots);
    add_body(world, options.a, mesh_a, Motion::kStatic);
    const uint32_t b = add_body(world, options.b, mesh_b, Motion::kHand);  // movable, or the pair is skipped
    world.poses.origin[b] = options.move_b;
    world.poses.orientation[b] = options.rotate_b;
    const auto diagonal = [&](uint32_t body) {
        const Box& box = world.meshes.info[world.bodies.mesh[body]].box;
        return (box.max - box.min).norm();
    };
    world.settings.contact.cross_check = options.cross_check;
    world.settings.contact.search = options.search;
    make_trees(world);
    world.settings.contact.tolerance = options.tolerance > 0 ? options.tolerance : 1e-4 * std::min(diagonal(0), diagonal(1));
    world.settings.contact.constraint_capacity = UINT32_MAX;
    world.settings.contact.regions = true;
    world.settings.contact.faces = true;
    world.settings.contact.deep = DeepResponse::kLastFree;  // reports whether the overlap is saturated
    const uint64_t start = now_ns();
    detect_contacts(world);
    const double time_ms = static_cast<double>(now_ns() - start) * 1e-6;

    const nlohmann::ordered_json apart = options.separate ? separation(world) : nlohmann::ordered_json(nullptr);
    const Penetrations& p = world.penetrations;
    const bool overlap = share_a_point(world), seen = overlap && !p.pair.empty();
    nlohmann::ordered_json j = {{"a", options.a}, {"b", options.b}, {"overlap", overlap}};
    j["depth"] = seen ? p.depth[0] : 0.0;
    j["surface_depth"] = seen ? p.surface_depth[0] : 0.0;  // search the faces too
    j["direction"] = seen ? row(p.direction[0]) : nlohmann::ordered_json(nullptr);
    j["witness"] = witness(world, seen ? p.witness[0] : kNone);
    j["vertices_a_in_b"] = seen ? p.vertices_a_in_b[0] : 0u;
    j["vertices_b_in_a"] = seen ? p.vertices_b_in_a[0] : 0u;
    j["edge_contacts"] = seen ? p.edge_contacts[0] : 0u;
    j["face_contacts"] = seen ? p.face_contacts[0] : 0u;
    j["cells"] = world.occupancy.cell_key.size();
    if (!options.cells.empty()) write_cells(world, options.cells);
    j["contained"] = contained(world);
    j["saturated"] = seen && p.saturated[0];
    j["regions"] = regions(world);
    if (options.separate) j["separation"] = apart;
    if (options.cross_check) j["disagreements"] = world.report.disagreements;
    j["time_ms"] = time_ms;
    if (!options.contours.empty()) write_contours(world, options.contours);
    if (options.json) {
        write_standard_output(j.dump() + "\n");
    } else if (!seen) {
        write_standard_output(overlap ? "overlap, depth 0: they touch\n" : "no overlap\n");
    } else {
        const Vec3d& d = p.direction[0];
        const Vec3d& w = world.contacts.point[p.witness[0]];
        write_standard_output(format(
            "overlap, depth %.6g (file units)\n  B separates along (%.4f, %.4f, %.4f); deepest point (%.6g, %.6g, %.6g)\n"
            "  %u vertices of A in B, %u of B in A, %u edge contacts; %.2f ms\n",
            p.depth[0], d.x(), d.y(), d.z(), w.x(), w.y(), w.z(), p.vertices_a_in_b[0], p.vertices_b_in_a[0], p.edge_contacts[0], time_ms));
        if (p.saturated[0]) write_standard_output("  saturated: so deep that other separating translations are about as short\n");
        const OverlapRegions& r = world.regions;
        for (const uint32_t i : sorted_regions(r)) {
            write_standard_output(format("  region: depth %.6g, %u + %u vertices, %u curves of %.6g, area %.6g, volume %.6g\n", r.depth[i],
                                         r.vertices_a[i], r.vertices_b[i], r.curves[i], r.contour[i], r.area[i], r.volume[i]));
        }
        if (options.separate) {
            const auto& t = apart["translation"];
            write_standard_output(format("  separated from A by the translation (%.6g, %.6g, %.6g): %.6g; none is shorter than %.6g\n",
                                         t[0].get<double>(), t[1].get<double>(), t[2].get<double>(), apart["upper"].get<double>(),
                                         apart["lower"].get<double>()));
        }
    }
    if (options.cross_check && !options.json)
        write_standard_output("  " + std::to_string(world.report.disagreements) + " signs differ from the winding number\n");
    return kDone;
}

}  // namespace trocar
