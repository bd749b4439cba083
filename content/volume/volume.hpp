#pragma once
#include <array>
#include <string>
#include <utility>
#include <vector>

#include "components/math.hpp"
#include "content/text/byte_order.hpp"
namespace trocar {

using VoxelType = Scalar;

// A named set of voxels: those with the value `label` in a layer.
struct Segment {
    std::string name, id;
    double label = 1;
    uint32_t layer = 0;
};

// A segmented or measured image in space. Lengths are the file's, for medical images millimetres; x runs to the
// patient's left, y to the back, z to the head (LPS, the convention of DICOM and ITK).
struct Volume {
    std::array<uint32_t, 3> size{};                                             // voxels
    Vec3d origin = Vec3d::Zero();                                               // centre of voxel (0, 0, 0)
    std::array<Vec3d, 3> step{Vec3d::UnitX(), Vec3d::UnitY(), Vec3d::UnitZ()};  // vector to the next voxel along each index
    VoxelType type = VoxelType::kUint8;
    uint32_t layers = 1;  // values of a voxel, one for each layer of segments that may overlap
    std::string voxels;   // layer fastest, then x; little endian; layers * size[0] * size[1] * size[2] values
    std::vector<Segment> segments;
    std::vector<std::string> warnings;  // one line each, with the file's name
};

// The volume with one of its layers, without segments and warnings.
Volume take_layer(const Volume& volume, uint32_t layer);

// Position of a point given in voxel indices.
Vec3d place_of_index(const Volume& volume, const Vec3d& index);

// Volume of one voxel; signed_voxel_volume is negative for left-handed steps (a mirrored image).
double signed_voxel_volume(const Volume& volume);
double voxel_volume(const Volume& volume);

// The distinct values of a volume of one layer with voxel counts, ascending; empty if more than `most` (not a label map).
std::vector<std::pair<double, uint64_t>> count_values(const Volume& volume, size_t most = 4096);

// Selected voxels in their bounding box plus a border of unselected voxels (possibly outside of the volume).
struct VoxelMask {
    std::array<int64_t, 3> first{};  // voxel of the volume that corresponds to inside[0]
    std::array<uint32_t, 3> size{};  // voxels, border included
    std::vector<uint8_t> inside;     // 1 = selected, x fastest
    uint64_t count = 0;              // number of selected voxels
};

// Selects the voxels with value `label`, or with value >= `threshold`. `frame` >= 1, border in voxels. An
// empty mask (count 0, no voxels) if there are none. NaN voxels are never selected.
VoxelMask select_label(const Volume& volume, double label, uint32_t frame);
VoxelMask select_above(const Volume& volume, double threshold, uint32_t frame);

// Pieces are connected across faces (6-connectivity): voxels that meet only along an edge or at a corner are
// separate, as in the contour. Keeps the largest piece (first of equal ones); returns all sizes, largest
// first.
std::vector<uint64_t> keep_largest_piece(VoxelMask& mask);

}  // namespace trocar
