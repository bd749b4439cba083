#pragma once
#include "components/mesh.hpp"
#include "content/admission.hpp"
#include "content/clean_mesh.hpp"
namespace trocar {

// Which point of a mesh becomes the origin of the body frame.
enum class Recentre : uint8_t {
    kNone,            // the file's origin
    kVolumeCentroid,  // centre of the enclosed volume; of an open surface, of its area
    kBoxCentre,       // middle of the box
};

struct PrototypeOptions {
    double scale = 1;  // metres per unit of the file
    Recentre recentre = Recentre::kNone;
    CleanParams clean = {};
    bool test_self_crossing = true;
};

struct Prototype {
    uint32_t row = kNone;         // of Meshes; kNone when the mesh was refused
    Vec3d shift = Vec3d::Zero();  // m, taken off every position: file position * scale = body position + shift
    CleanReport cleaning;         // weld_distance in units of the file
    MeshJudgement judgement;      // of the prototype as it stands: metres, body frame
};

// Cleans, scales, recentres and orders a mesh, judges it and appends it to meshes. A refused mesh (judge_mesh; or a face of no
// material, an image that is not as large as it says) appends nothing: row is kNone, judgement.reason says why. The scale must be
// finite and positive.
Prototype make_prototype(Meshes& meshes, Mesh mesh, const PrototypeOptions& options);

// Centre of the volume a closed mesh encloses; of the area where a mesh is open or encloses nothing.
Vec3d find_centroid(const Mesh& mesh);

}  // namespace trocar
