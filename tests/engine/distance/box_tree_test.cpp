#include "engine/distance/box_tree.hpp"

#include <gtest/gtest.h>

#include <cstring>
#include <random>
#include <set>

#include "engine/distance/winding_tree.hpp"
#include "engine/jobs/thread_pool.hpp"
#include "tests/engine/distance/closest_point_meshes.hpp"
#include "tests/reference/brute_force_distance.hpp"
namespace trocar {
namespace {

std::vector<FloatBox> random_boxes(uint32_t count, uint64_t seed) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<float> unit(-1, 1);
    std::vector<FloatBox> boxes(count);
    for (FloatBox& b : boxes) {
        clear(b);
        for (int k = 0; k < 3; ++k) {
            const float x = unit(random), y = x + 0.05f * unit(random);
            b.min[k] = std::min(x, y), b.max[k] = std::max(x, y);
        }
    }
    return boxes;
}

float squared_distance(const FloatBox& b, const float* q) {
    float sum = 0;
    for (int k = 0; k < 3; ++k) {
        const float out = std::max({b.min[k] - q[k], q[k] - b.max[k], 0.0f});
        sum += out * out;
    }
    return sum;
}

// Every box within the limit is found once, and none beyond it except by rounding.
void expect_finds_near_boxes(const std::vector<FloatBox>& boxes, const BoxTree& tree, uint64_t seed) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<float> unit(-1.5f, 1.5f);
    for (int i = 0; i < 200; ++i) {
        const float q[3] = {unit(random), unit(random), unit(random)}, limit = std::exp(3 * unit(random));
        std::multiset<uint32_t> found;
        visit_near_boxes(tree, q, limit, [&](uint32_t row) { return found.insert(row), limit; });
        for (uint32_t row = 0; row < boxes.size(); ++row) {
            const float d = squared_distance(boxes[row], q);
            if (d < limit * (1 - 1e-5f)) {
                ASSERT_EQ(found.count(row), 1u) << row << " of " << boxes.size();
            }
            if (d > limit * (1 + 1e-5f)) {
                ASSERT_EQ(found.count(row), 0u) << row << " of " << boxes.size();
            }
        }
    }
}

TEST(BoxTree, FindsNearBoxesAfterBuildsAndRefits) {
    for (const uint32_t count : {1u, 2u, 7u, 8u, 9u, 64u, 1000u}) {
        std::vector<FloatBox> boxes = random_boxes(count, count);
        BoxTree tree;
        build_box_tree(boxes, tree);
        expect_finds_near_boxes(boxes, tree, count);
        boxes = random_boxes(count, count + 1);
        refit_box_tree(boxes, tree);
        expect_finds_near_boxes(boxes, tree, count);
    }
}

TEST(BoxTree, EqualBoxesAndNoBoxes) {
    BoxTree tree;
    build_box_tree({}, tree);
    EXPECT_TRUE(tree.node.empty());
    EXPECT_EQ(refit_box_tree({}, tree), 0);
    const std::vector<FloatBox> boxes(500, random_boxes(1, 3)[0]);
    build_box_tree(boxes, tree);
    expect_finds_near_boxes(boxes, tree, 3);
}

// Boxes in a line, each a thousand times the preceding one: cuts by area alone would make a chain as deep as
// their number.
TEST(BoxTree, StaysShallow) {
    std::vector<FloatBox> boxes(3000);
    for (uint32_t i = 0; i < boxes.size(); ++i) {
        const float x = std::ldexp(1.0f, static_cast<int>(i % 120) - 60);
        boxes[i] = {{x, x, x, 0}, {1.5f * x, 1.5f * x, 1.5f * x, 0}};
    }
    BoxTree tree;
    build_box_tree(boxes, tree);
    uint32_t deepest = 0;
    std::vector<uint32_t> depth(tree.node.size(), 1);
    for (uint32_t i = 1; i < tree.node.size(); ++i) {
        ASSERT_LT(tree.node[i].parent, i);
        depth[i] = depth[tree.node[i].parent] + 1;
        deepest = std::max(deepest, depth[i]);
    }
    EXPECT_LE(deepest, kBoxDepth);
}

// Embree's builder uses several threads; nodes are in the order of the tree nevertheless.
TEST(BoxTree, IsTheSameForAnyThreads) {
    const std::vector<FloatBox> boxes = random_boxes(30000, 9);
    std::vector<BoxTree> made(2);
    for (const uint32_t threads : {1u, 4u}) {
        ThreadPool pool(threads);
        pool.run([&] { build_box_tree(boxes, made[threads > 1]); });
    }
    ASSERT_EQ(made[0].node.size(), made[1].node.size());
    EXPECT_EQ(std::memcmp(made[0].node.data(), made[1].node.data(), made[0].node.size() * sizeof(BoxNode)), 0);
    EXPECT_EQ(made[0].builds, 1u);
}

