#include "content/mend/self_crossing.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <bit>
#include <cmath>
#include <span>
#include <utility>

#include "engine/geometry/predicates.hpp"
#include "engine/geometry/space_curve.hpp"
#include "engine/mesh/contact_kernels.hpp"
#include "engine/mesh/face_meeting.hpp"
namespace trocar {
namespace {

constexpr uint32_t kLeafItems = 4;
constexpr uint32_t kManyFaces = 64;  // at one corner: above, pairs of them are sought among their directions

// A face as the search for near pairs sees it: a triangle that holds it, or its directions from a corner. Items of one
// group form no pairs.
struct Item {
    Corners corner;
    uint32_t face;
    uint32_t group = kNone;
};

struct OrientedBox {
    Eigen::Matrix3d axis = Eigen::Matrix3d::Identity();  // columns
    Vec3d centre = Vec3d::Zero(), half = Vec3d::Zero();
};

struct Node {
    Box box;
    uint32_t group = kNone;  // of all items
};

// Box hierarchy over items: leaves of kLeafItems, then levels of pairs. Unlike a grid it handles faces of very different
// size. Oriented boxes tell long faces side by side apart.
struct BoxTree {
    std::vector<Item> item;
    std::vector<Box> item_box;
    std::vector<std::vector<Node>> level;            // level 0 = leaves, the last level has one node
    std::vector<std::vector<OrientedBox>> oriented;  // as level, or empty
};

// Box along the longest direction of the items and, across it, their widest one.
OrientedBox bound(std::span<const Item> items) {
    Vec3d mean = Vec3d::Zero();
    const auto each = [&](auto&& visit) {
        for (const Item& i : items)
            for (const Vec3d& p : i.corner) visit(p);
    };
    const auto farthest = [&](auto&& distance) {
        Vec3d best = mean;
        double most = -1;
        each([&](const Vec3d& p) {
            if (const double d = distance(p); d > most) most = d, best = p;
        });
        return best;
    };
    each([&](const Vec3d& p) { mean += p / (3.0 * static_cast<double>(items.size())); });
    const Vec3d p = farthest([&](const Vec3d& x) { return (x - mean).squaredNorm(); });
    const Vec3d q = farthest([&](const Vec3d& x) { return (x - p).squaredNorm(); });
    OrientedBox box;
    const Vec3d x = (q - p).norm() > 0 ? Vec3d((q - p).normalized()) : Vec3d::UnitX();
    const Vec3d across = x.cross(farthest([&](const Vec3d& y) { return x.cross(y - p).squaredNorm(); }) - p);
    const Vec3d z = across.norm() > 0 ? Vec3d(across.normalized()) : x.unitOrthogonal();
    box.axis << x, z.cross(x), z;
    Vec3d low = Vec3d::Constant(INFINITY), high = -low;
    each([&](const Vec3d& y) {
        const Vec3d along = box.axis.transpose() * (y - mean);
        low = low.cwiseMin(along), high = high.cwiseMax(along);
    });
    box.centre = mean + box.axis * (0.5 * (low + high));
    box.half = (0.5 * (high - low)).array() + 1e-13 * (mean.norm() + (high - low).norm());  // far above rounding
    return box;
}

// Whether one of the fifteen axes separates two boxes (Gottschalk, Lin & Manocha, OBBTree, SIGGRAPH 1996).
bool are_apart(const OrientedBox& a, const OrientedBox& b) {
    const Eigen::Matrix3d turn = a.axis.transpose() * b.axis, size = turn.cwiseAbs();
    const Vec3d to = a.axis.transpose() * (b.centre - a.centre);
    const double pad = 1e-14 * (to.norm() + a.half.norm() + b.half.norm());
    for (int i = 0; i < 3; ++i) {
        if (std::abs(to[i]) > a.half[i] + size.row(i).dot(b.half) + pad) return true;
        if (std::abs(to.dot(turn.col(i))) > b.half[i] + size.col(i).dot(a.half) + pad) return true;
    }
    for (int i = 0; i < 3; ++i) {
        for (int k = 0; k < 3; ++k) {
            const int i1 = (i + 1) % 3, i2 = (i + 2) % 3, k1 = (k + 1) % 3, k2 = (k + 2) % 3;
            const double reach = a.half[i1] * size(i2, k) + a.half[i2] * size(i1, k) + b.half[k1] * size(i, k2) + b.half[k2] * size(i, k1);
            if (std::abs(to[i2] * turn(i1, k) - to[i1] * turn(i2, k)) > reach + pad) return true;
        }
    }
    return false;
}

// Puts the items of every node of an oriented tree into the order of the direction in which they are thinnest, compared
// with all of them together, so that boxes side by side overlap little. Keeps groups, already in order, together.
void arrange(std::span<Item> items) {
    if (items.size() <= kLeafItems) return;
    const size_t left = std::bit_floor((items.size() - 1) / kLeafItems) * kLeafItems;
    if (items.front().group == items.back().group) {
        const OrientedBox box = bound(items);
        Vec3d size = Vec3d::Zero();
        for (const Item& i : items) {
            const Eigen::Matrix3d along = (Eigen::Matrix3d() << i.corner[0], i.corner[1], i.corner[2]).finished().transpose() * box.axis;
            size += (along.colwise().maxCoeff() - along.colwise().minCoeff()).transpose().cwiseQuotient(box.half);
        }
        int thinnest;
        size.minCoeff(&thinnest);
        const Vec3d axis = box.axis.col(thinnest);
        const auto along = [&](const Item& i) { return axis.dot(i.corner[0] + i.corner[1] + i.corner[2]); };
        std::nth_element(items.begin(), items.begin() + static_cast<std::ptrdiff_t>(left), items.end(), [&](const Item& i, const Item& k) {
            const double x = along(i), y = along(k);
            return x != y ? x < y : i.face < k.face;
        });
    }
    arrange(items.first(left));
    arrange(items.subspan(left));
}

// In Hilbert order: enough for boxes along the axes.
void sort_along_curve(std::vector<Item>& items) {
    Box all;
    for (const Item& i : items)
        for (const Vec3d& p : i.corner) grow(all, p);
    std::vector<std::pair<uint64_t, uint32_t>> order;
    for (uint32_t i = 0; i < items.size(); ++i) {
        const auto& [a, b, c] = items[i].corner;
        order.push_back({hilbert_key((a + b + c) / 3, all), i});
    }
    std::sort(order.begin(), order.end());
    std::vector<Item> sorted;
    for (const auto& [key, i] : order) sorted.push_back(items[i]);
    items = std::move(sorted);
}

BoxTree make_box_tree(std::vector<Item> items, bool oriented) {
    BoxTree tree;
    if (items.empty()) return tree;
    if (oriented) {
        std::stable_sort(items.begin(), items.end(), [](const Item& a, const Item& b) { return a.group < b.group; });
        arrange(items);
    } else {
        sort_along_curve(items);
    }
    tree.item = std::move(items);
    tree.level.emplace_back((tree.item.size() + kLeafItems - 1) / kLeafItems);
    for (uint32_t i = 0; i < tree.item.size(); ++i) {
        const Item& item = tree.item[i];
        Box box;
        for (const Vec3d& p : item.corner) grow(box, p);
        tree.item_box.push_back(box);
        Node& leaf = tree.level[0][i / kLeafItems];
        leaf.group = i % kLeafItems == 0 || leaf.group == item.group ? item.group : kNone;
        grow(leaf.box, box);
    }
    while (tree.level.back().size() > 1) {
        const std::vector<Node>& below = tree.level.back();
        std::vector<Node> above((below.size() + 1) / 2);
        for (uint32_t i = 0; i < below.size(); ++i) {
            grow(above[i / 2].box, below[i].box);
            above[i / 2].group = i % 2 == 0 || above[i / 2].group == below[i].group ? below[i].group : kNone;
        }
        tree.level.push_back(std::move(above));
    }
    for (size_t width = kLeafItems; oriented && tree.oriented.size() < tree.level.size(); width *= 2) {
        std::vector<OrientedBox>& boxes = tree.oriented.emplace_back();
        for (size_t i = 0; i < tree.item.size(); i += width)
            boxes.push_back(bound(std::span(tree.item).subspan(i, std::min(width, tree.item.size() - i))));
    }
    return tree;
}

Corners corners_of(const Mesh& mesh, uint32_t face) {
    const Triangle& t = mesh.triangle[face];
    return {mesh.position[t[0]], mesh.position[t[1]], mesh.position[t[2]]};
}

// Visits every pair of leaves, or a leaf and itself, with near items once, until visit returns false.
template <typename Visit>  // Visit: bool(leaf, leaf)
void for_each_near_leaf_pair(const BoxTree& tree, const Visit& visit) {
    struct Nodes {
        uint32_t level, i, j;  // i <= j
    };
    std::vector<Nodes> stack;
    if (!tree.level.empty()) stack.push_back({static_cast<uint32_t>(tree.level.size() - 1), 0, 0});
    while (!stack.empty()) {
        const auto [level, i, j] = stack.back();
        stack.pop_back();
        const Node &a = tree.level[level][i], &b = tree.level[level][j];
        if (a.group != kNone && a.group == b.group) continue;
        if (i != j && !boxes_meet(a.box, b.box)) continue;
        if (i != j && !tree.oriented.empty() && are_apart(tree.oriented[level][i], tree.oriented[level][j])) continue;
        if (level == 0) {
            if (!visit(i, j)) return;
            continue;
        }
        const uint32_t below = static_cast<uint32_t>(tree.level[level - 1].size());
        for (uint32_t k = 2 * i; k < std::min(2 * i + 2, below); ++k) {
            for (uint32_t l = i == j ? k : 2 * j; l < std::min(2 * j + 2, below); ++l) stack.push_back({level - 1, k, l});
        }
    }
}

// Visits every pair of items of different groups with overlapping boxes once, until visit returns false.
template <typename Visit>  // Visit: bool(face, face)
void for_each_near_pair(const BoxTree& tree, const Visit& visit) {
    const uint32_t items = static_cast<uint32_t>(tree.item.size());
    for_each_near_leaf_pair(tree, [&](uint32_t i, uint32_t j) {
        for (uint32_t k = i * kLeafItems; k < std::min((i + 1) * kLeafItems, items); ++k) {
            for (uint32_t l = i == j ? k + 1 : j * kLeafItems; l < std::min((j + 1) * kLeafItems, items); ++l) {
                const bool grouped = tree.item[k].group != kNone && tree.item[k].group == tree.item[l].group;
                if (grouped || !boxes_meet(tree.item_box[k], tree.item_box[l])) continue;
                if (!visit(tree.item[k].face, tree.item[l].face)) return false;
            }
        }
        return true;
    });
}

// Whether boxes along the axes leave far more pairs than faces side by side have.
bool is_crowded(const BoxTree& tree) {
    constexpr size_t kPairsPerLeaf = 48;  // organs, prisms and skulls have 5 to 20
    size_t left = tree.level.empty() ? 1 : 1000 + kPairsPerLeaf * tree.level[0].size();
    for_each_near_leaf_pair(tree, [&](uint32_t, uint32_t) { return --left > 0; });
    return left == 0;
}

// Groups faces by their corner with the most faces, if those are many, and returns the groups' directions from that
// corner: near it two faces meet exactly if their arcs on the unit sphere do. An arc lies in the triangle of its chord
// and its end tangents.
std::vector<std::vector<Item>> group_fans(const Mesh& mesh, std::vector<Item>& items) {
    std::vector<uint32_t> faces(mesh.position.size(), 0), fan_of_vertex(mesh.position.size(), kNone);
    for (const Item& item : items)
        for (const uint32_t v : mesh.triangle[item.face]) ++faces[v];
    std::vector<std::vector<Item>> fans;
    for (Item& item : items) {
        const Triangle& t = mesh.triangle[item.face];
        int k = 0;
        for (int i = 1; i < 3; ++i) k = faces[t[i]] > faces[t[k]] ? i : k;
        if (faces[t[k]] <= kManyFaces) continue;
        const Vec3d a = (item.corner[(k + 1) % 3] - item.corner[k]).normalized(),
                    b = (item.corner[(k + 2) % 3] - item.corner[k]).normalized();
        if (a.dot(b) < -0.9) continue;  // its tangents meet too far away: it stays among the other faces
        item.group = t[k];
        if (fan_of_vertex[t[k]] == kNone) fan_of_vertex[t[k]] = static_cast<uint32_t>(fans.size()), fans.emplace_back();
        fans[fan_of_vertex[t[k]]].push_back({{a, b, (a + b) / (1 + a.dot(b))}, item.face});
    }
    return fans;
}

// Visits every pair of faces that may meet away from what they share once, until visit returns false.
template <typename Visit>  // Visit: bool(face, face)
void for_each_doubtful_pair(const Mesh& mesh, const Visit& visit) {
    std::vector<Item> items;
    for (uint32_t t = 0; t < mesh.triangle.size(); ++t) {
        const Corners c = corners_of(mesh, t);
        if (!are_collinear(c[0], c[1], c[2])) items.push_back({c, t});
    }
    const BoxTree plain = make_box_tree(items, false);
    if (!is_crowded(plain)) return for_each_near_pair(plain, visit);
    bool on = true;
    const auto visit_on = [&](uint32_t t, uint32_t u) { return on = visit(t, u); };
    for (std::vector<Item>& fan : group_fans(mesh, items))
        if (on) for_each_near_pair(make_box_tree(std::move(fan), true), visit_on);
    if (on) for_each_near_pair(make_box_tree(std::move(items), true), visit_on);
}

Meeting meet_faces_of(const Mesh& mesh, uint32_t t, uint32_t u) {
    return meet_faces(mesh.triangle[t], corners_of(mesh, t), mesh.triangle[u], corners_of(mesh, u));
}

}  // namespace

SelfCrossings count_self_crossings(const Mesh& mesh) {
    SelfCrossings out;
    for_each_doubtful_pair(mesh, [&](uint32_t t, uint32_t u) {
        ++out.tested;
        const Meeting meeting = meet_faces_of(mesh, t, u);
        if (meeting == Meeting::kDisjoint) return true;
        ++(meeting == Meeting::kCrossing ? out.crossing : out.touching);
        out.lowest_pair = std::min(out.lowest_pair, {std::min(t, u), std::max(t, u)});
        return out.crossing + out.touching < kSelfCrossingLimit;
    });
    return out;
}

std::vector<uint8_t> mark_self_crossings(const Mesh& mesh) {
    std::vector<uint8_t> marked(mesh.triangle.size(), 0);
    for_each_doubtful_pair(mesh, [&](uint32_t t, uint32_t u) {
        if (!(marked[t] && marked[u]) && meet_faces_of(mesh, t, u) != Meeting::kDisjoint) marked[t] = marked[u] = 1;
        return true;
    });
    return marked;
}

}  // namespace trocar
