#pragma once
#include <functional>
#include <string>
#include <vector>

#include "content/admission.hpp"
#include "content/volume.hpp"
namespace trocar {

struct OrganParams {
    double blur = 1;          // voxels, standard deviation along each index; 0 = the bare steps of the voxels
    uint32_t smooth = 10;     // rounds of Taubin smoothing
    uint32_t triangles = 0;   // wanted after simplification; 0 = as contoured
    bool even = false;        // simplify to even triangles, for simulation, instead of fewest for the shape
    bool all_pieces = false;  // keep every piece of the selection, not the largest only
};

// What one stage of the pipeline left.
struct OrganStage {
    std::string name;
    uint64_t triangles = 0;
    uint64_t open_edges = 0;  // edges that do not have two triangles in opposite directions
    double volume = 0;        // mm^3
    double change = 0;        // of the volume, against the stage before; 0 for the first
};

struct OrganSurface {
    Mesh mesh;                     // mm, in the patient's frame of the volume
    double voxel_volume = 0;       // mm^3, of all voxels kept: what the surface should enclose
    uint64_t voxels_selected = 0;  // by label or threshold
    uint64_t voxels_kept = 0;      // of those, after dropping smaller pieces
    std::vector<uint64_t> pieces;  // voxels of each 6-connected piece, largest first
    std::vector<OrganStage> stages;
    std::vector<std::string> warnings;  // one line each
    MeshJudgement judgement;
};

// Called before each stage: how much is done, in [0, 1], and what is next.
using OrganProgress = std::function<void(double done, const std::string& stage)>;

// Makes the closed surface of a selection of voxels, which encloses as much as the voxels do:
//  1. the largest 6-connected piece;
//  2. contour: marching cubes on the mask blurred by a Gaussian, at the level whose surface encloses the volume of the
//     voxels. The blur takes the steps away; the usual level of one half would make thin parts thinner and round organs
//     smaller, the volume's level does not;
//  3. Taubin smoothing; a warning when that changes the volume by more than 1 %; every vertex then moves along its
//     normal by one common distance that restores it;
//  4. simplification (meshoptimizer's quadric edge collapse; with params.even remesh_evenly, whose shortest edges are
//     long, which is what explicit dynamics wants) to params.triangles, up to 9 % fewer or as many more as it
//     takes: the first outcome that is solid; the volume is restored in the same way;
//  5. judgement.
// Every stage is checked for holes. The selection must not be empty and must have a frame of organ_frame(params)
// voxels. Throws InputError when nothing is left of it.
OrganSurface make_organ_surface(const OrganParams& params, const Volume& volume, VoxelMask selection, const OrganProgress& progress = {});

// Voxels of frame that the blur needs around a selection.
uint32_t organ_frame(const OrganParams& params);

// Collapses edges to about `triangles` triangles by meshoptimizer's quadric error (Garland and Heckbert 1997); vertices
// that stay do not move, fins are dropped. Closed surfaces stay closed, but folds may be left: judge the outcome.
// Returns the error meshoptimizer reports, relative to the largest extent.
double simplify_mesh(Mesh& mesh, uint32_t triangles);

}  // namespace trocar