TEST(BoxTree, RefitTellsTheAreaOfNodesAndBoxes) {
    std::vector<FloatBox> boxes(2);
    boxes[0] = {{0, 0, 0, 0}, {1, 1, 1, 0}};
    boxes[1] = {{1, 0, 0, 0}, {3, 1, 1, 0}};
    BoxTree tree;
    build_box_tree(boxes, tree);
    EXPECT_EQ(tree.built_area, 3 + 5 + 7);
    boxes[1].max[0] = 5;
    EXPECT_EQ(refit_box_tree(boxes, tree), 3 + 9 + 11);
}

// Random patches: the far field is within its bound of the sum, the bound is not too loose, and both remain
// true after merging.
TEST(WindingTree, FarFieldKeepsItsBound) {
    std::mt19937_64 random(5);
    std::uniform_real_distribution<double> unit(-1, 1);
    const auto vector = [&] { return Vec3d(unit(random), unit(random), unit(random)); };
    double closest = 0;
    for (int i = 0; i < 3000; ++i) {
        std::vector<WindingCluster> parts;
        std::vector<Vec3d> position;
        std::vector<Triangle> triangle;
        const Vec3d lean = i % 3 == 0 ? Vec3d(1, 1, 1) : i % 3 == 1 ? Vec3d(1, 1, 0.05) : Vec3d(1, 0.05, 0.05);
        for (int part = 0; part < 1 + i % 4; ++part) {
            std::vector<std::array<Vec3d, 3>> own(1 + random() % 9);
            const Vec3d middle = vector();
            for (auto& t : own) {
                for (Vec3d& x : t) x = middle + vector().cwiseProduct(lean);
                const uint32_t n = static_cast<uint32_t>(position.size());
                position.insert(position.end(), t.begin(), t.end());
                triangle.push_back({n, n + 1, n + 2});
            }
            parts.push_back(winding_cluster(own));
        }
        const WindingCluster whole = join_clusters(parts);
        for (const Vec3d& x : position) ASSERT_LE((x - whole.centre).norm(), whole.radius * (1 + 1e-12));
        const Vec3d p = whole.centre + whole.radius * std::pow(10.0, 1 + unit(random)) * random_direction(random);
        const FarField far = far_field(whole, p);
        const double truth = brute_force_winding(position, triangle, p);
        if (!(far.error < INFINITY)) {
            ASSERT_LE((p - whole.centre).norm(), whole.radius * (1 + 1e-12));
            continue;
        }
        ASSERT_LE(std::abs(far.value - truth), far.error + 1e-14) << i;
        if (far.error > 1e-12) closest = std::max(closest, std::abs(far.value - truth) / far.error);
    }
    EXPECT_GT(closest, 0.02) << "the bound is so wide that it tests nothing";
    std::printf("[   figure ] largest error / bound %.3f\n", closest);
}

// Orders zero to two are correct: halving groups divides the remaining error by 32, area times the third
// power of the size.
TEST(WindingTree, ErrorIsOfThirdOrder) {
    std::mt19937_64 random(6);
    std::uniform_real_distribution<double> unit(-1, 1);
    double error[2] = {};
    for (int i = 0; i < 300; ++i) {
        std::vector<std::array<Vec3d, 3>> group(4);
        for (auto& t : group)
            for (Vec3d& x : t) x = Vec3d(unit(random), unit(random), unit(random));
        const Vec3d centre = winding_cluster(group).centre, p = centre + 12 * random_direction(random);
        for (double& sum : error) {
            std::vector<Vec3d> position;
            std::vector<Triangle> triangle;
            for (const auto& t : group) {
                const uint32_t n = static_cast<uint32_t>(position.size());
                position.insert(position.end(), t.begin(), t.end());
                triangle.push_back({n, n + 1, n + 2});
            }
            sum += std::abs(far_field(winding_cluster(group), p).value - brute_force_winding(position, triangle, p));
            for (auto& t : group)
                for (Vec3d& x : t) x = centre + 0.5 * (x - centre);
        }
    }
    EXPECT_NEAR(std::log2(error[0] / error[1]), 5, 0.3);
}

}  // namespace
}  // namespace trocar
