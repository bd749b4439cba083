#include "engine/tissue/solid_tears.hpp"

#include <algorithm>
#include <map>

#include "engine/base/check.hpp"
#include "engine/geometry/edge_table.hpp"
#include "engine/geometry/quaternion.hpp"
#include "engine/tissue/embedded_surface.hpp"
#include "engine/tissue/tet_forces.hpp"
namespace trocar {
namespace {

using Tetrahedron = std::array<uint32_t, 4>;

// Outward faces of a tetrahedron of positive volume.
constexpr uint8_t kFaces[4][3] = {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {0, 3, 2}};

struct FaceUse {
    Triangle sorted, corner;
    uint32_t tetrahedron;
    bool operator<(const FaceUse& other) const { return sorted != other.sorted ? sorted < other.sorted : tetrahedron < other.tetrahedron; }
};

std::vector<FaceUse> sorted_faces(std::span<const Tetrahedron> tetrahedra) {
    std::vector<FaceUse> faces;
    for (uint32_t t = 0; t < tetrahedra.size(); ++t) {
        for (const auto& face : kFaces) {
            const Triangle corner{tetrahedra[t][face[0]], tetrahedra[t][face[1]], tetrahedra[t][face[2]]};
            Triangle sorted = corner;
            std::sort(sorted.begin(), sorted.end());
            faces.push_back({sorted, corner, t});
        }
    }
    std::sort(faces.begin(), faces.end());
    return faces;
}

Tetrahedron corners(const Solids& solids, const SolidInfo& info, uint32_t t) {
    Tetrahedron out;
    for (int k = 0; k < 4; ++k) out[k] = solids.corner[k][info.tetrahedra.first + t];
    return out;
}

std::vector<Tetrahedron> tetrahedra_of(const Solids& solids, const SolidInfo& info) {
    std::vector<Tetrahedron> out(info.count);
    for (uint32_t t = 0; t < info.count; ++t) out[t] = corners(solids, info, t);
    return out;
}

// Index of the half-edge between two nodes.
size_t half_edge(const Springs& springs, uint32_t prototype, uint32_t from, uint32_t to) {
    const uint32_t* column = springs.slice_column.data() + springs.info[prototype].slices.first + prototype + from / kSliceWidth;
    for (size_t c = column[0]; c < column[1]; ++c) {
        if (springs.neighbour[c * kSliceWidth + from % kSliceWidth] == to) return c * kSliceWidth + from % kSliceWidth;
    }
    TROCAR_ASSERT(false);
    return 0;
}

// Half-edges of a solid, from the first of its prototype on: stiffness of all and of the remaining
// tetrahedra.
struct EdgeShares {
    size_t first = 0;
    std::vector<double> all, left;
};

EdgeShares share_edges(const Springs& springs, const Solids& solids, uint32_t prototype, const uint8_t* gone) {
    const SolidInfo& info = solids.info[prototype];
    const Range slices = springs.info[prototype].slices;
    const uint32_t* column = springs.slice_column.data() + slices.first + prototype;
    EdgeShares shares;
    shares.first = size_t{column[0]} * kSliceWidth;
    shares.all.resize(size_t{column[slices.count]} * kSliceWidth - shares.first);
    shares.left.resize(shares.all.size());
    for (uint32_t t = 0; t < info.count; ++t) {
        const Tetrahedron node = corners(solids, info, t);
        size_t index[12];
        double squared = 0;
        int count = 0;
        for (int i = 0; i < 4; ++i) {
            for (int j = 0; j < 4; ++j) {
                if (i == j) continue;
                index[count] = half_edge(springs, prototype, node[i], node[j]) - shares.first;
                squared += 0.5 * double{springs.rest_length[shares.first + index[count]]} *
                           double{springs.rest_length[shares.first + index[count]]};
                ++count;
            }
        }
        const double share = double{solids.rest[info.tetrahedra.first + t]} / squared;  // 6 V / sum of L^2, as add_solid
        for (const size_t r : index) {
            shares.all[r] += share;
            if (!gone[t]) shares.left[r] += share;
        }
    }
    return shares;
}

}  // namespace

SurfaceRoom room_for_tears(const Mesh& surface, std::span<const Tetrahedron> tetrahedra, bool skin) {
    const std::vector<FaceUse> faces = sorted_faces(tetrahedra);
    std::vector<Triangle> all;  // each face once
    uint32_t between = 0;
    for (size_t i = 0; i < faces.size(); ++i) {
        if (i > 0 && faces[i].sorted == faces[i - 1].sorted)
            ++between;
        else
            all.push_back(faces[i].sorted);
    }
    const uint32_t nodes = 1 + *std::max_element(&tetrahedra.front()[0], &tetrahedra.back()[0] + 4);
    const size_t edges = make_edge_table(all, nodes).edge.size();
    const size_t outer = skin ? make_edge_table(surface.triangle, static_cast<uint32_t>(surface.position.size())).edge.size() : 0;
    return {static_cast<uint32_t>(surface.triangle.size()) + between, static_cast<uint32_t>(edges + outer)};
}

void keep_room(const SurfaceRoom& room, Meshes& meshes) {
    const MeshInfo& info = meshes.info.back();
    TROCAR_ASSERT(info.triangles.end() == meshes.triangle.size() && info.triangles.count <= room.triangles &&
                  info.edges.count <= room.edges);
    const size_t triangles = size_t{info.triangles.first} + room.triangles, edges = size_t{info.edges.first} + room.edges;
    meshes.triangle.resize(triangles);
    meshes.neighbour.resize(triangles, {kNone, kNone, kNone});
    meshes.triangle_edge.resize(triangles);
    meshes.uv.resize(triangles);
    meshes.triangle_material.resize(triangles, 0);
    meshes.edge.resize(edges);
    meshes.edge_triangle.resize(edges);
    meshes.incident.resize(size_t{info.incident.first} + 3 * size_t{room.triangles});
    for (uint32_t v = info.vertices.first; v < info.vertices.end(); ++v) {
        if (meshes.component[v] == kNone) meshes.component[v] = 0;
    }
}

void add_tear_faces(const Meshes& meshes, const Solids& solids, uint32_t prototype, Tears& tears, TearBody& tear) {
    const SolidInfo& info = solids.info[prototype];
    const MeshInfo& mesh = meshes.info[prototype];
    const std::vector<Tetrahedron> tetrahedra = tetrahedra_of(solids, info);
    const std::vector<FaceUse> faces = sorted_faces(tetrahedra);
    const uint32_t before = info.skin.count > 0 ? info.skin.count - info.nodes.count : 0;  // vertices before those that are nodes
    tear.outer = mesh.triangles.count;
    tear.faces.first = static_cast<uint32_t>(tears.face.size());
    std::map<Tetrahedron, uint32_t> named;  // by its corners, as an embedded surface refers to it
    if (before > 0) {
        for (uint32_t t = 0; t < tetrahedra.size(); ++t) named[tetrahedra[t]] = t;
    }
    for (uint32_t i = mesh.triangles.first; i < mesh.triangles.end(); ++i) {
        TearFace face{meshes.triangle[i], {}};
        if (before > 0) {
            for (int k = 0; k < 3; ++k) face.tetrahedron[k] = named.at(solids.embedding_node[info.skin.first + face.corner[k]]);
        } else {
            FaceUse wanted{face.corner, {}, 0};
            std::sort(wanted.sorted.begin(), wanted.sorted.end());
            const auto found = std::lower_bound(faces.begin(), faces.end(), wanted);
            TROCAR_ASSERT(found != faces.end() && found->sorted == wanted.sorted);
            face.tetrahedron.fill(found->tetrahedron);
        }
        tears.face.push_back(face);
    }
    for (size_t i = 1; i < faces.size(); ++i) {
        if (faces[i].sorted != faces[i - 1].sorted) continue;
        const Triangle& c = faces[i - 1].corner;
        tears.face.push_back({{c[0] + before, c[1] + before, c[2] + before}, {faces[i - 1].tetrahedron, faces[i].tetrahedron, kNone}});
    }
    tear.faces.count = static_cast<uint32_t>(tears.face.size()) - tear.faces.first;
    tear.order = {static_cast<uint32_t>(tears.order.size()), tear.faces.count};
    for (uint32_t number = 0; number < tear.faces.count; ++number) tears.order.push_back(number);
}

bool is_surface(const TearFace& face, const uint8_t* gone, Triangle& corner) {
    corner = face.corner;
    const auto& t = face.tetrahedron;
    if (t[2] != kNone) return !gone[t[0]] && !gone[t[1]] && !gone[t[2]];
    if (gone[t[0]]) std::swap(corner[1], corner[2]);
    return (gone[t[0]] != 0) != (gone[t[1]] != 0);
}

void copy_torn_solid(const Springs& springs, const Solids& solids, uint32_t prototype, const Torn& torn, TornSprings& out) {
    const SolidInfo& info = solids.info[prototype];
    const Range tets = info.tetrahedra;
    // elements before these belong to solids that do not tear
    const auto grow = [&](std::vector<float>& to, const std::vector<float>& from) {
        for (size_t t = to.size(); t < tets.end(); ++t) to.push_back(from[t]);
    };
    grow(out.rest, solids.rest), grow(out.per_rest, solids.per_rest);
    const Range slices = springs.info[prototype].slices;
    const size_t end = size_t{springs.slice_column[slices.end() + prototype]} * kSliceWidth;
    bool same = out.factor.size() >= end;
    for (uint32_t t = tets.first; t < tets.first + info.count; ++t) {
        const float rest = torn.tetrahedron[t] ? 0.0f : solids.rest[t];
        same = same && rest == out.rest[t];
        out.rest[t] = rest, out.per_rest[t] = torn.tetrahedron[t] ? 0.0f : solids.per_rest[t];
    }
    if (same) return;
    if (out.factor.size() < end) {
        const size_t from = out.factor.size();
        out.factor.resize(end, 1.0f);
        std::copy(springs.factor.begin() + from, springs.factor.begin() + std::min(end, springs.factor.size()), out.factor.begin() + from);
    }
    const EdgeShares shares = share_edges(springs, solids, prototype, torn.tetrahedron.data() + tets.first);
    const uint32_t* column = springs.slice_column.data() + slices.first + prototype;
    for (uint32_t slice = 0; slice < slices.count; ++slice) {
        for (size_t h = size_t{column[slice]} * kSliceWidth; h < size_t{column[slice + 1]} * kSliceWidth; ++h) {
            const double all = shares.all[h - shares.first], left = shares.left[h - shares.first];
            const bool lost = all > 0 && left == 0;
            out.neighbour[h] = lost ? slice * kSliceWidth + static_cast<uint32_t>(h % kSliceWidth) : springs.neighbour[h];
            out.rest_length[h] = lost ? 0.0f : springs.rest_length[h];
            out.factor[h] = all > 0 ? static_cast<float>(double{springs.factor[h]} * (left / all)) : springs.factor[h];
        }
    }
}

std::vector<Vec3d> positions_of_nodes(const Solids& solids, const Bodies& bodies, const Particles& particles, uint32_t body) {
    const SolidInfo& info = solids.info[bodies.mesh[body]];
    const uint32_t first = bodies.particles[body].first + embedded_count(info);
    const double back = 0.5 * particles.last_dt[body];
    std::vector<Vec3d> position(info.nodes.count);
    for (uint32_t i = 0; i < info.nodes.count; ++i) {
        const Float4& o = particles.offset[first + i];
        position[i] = Vec3d(o.x, o.y, o.z) -
                      back * Vec3d(particles.velocity_x[first + i], particles.velocity_y[first + i], particles.velocity_z[first + i]);
    }
    return position;
}

double drop_tetrahedra(const Springs& springs, const Solids& solids, const Bodies& bodies, uint32_t body,
                       std::span<const uint32_t> tetrahedra, std::span<const Vec3d> position, Torn& torn, TornSprings& torn_springs,
                       uint64_t& broken_springs) {
    const uint32_t prototype = bodies.mesh[body];
    const SolidInfo& info = solids.info[prototype];
    uint8_t* gone = torn.tetrahedron.data() + info.tetrahedra.first;
    size_t left = static_cast<size_t>(std::count(gone, gone + info.count, uint8_t{0}));
    const SolidModuli moduli = solid_moduli(bodies.tissue[body]);
    double held = 0;
    for (const uint32_t t : tetrahedra) {
        if (t >= info.count || gone[t] || left == 1) continue;
        gone[t] = 1, --left;
        const Tetrahedron c = corners(solids, info, t);
        const double factor = info.varied ? double{solids.factor[info.tetrahedra.first + t]} : 1.0;
        held += factor * tet_energy(moduli, solids.rest[info.tetrahedra.first + t],
                                    six_volumes(position[c[0]], position[c[1]], position[c[2]], position[c[3]]));
    }
    const Range slices = springs.info[prototype].slices;
    const uint32_t* column = springs.slice_column.data() + slices.first + prototype;
    const size_t first = size_t{column[0]} * kSliceWidth, end = size_t{column[slices.count]} * kSliceWidth;
    const std::vector<float> before(torn_springs.factor.begin() + first, torn_springs.factor.begin() + end);
    copy_torn_solid(springs, solids, prototype, torn, torn_springs);
    for (uint32_t slice = 0; slice < slices.count; ++slice) {
        for (size_t h = size_t{column[slice]} * kSliceWidth; h < size_t{column[slice + 1]} * kSliceWidth; ++h) {
            const uint32_t from = slice * kSliceWidth + static_cast<uint32_t>(h % kSliceWidth), to = springs.neighbour[h];
            const double lost = double{before[h - first]} - double{torn_springs.factor[h]};
            if (to <= from || lost == 0) continue;
            const double stretch = (position[to] - position[from]).norm() - double{springs.rest_length[h]};
            held += 0.5 * double{bodies.spring_stiffness[body]} * lost * stretch * stretch;
            broken_springs += torn_springs.neighbour[h] == from;
        }
    }
    return held;
}

double lose_mass(const Solids& solids, const Bodies& bodies, const Poses& poses, const Anchors& anchors, const Vec3d& gravity,
                 uint32_t body, Torn& torn, Particles& particles) {
    const uint32_t prototype = bodies.mesh[body];
    const SolidInfo& info = solids.info[prototype];
    const uint32_t first = bodies.particles[body].first + embedded_count(info);
    uint8_t* gone = torn.tetrahedron.data() + info.tetrahedra.first;
    std::vector<double> before(info.nodes.count), left(info.nodes.count);  // six times four times the volume around a node
    for (uint32_t t = 0; t < info.count; ++t) {
        const double six = gone[t] == 2 ? 0 : double{solids.rest[info.tetrahedra.first + t]};
        for (const uint32_t node : corners(solids, info, t)) {
            before[node] += six;
            if (gone[t] == 0) left[node] += six;
        }
    }
    double energy = 0;
    for (uint32_t v = 0; v < info.nodes.count; ++v) {
        Float4& o = particles.offset[first + v];
        if (!(o.w > 0) || left[v] == before[v]) continue;
        Vec3d velocity(particles.velocity_x[first + v], particles.velocity_y[first + v], particles.velocity_z[first + v]);
        const Vec3d position = poses.origin[body] + Vec3d(o.x, o.y, o.z) - 0.5 * particles.last_dt[body] * velocity;
        const double mass = 1 / double{o.w};
        o.w = left[v] > 0 ? static_cast<float>(before[v] / (mass * left[v])) : 0.0f;
        const double lost = mass - (o.w > 0 ? 1 / double{o.w} : 0);
        energy += lost * (0.5 * velocity.squaredNorm() - gravity.dot(position));
        if (o.w > 0) continue;
        particles.velocity_x[first + v] = particles.velocity_y[first + v] = particles.velocity_z[first + v] = 0;
    }
    for (uint32_t t = 0; t < info.count; ++t) gone[t] = gone[t] ? 2 : 0;
    // nodes without a tetrahedron move to their goals
    const bool shape = bodies.anchor_frame[body] == AnchorFrame::kShape;
    const auto goal = [&](uint32_t v) {
        const Vec3d rest(anchors.rest_x[first + v], anchors.rest_y[first + v], anchors.rest_z[first + v]);
        return shape ? rotate(poses.orientation[body], rest) : rest;
    };
    Vec3d centre = Vec3d::Zero();
    double weight = 0;
    for (uint32_t v = 0; shape && v < info.nodes.count; ++v) {
        if (left[v] == 0) continue;
        const Float4& o = particles.offset[first + v];
        centre += anchors.stiffness[first + v] * (Vec3d(o.x, o.y, o.z) - goal(v));
        weight += anchors.stiffness[first + v];
    }
    if (weight > 0) centre /= weight;
    for (uint32_t v = 0; v < info.nodes.count; ++v) {
        if (left[v] > 0) continue;
        const Vec3d g = centre + goal(v);
        particles.offset[first + v] = {static_cast<float>(g.x()), static_cast<float>(g.y()), static_cast<float>(g.z()), 0.0f};
    }
    return energy;
}

}  // namespace trocar
