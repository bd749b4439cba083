#include <cmath>

#include "content/mend/admission.hpp"
#include "content/scene/build_scene.hpp"
#include "engine/distance/closest_point.hpp"
#include "engine/jobs/parallel.hpp"
#include "engine/mesh/mesh_topology.hpp"
#include "systems/app/interface/handles.hpp"

struct trocar_collider {
    trocar::World world;
    std::vector<uint8_t> moved;  // per mesh: its tree is out of date
    bool own_tolerance = false;
};

namespace trocar {
namespace {

std::vector<Vec3d> positions(const double* xyz, uint32_t count) {
    std::vector<Vec3d> all(count);
    for (uint32_t v = 0; v < count; ++v) all[v] = vector_at(xyz + 3 * size_t{v});
    return all;
}

void check_positions(uint32_t number, std::span<const Vec3d> position) {
    for (size_t v = 0; v < position.size(); ++v)
        if (!(position[v].cwiseAbs().maxCoeff() <= kFarthestCoordinate))
            throw InputError("mesh " + std::to_string(number) + ", vertex " + std::to_string(v) + ": not finite, or beyond 1e30");
}

Mesh read_mesh(const trocar_mesh& given, uint32_t number) {
    Mesh mesh;
    mesh.name = "mesh " + std::to_string(number);
    if (given.vertices > 0) needed(given.xyz, "mesh.xyz");
    if (given.triangles > 0) needed(given.corners, "mesh.corners");
    mesh.position = positions(given.xyz, given.vertices);
    check_positions(number, mesh.position);
    mesh.triangle.resize(given.triangles);
    for (uint32_t t = 0; t < given.triangles; ++t) {
        Triangle& corner = mesh.triangle[t];
        std::copy_n(given.corners + 3 * size_t{t}, 3, corner.data());
        const std::string where = mesh.name + ", triangle " + std::to_string(t) + ": ";
        for (const uint32_t v : corner)
            if (v >= given.vertices) throw InputError(where + "vertex " + std::to_string(v) + " of " + std::to_string(given.vertices));
        if (corner[0] == corner[1] || corner[1] == corner[2] || corner[2] == corner[0]) throw InputError(where + "the same corner twice");
    }
    return mesh;
}

double diagonal(const MeshInfo& info) { return (info.box.max - info.box.min).norm(); }

void set_tolerance(trocar_collider& c) {
    if (c.own_tolerance) return;
    double least = std::numeric_limits<double>::infinity();
    for (const MeshInfo& info : c.world.meshes.info) least = std::min(least, diagonal(info));
    c.world.settings.contact.tolerance = 1e-4 * least;
}

void refresh(trocar_collider& c) {
    World& w = c.world;
    parallel_for(static_cast<uint32_t>(c.moved.size()), 1, [&](uint32_t begin, uint32_t end) {
        for (uint32_t body = begin; body < end; ++body) {
            if (!c.moved[body]) continue;
            measure_prototype(w.meshes, body);
            auto& tree = w.trees[w.bodies.tree[body]];
            tree = std::make_unique<ClosestPointTree>(mesh_view(w.meshes, body), tree.get());
        }
    });
    std::ranges::fill(c.moved, 0);
    set_tolerance(c);
}

const World& found(const trocar_collider* collider) { return needed(collider, "collider").world; }
void check_mesh(const trocar_collider* collider, uint32_t mesh) {
    const size_t count = needed(collider, "collider").moved.size();
    if (mesh >= count) throw BadCall("mesh " + std::to_string(mesh) + " of " + std::to_string(count));
}

}  // namespace
}  // namespace trocar

using namespace trocar;

