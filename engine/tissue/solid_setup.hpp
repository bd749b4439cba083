#pragma once
#include <array>
#include <span>

#include "components/bodies.hpp"
#include "components/mesh.hpp"
#include "components/particles.hpp"
#include "components/solids.hpp"
#include "components/springs.hpp"
#include "engine/tissue/embedded_surface.hpp"
namespace trocar {

// Depth (m) of an elastic foundation so soft that it exerts no force but still defines the best-fit rigid
// copy of a free body.
inline constexpr double kNoFoundation = 1e9;

// Fills a prototype with tetrahedra: nodes are the vertices of its surface, then `inner` (m, body frame);
// corners are node indices, volumes are positive. Appends to Solids and makes springs along the edges of the
// tetrahedra. Prototypes skipped get empty elements. The prototype must not have springs yet.
// With an embedded surface `inner` are all nodes, and `boundary`, triangles between nodes, carries the
// anchors of the elastic foundation. If it `tears`, each node gets the mass of the tetrahedra around it, so
// that removed ones take their mass along; otherwise masses are lumped evenly (engine/tissue/lumped_volume.hpp).
struct SolidSurface {
    SurfaceEmbedding binding;
    std::vector<Triangle> boundary;
    // Of tetrahedra that the surface cuts; empty: they are its inside. Stiffness of each / that of a full one; m^3, volume of each
    // node; m^2, share of the embedded surface that each carries (instead of `boundary`).
    std::vector<double> fill{}, node_volume{}, node_area{};
};
void add_solid(const Meshes& meshes, uint32_t prototype, std::span<const Vec3d> inner, std::span<const std::array<uint32_t, 4>> tetrahedra,
               Springs& springs, Solids& solids, const SolidSurface* skin = nullptr, bool tears = false);

// A shell with an embedded surface: springs along the edges of `boundary`, a surface between nodes (m, body
// frame), for a prototype whose vertices are embedded in it. Its elements of Solids are those of a solid
// without tetrahedra.
void add_caged_shell(const Meshes& meshes, uint32_t prototype, std::span<const Vec3d> node, const SolidSurface& skin, Springs& springs,
                     Solids& solids);
// As add_deformable for a body of such a prototype: mass by the volume of the embedded surface (a sheet: its
// area), distributed by the area around the nodes; stiffness and anchors as for any shell.
void add_caged_shell_body(const Meshes& meshes, const Springs& springs, const Solids& solids, const Poses& poses, uint32_t body,
                          Bodies& bodies, Particles& particles, Anchors& anchors);

// As add_deformable of deformable_setup.hpp, for a body whose prototype is a solid: masses from the
// tetrahedra's volumes, stiffnesses by solid_moduli, anchors at the surface only, stable_dt by
// update_solid_dt. Throws InputError for an invalid material value; Poisson's ratio must be at least 0.25
// (that of springs alone) and below 0.5.
void add_solid_body(const Meshes& meshes, const Springs& springs, const Solids& solids, const Poses& poses, uint32_t body, Bodies& bodies,
                    Particles& particles, Anchors& anchors);

}  // namespace trocar
