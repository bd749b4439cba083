#include "content/volume/marching_cubes.hpp"

#include <algorithm>
#include <array>
#include <cstring>
#include <utility>

#include "engine/base/check.hpp"
namespace trocar {
namespace {

// Corner c of a cell: (c & 1, c >> 1 & 1, c >> 2 & 1). Edge 4 * axis + j starts at the j-th corner with 0
// there.
struct CubeEdge {
    uint8_t from = 0;
    uint8_t to = 0;
};

constexpr CubeEdge cube_edge(int e) {
    const int axis = e / 4;
    const int low = (1 << axis) - 1;
    const int j = e % 4;
    const int from = (j & low) | ((j & ~low) << 1);
    return {static_cast<uint8_t>(from), static_cast<uint8_t>(from | 1 << axis)};
}

constexpr int edge_between(int a, int b) {
    for (int e = 0; e < 12; ++e) {
        const CubeEdge edge = cube_edge(e);
        if ((edge.from == a && edge.to == b) || (edge.from == b && edge.to == a)) return e;
    }
    return -1;
}

// The four corners of face 2 * axis + side, counter-clockwise seen from outside the cell.
constexpr std::array<int, 4> face_corners(int face) {
    const int axis = face / 2;
    const int side = face % 2;
    const int u = 1 << (axis + 1) % 3;
    const int v = 1 << (axis + 2) % 3;
    const int base = side << axis;
    if (side == 1) return {base, base | u, base | u | v, base | v};
    return {base, base | v, base | u | v, base | u};
}

constexpr bool share_face(int e, int f) {
    const CubeEdge a = cube_edge(e);
    const CubeEdge b = cube_edge(f);
    for (int axis = 0; axis < 3; ++axis) {
        const int bit = 1 << axis;
        const int all = a.from & a.to & b.from & b.to & bit;
        const int any = (a.from | a.to | b.from | b.to) & bit;
        if (all || !any) return true;
    }
    return false;
}

// Triangles for one of the 256 sign patterns. An entry below 12 is the vertex on that cell edge; 12 + k is
// the centre of loop k, an extra vertex.
struct CubeCase {
    uint8_t triangles = 0;
    uint8_t centres = 0;
    std::array<uint8_t, 36> corner{};
    std::array<uint8_t, 4> loop_size{};
    std::array<std::array<uint8_t, 12>, 4> loop{};
};

struct Loop {
    int size = 0;
    std::array<int, 12> edge{};
};

// Splits the polygon from..to of a loop into triangles without a diagonal inside a cell face: the neighbour
// could have the same diagonal, and four triangles would meet there. False if there is no such split.
constexpr bool cut_polygon(const Loop& loop, int from, int to, CubeCase& out) {
    if (to - from < 2) return true;
    const auto allowed = [&](int i, int j) {
        const bool side = j - i == 1 || (i == 0 && j == loop.size - 1);
        return side || !share_face(loop.edge[i], loop.edge[j]);
    };
    for (int mid = from + 1; mid < to; ++mid) {
        if (!allowed(from, mid) || !allowed(mid, to)) continue;
        CubeCase attempt = out;
        for (const int i : {from, mid, to}) {
            attempt.corner[3 * attempt.triangles + (i == from ? 0 : i == mid ? 1 : 2)] = static_cast<uint8_t>(loop.edge[i]);
        }
        ++attempt.triangles;
        if (cut_polygon(loop, from, mid, attempt) && cut_polygon(loop, mid, to, attempt)) {
            out = attempt;
            return true;
        }
    }
    return false;
}

constexpr void fan_polygon(const Loop& loop, CubeCase& out) {
    const int centre = 12 + out.centres;
    for (int i = 0; i < loop.size; ++i) {
        out.corner[3 * out.triangles] = static_cast<uint8_t>(centre);
        out.corner[3 * out.triangles + 1] = static_cast<uint8_t>(loop.edge[i]);
        out.corner[3 * out.triangles + 2] = static_cast<uint8_t>(loop.edge[(i + 1) % loop.size]);
        ++out.triangles;
        out.loop[out.centres][i] = static_cast<uint8_t>(loop.edge[i]);
    }
    out.loop_size[out.centres] = static_cast<uint8_t>(loop.size);
    ++out.centres;
}

// Every run of inside corners around a face is cut off by one segment, from the edge where the run begins to
// the edge where it ends. On a face with two runs this separates the inside corners. The rule depends only on
// the signs of the face, so both cells at a face get the same segments, in opposite directions.
constexpr CubeCase derive_case(int signs) {
    std::array<int, 12> next{};
    next.fill(-1);
    for (int face = 0; face < 6; ++face) {
        const std::array<int, 4> q = face_corners(face);
        const auto inside = [&](int i) { return (signs >> q[i % 4] & 1) != 0; };
        for (int i = 0; i < 4; ++i) {
            if (inside(i) || !inside(i + 1)) continue;
            int last = i + 1;
            while (inside(last + 1)) ++last;
            next[edge_between(q[i], q[(i + 1) % 4])] = edge_between(q[last % 4], q[(last + 1) % 4]);
        }
    }
    CubeCase out;
    for (int start = 0; start < 12; ++start) {
        Loop loop;
        for (int e = start; next[e] >= 0;) {
            loop.edge[loop.size++] = e;
            const int following = next[e];
            next[e] = -1;
            e = following;
        }
        if (loop.size == 0) continue;
        if (!cut_polygon(loop, 0, loop.size - 1, out)) fan_polygon(loop, out);
    }
    return out;
}

constexpr std::array<CubeCase, 256> derive_cases() {
    std::array<CubeCase, 256> cases{};
    for (int signs = 0; signs < 256; ++signs) cases[signs] = derive_case(signs);
    return cases;
}

constexpr std::array<CubeCase, 256> kCases = derive_cases();

// Vertex indices on the edges around one layer of cells: x and y edges of its lower and upper slice, z edges
// between. Entries of edges without a crossing are never read.
struct LayerEdges {
    std::array<std::vector<uint32_t>, 2> x;
    std::array<std::vector<uint32_t>, 2> y;
    std::vector<uint32_t> z;
};

// One byte per sample: 1 inside.
void mark_inside(const float* values, size_t count, float iso, uint8_t* inside) {
    for (size_t i = 0; i < count; ++i) inside[i] = values[i] < iso ? 1 : 0;
}

// Calls visit(x) for every x where a and b differ; compares eight samples at a time.
template <typename Visit>
void for_each_difference(const uint8_t* a, const uint8_t* b, uint32_t count, const Visit& visit) {
    uint32_t x = 0;
    for (; x + 8 <= count; x += 8) {
        uint64_t wide_a = 0;
        uint64_t wide_b = 0;
        std::memcpy(&wide_a, a + x, 8);
        std::memcpy(&wide_b, b + x, 8);
        for (uint64_t rest = wide_a ^ wide_b; rest != 0; rest &= rest - 1) {
            visit(x + static_cast<uint32_t>(__builtin_ctzll(rest)) / 8);
        }
    }
    for (; x < count; ++x) {
        if (a[x] != b[x]) visit(x);
    }
}

struct Contourer {
    const ScalarGrid& grid;
    float iso;
    Mesh mesh;
    LayerEdges edges;
    std::array<std::vector<uint8_t>, 2> inside;  // signs of the lower and upper slice
    std::vector<uint8_t> column;                 // for one line of cells: the four signs at each x, as bits

