#include "bench/peers/float_depth.hpp"

#include <algorithm>
#include <numeric>
namespace trocar::bench {
namespace {

float squared_distance(const FloatBox& box, const Vec<float>& p) {
    const __m128 at = _mm_setr_ps(p.x, p.y, p.z, 0), zero = _mm_setzero_ps();
    const __m128 out = _mm_max_ps(_mm_max_ps(_mm_sub_ps(box.low, at), _mm_sub_ps(at, box.high)), zero);
    alignas(16) std::array<float, 4> d;
    _mm_store_ps(d.data(), _mm_mul_ps(out, out));
    return d[0] + d[1] + d[2];
}

}  // namespace

FloatDepth::FloatDepth(const Soup& soup) : incidence_(soup), order_(soup.triangle.size()) {
    std::iota(order_.begin(), order_.end(), 0u);
    for (const Range& range : soup.triangles) {
        root_.push_back(uint32_t(node_.size()));
        node_.push_back({{}, 0, range.first, range.count});
        for (uint32_t n = root_.back(); n < node_.size(); ++n) {
            const uint32_t first = node_[n].first, count = node_[n].count;
            if (count <= 4) continue;
            FloatBox all;
            for (uint32_t i = first; i < first + count; ++i) all.take(box_of(soup, order_[i]));
            alignas(16) std::array<float, 4> size;
            _mm_store_ps(size.data(), _mm_sub_ps(all.high, all.low));
            const int axis = int(std::max_element(size.begin(), size.begin() + 3) - size.begin());
            const auto middle = [&](uint32_t t) {
                const FloatBox box = box_of(soup, t);
                alignas(16) std::array<float, 4> sum;
                _mm_store_ps(sum.data(), _mm_add_ps(box.low, box.high));
                return sum[size_t(axis)];
            };
            const auto begin = order_.begin() + first;
            std::nth_element(begin, begin + count / 2, begin + count, [&](uint32_t a, uint32_t b) {
                const float x = middle(a), y = middle(b);
                return x < y || (x == y && a < b);
            });
            node_[n].child = uint32_t(node_.size());
            node_.push_back({{}, 0, first, count / 2});
            node_.push_back({{}, 0, first + count / 2, count - count / 2});
        }
    }
    refit(soup);
}

void FloatDepth::refit(const Soup& soup) {
    for (size_t n = node_.size(); n-- > 0;) {
        Node& node = node_[n];
        node.box = {};
        if (node.child != 0) {
            node.box.take(node_[node.child].box);
            node.box.take(node_[node.child + 1].box);
        } else {
            for (uint32_t i = node.first; i < node.first + node.count; ++i) node.box.take(box_of(soup, order_[i]));
        }
    }
}

Closest<float> FloatDepth::nearest(const Soup& soup, uint32_t body, const Vec<float>& p) {
    Closest<float> best{{}, 0, -1, 3e38f};
    std::array<uint32_t, 64> node;
    std::array<float, 64> far;
    size_t top = 0;
    node[0] = root_[body], far[0] = 0, top = 1;
    while (top > 0) {
        --top;
        if (far[top] > best.squared) continue;
        const Node& n = node_[node[top]];
        if (n.child == 0) {
            for (uint32_t i = n.first; i < n.first + n.count; ++i) {
                const Closest<float> c = closest_on_triangle<float>(soup, order_[i], p);
                if (c.squared < best.squared) best = c;
            }
            continue;
        }
        const float left = squared_distance(node_[n.child].box, p), right = squared_distance(node_[n.child + 1].box, p);
        const bool left_last = left < right;  // nearer one on top
        node[top] = n.child + left_last, far[top++] = left_last ? right : left;
        node[top] = n.child + !left_last, far[top++] = left_last ? left : right;
    }
    return best;
}

float FloatDepth::depth(const Soup& soup) {
    float deepest = 0;
    for (uint32_t body = 0; body < root_.size(); ++body)
        for (uint32_t other = 0; other < root_.size(); ++other) {
            if (other == body) continue;
            const FloatBox& box = node_[root_[other]].box;
            for (uint32_t v = soup.vertices[body].first; v < soup.vertices[body].end(); ++v) {
                const __m128 at = _mm_load_ps(&soup.position[v].x);
                if (!meet({at, at}, box)) continue;
                const Vec<float> p = vertex<float>(soup, v);
                const Closest<float> c = nearest(soup, other, p);
                if (dot(pseudonormal<float>(soup, incidence_, c), p - c.point) < 0) deepest = std::max(deepest, std::sqrt(c.squared));
            }
        }
    return deepest;
}

}  // namespace trocar::bench
