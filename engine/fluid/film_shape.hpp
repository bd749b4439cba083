#pragma once
#include <vector>

#include "engine/fluid/film.hpp"
#include "engine/mesh/surfaces.hpp"
namespace trocar {

struct FilmShapeScratch {
    std::vector<Float4> place;   // per cell
    std::vector<Float4> normal;  // per triangle
    std::vector<Float4> sum;     // per cell
};

// Heights, areas and slopes of the cells of one wet body at its present place. `down`: unit, world. A sheet is wet on the side that is
// up; a closed surface outside.
void find_film_shape(const Surfaces& surfaces, uint32_t body, uint32_t cells, const Vec3d& down, FilmShapeScratch& scratch,
                     FilmShape& shape);

// Direction of gravity; where there is none, -z.
inline Vec3d down_of(const Vec3d& gravity) { return gravity.norm() > 0 ? Vec3d(gravity.normalized()) : Vec3d(-Vec3d::UnitZ()); }

// sqrt(tension / (density g)) of blood, m.
double capillary_length(const FluidParams& params, double gravity);

// Volume of a drop that hangs until its weight tears it off, m^3: 4 capillary lengths cubed, 52 microlitres of blood; by Tate's law
// that of a tip whose radius is 1.06 capillary lengths, of whose tension 0.6 acts when it parts (Harkins & Brown, J. Am. Chem. Soc.
// 41(4), 1919).
double hanging_drop(const FluidParams& params, double gravity);

}  // namespace trocar