trocar_code trocar_collider_open(const trocar_mesh* meshes, uint32_t count, const trocar_collider_options* options,
                                 trocar_collider** collider) {
    return guarded([&] {
        needed(collider, "collider") = nullptr;
        needed(meshes, "meshes");
        if (count < 2) throw BadCall("contact needs two meshes or more");
        const trocar_collider_options asked = options ? taken(options, "options") : trocar_collider_options{};
        if (!(asked.tolerance >= 0 && std::isfinite(asked.tolerance))) throw InputError("options.tolerance: not a length from 0 on");
        auto made = std::make_unique<trocar_collider>();
        on_threads([&] {
            World& w = made->world;
            const char* at = reinterpret_cast<const char*>(meshes);  // the caller's structs may be shorter or longer than ours
            for (uint32_t i = 0; i < count; ++i, at += meshes->size) {
                const trocar_mesh given = taken(reinterpret_cast<const trocar_mesh*>(at), "mesh");
                if (given.size != meshes->size) throw BadCall("mesh " + std::to_string(i) + ": its size is not set");
                const Mesh mesh = read_mesh(given, i);
                const MeshJudgement judgement = judge_mesh(mesh);
                if (judgement.admitted_as == Admission::kRefused) throw InputError(mesh.name + ": " + judgement.reason);
                add_body(w, mesh.name, add_prototype(w.meshes, mesh, judgement.admitted_as), i == 0 ? Motion::kStatic : Motion::kHand);
            }
            made->moved.assign(count, 0);
            made->own_tolerance = asked.tolerance > 0;
            ContactParams& contact = w.settings.contact;
            contact.tolerance = asked.tolerance;
            contact.constraint_capacity = UINT32_MAX;
            contact.regions = true;
            contact.faces = !asked.no_faces;
            contact.deep = DeepResponse::kLastFree;
            make_trees(w);
            set_tolerance(*made);
        });
        *collider = made.release();
        return TROCAR_OK;
    });
}

void trocar_collider_close(trocar_collider* collider) {
    if (collider) guarded([&] { return on_threads([&] { delete collider; }), TROCAR_OK; });
}

trocar_code trocar_collider_admission(const trocar_collider* collider, uint32_t mesh, trocar_admission* admission) {
    return guarded([&] {
        check_mesh(collider, mesh);
        needed(admission, "admission") = static_cast<trocar_admission>(collider->world.meshes.info[mesh].admission);
        return TROCAR_OK;
    });
}

trocar_code trocar_collider_move(trocar_collider* collider, uint32_t mesh, const double* xyz) {
    return guarded([&] {
        check_mesh(collider, mesh);
        Meshes& meshes = collider->world.meshes;
        const Range range = meshes.info[mesh].vertices;
        const std::vector<Vec3d> position = positions(&needed(xyz, "xyz"), range.count);
        check_positions(mesh, position);
        std::ranges::copy(position, meshes.position.begin() + range.first);
        collider->moved[mesh] = 1;
        return TROCAR_OK;
    });
}

trocar_code trocar_collider_find(trocar_collider* collider) {
    return guarded([&] {
        trocar_collider& c = needed(collider, "collider");
        on_threads([&] {
            refresh(c);
            c.world.report = {}, c.world.pair_memory = {};
            detect_contacts(c.world, false);
        });
        return TROCAR_OK;
    });
}

// A pair that was not found to be inside may still touch: it has a row too.
trocar_code trocar_collider_pairs(const trocar_collider* collider, trocar_pair* out, size_t capacity, size_t* count) {
    return guarded([&] {
        const World& w = found(collider);
        return fill(out, capacity, count, w.pairs.a.size(), 1, [&](size_t pair, trocar_pair* to) {
            const auto row = std::ranges::find(w.penetrations.pair, static_cast<uint32_t>(pair)) - w.penetrations.pair.begin();
            put_pair(w, static_cast<uint32_t>(pair), static_cast<size_t>(row), *to);
        });
    });
}

trocar_code trocar_collider_contacts(const trocar_collider* collider, trocar_contact* out, size_t capacity, size_t* count) {
    return guarded([&] {
        const Contacts& c = found(collider).contacts;
        return fill(out, capacity, count, c.point.size(), 1, [&](size_t i, trocar_contact* to) { put_contact(c, i, *to); });
    });
}

trocar_code trocar_collider_regions(const trocar_collider* collider, trocar_region* out, size_t capacity, size_t* count) {
    return guarded([&] {
        const World& w = found(collider);
        const OverlapRegions& r = w.regions;
        return fill(out, capacity, count, r.pair.size(), 1, [&](size_t i, trocar_region* to) {
            *to = {w.pairs.a[r.pair[i]],
                   w.pairs.b[r.pair[i]],
                   r.vertices_a[i],
                   r.vertices_b[i],
                   r.curves[i],
                   r.witness[i],
                   r.contour[i],
                   r.area[i],
                   r.volume[i],
                   r.depth[i],
                   {}};
            put(r.direction[i], to->direction);
        });
    });
}
