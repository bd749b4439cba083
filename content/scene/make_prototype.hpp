#pragma once
#include "components/mesh.hpp"
#include "content/mend/admission.hpp"
#include "content/mend/clean_mesh.hpp"
#include "engine/tissue/cut_solid_setup.hpp"
namespace trocar {

// The point of a mesh that becomes the origin of the body frame.
enum class Recentre : uint8_t {
    kNone,            // the file's origin
    kVolumeCentroid,  // centroid of the enclosed volume; for an open surface, of its area
    kBoxCentre,       // middle of the box
};

struct PrototypeOptions {
    double scale = 1;  // metres per unit of the file
    Recentre recentre = Recentre::kNone;
    CleanParams clean = {};
    bool test_self_crossing = true;
};

struct Prototype {
    uint32_t row = kNone;         // index in Meshes; kNone if the mesh was refused
    Vec3d shift = Vec3d::Zero();  // m; file position * scale = body position + shift
    CleanReport cleaning;         // weld_distance in units of the file
    MeshJudgement judgement;      // of the prototype: metres, body frame
    // of a solid that instruments may cut
    CutSolidRoom room;
    uint32_t lattice_nodes = 0, lattice_tetrahedra = 0;
    uint32_t wall = 0;  // material of the new surface
};

// Cleans, scales, recentres and reorders a mesh, judges it and appends it to meshes. A refused mesh
// (judge_mesh; a face without material; inconsistent image size) appends nothing: row is kNone, and
// judgement.reason gives the cause. The scale must be finite and positive.
Prototype make_prototype(Meshes& meshes, Mesh mesh, const PrototypeOptions& options);

// Centroid of the enclosed volume; of the area if the mesh is open or encloses nothing.
Vec3d find_centroid(const Mesh& mesh);

}  // namespace trocar
