#include "bench/peers/broad_phases.hpp"

#include <algorithm>
#include <numeric>

#include "engine/mesh/contact_kernels.hpp"
namespace trocar::bench {
namespace {

FloatBox box_of_body(const Soup& soup, uint32_t body) {
    FloatBox box;
    for (uint32_t v = soup.vertices[body].first; v < soup.vertices[body].end(); ++v) {
        const __m128 p = _mm_load_ps(&soup.position[v].x);
        box.take({p, p});
    }
    return box;
}

// Cell ranges of boxes relative to a corner below all of them.
struct Grid {
    __m128 origin, scale;
    std::array<uint32_t, 4> cell(__m128 p) const {
        alignas(16) std::array<uint32_t, 4> at;
        _mm_store_si128(reinterpret_cast<__m128i*>(at.data()), _mm_cvttps_epi32(_mm_mul_ps(_mm_sub_ps(p, origin), scale)));
        return at;
    }
};

// Where a cell belongs in a table of 2^(64 - shift) slots.
uint32_t cell_slot(uint64_t key, uint32_t shift) { return uint32_t((key * 0x9E3779B97F4A7C15ull) >> shift); }

}  // namespace

Soup make_soup(const Surfaces& s) {
    Soup soup;
    double edges = 0;
    for (uint32_t body = 0; body < s.bodies.mesh.size(); ++body) {
        const MeshView mesh = mesh_view(s.meshes, s.bodies.mesh[body]);
        const uint32_t first = uint32_t(soup.position.size());
        soup.vertices.push_back({first, uint32_t(mesh.position.size())});
        soup.triangles.push_back({uint32_t(soup.triangle.size()), uint32_t(mesh.triangle.size())});
        soup.position.resize(first + mesh.position.size());
        for (const Triangle& t : mesh.triangle) {
            soup.triangle.push_back({first + t[0], first + t[1], first + t[2]});
            soup.body.push_back(body);
        }
        edges += s.meshes.info[s.bodies.mesh[body]].mean_edge * double(mesh.triangle.size());
    }
    soup.mean_edge = edges / double(soup.triangle.size());
    move_soup(s, soup);
    return soup;
}

void move_soup(const Surfaces& s, Soup& soup) {
    for (uint32_t body = 0; body < soup.vertices.size(); ++body) {
        for (uint32_t v = 0; v < soup.vertices[body].count; ++v) {
            const Vec3d p = vertex_position(s, body, v);
            soup.position[soup.vertices[body].first + v] = {float(p.x()), float(p.y()), float(p.z()), 0};
        }
    }
}

void RasteriseAll::find(const Soup& soup, double cell_size, TrianglePairs& pairs) {
    const uint32_t triangles = uint32_t(soup.triangle.size());
    FloatBox all;
    box_.resize(triangles);
    for (uint32_t t = 0; t < triangles; ++t) all.take(box_[t] = box_of(soup, t));
    const Grid grid{all.low, _mm_set1_ps(float(1 / cell_size))};
    if (table_.empty()) table_.assign(1024, {UINT64_MAX, 0, 0});
    const auto clear = [&](size_t size) {
        if (size != table_.size())
            table_.assign(size, {UINT64_MAX, 0, 0});
        else
            for (const uint32_t s : used_) table_[s] = {UINT64_MAX, 0, 0};
        used_.clear(), slot_.clear(), row_.clear(), key_.clear();
    };
    clear(table_.size());
    for (uint32_t t = 0; t < triangles; ++t) {  // pass 1: number of bodies per cell
        if (used_.size() * 2 + 1024 > table_.size()) {
            clear(4 * table_.size());
            t = UINT32_MAX;  // from the start
            continue;
        }
        const uint32_t mask = uint32_t(table_.size()) - 1, shift = 64 - uint32_t(__builtin_ctzll(table_.size()));
        const auto low = grid.cell(box_[t].low), high = grid.cell(box_[t].high);
        for (uint32_t i = low[0]; i <= high[0]; ++i)
            for (uint32_t j = low[1]; j <= high[1]; ++j)
                for (uint32_t k = low[2]; k <= high[2]; ++k) {
                    const uint64_t key = pack_cell(i, j, k);
                    uint32_t s = cell_slot(key, shift);
                    while (table_[s].key != key && table_[s].key != UINT64_MAX) s = (s + 1) & mask;
                    Slot& slot = table_[s];
                    if (slot.key == UINT64_MAX) {
                        slot = {key, soup.body[t], 0};
                        used_.push_back(s);
                    } else if (slot.body != soup.body[t] && slot.shared == 0) {
                        key_.push_back(key);
                        slot.shared = uint32_t(key_.size());
                    }
                    slot_.push_back(s);
                    row_.push_back(t);
                }
    }
    first_.assign(key_.size() + 2, 0);  // pass 2: only cells of several bodies
    for (const uint32_t s : slot_) ++first_[table_[s].shared == 0 ? 0 : table_[s].shared + 1];
    first_[0] = 0;
    for (size_t i = 1; i < first_.size(); ++i) first_[i] += first_[i - 1];
    list_.resize(first_.back());
    for (size_t r = 0; r < slot_.size(); ++r) {
        if (const uint32_t shared = table_[slot_[r]].shared) list_[first_[shared]++] = row_[r];
    }
    pairs.clear();
    for (size_t cell = 0; cell < key_.size(); ++cell) {  // first_[cell + 1] is now the end of that cell
        for (uint32_t i = first_[cell]; i < first_[cell + 1]; ++i)
            for (uint32_t j = i + 1; j < first_[cell + 1]; ++j) {
                const uint32_t a = list_[i], b = list_[j];
                if (soup.body[a] == soup.body[b] || !meet(box_[a], box_[b])) continue;
                const auto at = grid.cell(_mm_max_ps(box_[a].low, box_[b].low));
                if (pack_cell(at[0], at[1], at[2]) == key_[cell]) pairs.push_back({a, b});
            }
    }
}

SweptTrees::SweptTrees(const Soup& soup) : triangle_box_(soup.triangle.size()) {
    for (uint32_t body = 0; body < soup.vertices.size(); ++body) build(soup, body);
    sweep_.resize(soup.vertices.size());
    std::iota(sweep_.begin(), sweep_.end(), 0u);
}

void SweptTrees::build(const Soup& soup, uint32_t body) {
    const Range range = soup.triangles[body];
    const FloatBox all = box_of_body(soup, body);
    alignas(16) std::array<float, 4> size;
    _mm_store_ps(size.data(), _mm_sub_ps(all.high, all.low));
    const Grid grid{all.low,
                    _mm_setr_ps(1023 / std::max(size[0], 1e-30f), 1023 / std::max(size[1], 1e-30f), 1023 / std::max(size[2], 1e-30f), 0)};
    std::vector<std::array<uint32_t, 2>> coded;
    for (uint32_t t = range.first; t < range.end(); ++t) {
        const FloatBox box = box_of(soup, t);
        const auto at = grid.cell(_mm_mul_ps(_mm_set1_ps(0.5f), _mm_add_ps(box.low, box.high)));
        uint32_t code = 0;
        for (uint32_t bit = 0; bit < 10; ++bit)
            for (uint32_t k = 0; k < 3; ++k) code |= (at[k] >> bit & 1) << (3 * bit + k);
        coded.push_back({code, t});
    }
    std::sort(coded.begin(), coded.end());
    const uint32_t base = uint32_t(order_.size()), root = uint32_t(node_.size());
    for (const auto& c : coded) order_.push_back(c[1]);
    node_.push_back({{}, 0, base, range.count});
    for (uint32_t n = root; n < node_.size(); ++n) {
        const uint32_t first = node_[n].first, count = node_[n].count;
        if (count <= 4) continue;
        // split where the highest differing bit of the codes changes; in the middle if all are equal
        const auto code = [&](uint32_t row) { return coded[row - base][0]; };
        const uint32_t differ = code(first) ^ code(first + count - 1);
        uint32_t split = first + count / 2;
        if (differ != 0) {
            const uint32_t bit = 1u << (31 - __builtin_clz(differ));
            split = uint32_t(std::partition_point(coded.begin() + (first - base), coded.begin() + (first + count - base),
                                                  [&](const auto& c) { return (c[0] & bit) == 0; }) -
                             coded.begin()) +
                    base;
        }
        node_[n].child = uint32_t(node_.size());
        node_.push_back({{}, 0, first, split - first});
        node_.push_back({{}, 0, split, first + count - split});
    }
    nodes_.push_back({root, uint32_t(node_.size()) - root});
}

void SweptTrees::refit(const Soup& soup, uint32_t body) {
    for (uint32_t n = nodes_[body].end(); n-- > nodes_[body].first;) {
        Node& node = node_[n];
        FloatBox box;
        if (node.child != 0) {
            box = node_[node.child].box;
            box.take(node_[node.child + 1].box);
        } else {
            for (uint32_t i = node.first; i < node.first + node.count; ++i) {
                box.take(triangle_box_[order_[i]] = box_of(soup, order_[i]));
            }
        }
        node.box = box;
    }
}

void SweptTrees::descend(uint32_t a, uint32_t b, TrianglePairs& pairs) {
    stack_.assign(1, {nodes_[a].first, nodes_[b].first});
    while (!stack_.empty()) {
        const auto [m, n] = stack_.back();
        stack_.pop_back();
        const Node &p = node_[m], &q = node_[n];
        if (!meet(p.box, q.box)) continue;
        if (p.child == 0 && q.child == 0) {
            for (uint32_t i = p.first; i < p.first + p.count; ++i)
                for (uint32_t j = q.first; j < q.first + q.count; ++j)
                    if (meet(triangle_box_[order_[i]], triangle_box_[order_[j]])) pairs.push_back({order_[i], order_[j]});
        } else if (q.child == 0 || (p.child != 0 && p.count >= q.count)) {
            stack_.push_back({p.child, n});
            stack_.push_back({p.child + 1, n});
        } else {
            stack_.push_back({m, q.child});
            stack_.push_back({m, q.child + 1});
        }
    }
}

void SweptTrees::find(const Soup& soup, TrianglePairs& pairs) {
    const uint32_t bodies = uint32_t(soup.vertices.size());
    body_box_.resize(bodies);
    for (uint32_t body = 0; body < bodies; ++body) body_box_[body] = box_of_body(soup, body);
    const auto low = [&](uint32_t body) { return _mm_cvtss_f32(body_box_[body].low); };
    for (uint32_t i = 1; i < bodies; ++i) {
        const uint32_t body = sweep_[i];
        uint32_t j = i;
        for (; j > 0 && low(body) < low(sweep_[j - 1]); --j) sweep_[j] = sweep_[j - 1];
        sweep_[j] = body;
    }
    met_.clear();
    std::vector<FloatBox> sorted(bodies);
    for (uint32_t i = 0; i < bodies; ++i) sorted[i] = body_box_[sweep_[i]];
    for (uint32_t i = 0; i < bodies; ++i) {
        const float end = _mm_cvtss_f32(sorted[i].high);
        for (uint32_t j = i + 1; j < bodies && _mm_cvtss_f32(sorted[j].low) <= end; ++j) {
            if (meet(sorted[i], sorted[j])) met_.push_back({std::min(sweep_[i], sweep_[j]), std::max(sweep_[i], sweep_[j])});
        }
    }
    fresh_.assign(bodies, 0);
    pairs.clear();
    for (const auto& [a, b] : met_) {
        for (const uint32_t body : {a, b}) {
            if (!fresh_[body]) refit(soup, body);
            fresh_[body] = 1;
        }
        descend(a, b, pairs);
    }
}

void find_by_brute_force(const Soup& soup, TrianglePairs& pairs) {
    std::vector<FloatBox> body(soup.vertices.size()), box(soup.triangle.size());
    for (uint32_t i = 0; i < body.size(); ++i) body[i] = box_of_body(soup, i);
    for (uint32_t t = 0; t < box.size(); ++t) box[t] = box_of(soup, t);
    pairs.clear();
    for (uint32_t a = 0; a < body.size(); ++a)
        for (uint32_t b = a + 1; b < body.size(); ++b) {
            if (!meet(body[a], body[b])) continue;
            for (uint32_t i = soup.triangles[a].first; i < soup.triangles[a].end(); ++i)
                for (uint32_t j = soup.triangles[b].first; j < soup.triangles[b].end(); ++j)
                    if (meet(box[i], box[j])) pairs.push_back({i, j});
        }
}

}  // namespace trocar::bench
