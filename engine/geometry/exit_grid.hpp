#pragma once
#include <array>
#include <span>
#include <vector>

#include "components/mesh.hpp"
namespace trocar {

// Where straight lines of one direction leave a closed surface: its triangles in the cells of a grid
// perpendicular to the direction.
class ExitGrid {
 public:
    struct Exit {
        uint32_t triangle = kNone;  // kNone: the line does not leave
        double distance = 0;        // m, distance from the query point
    };

    // `direction`: unit. Triangles that face against it are excluded: no line leaves there.
    void build(std::span<const Vec3d> position, std::span<const Triangle> triangle, const Vec3d& direction);
    // First point at which the line from p along the direction passes a triangle from inside; ties: the
    // lowest.
    Exit find(const Vec3d& p) const;

 private:
    std::array<double, 2> across(const Vec3d& p) const { return {p.dot(u_), p.dot(v_)}; }
    uint32_t cell_of(double x, int axis) const;

    std::span<const Vec3d> position_;
    std::span<const Triangle> triangle_;
    Vec3d direction_ = Vec3d::UnitZ(), u_ = Vec3d::UnitX(), v_ = Vec3d::UnitY();
    std::array<double, 2> low_{}, size_{};  // m, corner and size of a cell
    uint32_t cells_ = 1;                    // along each side
    std::vector<uint32_t> first_, entry_;   // per cell: range of entry, one more; triangles
};

}  // namespace trocar
