#include "engine/tissue/solid_setup.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>

#include "engine/base/check.hpp"
#include "engine/geometry/edge_table.hpp"
#include "engine/mesh/mesh_topology.hpp"
#include "engine/mesh/mesh_view.hpp"
#include "engine/tissue/deformable_setup.hpp"
#include "engine/tissue/lumped_volume.hpp"
#include "engine/tissue/solid_limit.hpp"
#include "engine/tissue/tet_forces.hpp"
namespace trocar {
namespace {

using Tetrahedron = std::array<uint32_t, 4>;

Range grown(size_t first, size_t count) {
    TROCAR_ASSERT(first + count < kNone);
    return {static_cast<uint32_t>(first), static_cast<uint32_t>(count)};
}

struct Filling {
    std::vector<Vec3d> node;
    std::span<const Tetrahedron> tetrahedra;
    std::span<const double> fill{};  // empty = 1
    double share(size_t t) const { return fill.empty() ? 1.0 : fill[t]; }
    double volume(const Tetrahedron& t) const { return six_volumes(node[t[0]], node[t[1]], node[t[2]], node[t[3]]) / 6; }
};

void append_tetrahedra(const Filling& filling, SolidInfo& info, Solids& solids) {
    const size_t count = filling.tetrahedra.size(), padded = (count + kSliceWidth - 1) / kSliceWidth * kSliceWidth;
    info.count = static_cast<uint32_t>(count);
    info.tetrahedra = grown(solids.rest.size(), padded);
    for (size_t t = 0; t < padded; ++t) {
        const Tetrahedron tet = t < count ? filling.tetrahedra[t] : Tetrahedron{};
        for (int k = 0; k < 4; ++k) solids.corner[k].push_back(tet[k]);
        const double rest = t < count ? 6 * filling.volume(tet) : 0;
        TROCAR_ASSERT(t >= count || rest > 0);
        solids.rest.push_back(static_cast<float>(rest));
        solids.per_rest.push_back(rest > 0 ? static_cast<float>(1 / rest) : 0.0f);
    }
    if (filling.fill.empty()) return;
    info.varied = 1;
    solids.factor.resize(info.tetrahedra.end(), 1.0f);
    for (size_t t = 0; t < count; ++t) solids.factor[info.tetrahedra.first + t] = static_cast<float>(filling.fill[t]);
}

// For each node the tetrahedron corners around it, by tetrahedron.
void append_slots(const Filling& filling, uint32_t padded_tets, SolidInfo& info, Solids& solids) {
    const size_t slices = (filling.node.size() + kSliceWidth - 1) / kSliceWidth;
    std::vector<std::vector<uint32_t>> slots(slices * kSliceWidth);
    for (uint32_t t = 0; t < filling.tetrahedra.size(); ++t) {
        for (uint32_t k = 0; k < 4; ++k) slots[filling.tetrahedra[t][k]].push_back(k * padded_tets + t);
    }
    const size_t prototype = solids.info.size();
    info.slices = grown(solids.slot_column.size() - prototype, slices);
    for (size_t slice = 0; slice < slices; ++slice) {
        solids.slot_column.push_back(grown(solids.slot.size() / kSliceWidth, 0).first);
        size_t columns = 0;
        for (uint32_t lane = 0; lane < kSliceWidth; ++lane) {
            columns = std::max(columns, slots[slice * kSliceWidth + lane].size());
        }
        for (size_t c = 0; c < columns; ++c) {
            for (uint32_t lane = 0; lane < kSliceWidth; ++lane) {
                const auto& list = slots[slice * kSliceWidth + lane];
                solids.slot.push_back(c < list.size() ? list[c] : 4 * padded_tets);
            }
        }
    }
    solids.slot_column.push_back(grown(solids.slot.size() / kSliceWidth, 0).first);
}

// Springs along the edges, stiffness from solid_moduli; factor = stiffness / its mean over the edges.
void append_edge_springs(const Meshes& meshes, uint32_t prototype, const Filling& filling, const SolidSurface* skin, Springs& springs) {
    std::map<std::array<uint32_t, 2>, double> around;  // edge -> stiffness / modulus
    for (size_t tet = 0; tet < filling.tetrahedra.size(); ++tet) {
        const Tetrahedron& t = filling.tetrahedra[tet];
        double squared = 0;
        for (int i = 0; i < 4; ++i) {
            for (int j = i + 1; j < 4; ++j) squared += (filling.node[t[i]] - filling.node[t[j]]).squaredNorm();
        }
        const double share = 6 * filling.volume(t) * filling.share(tet) / squared;
        for (int i = 0; i < 4; ++i) {
            for (int j = i + 1; j < 4; ++j) around[{std::min(t[i], t[j]), std::max(t[i], t[j])}] += share;
        }
    }
    std::vector<std::array<uint32_t, 2>> edge;
    double mean = 0;
    for (const auto& [ends, stiffness] : around) {
        mean += stiffness / static_cast<double>(around.size());
        edge.push_back(ends);
    }
    springs.factor.resize(springs.rest_length.size(), 1.0f);
    const EmbeddedSkin carried = skin ? EmbeddedSkin{meshes.info[prototype].vertices.count, skin->boundary} : EmbeddedSkin{};
    add_springs(springs, meshes, prototype, filling.node, edge, carried);
    SpringInfo& info = springs.info[prototype];
    info.varied = 1;
    springs.factor.resize(springs.rest_length.size(), 0.0f);
    const uint32_t* column = springs.slice_column.data() + info.slices.first + prototype;
    for (uint32_t v = 0; v < filling.node.size(); ++v) {
        const uint32_t slice = v / kSliceWidth, lane = v % kSliceWidth;
        for (uint32_t c = column[slice]; c < column[slice + 1]; ++c) {
            const uint32_t slot = c * kSliceWidth + lane, far_end = springs.neighbour[slot];
            if (far_end == v) continue;
            springs.factor[slot] = static_cast<float>(around.at({std::min(v, far_end), std::max(v, far_end)}) / mean);
        }
    }
    info.mean_geometry = mean;
}

// An element for a prototype without tetrahedra.
void add_without_tetrahedra(SolidInfo info, Solids& solids) {
    info.slices = grown(solids.slot_column.size() - solids.info.size(), 0);
    solids.slot_column.push_back(static_cast<uint32_t>(solids.slot.size() / kSliceWidth));
    solids.info.push_back(info);
}

Range append_skin(const SurfaceEmbedding& binding, size_t vertices, Solids& solids) {
    TROCAR_ASSERT(binding.node.size() == vertices);
    const Range range = grown(solids.embedding_node.size(), vertices);
    solids.embedding_node.insert(solids.embedding_node.end(), binding.node.begin(), binding.node.end());
    solids.embedding_weight.insert(solids.embedding_weight.end(), binding.weight.begin(), binding.weight.end());
    return range;
}

}  // namespace

void add_solid(const Meshes& meshes, uint32_t prototype, std::span<const Vec3d> inner, std::span<const Tetrahedron> tetrahedra,
               Springs& springs, Solids& solids, const SolidSurface* skin, bool tears) {
    TROCAR_ASSERT(!tetrahedra.empty() && solids.info.size() <= prototype);
    while (solids.info.size() < prototype) add_without_tetrahedra({}, solids);
    const MeshView surface = mesh_view(meshes, prototype);
    Filling filling{{}, tetrahedra, skin ? std::span<const double>(skin->fill) : std::span<const double>()};
    TROCAR_ASSERT(filling.fill.empty() || (filling.fill.size() == tetrahedra.size() && !tears));
    if (!skin) filling.node.assign(surface.position.begin(), surface.position.end());
    filling.node.insert(filling.node.end(), inner.begin(), inner.end());
    for (const Tetrahedron& t : tetrahedra) {
        for (const uint32_t node : t) TROCAR_ASSERT(node < filling.node.size());
    }
    append_edge_springs(meshes, prototype, filling, skin, springs);
    if (!filling.fill.empty()) {
        const uint32_t first = springs.vertices[prototype].first + springs.info[prototype].skin;
        for (size_t v = 0; v < inner.size(); ++v) springs.area_share[first + v] = static_cast<float>(skin->node_area[v]);
    }
    SolidInfo info;
    info.inner = grown(solids.position.size(), inner.size());
    solids.position.insert(solids.position.end(), inner.begin(), inner.end());
    if (skin) info.skin = append_skin(skin->binding, surface.position.size(), solids);
    append_tetrahedra(filling, info, solids);
    append_slots(filling, info.tetrahedra.count, info, solids);
    info.nodes = grown(solids.node_volume.size(), filling.node.size());
    const std::vector<double> volume = !filling.fill.empty() ? skin->node_volume
                                       : tears               ? quarter_volumes(filling.node, tetrahedra)
                                                             : lumped_volume(filling.node, tetrahedra);
    solids.node_volume.insert(solids.node_volume.end(), volume.begin(), volume.end());
    solids.info.push_back(info);
}

void add_caged_shell(const Meshes& meshes, uint32_t prototype, std::span<const Vec3d> node, const SolidSurface& skin, Springs& springs,
                     Solids& solids) {
    TROCAR_ASSERT(solids.info.size() <= prototype);
    while (solids.info.size() < prototype) add_without_tetrahedra({}, solids);
    const EdgeTable table = make_edge_table(skin.boundary, static_cast<uint32_t>(node.size()));
    add_springs(springs, meshes, prototype, node, table.edge, {meshes.info[prototype].vertices.count, skin.boundary});
    SolidInfo info;
    info.inner = grown(solids.position.size(), node.size());
    solids.position.insert(solids.position.end(), node.begin(), node.end());
    info.skin = append_skin(skin.binding, meshes.info[prototype].vertices.count, solids);
    info.nodes = grown(solids.node_volume.size(), node.size());
    std::vector<double> share(node.size());
    double area = 0;
    for (const Triangle& t : skin.boundary) {
        const double third = (node[t[1]] - node[t[0]]).cross(node[t[2]] - node[t[0]]).norm() / 6;
        for (const uint32_t v : t) share[v] += third;
        area += 3 * third;
    }
    for (const double s : share) solids.node_volume.push_back(s / area);
    add_without_tetrahedra(info, solids);
}

void add_caged_shell_body(const Meshes& meshes, const Springs& springs, const Solids& solids, const Poses& poses, uint32_t body,
                          Bodies& bodies, Particles& particles, Anchors& anchors) {
    const uint32_t prototype = bodies.mesh[body];
    const SolidInfo& info = solids.info[prototype];
    const MeshInfo& mesh = meshes.info[prototype];
    const Tissue& tissue = bodies.tissue[body];
    const bool sheet = mesh.admission == Admission::kSheet;
    const double whole = sheet ? mesh.area * (bodies.thickness[body] > 0 ? bodies.thickness[body] : tissue.wall) : std::abs(mesh.volume);
    std::vector<double> volume(solids.node_volume.begin() + info.nodes.first, solids.node_volume.begin() + info.nodes.end());
    for (double& v : volume) v *= whole;
    BodyNodes nodes;
    nodes.skin = embedded_count(info);
    nodes.inner = std::span(solids.position).subspan(info.inner.first, info.inner.count);
    nodes.volume = volume;
    nodes.spring_stiffness = 0.5 * std::sqrt(3.0) * tissue.youngs_modulus * tissue.wall;  // as add_deformable
    add_deformable(meshes, springs, poses, body, bodies, particles, anchors, &nodes);
    drape_skin(solids, bodies, body, particles);
    update_stable_dt(springs, body, particles, anchors, bodies);
}

void add_solid_body(const Meshes& meshes, const Springs& springs, const Solids& solids, const Poses& poses, uint32_t body, Bodies& bodies,
                    Particles& particles, Anchors& anchors) {
    const uint32_t prototype = bodies.mesh[body];
    TROCAR_ASSERT(is_solid(solids, prototype));
    const SolidInfo& info = solids.info[prototype];
    const uint32_t surface = surface_nodes(meshes, info, prototype);
    BodyNodes nodes;
    nodes.skin = embedded_count(info);
    nodes.inner = std::span(solids.position).subspan(info.inner.first, info.inner.count);
    nodes.volume = std::span(solids.node_volume).subspan(info.nodes.first, info.nodes.count);
    TROCAR_ASSERT(nodes.volume.size() == surface + nodes.inner.size());
    const SolidModuli moduli = solid_moduli(bodies.tissue[body]);
    nodes.spring_stiffness = moduli.springs * springs.info[prototype].mean_geometry;
    add_deformable(meshes, springs, poses, body, bodies, particles, anchors, &nodes);
    drape_skin(solids, bodies, body, particles);
    update_solid_dt(meshes, springs, solids, body, particles, anchors, bodies);
}

}  // namespace trocar