    size_t row(uint32_t y, uint32_t z) const { return (size_t(z) * grid.ny + y) * grid.nx; }

    uint32_t add_vertex(uint32_t x, uint32_t y, uint32_t z, int axis) {
        const size_t step = axis == 0 ? 1 : axis == 1 ? grid.nx : size_t(grid.nx) * grid.ny;
        const size_t at = row(y, z) + x;
        const double from = grid.values[at];
        const double to = grid.values[at + step];
        constexpr double kMargin = 1e-3;
        Vec3d position(x, y, z);
        position[axis] += std::clamp((iso - from) / (to - from), kMargin, 1.0 - kMargin);
        mesh.position.push_back(grid.origin + position.cwiseProduct(grid.spacing));
        return static_cast<uint32_t>(mesh.position.size() - 1);
    }

    void cross_slice(uint32_t z, int side) {
        mark_inside(grid.values.data() + row(0, z), size_t(grid.nx) * grid.ny, iso, inside[side].data());
        for (uint32_t y = 0; y < grid.ny; ++y) {
            const size_t at = size_t(y) * grid.nx;
            const uint8_t* signs = inside[side].data() + at;
            for_each_difference(signs, signs + 1, grid.nx - 1, [&](uint32_t x) { edges.x[side][at + x] = add_vertex(x, y, z, 0); });
            if (y + 1 == grid.ny) break;
            for_each_difference(signs, signs + grid.nx, grid.nx, [&](uint32_t x) { edges.y[side][at + x] = add_vertex(x, y, z, 1); });
        }
    }

