#pragma once
#include "components/solids.hpp"
#include "components/springs.hpp"
#include "content/scene/make_prototype.hpp"
#include "content/volume/isosurface_stuffing.hpp"
namespace trocar {

struct SolidOptions {
    double spacing = 0;  // m, long edge of the lattice; 0 = largest extent / cells
    double cells = 12;
    bool skin = false;                       // embed the given surface; false: the tetrahedra's boundary is
                                             // used
    bool filled = false;                     // with skin: whole lattice tetrahedra weighted by what the surface encloses of them
                                             // (content/volume/filled_lattice.hpp); false: tetrahedra stuffed into the surface
    bool tears = false;                      // reserves room for faces behind tetrahedra,
                                             // engine/tissue/solid_tears.hpp
    bool cuts = false;                       // instruments may cut it (engine/tissue/lattice_cut.hpp); without skin
    uint32_t cut_capacity = 0;               // triangles that cuts may add; 0 = four times as many as the surface has
    bool pressure = false, bending = false;  // an embedded shell: its bodies may have pressure, may bend
};

// Renumbers the nodes of a tetrahedral mesh (m), boundary first, and appends it as a solid prototype. The
// boundary becomes the surface and is judged without cleaning. Texture coordinates and materials come from
// `looks`, projected anew. `tears` as in SolidOptions.
Prototype add_tet_mesh(Meshes& meshes, Springs& springs, Solids& solids, const TetMesh& tets, const Mesh& looks, bool tears = false);

// Like make_prototype, then fills the enclosed region by isosurface stuffing of its signed distance. Throws
// InputError if the surface has no inside, nothing fits at this spacing, or an embedded surface has parts
// outside the tetrahedra (bind_skin). A refused mesh appends nothing.
Prototype make_solid(Meshes& meshes, Springs& springs, Solids& solids, Mesh mesh, const PrototypeOptions& options,
                     const SolidOptions& fill);

// Like make_prototype, for a shell whose surface is too fine for its stiffness: the given surface is embedded
// in a simplified one that has the springs, with edges of about fill.spacing (or its largest extent /
// fill.cells). Throws InputError if the surface is no finer than that, cannot be bound to the simplified one,
// or must keep a volume that the simplified one does not enclose. Pressure and bending act on the latter.
Prototype make_caged_shell(Meshes& meshes, Springs& springs, Solids& solids, Mesh mesh, const PrototypeOptions& options,
                           const SolidOptions& fill);

}  // namespace trocar
