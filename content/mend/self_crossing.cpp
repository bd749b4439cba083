#include "content/mend/self_crossing.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <utility>

#include "engine/geometry/predicates.hpp"
#include "engine/geometry/space_curve.hpp"
#include "engine/geometry/triangle_triangle.hpp"
#include "engine/mesh/contact_kernels.hpp"
namespace trocar {
namespace {

constexpr uint32_t kLeafFaces = 4;

// Box hierarchy over faces in Hilbert order: leaves of kLeafFaces, then levels of pairs. Unlike a grid it
// handles faces of very different size.
struct BoxTree {
    std::vector<uint32_t> face;           // in Hilbert order
    std::vector<Box> face_box;            // in Hilbert order
    std::vector<std::vector<Box>> level;  // level 0 = leaves, the last level has one box
};

BoxTree make_box_tree(const Mesh& mesh) {
    BoxTree tree;
    Box all;
    for (const Vec3d& p : mesh.position) grow(all, p);
    std::vector<std::pair<uint64_t, uint32_t>> order;
    for (uint32_t t = 0; t < mesh.triangle.size(); ++t) {
        const auto& [a, b, c] = mesh.triangle[t];
        if (are_collinear(mesh.position[a], mesh.position[b], mesh.position[c])) continue;
        order.push_back({hilbert_key((mesh.position[a] + mesh.position[b] + mesh.position[c]) / 3, all), t});
    }
    std::sort(order.begin(), order.end());
    if (order.empty()) return tree;
    tree.level.emplace_back((order.size() + kLeafFaces - 1) / kLeafFaces);
    for (uint32_t i = 0; i < order.size(); ++i) {
        tree.face.push_back(order[i].second);
        Box box;
        for (const uint32_t v : mesh.triangle[order[i].second]) grow(box, mesh.position[v]);
        tree.face_box.push_back(box);
        grow(tree.level[0][i / kLeafFaces], box);
    }
    while (tree.level.back().size() > 1) {
        const std::vector<Box>& below = tree.level.back();
        std::vector<Box> above((below.size() + 1) / 2);
        for (uint32_t i = 0; i < below.size(); ++i) grow(above[i / 2], below[i]);
        tree.level.push_back(std::move(above));
    }
    return tree;
}

Corners corners_of(const Mesh& mesh, uint32_t face) {
    const Triangle& t = mesh.triangle[face];
    return {mesh.position[t[0]], mesh.position[t[1]], mesh.position[t[2]]};
}

// Quick proof that two faces meet only at their shared corner: a plane through it with both free corners of
// each face clearly on its own side. The margin is far above the rounding of the products (a few 1e-16).
bool separated_at_corner(const Vec3d& a1, const Vec3d& a2, const Vec3d& b1, const Vec3d& b2) {
    const double la1 = a1.norm(), la2 = a2.norm(), lb1 = b1.norm(), lb2 = b2.norm();
    const Vec3d apart = a1 / la1 + a2 / la2 - b1 / lb1 - b2 / lb2;
    const double margin = 1e-12 * apart.norm();
    return apart.dot(a1) > margin * la1 && apart.dot(a2) > margin * la2 && apart.dot(b1) < -margin * lb1 && apart.dot(b2) < -margin * lb2;
}

// Ignores the shared corner itself. If two convex sets with a common point have a second one, they also have
// one on the ray from the corner through it, where the ray leaves one of them. So it suffices to test whether
// an opposite edge reaches the other face.
Meeting meet_at_shared_corner(const Corners& a, int a_shared, const Corners& b, int b_shared) {
    const Vec3d &corner = a[a_shared], &a1 = a[(a_shared + 1) % 3], &a2 = a[(a_shared + 2) % 3];
    const Vec3d &b1 = b[(b_shared + 1) % 3], &b2 = b[(b_shared + 2) % 3];
    if (separated_at_corner(a1 - corner, a2 - corner, b1 - corner, b2 - corner)) return Meeting::kDisjoint;
    if (orient3d(a[0], a[1], a[2], b1) * orient3d(a[0], a[1], a[2], b2) > 0) return Meeting::kDisjoint;
    if (orient3d(b[0], b[1], b[2], a1) * orient3d(b[0], b[1], b[2], a2) > 0) return Meeting::kDisjoint;
    if (meet_segment_triangle(a1, a2, b) == Meeting::kDisjoint && meet_segment_triangle(b1, b2, a) == Meeting::kDisjoint) {
        return Meeting::kDisjoint;
    }
    return meet_triangles(a, b);
}

// Faces with a shared edge overlap only if they are folded onto each other in a common plane. Faces at more
// than a right angle (beyond rounding) are not folded.
Meeting meet_at_shared_edge(const Corners& a, int a_free, const Corners& b, int b_free) {
    const Vec3d& free_end = a[(a_free + 1) % 3];
    const Vec3d edge = a[(a_free + 2) % 3] - free_end, to_a = a[a_free] - free_end, to_b = b[b_free] - free_end;
    const double size = edge.squaredNorm() * to_a.norm() * to_b.norm();
    if (edge.cross(to_a).dot(edge.cross(to_b)) < -1e-12 * size) return Meeting::kDisjoint;
    if (orient3d(a[0], a[1], a[2], b[b_free]) != 0) return Meeting::kDisjoint;
    return meet_triangles(a, b) == Meeting::kCrossing ? Meeting::kCrossing : Meeting::kDisjoint;
}

Meeting meet_faces(const Mesh& mesh, uint32_t t, uint32_t u) {
    int shared = 0, t_shared = 0, u_shared = 0, t_sum = 0, u_sum = 0;
    for (int i = 0; i < 3; ++i) {
        for (int k = 0; k < 3; ++k) {
            if (mesh.triangle[t][i] != mesh.triangle[u][k]) continue;
            ++shared;
            t_shared = i;
            u_shared = k;
            t_sum += i;
            u_sum += k;
        }
    }
    const Corners a = corners_of(mesh, t), b = corners_of(mesh, u);
    if (shared == 0) return meet_triangles(a, b);
    if (shared == 1) return meet_at_shared_corner(a, t_shared, b, u_shared);
    if (shared == 2) return meet_at_shared_edge(a, 3 - t_sum, b, 3 - u_sum);
    return Meeting::kCrossing;
}

// Visits every pair of faces with overlapping boxes once; stops early when `*stop` is set, if given.
template <typename Visit>
void for_each_near_pair(const BoxTree& tree, const Visit& visit, const bool* stop = nullptr) {
    struct Nodes {
        uint32_t level, i, j;  // i <= j
    };
    std::vector<Nodes> stack;
    if (!tree.level.empty()) stack.push_back({static_cast<uint32_t>(tree.level.size() - 1), 0, 0});
    const uint32_t faces = static_cast<uint32_t>(tree.face.size());
    while (!stack.empty() && !(stop && *stop)) {
        const auto [level, i, j] = stack.back();
        stack.pop_back();
        if (i != j && !boxes_meet(tree.level[level][i], tree.level[level][j])) continue;
        if (level > 0) {
            const uint32_t below = static_cast<uint32_t>(tree.level[level - 1].size());
            for (uint32_t k = 2 * i; k < std::min(2 * i + 2, below); ++k) {
                for (uint32_t l = i == j ? k : 2 * j; l < std::min(2 * j + 2, below); ++l) {
                    stack.push_back({level - 1, k, l});
                }
            }
            continue;
        }
        for (uint32_t k = i * kLeafFaces; k < std::min((i + 1) * kLeafFaces, faces); ++k) {
            for (uint32_t l = i == j ? k + 1 : j * kLeafFaces; l < std::min((j + 1) * kLeafFaces, faces); ++l) {
                if (boxes_meet(tree.face_box[k], tree.face_box[l])) visit(tree.face[k], tree.face[l]);
            }
        }
    }
}

}  // namespace

SelfCrossings count_self_crossings(const Mesh& mesh) {
    SelfCrossings out;
    bool enough = false;
    const auto count = [&](uint32_t t, uint32_t u) {
        const Meeting meeting = meet_faces(mesh, t, u);
        if (meeting == Meeting::kDisjoint) return;
        ++(meeting == Meeting::kCrossing ? out.crossing : out.touching);
        out.lowest_pair = std::min(out.lowest_pair, {std::min(t, u), std::max(t, u)});
        enough = out.crossing + out.touching >= kSelfCrossingLimit;
    };
    for_each_near_pair(make_box_tree(mesh), count, &enough);
    return out;
}

std::vector<uint8_t> mark_self_crossings(const Mesh& mesh) {
    std::vector<uint8_t> marked(mesh.triangle.size(), 0);
    for_each_near_pair(make_box_tree(mesh), [&](uint32_t t, uint32_t u) {
        if (!(marked[t] && marked[u]) && meet_faces(mesh, t, u) != Meeting::kDisjoint) marked[t] = marked[u] = 1;
    });
    return marked;
}

}  // namespace trocar
