#pragma once
#include "components/solids.hpp"
#include "components/springs.hpp"
#include "content/isosurface_stuffing.hpp"
#include "content/make_prototype.hpp"
namespace trocar {

struct SolidOptions {
    double spacing = 0;  // m, long edge of the lattice; 0 = largest extent / cells
    double cells = 12;
    bool skin = false;                       // the surface is kept as given and rides on the tetrahedra; else their boundary is the surface
    bool tears = false;                      // may lose tetrahedra: keeps room for the faces behind them, see engine/solid_tears.hpp
    bool pressure = false, bending = false;  // a caged shell: bodies of it may keep their volume, may bend
};

// Numbers the nodes of a tetrahedral mesh (metres) so that those of its boundary come first and appends both as a solid
// prototype. The boundary becomes the surface, judged as it stands. Texture coordinates and materials come from `looks`,
// projected anew. `tears` as in SolidOptions.
Prototype add_tet_mesh(Meshes& meshes, Springs& springs, Solids& solids, const TetMesh& tets, const Mesh& looks, bool tears = false);

// As make_prototype, then fills what the surface encloses by isosurface stuffing of its signed distance. Throws
// InputError when the surface has no inside, nothing fits at this spacing, or a skin has parts that the tetrahedra do not
// reach (bind_skin); a refused mesh appends nothing.
Prototype make_solid(Meshes& meshes, Springs& springs, Solids& solids, Mesh mesh, const PrototypeOptions& options,
                     const SolidOptions& fill);

// As make_prototype, for a shell whose surface is too fine for its stiffness: the surface as given rides on a simplified one
// with edges of about fill.spacing (or its largest extent / fill.cells), which has the springs. Throws InputError when the
// surface is no finer than that, cannot ride on what simplifying left of it, or must keep a volume that this does not enclose.
// Pressure and bending are those of the simplified surface: the skin follows it.
Prototype make_caged_shell(Meshes& meshes, Springs& springs, Solids& solids, Mesh mesh, const PrototypeOptions& options,
                           const SolidOptions& fill);

}  // namespace trocar