    void cross_between(uint32_t z, int lower) {
        for (uint32_t y = 0; y < grid.ny; ++y) {
            const size_t at = size_t(y) * grid.nx;
            for_each_difference(inside[lower].data() + at, inside[1 - lower].data() + at, grid.nx,
                                [&](uint32_t x) { edges.z[at + x] = add_vertex(x, y, z, 2); });
        }
    }

    void fill_cell(uint32_t x, uint32_t y, int lower, const CubeCase& cube) {
        const size_t at = size_t(y) * grid.nx + x;
        const size_t up = at + grid.nx;
        const auto& x0 = edges.x[lower];
        const auto& x1 = edges.x[1 - lower];
        const auto& y0 = edges.y[lower];
        const auto& y1 = edges.y[1 - lower];
        const std::array<const uint32_t*, 12> source{&x0[at], &x0[up],     &x1[at],      &x1[up],          &y0[at],      &y0[at + 1],
                                                     &y1[at], &y1[at + 1], &edges.z[at], &edges.z[at + 1], &edges.z[up], &edges.z[up + 1]};
        std::array<uint32_t, 4> centre{};
        for (int k = 0; k < cube.centres; ++k) {
            Vec3d sum = Vec3d::Zero();
            for (int i = 0; i < cube.loop_size[k]; ++i) sum += mesh.position[*source[cube.loop[k][i]]];
            centre[k] = static_cast<uint32_t>(mesh.position.size());
            mesh.position.push_back(sum / cube.loop_size[k]);
        }
        for (int t = 0; t < cube.triangles; ++t) {
            Triangle triangle{};
            for (int k = 0; k < 3; ++k) {
                const uint8_t entry = cube.corner[3 * t + k];
                triangle[k] = entry < 12 ? *source[entry] : centre[entry - 12];
            }
            mesh.triangle.push_back(triangle);
        }
    }

    void fill_row(uint32_t y, int lower) {
        const uint8_t* a = inside[lower].data() + size_t(y) * grid.nx;
        const uint8_t* b = inside[1 - lower].data() + size_t(y) * grid.nx;
        uint8_t* bits = column.data();
        for (uint32_t x = 0; x < grid.nx; ++x) {
            bits[x] = static_cast<uint8_t>(a[x] | a[x + grid.nx] << 2 | b[x] << 4 | b[x + grid.nx] << 6);
        }
        const auto visit = [&](uint32_t x) {
            const int signs = bits[x] | bits[x + 1] << 1;
            fill_cell(x, y, lower, kCases[signs]);
        };
        // a cell is empty if its two columns are equal and either all inside or all outside
        uint32_t x = 0;
        const uint32_t cells = grid.nx - 1;
        for (; x + 9 <= grid.nx; x += 8) {
            uint64_t wide = 0;
            std::memcpy(&wide, bits + x, 8);
            const bool uniform = wide == 0 || wide == 0x5555555555555555u;
            if (uniform && bits[x + 8] == bits[x]) continue;
            for (uint32_t i = x; i < x + 8; ++i) {
                const int signs = bits[i] | bits[i + 1] << 1;
                if (signs != 0 && signs != 255) visit(i);
            }
        }
        for (; x < cells; ++x) {
            const int signs = bits[x] | bits[x + 1] << 1;
            if (signs != 0 && signs != 255) visit(x);
        }
    }
};

}  // namespace

Mesh contour(const ScalarGrid& grid, double iso) {
    TROCAR_ASSERT(grid.nx >= 2 && grid.ny >= 2 && grid.nz >= 2);
    TROCAR_ASSERT(grid.values.size() == size_t(grid.nx) * grid.ny * grid.nz);
    Contourer work{grid, static_cast<float>(iso), {}, {}, {}, {}};
    const size_t slice = size_t(grid.nx) * grid.ny;
    for (int side = 0; side < 2; ++side) {
        work.inside[side].resize(slice);
        work.edges.x[side].resize(slice);
        work.edges.y[side].resize(slice);
    }
    work.edges.z.resize(slice + grid.nx + 1);
    work.column.resize(grid.nx);
    work.cross_slice(0, 0);
    for (uint32_t z = 0; z + 1 < grid.nz; ++z) {
        const int lower = z % 2;
        work.cross_slice(z + 1, 1 - lower);
        work.cross_between(z, lower);
        for (uint32_t y = 0; y + 1 < grid.ny; ++y) work.fill_row(y, lower);
    }
    return std::move(work.mesh);
}

}  // namespace trocar
