#include "content/scene/make_solid.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "content/shapes/surface_texture.hpp"
#include "content/volume/filled_lattice.hpp"
#include "content/volume/mesh_distance.hpp"
#include "content/volume/organ_surface.hpp"
#include "engine/base/error.hpp"
#include "engine/mesh/mesh_topology.hpp"
#include "engine/tissue/bending_forces.hpp"
#include "engine/tissue/cut_setup.hpp"
#include "engine/tissue/pressure_force.hpp"
#include "engine/tissue/solid_setup.hpp"
#include "engine/tissue/solid_tears.hpp"
namespace trocar {
namespace {

constexpr double kTextureTile = 0.08;  // m

// Applies the appearance of the first material; a texture made for other coordinates is kept and projected.
void dress(const Mesh& looks, Mesh& surface) {
    if (looks.material.empty()) return;
    surface.material.push_back(looks.material.front());
    if (!surface.material.front().image.rgba.empty()) project_uv(kTextureTile, surface);
}

// Permutation with the boundary vertices first; both parts keep their order.
std::vector<uint32_t> boundary_first(const TetMesh& tets, std::span<const Triangle> boundary, uint32_t& count) {
    std::vector<uint32_t> to(tets.position.size(), kNone);
    std::vector<bool> outside(to.size(), false);
    for (const Triangle& t : boundary) {
        for (const uint32_t v : t) outside[v] = true;
    }
    uint32_t next = 0;
    for (uint32_t v = 0; v < to.size(); ++v) {
        if (outside[v]) to[v] = next++;
    }
    count = next;
    for (uint32_t v = 0; v < to.size(); ++v) {
        if (!outside[v]) to[v] = next++;
    }
    return to;
}

// Groups nodes with similar numbers of tetrahedra within windows of `kWindow` nodes: sixteen nodes are
// processed together in SIMD and take as long as the one with the most neighbours.
void order_nodes(TetMesh& tets) {
    constexpr size_t kWindow = 512;
    std::vector<uint32_t> valence(tets.position.size(), 0), order(valence.size()), to(valence.size());
    for (const auto& t : tets.tetrahedron) {
        for (const uint32_t v : t) ++valence[v];
    }
    std::iota(order.begin(), order.end(), 0u);
    for (size_t begin = 0; begin < order.size(); begin += kWindow) {
        const size_t end = std::min(begin + kWindow, order.size());
        std::stable_sort(order.begin() + static_cast<ptrdiff_t>(begin), order.begin() + static_cast<ptrdiff_t>(end),
                         [&](uint32_t a, uint32_t b) { return valence[a] > valence[b]; });
    }
    std::vector<Vec3d> position(order.size());
    for (uint32_t row = 0; row < order.size(); ++row) position[row] = tets.position[order[row]], to[order[row]] = row;
    tets.position.swap(position);
    for (auto& t : tets.tetrahedron) t = {to[t[0]], to[t[1]], to[t[2]], to[t[3]]};
}

// Appends all nodes as vertices behind those of the embedded surface, each bound to itself.
void add_riding_nodes(const TetMesh& tets, Mesh& surface, SurfaceEmbedding& skin) {
    for (uint32_t node = 0; node < tets.position.size(); ++node) {
        surface.position.push_back(tets.position[node]);
        skin.node.push_back({node, node, node, node});
        skin.weight.push_back({1, 0, 0, 0});
    }
}

// Shares of a surface's area (m^2) that the nodes carry which its vertices are bound to.
std::vector<double> carried_area(const Mesh& surface, const SurfaceEmbedding& binding, size_t nodes) {
    std::vector<double> area(nodes, 0.0);
    for (const Triangle& t : surface.triangle) {
        const Vec3d &a = surface.position[t[0]], &b = surface.position[t[1]], &c = surface.position[t[2]];
        const double third = (b - a).cross(c - a).norm() / 6;
        for (const uint32_t v : t)
            for (int k = 0; k < 4; ++k) area[binding.node[v][k]] += third * binding.weight[v][k];
    }
    for (double& a : area) a = std::max(a, 0.0);  // vertices outside their tetrahedron have negative weights
    return area;
}

// A solid whose surface cuts whole tetrahedra of a lattice.
void add_filled(Meshes& meshes, Springs& springs, Solids& solids, double spacing, Mesh& surface, Prototype& skin) {
    if (skin.judgement.admitted_as != Admission::kSolid)
        throw InputError("boundary = \"filled\" needs a closed, oriented surface without self-crossings: " + skin.judgement.reason);
    FilledLattice lattice = fill_lattice(spacing, surface.position, surface.triangle);
    if (lattice.tets.tetrahedron.empty()) throw InputError("no tetrahedra: the surface encloses nothing");
    order_nodes(lattice.tets);
    SolidSurface carried{bind_skin(surface.position, lattice.tets.position, lattice.tets.tetrahedron), boundary_of(lattice.tets)};
    carried.node_volume = filled_node_volume(lattice);
    carried.node_area = carried_area(surface, carried.binding, lattice.tets.position.size());
    carried.fill = std::move(lattice.fill);
    skin.row = add_prototype(meshes, surface, skin.judgement.admitted_as);
    add_solid(meshes, skin.row, lattice.tets.position, lattice.tets.tetrahedron, springs, solids, &carried);
}

// Factor on the colour of a body for the new surface inside it.
constexpr float kInside = 0.6f;

// A solid that instruments may cut: all its vertices are embedded in its nodes, and elements are reserved.
Prototype add_cut_tets(Meshes& meshes, Springs& springs, Solids& solids, const TetMesh& tets, const Mesh& looks, uint32_t more) {
    std::vector<std::array<uint32_t, 4>> neighbour;
    std::vector<std::array<uint32_t, 2>> edge;
    std::vector<LatticeFace> face;
    find_lattice(tets.tetrahedron, neighbour, edge, face);
    const std::vector<std::array<Vec2, 3>> uv(face.size());
    const std::vector<uint16_t> material(face.size(), 0);
    const uint32_t nodes = static_cast<uint32_t>(tets.position.size());
    const LatticePieces pieces = whole_pieces({tets.tetrahedron, neighbour, edge, face, uv, material, nodes, 1});
    Mesh surface;
    surface.name = looks.name;
    SolidSurface carried;
    for (const CutSolidVertex& v : pieces.vertex) surface.position.push_back(tets.position[v.point[0]]);
    surface.triangle = pieces.triangle;
    for (const LatticeFace& f : face) carried.boundary.push_back(f.corner);
    dress(looks, surface);
    if (surface.material.empty()) surface.material.emplace_back();
    Material inside = surface.material.front();
    for (float& c : inside.diffuse) c *= kInside;
    inside.image = {}, inside.texture.clear();
    surface.material.push_back(inside);
    surface.triangle_material = material;

    Prototype made;
    made.judgement = judge_mesh(surface);
    if (made.judgement.admitted_as == Admission::kRefused) return made;
    if (made.judgement.admitted_as != Admission::kSolid)
        throw InputError("the lattice of a solid that instruments cut must have a sound surface (" + made.judgement.reason +
                         "); take finer cells");
    const auto count = [](const auto& of) { return static_cast<uint32_t>(of.size()); };
    const uint32_t triangles = count(surface.triangle), vertices = count(surface.position);
    made.room = room_for_solid_cuts(nodes, count(tets.tetrahedron), vertices, triangles, more > 0 ? more : 4 * triangles);
    made.lattice_nodes = nodes, made.lattice_tetrahedra = count(tets.tetrahedron), made.wall = 1;
    made.row = add_prototype(meshes, surface, made.judgement.admitted_as);
    keep_cut_room({made.room.vertices, made.room.triangles, made.room.edges}, meshes);
    // all that it may get are embedded, the unused ones where the first one is; unused nodes have no tetrahedra
    for (uint32_t v = 0; v < made.room.vertices; ++v) {
        const CutSolidVertex& vertex = pieces.vertex[v < vertices ? v : 0];
        carried.binding.node.push_back(vertex.node), carried.binding.weight.push_back(vertex.weight);
    }
    std::vector<Vec3d> all = tets.position;
    all.resize(made.room.nodes, tets.position.front());
    meshes.info[made.row].vertices.count = made.room.vertices;
    add_solid(meshes, made.row, all, tets.tetrahedron, springs, solids, &carried, true);
    meshes.info[made.row].vertices.count = vertices;
    widen_solid(made.room, made.row, springs, solids);
    return made;
}

}  // namespace

Prototype add_tet_mesh(Meshes& meshes, Springs& springs, Solids& solids, const TetMesh& tets, const Mesh& looks, bool tears) {
    Mesh surface;
    surface.name = looks.name;
    surface.triangle = boundary_of(tets);
    uint32_t outer = 0;
    const std::vector<uint32_t> to = boundary_first(tets, surface.triangle, outer);
    surface.position.resize(outer);
    std::vector<Vec3d> inner(to.size() - outer);
    for (uint32_t v = 0; v < to.size(); ++v) {
        (to[v] < outer ? surface.position[to[v]] : inner[to[v] - outer]) = tets.position[v];
    }
    for (Triangle& t : surface.triangle) t = {to[t[0]], to[t[1]], to[t[2]]};
    dress(looks, surface);
    std::vector<std::array<uint32_t, 4>> corners = tets.tetrahedron;
    for (auto& t : corners) t = {to[t[0]], to[t[1]], to[t[2]], to[t[3]]};

    Prototype made;
    made.judgement = judge_mesh(surface);
    if (made.judgement.admitted_as == Admission::kRefused) return made;
    if (tears) surface.position.insert(surface.position.end(), inner.begin(), inner.end()), inner.clear();
    made.row = add_prototype(meshes, surface, made.judgement.admitted_as);
    if (tears) keep_room(room_for_tears(surface, corners, false), meshes);
    add_solid(meshes, made.row, inner, corners, springs, solids, nullptr, tears);
    return made;
}

Prototype make_solid(Meshes& meshes, Springs& springs, Solids& solids, Mesh mesh, const PrototypeOptions& options,
                     const SolidOptions& fill) {
    Meshes alone;
    Prototype skin = make_prototype(alone, std::move(mesh), options);
    if (skin.row == kNone) return skin;
    if (skin.judgement.admitted_as == Admission::kSheet) throw InputError("a solid needs a closed surface: " + skin.judgement.reason);
    Mesh surface{alone.name[0], alone.position, alone.triangle, {}, {}, alone.material};
    const Box box = alone.info[0].box;
    const double extent = (box.max - box.min).maxCoeff();
    const double spacing = fill.spacing > 0 ? fill.spacing : extent / fill.cells;
    if (fill.filled) {
        if (!fill.skin || fill.tears || fill.cuts)
            throw InputError("boundary = \"filled\" is for solids with skin = true that are neither cut nor torn");
        surface.uv = alone.uv, surface.triangle_material = alone.triangle_material;
        add_filled(meshes, springs, solids, spacing, surface, skin);
        return skin;
    }
    TetMesh tets = stuff_isosurface({spacing, 1}, box, mesh_distance(surface, skin.judgement.admitted_as));
    if (tets.tetrahedron.empty()) throw InputError("no tetrahedra: the lattice is too wide for this shape");
    order_nodes(tets);
    if (fill.skin) {
        // bind first, before anything is appended: it may throw
        SolidSurface carried{bind_skin(surface.position, tets.position, tets.tetrahedron), boundary_of(tets)};
        surface.uv = alone.uv;
        surface.triangle_material = alone.triangle_material;
        if (fill.tears) add_riding_nodes(tets, surface, carried.binding);
        skin.row = add_prototype(meshes, surface, skin.judgement.admitted_as);
        if (fill.tears) keep_room(room_for_tears(surface, tets.tetrahedron, true), meshes);
        add_solid(meshes, skin.row, tets.position, tets.tetrahedron, springs, solids, &carried, fill.tears);
        return skin;
    }
    Prototype made = fill.cuts ? add_cut_tets(meshes, springs, solids, tets, surface, fill.cut_capacity)
                               : add_tet_mesh(meshes, springs, solids, tets, surface, fill.tears);
    made.shift = skin.shift;
    made.cleaning = skin.cleaning;
    return made;
}

Prototype make_caged_shell(Meshes& meshes, Springs& springs, Solids& solids, Mesh mesh, const PrototypeOptions& options,
                           const SolidOptions& fill) {
    Meshes alone;
    Prototype skin = make_prototype(alone, std::move(mesh), options);
    if (skin.row == kNone) return skin;
    const Mesh surface{alone.name[0], alone.position, alone.triangle, alone.uv, alone.triangle_material, alone.material};
    const MeshInfo& info = alone.info[0];
    const double spacing = fill.spacing > 0 ? fill.spacing : (info.box.max - info.box.min).maxCoeff() / fill.cells;
    constexpr double kFewest = 20;
    const double wanted = std::max(kFewest, info.area / (0.25 * std::sqrt(3.0) * spacing * spacing));  // number of equilateral triangles
    Mesh cage{{}, surface.position, surface.triangle, {}, {}, {}};
    if (!(wanted < static_cast<double>(surface.triangle.size())))
        throw InputError("the surface has no more triangles than the cage that it would ride on; take wider cells");
    simplify_mesh(cage, static_cast<uint32_t>(wanted));
    SolidSurface carried{bind_to_surface(surface.position, cage.position, cage.triangle), cage.triangle};
    Meshes cages;
    if (fill.pressure || fill.bending) add_prototype(cages, cage, judge_mesh(cage).admitted_as);
    if (fill.pressure && cages.info[0].admission != Admission::kSolid && skin.judgement.admitted_as == Admission::kSolid)
        throw InputError("the surface that is simulated does not enclose a volume that pressure could keep; take finer cells");
    skin.row = add_prototype(meshes, surface, skin.judgement.admitted_as);
    add_caged_shell(meshes, skin.row, cage.position, carried, springs, solids);
    if (fill.pressure) add_fans(springs, mesh_view(cages, 0), skin.row);
    if (fill.bending) add_hinges(springs, mesh_view(cages, 0), skin.row);
    return skin;
}

}  // namespace trocar
