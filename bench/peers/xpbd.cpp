#include "bench/peers/xpbd.hpp"

#include <algorithm>
#include <cmath>

#include "engine/kernels/lanes_avx2.inl"
namespace trocar::bench {
namespace {

// Writes groups of four floats to eight distinct indices.
TROCAR_LANES void scatter4(float* base, const uint32_t* row, const Lanes& lanes) {
    const Lanes r = transpose(lanes.x, lanes.y, lanes.z, lanes.w);
    const auto put = [&](V two, int i) __attribute__((always_inline)) {
        _mm_store_ps(base + 4ul * row[i], _mm256_castps256_ps128(two));
        _mm_store_ps(base + 4ul * row[i + 4], _mm256_extractf128_ps(two, 1));
    };
    put(r.x, 0), put(r.y, 1), put(r.z, 2), put(r.w, 3);
}

struct Spring {
    uint32_t a, b;
    float rest;
};

// Greedy colouring: springs in the order of their lower end, each with the first colour free at both ends.
std::vector<std::vector<Spring>> colour_springs(const SpringGraph& graph) {
    std::vector<std::array<uint32_t, 2>> edge = graph.edge;
    for (auto& e : edge) std::sort(e.begin(), e.end());
    std::sort(edge.begin(), edge.end());
    std::vector<std::vector<uint8_t>> used(graph.position.size());
    std::vector<std::vector<Spring>> by_colour;
    for (const auto& [a, b] : edge) {
        const auto taken = [&](uint32_t end, size_t colour) { return colour < used[end].size() && used[end][colour]; };
        size_t colour = 0;
        while (taken(a, colour) || taken(b, colour)) ++colour;
        for (const uint32_t end : {a, b}) used[end].resize(std::max(used[end].size(), colour + 1)), used[end][colour] = 1;
        by_colour.resize(std::max(by_colour.size(), colour + 1));
        const double rest = graph.rest >= 0 ? graph.rest : (graph.position[a] - graph.position[b]).norm();
        by_colour[colour].push_back({a, b, static_cast<float>(rest)});
    }
    return by_colour;
}

}  // namespace

XpbdSprings::XpbdSprings(const SpringGraph& graph, double damping)
    : count_(static_cast<uint32_t>(graph.position.size())), damping_(damping), stiffness_(static_cast<float>(graph.stiffness)) {
    position_.resize(count_ + 2 * kWidth);
    increment_.resize(position_.size());
    velocity_.assign(count_, Vec3::Zero());
    for (uint32_t v = 0; v < count_; ++v) {
        const Vec3 p = graph.position[v].cast<float>();
        position_[v] = {p.x(), p.y(), p.z(), graph.mass[v] > 0 ? static_cast<float>(1 / graph.mass[v]) : 0.0f};
    }
    for (const std::vector<Spring>& list : colour_springs(graph)) {
        for (size_t first = 0; first < list.size(); first += kWidth) {
            for (const bool second : {false, true}) {
                for (uint32_t lane = 0; lane < kWidth; ++lane) {
                    const size_t i = first + lane;
                    const uint32_t padding = count_ + 2 * lane + (second ? 1 : 0);
                    end_.push_back(i >= list.size() ? padding : second ? list[i].b : list[i].a);
                    if (!second) rest_.push_back(i < list.size() ? list[i].rest : 0.0f);
                }
            }
        }
    }
}

void XpbdSprings::sweep(bool many) {
    const V soft = set(compliance_), one = set(1), zero = set(0);
    const float* position = &position_[0].x;
    float* increment = &increment_[0].x;
    for (size_t batch = 0; batch < rest_.size() / kWidth; ++batch) {
        const uint32_t *i = end_.data() + 2 * kWidth * batch, *j = i + kWidth;
        const Lanes xi = gather4(position, i), xj = gather4(position, j), di = gather4(increment, i), dj = gather4(increment, j);
        const V x = (xj.x - xi.x) + (dj.x - di.x), y = (xj.y - xi.y) + (dj.y - di.y), z = (xj.z - xi.z) + (dj.z - di.z);
        const V length = root(multiply_add(x, x, multiply_add(y, y, z * z))), weight = (xi.w + xj.w) + soft;
        V push = load(rest_.data() + kWidth * batch) - length;
        if (many) push = push - soft * load(multiplier_.data() + kWidth * batch);
        push = where_positive(weight, push / weight);
        if (many) keep_store(multiplier_.data() + kWidth * batch, load(multiplier_.data() + kWidth * batch) + push);
        const V by = where_positive(length, push * (one / length)), ai = zero - by * xi.w, aj = by * xj.w;
        scatter4(increment, i, {multiply_add(ai, x, di.x), multiply_add(ai, y, di.y), multiply_add(ai, z, di.z), zero});
        scatter4(increment, j, {multiply_add(aj, x, dj.x), multiply_add(aj, y, dj.y), multiply_add(aj, z, dj.z), zero});
    }
}

void XpbdSprings::step(double dt, uint32_t sweeps, double gravity) {
    const double kick = 0.5 * (last_dt_ + dt);
    last_dt_ = dt;
    compliance_ = static_cast<float>(1 / (double{stiffness_} * dt * dt));
    const float keep = static_cast<float>(std::exp(-damping_ * kick)), h = static_cast<float>(dt);
    const float fall = static_cast<float>(kick * gravity);
    for (uint32_t v = 0; v < count_; ++v) {
        if (!(position_[v].w > 0)) continue;
        const Vec3 u = keep * velocity_[v] - Vec3(0, 0, fall);
        increment_[v] = {h * u.x(), h * u.y(), h * u.z(), 0};
    }
    if (sweeps > 1) multiplier_.assign(rest_.size(), 0.0f);
    for (uint32_t i = 0; i < sweeps; ++i) sweep(sweeps > 1);
    for (uint32_t v = 0; v < count_; ++v) {
        const Float4 d = increment_[v];
        velocity_[v] = Vec3(d.x, d.y, d.z) / h;
        position_[v].x += d.x, position_[v].y += d.y, position_[v].z += d.z;
    }
}

std::vector<Vec3d> XpbdSprings::positions() const {
    std::vector<Vec3d> positions;
    for (uint32_t v = 0; v < count_; ++v) positions.push_back(Vec3d(position_[v].x, position_[v].y, position_[v].z));
    return positions;
}

}  // namespace trocar::bench
