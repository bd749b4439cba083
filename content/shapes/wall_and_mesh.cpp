#include "content/shapes/wall_and_mesh.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include "content/shapes/loft.hpp"
namespace trocar {
namespace {

constexpr double kWidth = 0.15, kHeight = 0.1;  // m, of the surgical mesh
constexpr double kOpen = 0.76;                  // pore radius relative to the cell radius
constexpr double kMostPitch = 6.6e-3;           // m

// Point on the outline of a rectangle, u from its lower left corner, a quarter per side.
Vec3d rectangle(const Vec3d& half, double u) {
    const Vec3d corner[5] = {
        {-half.x(), -half.y(), 0}, {half.x(), -half.y(), 0}, {half.x(), half.y(), 0}, {-half.x(), half.y(), 0}, {-half.x(), -half.y(), 0}};
    const size_t side = std::min<size_t>(static_cast<size_t>(4 * u), 3);
    return corner[side] + (4 * u - double(side)) * (corner[side + 1] - corner[side]);
}

// Vertices of the surgical mesh, indexed by position in the plane.
struct SheetBuilder {
    Mesh mesh;
    std::map<std::array<int64_t, 2>, uint32_t> known;

    uint32_t vertex(double x, double y) {
        const std::array<int64_t, 2> key{std::llround(x * 1e8), std::llround(y * 1e8)};
        const auto [found, fresh] = known.try_emplace(key, static_cast<uint32_t>(mesh.position.size()));
        if (fresh) mesh.position.push_back({x, y, 0});
        return found->second;
    }
    void add(uint32_t a, uint32_t b, uint32_t c) {
        mesh.triangle.push_back({a, b, c});
        std::array<Vec2, 3> uv;
        for (int k = 0; k < 3; ++k) {
            const Vec3d& p = mesh.position[mesh.triangle.back()[k]];
            uv[k] = {static_cast<float>(p.x() / 0.01), static_cast<float>(p.y() / 0.01)};
        }
        mesh.uv.push_back(uv);
    }
};

// Rows of triangles between the outline of a cell and its pore.
void add_cell(const std::vector<Vec3d>& outline, const MeshCells& cells, SheetBuilder& sheet) {
    Vec3d centre = Vec3d::Zero();
    for (const Vec3d& p : outline) centre += p / double(outline.size());
    std::vector<Vec3d> outer;
    for (size_t k = 0; k < outline.size(); ++k) {
        for (uint32_t i = 0; i < cells.along; ++i) {
            outer.push_back(outline[k] + double(i) / cells.along * (outline[(k + 1) % outline.size()] - outline[k]));
        }
    }
    const size_t n = outer.size();
    std::vector<uint32_t> below, row;
    for (uint32_t j = 0; j <= cells.across; ++j) {
        row.clear();
        const double shrink = 1 - (1 - kOpen) * j / cells.across;
        for (const Vec3d& p : outer) {
            const Vec3d at = centre + shrink * (p - centre);
            row.push_back(sheet.vertex(at.x(), at.y()));
        }
        for (size_t i = 0; i < n && j > 0; ++i) {
            const size_t next = (i + 1) % n;
            // diagonals lean away from the corners of the cell
            if (i % cells.along * 2 < cells.along) {
                sheet.add(below[i], below[next], row[next]);
                sheet.add(below[i], row[next], row[i]);
            } else {
                sheet.add(below[i], below[next], row[i]);
                sheet.add(below[next], row[next], row[i]);
            }
        }
        below = row;
    }
}

// Half a cell at the end of a row, without a pore: a grid between its four corners.
void add_half_cell(const std::array<Vec3d, 4>& corner, uint32_t along, SheetBuilder& sheet) {
    const auto vertex = [&](uint32_t i, uint32_t j) {
        const double x = double(i) / along, y = double(j) / along;
        const Vec3d p = (1 - y) * ((1 - x) * corner[0] + x * corner[1]) + y * ((1 - x) * corner[3] + x * corner[2]);
        return sheet.vertex(p.x(), p.y());
    };
    for (uint32_t j = 0; j < along; ++j) {
        for (uint32_t i = 0; i < along; ++i) {
            sheet.add(vertex(i, j), vertex(i + 1, j), vertex(i + 1, j + 1));
            sheet.add(vertex(i, j), vertex(i + 1, j + 1), vertex(i, j + 1));
        }
    }
}

// Columns and rows of nearly regular hexagons for a number of triangles.
MeshCells fit_cells(uint32_t triangles, uint32_t along, uint32_t across) {
    MeshCells best;
    uint32_t nearest = kNone;
    for (uint32_t columns = 2; columns < 2000; ++columns) {
        // in a regular honeycomb the row spacing is sqrt(3) / 2 of the column spacing
        const double pitch = kWidth / columns;
        const uint32_t rows = std::max(1u, static_cast<uint32_t>(std::lround(kHeight / (pitch * std::sqrt(0.75)))));
        const MeshCells cells{columns, rows, along, across};
        const uint32_t have = cells.triangles(), miss = have > triangles ? have - triangles : triangles - have;
        if (miss < nearest) nearest = miss, best = cells;
        if (have > triangles) break;
    }
    return best;
}

}  // namespace

Mesh make_hernia_wall(const WallSize& size, uint32_t triangles) {
    Loft loft;
    loft.ring = true;
    loft.pieces = 4;
    loft.corner = {0, 0.25, 0.5, 0.75};
    loft.point = [size](double u, double v) {
        const Vec3d outer = rectangle(Vec3d(size.width / 2, size.height / 2, 0), u);
        const double angle = std::atan2(outer.y() / size.defect_y, outer.x() / size.defect_x);
        const auto hole = [&](double inwards) {
            return Vec3d((size.defect_x - inwards) * std::cos(angle), (size.defect_y - inwards) * std::sin(angle), 0);
        };
        // rim of the defect upwards, outer surface, cut edge downwards, inner surface
        const double part = v < 4 ? v - std::floor(v) : 0;
        const int piece = v < 4 ? static_cast<int>(v) : 0;
        const double turn = M_PI * (part - 0.5);
        const Vec3d plan = piece == 0   ? hole(size.rim * std::cos(turn))
                           : piece == 1 ? Vec3d(hole(0) + part * (outer - hole(0)))
                           : piece == 2 ? outer
                                        : Vec3d(outer + part * (hole(0) - outer));
        const double lift = size.thickness / 2 * (piece == 0 ? std::sin(turn) : piece == 1 ? 1.0 : piece == 2 ? 1 - 2 * part : -1.0);
        const double bend = plan.x() / size.bend;
        return Vec3d((size.bend + lift) * std::sin(bend), plan.y(), (size.bend + lift) * std::cos(bend) - size.bend);
    };
    Mesh mesh = loft_surface(loft, triangles);
    for (const Triangle& t : mesh.triangle) {
        double lift = 0;
        for (const uint32_t v : t) {
            const Vec3d& p = mesh.position[v];
            lift += std::hypot(p.x(), p.z() + size.bend) - size.bend;
        }
        const double share = lift / 3 / (size.thickness / 2);
        mesh.triangle_material.push_back(share > 0.999 ? 1 : share < -0.999 ? 2 : 0);
    }
    return mesh;
}

uint32_t MeshCells::triangles() const { return pores() * 12 * along * across + rows / 2 * 2 * 2 * along * along; }

MeshCells divide_mesh(uint32_t triangles) {
    MeshCells best = fit_cells(triangles, 1, 1);
    for (const auto& [along, across] : {std::array<uint32_t, 2>{2, 1}, {4, 2}, {6, 3}, {8, 4}}) {
        const MeshCells cells = fit_cells(triangles, along, across);
        if (kWidth / cells.columns <= kMostPitch) best = cells;
    }
    return best;
}

Mesh make_surgical_mesh(const MeshCells& cells) {
    SheetBuilder sheet;
    const double step = kWidth / (2 * cells.columns), rise = kHeight / cells.rows;
    // corner i of line j; lines between rows zigzag, the first and the last are straight
    const auto corner = [&](uint32_t i, uint32_t j) {
        const bool straight = j == 0 || j == cells.rows;
        const double zigzag = straight ? 0.0 : rise / 6 * ((i + j) % 2 == 0 ? 1 : -1);
        return Vec3d(step * i - kWidth / 2, rise * j + zigzag - kHeight / 2, 0);
    };
    for (uint32_t j = 0; j < cells.rows; ++j) {
        const bool shifted = j % 2 == 1;
        for (uint32_t i = shifted ? 1 : 0; i + 2 <= 2 * cells.columns; i += 2) {
            add_cell({corner(i, j), corner(i + 1, j), corner(i + 2, j), corner(i + 2, j + 1), corner(i + 1, j + 1), corner(i, j + 1)},
                     cells, sheet);
        }
        for (uint32_t i = 0; shifted && i <= 2 * cells.columns; i += 2 * cells.columns - 1) {
            add_half_cell({corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)}, cells.along, sheet);
        }
    }
    return std::move(sheet.mesh);
}

Mesh make_fine_mesh(uint32_t triangles) {
    const auto cells = [](double wanted) { return std::max(1u, static_cast<uint32_t>(std::lround(std::sqrt(wanted)))); };
    const uint32_t columns = cells(triangles / 2.0 * kWidth / kHeight), rows = cells(triangles / 2.0 * kHeight / kWidth);
    SheetBuilder sheet;
    const auto vertex = [&](uint32_t i, uint32_t j) {
        return sheet.vertex(kWidth * (double(i) / columns - 0.5), kHeight * (double(j) / rows - 0.5));
    };
    for (uint32_t j = 0; j < rows; ++j) {
        for (uint32_t i = 0; i < columns; ++i) {
            const uint32_t a = vertex(i, j), b = vertex(i + 1, j), c = vertex(i + 1, j + 1), d = vertex(i, j + 1);
            // alternate diagonals, so that the sheet has no preferred direction
            if ((i + j) % 2 == 0)
                sheet.add(a, b, c), sheet.add(a, c, d);
            else
                sheet.add(a, b, d), sheet.add(b, c, d);
        }
    }
    return std::move(sheet.mesh);
}

}  // namespace trocar
