#include "bench/peers/thesis2008.hpp"

#include <algorithm>

#include "engine/mesh/contact_kernels.hpp"
namespace trocar::bench {

// Cells that completely contain a triangle: those of its box.
template <typename Visit>
void Thesis2008::rasterise(const Soup& soup, uint32_t triangle, const Visit& visit) const {
    uint32_t low[3], high[3];
    const Triangle& t = soup.triangle[triangle];
    const Vec<double> a = vertex<double>(soup, t[0]), b = vertex<double>(soup, t[1]), c = vertex<double>(soup, t[2]);
    const double Vec<double>::*axis[] = {&Vec<double>::x, &Vec<double>::y, &Vec<double>::z};
    for (int k = 0; k < 3; ++k) {
        low[k] = uint32_t((std::min({a.*axis[k], b.*axis[k], c.*axis[k]}) - origin_.*axis[k]) / cell_size_);
        high[k] = uint32_t((std::max({a.*axis[k], b.*axis[k], c.*axis[k]}) - origin_.*axis[k]) / cell_size_);
    }
    for (uint32_t i = low[0]; i <= high[0]; ++i)
        for (uint32_t j = low[1]; j <= high[1]; ++j)
            for (uint32_t k = low[2]; k <= high[2]; ++k) visit(pack_cell(i, j, k));
}

// Construction in two passes (3.3.1): the object counting table, then only the cells of several objects.
void Thesis2008::construct(const Soup& soup) {
    counting_.clear();
    cells_.clear();
    origin_ = {1e30, 1e30, 1e30};
    for (uint32_t v = 0; v < soup.position.size(); ++v) {
        const Vec<double> p = vertex<double>(soup, v);
        origin_ = {std::min(origin_.x, p.x), std::min(origin_.y, p.y), std::min(origin_.z, p.z)};
    }
    for (uint32_t t = 0; t < soup.triangle.size(); ++t) {
        rasterise(soup, t, [&](uint64_t cell) {
            Count& count = counting_[cell];
            if (count.last == soup.body[t]) return;
            count.last = soup.body[t];
            ++count.objects;
        });
    }
    for (uint32_t t = 0; t < soup.triangle.size(); ++t) {
        rasterise(soup, t, [&](uint64_t cell) {
            if (counting_[cell].objects > 1) cells_[cell][soup.body[t]].push_back(t);
        });
    }
}

// FindOverlapReg and FindPenetration (4.1.1, 4.2) of one pair.
void Thesis2008::find_overlap(const Soup& soup, const std::vector<uint64_t>& cells, ThesisPair& pair) {
    std::array<std::vector<uint32_t>, 2> triangles, vertices;
    for (int side = 0; side < 2; ++side) {
        for (const uint64_t cell : cells) {
            const std::vector<uint32_t>& list = cells_[cell][pair.bodies[side]];
            triangles[side].insert(triangles[side].end(), list.begin(), list.end());
        }
        const auto unique = [](std::vector<uint32_t>& rows) {
            std::sort(rows.begin(), rows.end());
            rows.erase(std::unique(rows.begin(), rows.end()), rows.end());
        };
        unique(triangles[side]);
        for (const uint32_t t : triangles[side])
            vertices[side].insert(vertices[side].end(), soup.triangle[t].begin(), soup.triangle[t].end());
        unique(vertices[side]);
    }
    std::vector<Vec<double>> displacement;
    for (int side = 0; side < 2; ++side) {
        for (const uint32_t v : vertices[side]) {
            const Vec<double> p = vertex<double>(soup, v);
            Closest<double> best{{}, 0, -1, 1e300};
            for (const uint32_t t : triangles[1 - side]) {
                const Closest<double> c = closest_on_triangle<double>(soup, t, p);
                if (c.squared < best.squared) best = c;
            }
            const Vec<double> r = p - best.point;
            if (!(dot(pseudonormal<double>(soup, incidence_, best), r) < 0)) continue;
            pair.inside.push_back({v, pair.bodies[side], norm(r), 0});
            displacement.push_back(side == 0 ? best.point - p : r);  // separation direction of the first body
        }
    }
    for (size_t i = 0; i < displacement.size(); ++i) {
        if (pair.inside[i].distance <= pair.depth) continue;
        pair.depth = pair.inside[i].distance;
        pair.direction = 1 / pair.depth * displacement[i];
    }
    for (size_t i = 0; i < displacement.size(); ++i) pair.inside[i].projected = std::abs(dot(displacement[i], pair.direction));
}

void Thesis2008::run(const Soup& soup, double cell_size, std::vector<ThesisPair>& pairs) {
    cell_size_ = cell_size;
    construct(soup);
    std::map<std::array<uint32_t, 2>, std::vector<uint64_t>> shared;  // instruction: the cells of every pair
    for (const auto& [cell, objects] : cells_) {
        for (auto a = objects.begin(); a != objects.end(); ++a)
            for (auto b = std::next(a); b != objects.end(); ++b) shared[{a->first, b->first}].push_back(cell);
    }
    pairs.clear();
    for (const auto& [bodies, cells] : shared) {
        ThesisPair pair;
        pair.bodies = bodies;
        find_overlap(soup, cells, pair);
        if (!pair.inside.empty()) pairs.push_back(std::move(pair));
    }
}

}  // namespace trocar::bench
