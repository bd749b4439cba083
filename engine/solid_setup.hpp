#pragma once
#include <array>
#include <span>

#include "components/bodies.hpp"
#include "components/mesh.hpp"
#include "components/particles.hpp"
#include "components/solids.hpp"
#include "components/springs.hpp"
#include "engine/skin.hpp"
namespace trocar {

// Depth (m) of an elastic bed that holds nothing but still tells the best-fit rigid copy of a free body.
inline constexpr double kNoBed = 1e9;

// Fills a prototype with tetrahedra: nodes are the vertices of its surface, then `inner` (m, body frame); corners name
// nodes, volumes are positive. Makes the rows of Solids and the springs along the edges of the tetrahedra. Prototypes passed
// over get empty rows. The prototype must not have springs yet. With a skin `inner` are all nodes, the surface rides on
// them, and the anchors' bed is what `boundary`, triangles between nodes, is. Nodes of one that `tears` weigh what the
// tetrahedra around them do, so that those take their mass along; all others are lumped evenly (engine/lumped_volume.hpp).
struct SolidSkin {
    SkinBinding binding;
    std::vector<Triangle> boundary;
};
void add_solid(const Meshes& meshes, uint32_t prototype, std::span<const Vec3d> inner, std::span<const std::array<uint32_t, 4>> tetrahedra,
               Springs& springs, Solids& solids, const SolidSkin* skin = nullptr, bool tears = false);

// A shell under a skin: springs along the edges of `boundary`, a surface between nodes (m, body frame), for a prototype
// whose vertices ride on them. The rows of Solids are those of a solid without tetrahedra.
void add_caged_shell(const Meshes& meshes, uint32_t prototype, std::span<const Vec3d> node, const SolidSkin& skin, Springs& springs,
                     Solids& solids);
// As add_deformable for a body of such a prototype: mass by the volume of the skin (a sheet: its area), shared by the area
// around the nodes; stiffness and anchors as of any shell.
void add_caged_shell_body(const Meshes& meshes, const Springs& springs, const Solids& solids, const Poses& poses, uint32_t body,
                          Bodies& bodies, Particles& particles, Anchors& anchors);

// As add_deformable of deformable_setup.hpp, for a body whose prototype is a solid: masses from the tetrahedra's volumes,
// stiffnesses by solid_moduli, anchors at the surface only, stable_dt by update_solid_dt. Throws InputError when a material
// value is impossible; Poisson's ratio must be at least 0.25 (springs cannot do less) and below 0.5.
void add_solid_body(const Meshes& meshes, const Springs& springs, const Solids& solids, const Poses& poses, uint32_t body, Bodies& bodies,
                    Particles& particles, Anchors& anchors);

}  // namespace trocar
