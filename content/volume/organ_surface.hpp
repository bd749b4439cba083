#pragma once
#include <functional>
#include <string>
#include <vector>

#include "content/mend/admission.hpp"
#include "content/volume/volume.hpp"
namespace trocar {

struct OrganParams {
    double blur = 1;          // voxels, standard deviation along each index; 0 = unblurred voxel steps
    uint32_t smooth = 10;     // rounds of Taubin smoothing
    uint32_t triangles = 0;   // target of the simplification; 0 = all contoured triangles
    bool even = false;        // simplify to even triangles for simulation, not to the fewest for the shape
    bool all_pieces = false;  // keep every piece of the selection, not only the largest
};

// Result of one stage of the pipeline.
struct OrganStage {
    std::string name;
    uint64_t triangles = 0;
    uint64_t open_edges = 0;  // edges without exactly two triangles in opposite directions
    double volume = 0;        // mm^3
    double change = 0;        // relative change of volume against the previous stage; 0 for the first
};

struct OrganSurface {
    Mesh mesh;                     // mm, in the patient frame of the volume
    double voxel_volume = 0;       // mm^3, of all kept voxels: the target volume of the surface
    uint64_t voxels_selected = 0;  // by label or threshold
    uint64_t voxels_kept = 0;      // remaining after smaller pieces were dropped
    std::vector<uint64_t> pieces;  // voxel counts of the 6-connected pieces, largest first
    std::vector<OrganStage> stages;
    std::vector<std::string> warnings;  // one line each
    MeshJudgement judgement;
};

// Called before each stage with the fraction done, in [0, 1], and the next stage.
using OrganProgress = std::function<void(double done, const std::string& stage)>;

// Makes the closed surface of a selection of voxels, with the same volume as the voxels:
//  1. largest 6-connected piece;
//  2. contour: marching cubes on the mask blurred by a Gaussian, at the level whose surface encloses the
//     voxels' volume. The blur removes the voxel steps. The usual level of one half would thin out thin
//     parts and shrink round organs;
//  3. Taubin smoothing, with a warning if it changes the volume by more than 1 %; then all vertices move
//     along their normals by one common distance that restores the volume;
//  4. simplification (meshoptimizer's quadric edge collapse; with params.even remesh_evenly, whose shortest
//     edges are long, as explicit dynamics needs) to params.triangles, up to 9 % fewer, or as many more as
//     needed: the first solid result is taken; the volume is restored in the same way;
//  5. judgement.
// Every stage is checked for holes. The selection must not be empty and must have a border of
// organ_frame(params) voxels. Throws InputError if nothing is left of it.
OrganSurface make_organ_surface(const OrganParams& params, const Volume& volume, VoxelMask selection, const OrganProgress& progress = {});

// Border that the blur needs around a selection, voxels.
uint32_t organ_frame(const OrganParams& params);

// Collapses edges to about `triangles` triangles by meshoptimizer's quadric error (Garland and Heckbert
// 1997). Remaining vertices do not move; coincident opposite faces are dropped. Closed surfaces stay closed,
// but folds may remain: judge the result. Returns meshoptimizer's error, relative to the largest extent.
double simplify_mesh(Mesh& mesh, uint32_t triangles);

}  // namespace trocar
