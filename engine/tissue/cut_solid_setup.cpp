#include "engine/tissue/cut_solid_setup.hpp"

#include <algorithm>
#include <cmath>

#include "engine/base/check.hpp"
#include "engine/mesh/mesh_topology.hpp"
#include "engine/tissue/cut_setup.hpp"
#include "engine/tissue/embedded_surface.hpp"
#include "engine/tissue/solid_limit.hpp"
#include "engine/tissue/tet_forces.hpp"
namespace trocar {
namespace {

uint32_t in_slices(uint32_t elements) { return (elements + kSliceWidth - 1) / kSliceWidth; }

// Lists of the nodes of a solid in slices of 16, as springs and tetrahedra have them.
struct SlicedLists {
    std::vector<uint32_t> column;  // first column of a slice, from 0
    std::vector<uint32_t> degree;  // per node
};

SlicedLists slice_lists(uint32_t slices, std::vector<uint32_t> degree) {
    degree.resize(size_t{slices} * kSliceWidth, 0);
    SlicedLists lists{{0}, std::move(degree)};
    for (uint32_t slice = 0; slice < slices; ++slice) {
        const auto begin = lists.degree.begin() + slice * kSliceWidth;
        lists.column.push_back(lists.column.back() + *std::max_element(begin, begin + kSliceWidth));
    }
    return lists;
}

struct LatticeSpring {
    uint32_t a, b;
    double share;  // stiffness / modulus
    double length;
};

// The pieces in numbers that the arrays take.
struct LaidPieces {
    std::vector<double> six;            // m^3, six times the volume of a lattice tetrahedron at rest
    std::vector<double> volume;         // m^3, of a node
    std::vector<LatticeSpring> spring;  // ascending
    SlicedLists springs, corners;
    Meshes surface;
};

std::vector<LatticeSpring> gather_springs(std::span<const CutPart> part, const auto& rest, std::span<const double> six) {
    std::vector<LatticeSpring> all;
    for (const CutPart& p : part) {
        double squared = 0;
        for (int i = 0; i < 4; ++i)
            for (int j = i + 1; j < 4; ++j) squared += (rest(p.node[i]) - rest(p.node[j])).squaredNorm();
        for (int i = 0; i < 4; ++i)
            for (int j = i + 1; j < 4; ++j)
                all.push_back({std::min(p.node[i], p.node[j]), std::max(p.node[i], p.node[j]), p.share * six[p.tetrahedron] / squared,
                               (rest(p.node[i]) - rest(p.node[j])).norm()});
    }
    std::stable_sort(all.begin(), all.end(),
                     [](const LatticeSpring& x, const LatticeSpring& y) { return std::tie(x.a, x.b) < std::tie(y.a, y.b); });
    std::vector<LatticeSpring> each;
    for (const LatticeSpring& s : all) {
        if (!each.empty() && each.back().a == s.a && each.back().b == s.b)
            each.back().share += s.share;
        else
            each.push_back(s);
    }
    return each;
}

Meshes surface_of(const CutSolid& limits, const LatticePieces& pieces, const auto& rest, Admission admission) {
    Mesh mesh;
    for (const CutSolidVertex& v : pieces.vertex) {
        Vec3d p = Vec3d::Zero();
        for (size_t k = 0; k < 4; ++k) p += v.weight[k] * rest(v.node[k]);
        mesh.position.push_back(p);
    }
    mesh.triangle = pieces.triangle, mesh.uv = pieces.uv, mesh.triangle_material = pieces.material;
    mesh.material.resize(limits.wall + 1);
    Meshes made;
    add_prototype(made, mesh, admission);
    for (uint32_t& component : made.component)
        if (component == kNone) component = 0;  // of a vertex without a triangle
    return made;
}

LaidPieces lay_out(const CutSolid& limits, const LatticePieces& pieces, const Actions& actions, const Solids& solids, uint32_t prototype,
                   Admission admission) {
    const SolidInfo& info = solids.info[prototype];
    const auto rest = [&](uint32_t node) -> const Vec3d& { return solids.position[info.inner.first + pieces.node_of[node]]; };
    const Lattice lattice = lattice_of(limits, actions);
    LaidPieces laid;
    for (const auto& t : lattice.tetrahedron) laid.six.push_back(six_volumes(rest(t[0]), rest(t[1]), rest(t[2]), rest(t[3])));
    laid.volume.assign(info.nodes.count, 0.0);
    std::vector<uint32_t> degree(info.nodes.count, 0), around(info.nodes.count, 0);
    for (const CutPart& p : pieces.part)
        for (const uint32_t n : p.node) laid.volume[n] += p.share * laid.six[p.tetrahedron] / 24, ++around[n];
    laid.spring = gather_springs(pieces.part, rest, laid.six);
    for (const LatticeSpring& s : laid.spring) ++degree[s.a], ++degree[s.b];
    laid.springs = slice_lists(info.slices.count, std::move(degree));
    laid.corners = slice_lists(info.slices.count, std::move(around));
    laid.surface = surface_of(limits, pieces, rest, admission);
    return laid;
}

void lay_springs(const CutSolid& limits, const LaidPieces& laid, uint32_t prototype, Springs& springs) {
    const SpringInfo& info = springs.info[prototype];
    uint32_t* column = springs.slice_column.data() + info.slices.first + prototype;
    const uint32_t first = column[0];
    for (uint32_t slice = 0; slice <= info.slices.count; ++slice) column[slice] = first + laid.springs.column[slice];
    const size_t at = size_t{first} * kSliceWidth, used = size_t{laid.springs.column.back()} * kSliceWidth;
    for (uint32_t slice = 0; slice < info.slices.count; ++slice)
        for (size_t h = size_t{column[slice]} * kSliceWidth; h < size_t{column[slice + 1]} * kSliceWidth; ++h) {
            springs.neighbour[h] = slice * kSliceWidth + static_cast<uint32_t>(h % kSliceWidth);
            springs.rest_length[h] = springs.factor[h] = 0.0f;
        }
    const size_t left = size_t{limits.columns} * kSliceWidth - used;
    std::fill_n(springs.neighbour.begin() + at + used, left, 0u);
    std::fill_n(springs.rest_length.begin() + at + used, left, 0.0f);
    std::fill_n(springs.factor.begin() + at + used, left, 0.0f);
    std::vector<uint32_t> filled(laid.springs.degree.size(), 0);
    const auto put = [&](uint32_t from, uint32_t to, const LatticeSpring& s) {
        const size_t h = (size_t{column[from / kSliceWidth]} + filled[from]++) * kSliceWidth + from % kSliceWidth;
        springs.neighbour[h] = to;
        springs.rest_length[h] = static_cast<float>(s.length);
        springs.factor[h] = static_cast<float>(s.share / info.mean_geometry);
    };
    // within a node the columns ascend by neighbour: the lower ones first
    for (const LatticeSpring& s : laid.spring) put(s.b, s.a, s);
    for (const LatticeSpring& s : laid.spring) put(s.a, s.b, s);
}

void lay_tetrahedra(const CutSolid& limits, const LatticePieces& pieces, const LaidPieces& laid, uint32_t prototype, Solids& solids) {
    SolidInfo& info = solids.info[prototype];
    info.count = static_cast<uint32_t>(pieces.part.size());
    const uint32_t padded = info.tetrahedra.count;
    for (uint32_t t = 0; t < padded; ++t) {
        const size_t at = size_t{info.tetrahedra.first} + t;
        const bool there = t < info.count;
        const double six = there ? laid.six[pieces.part[t].tetrahedron] : 0;
        for (size_t k = 0; k < 4; ++k) solids.corner[k][at] = there ? pieces.part[t].node[k] : 0u;
        solids.rest[at] = static_cast<float>(six);
        solids.per_rest[at] = there ? static_cast<float>(1 / six) : 0.0f;
        solids.factor[at] = there ? static_cast<float>(pieces.part[t].share) : 1.0f;
    }
    uint32_t* column = solids.slot_column.data() + info.slices.first + prototype;
    const uint32_t first = column[0];
    for (uint32_t slice = 0; slice <= info.slices.count; ++slice) column[slice] = first + laid.corners.column[slice];
    std::fill_n(solids.slot.begin() + size_t{first} * kSliceWidth, size_t{limits.slots} * kSliceWidth, 4 * padded);
    std::vector<uint32_t> filled(laid.corners.degree.size(), 0);
    for (uint32_t t = 0; t < info.count; ++t) {
        for (uint32_t k = 0; k < 4; ++k) {
            const uint32_t node = pieces.part[t].node[k];
            solids.slot[(size_t{column[node / kSliceWidth]} + filled[node]++) * kSliceWidth + node % kSliceWidth] = k * padded + t;
        }
    }
    std::copy(laid.volume.begin(), laid.volume.end(), solids.node_volume.begin() + info.nodes.first);
    for (size_t n = 0; n < pieces.node_of.size(); ++n)
        solids.position[info.inner.first + n] = solids.position[info.inner.first + pieces.node_of[n]];
    for (uint32_t v = 0; v < info.skin.count; ++v) {
        const CutSolidVertex& vertex = pieces.vertex[v < pieces.vertex.size() ? v : 0];
        solids.embedding_node[info.skin.first + v] = vertex.node;
        solids.embedding_weight[info.skin.first + v] = vertex.weight;
    }
}

// A copy of a node has its share of the anchor, by volume: so it is no stiffer for its mass.
void lay_anchors(const CutSolid& limits, const LatticePieces& pieces, const LaidPieces& laid, const Actions& actions, uint32_t first,
                 Anchors& anchors) {
    std::vector<double> whole(limits.nodes, 0.0);
    for (size_t n = 0; n < pieces.node_of.size(); ++n) whole[pieces.node_of[n]] += laid.volume[n];
    for (uint32_t n = 0; n < pieces.node_of.size(); ++n) {
        const uint32_t of = pieces.node_of[n];
        const double share = whole[of] > 0 ? laid.volume[n] / whole[of] : 0;
        anchors.stiffness[first + n] = static_cast<float>(share * double{actions.lattice_anchor[limits.anchors.first + of]});
        for (auto* goal : {&anchors.rest_x, &anchors.rest_y, &anchors.rest_z}) (*goal)[first + n] = (*goal)[first + of];
    }
}

bool is_laid(const CutSolid& limits, uint32_t index, const CutLattices& state, const Meshes& meshes, const Solids& solids,
             uint32_t prototype) {
    const MeshInfo& info = meshes.info[prototype];
    const auto& count = state.count[index];
    if (info.vertices.count != count[2] || info.triangles.count != count[3] || solids.info[prototype].count != count[1]) return false;
    return std::equal(state.triangle.begin() + limits.triangles.first, state.triangle.begin() + limits.triangles.first + count[3],
                      meshes.triangle.begin() + info.triangles.first);
}

}  // namespace

CutSolidRoom room_for_solid_cuts(uint32_t nodes, uint32_t tetrahedra, uint32_t vertices, uint32_t triangles, uint32_t more) {
    // A parted tetrahedron adds a part and two to eight triangles, and shares its new nodes and vertices with its neighbours.
    CutSolidRoom room{nodes + more / 2 + 64, tetrahedra + more / 2 + 64, vertices + more + 64, triangles + more, 0};
    room.edges = 3 * room.triangles / 2 + 64;
    return room;
}

void widen_solid(const CutSolidRoom& room, uint32_t prototype, Springs& springs, Solids& solids) {
    SpringInfo& spring = springs.info[prototype];
    SolidInfo& info = solids.info[prototype];
    TROCAR_ASSERT(springs.info.size() == prototype + 1 && solids.info.size() == prototype + 1 && info.nodes.count == room.nodes);
    spring.packed = kNone;
    // A copy has at most the neighbours of its node. Three quarters of the slices that are added take what a cut node has at most.
    constexpr uint32_t kSpringColumns = 24, kCornerColumns = 40;
    const uint32_t more = in_slices(room.nodes);
    const auto reserved = [&](uint32_t used, uint32_t each) { return used + used / 4 + more * each / 4; };
    const auto widen = [](auto& array, size_t columns, auto value) { array.resize(array.size() + columns * kSliceWidth, value); };
    const uint32_t used = springs.slice_column.back() - springs.slice_column[spring.slices.first + prototype];
    const uint32_t columns = reserved(used, kSpringColumns) - used;
    widen(springs.neighbour, columns, 0u), widen(springs.rest_length, columns, 0.0f);
    springs.factor.resize(springs.neighbour.size(), 0.0f);
    const uint32_t slots = solids.slot_column.back() - solids.slot_column[info.slices.first + prototype];
    info.tetrahedra.count = in_slices(room.parts) * kSliceWidth;
    info.varied = 1;
    for (auto& corner : solids.corner) corner.resize(info.tetrahedra.end(), 0);
    solids.rest.resize(info.tetrahedra.end(), 0.0f), solids.per_rest.resize(info.tetrahedra.end(), 0.0f);
    solids.factor.resize(info.tetrahedra.end(), 1.0f);
    widen(solids.slot, reserved(slots, kCornerColumns) - slots, 4 * info.tetrahedra.count);
}

void add_cut_solid(const CutSolidRoom& room, uint32_t nodes, uint32_t tetrahedra, uint32_t wall, uint32_t body,
                   const CutSolidArrays& arrays, const Particles& particles, Bodies& bodies, Actions& actions, CutLattices& state) {
    const auto& [meshes, springs, solids, anchors] = arrays;
    const uint32_t prototype = bodies.mesh[body];
    const MeshInfo& mesh = meshes.info[prototype];
    const SolidInfo& info = solids.info[prototype];
    const auto next = [](size_t size, size_t count) { return Range{static_cast<uint32_t>(size), static_cast<uint32_t>(count)}; };
    CutSolid limits;
    limits.body = body, limits.nodes = nodes, limits.wall = wall, limits.mesh_edges = room.edges;
    limits.tetrahedra = next(actions.lattice_tetrahedron.size(), tetrahedra);
    std::vector<std::array<uint32_t, 4>> tetrahedron(tetrahedra), neighbour;
    for (uint32_t t = 0; t < tetrahedra; ++t)
        for (size_t k = 0; k < 4; ++k) tetrahedron[t][k] = solids.corner[k][info.tetrahedra.first + t];
    std::vector<std::array<uint32_t, 2>> edge;
    std::vector<LatticeFace> face;
    find_lattice(tetrahedron, neighbour, edge, face);
    TROCAR_ASSERT(face.size() == mesh.triangles.count);
    limits.edges = next(actions.lattice_edge.size(), edge.size());
    limits.faces = next(actions.lattice_face.size(), face.size());
    limits.anchors = next(actions.lattice_anchor.size(), nodes);
    const auto append = [](auto& to, const auto& from) { to.insert(to.end(), from.begin(), from.end()); };
    append(actions.lattice_tetrahedron, tetrahedron), append(actions.lattice_neighbour, neighbour);
    append(actions.lattice_edge, edge), append(actions.lattice_face, face);
    const auto looks = [&](auto& to, const auto& from) {
        to.insert(to.end(), from.begin() + mesh.triangles.first, from.begin() + mesh.triangles.end());
    };
    looks(actions.lattice_uv, meshes.uv), looks(actions.lattice_material, meshes.triangle_material);
    const auto held = anchors.stiffness.begin() + bodies.particles[body].first + embedded_count(info);
    actions.lattice_anchor.insert(actions.lattice_anchor.end(), held, held + nodes);
    limits.parts = next(state.part.size(), room.parts), limits.copies = next(state.node_of.size(), room.nodes);
    limits.vertices = next(state.vertex.size(), room.vertices), limits.triangles = next(state.triangle.size(), room.triangles);
    limits.columns = static_cast<uint32_t>(springs.neighbour.size() / kSliceWidth) -
                     springs.slice_column[springs.info[prototype].slices.first + prototype];
    limits.slots = static_cast<uint32_t>(solids.slot.size() / kSliceWidth) - solids.slot_column[info.slices.first + prototype];
    state.cut_at.resize(limits.edges.end(), 0.0);
    state.part.resize(limits.parts.end()), state.node_of.resize(limits.copies.end(), 0);
    state.before.resize(limits.copies.end(), Vec3d::Zero());
    state.vertex.resize(limits.vertices.end()), state.triangle.resize(limits.triangles.end());
    state.uv.resize(limits.triangles.end()), state.material.resize(limits.triangles.end(), 0);
    state.count.emplace_back();
    const uint32_t index = static_cast<uint32_t>(actions.cut_solid.size());
    actions.cut_solid.push_back(limits);
    [[maybe_unused]] const bool fits = put_pieces(limits, index, whole_pieces(lattice_of(limits, actions)), state) &&
                                       lay_cut_solid(limits, index, actions, state, bodies, arrays);
    TROCAR_ASSERT(fits);
    update_tearing_solid_dt(meshes, springs, solids, body, particles, anchors, bodies);
}

Lattice lattice_of(const CutSolid& limits, const Actions& actions) {
    const auto part = [](const auto& of, const Range& range) { return std::span(of).subspan(range.first, range.count); };
    return {part(actions.lattice_tetrahedron, limits.tetrahedra),
            part(actions.lattice_neighbour, limits.tetrahedra),
            part(actions.lattice_edge, limits.edges),
            part(actions.lattice_face, limits.faces),
            part(actions.lattice_uv, limits.faces),
            part(actions.lattice_material, limits.faces),
            limits.nodes,
            static_cast<uint16_t>(limits.wall)};
}

LatticePieces take_pieces(const CutSolid& limits, uint32_t index, const CutLattices& state) {
    const auto& [nodes, parts, vertices, triangles] = state.count[index];
    LatticePieces pieces;
    const auto take = [](const auto& from, const Range& range, uint32_t count, auto& to) {
        to.assign(from.begin() + range.first, from.begin() + range.first + count);
    };
    take(state.cut_at, limits.edges, limits.edges.count, pieces.cut_at);
    take(state.part, limits.parts, parts, pieces.part), take(state.node_of, limits.copies, nodes, pieces.node_of);
    take(state.vertex, limits.vertices, vertices, pieces.vertex);
    take(state.triangle, limits.triangles, triangles, pieces.triangle), take(state.uv, limits.triangles, triangles, pieces.uv);
    take(state.material, limits.triangles, triangles, pieces.material);
    return pieces;
}

bool put_pieces(const CutSolid& limits, uint32_t index, const LatticePieces& pieces, CutLattices& state) {
    if (pieces.node_of.size() > limits.copies.count || pieces.part.size() > limits.parts.count ||
        pieces.vertex.size() > limits.vertices.count || pieces.triangle.size() > limits.triangles.count)
        return false;
    const auto put = [](const auto& from, const Range& range, auto& to) { std::copy(from.begin(), from.end(), to.begin() + range.first); };
    put(pieces.cut_at, limits.edges, state.cut_at), put(pieces.part, limits.parts, state.part);
    put(pieces.node_of, limits.copies, state.node_of), put(pieces.vertex, limits.vertices, state.vertex);
    put(pieces.triangle, limits.triangles, state.triangle), put(pieces.uv, limits.triangles, state.uv);
    put(pieces.material, limits.triangles, state.material);
    const auto count = [](const auto& of) { return static_cast<uint32_t>(of.size()); };
    state.count[index] = {count(pieces.node_of), count(pieces.part), count(pieces.vertex), count(pieces.triangle)};
    return true;
}

bool lay_cut_solid(const CutSolid& limits, uint32_t index, const Actions& actions, const CutLattices& state, const Bodies& bodies,
                   const CutSolidArrays& arrays) {
    const uint32_t prototype = bodies.mesh[limits.body];
    const LatticePieces pieces = take_pieces(limits, index, state);
    const Admission admission = arrays.meshes.info[prototype].admission;
    const LaidPieces laid = lay_out(limits, pieces, actions, arrays.solids, prototype, admission);
    if (laid.springs.column.back() > limits.columns || laid.corners.column.back() > limits.slots ||
        laid.surface.edge.size() > limits.mesh_edges)
        return false;
    copy_cut_surface(laid.surface, prototype, arrays.meshes);
    // both sides of a cut touch: their inside is that of the winding number
    const bool parted = pieces.part.size() > limits.tetrahedra.count;
    arrays.meshes.info[prototype].admission = parted ? Admission::kWinding : Admission::kSolid;
    lay_springs(limits, laid, prototype, arrays.springs);
    lay_tetrahedra(limits, pieces, laid, prototype, arrays.solids);
    const uint32_t first = bodies.particles[limits.body].first + embedded_count(arrays.solids.info[prototype]);
    lay_anchors(limits, pieces, laid, actions, first, arrays.anchors);
    return true;
}

void restore_cut_solids(const Actions& actions, const CutLattices& state, const Bodies& bodies, const Particles& particles,
                        const CutSolidArrays& arrays, std::span<std::unique_ptr<ClosestPointTree>> trees) {
    for (uint32_t index = 0; index < actions.cut_solid.size(); ++index) {
        const CutSolid& limits = actions.cut_solid[index];
        if (is_laid(limits, index, state, arrays.meshes, arrays.solids, bodies.mesh[limits.body])) continue;
        lay_cut_solid(limits, index, actions, state, bodies, arrays);
        remake_tree(limits.body, bodies, particles, arrays.meshes, trees);
    }
}

}  // namespace trocar
