#pragma once
#include <array>
#include <string>
#include <utility>
#include <vector>

#include "components/math.hpp"
namespace trocar {

enum class VoxelType : uint8_t { kUint8, kInt8, kUint16, kInt16, kUint32, kInt32, kUint64, kInt64, kFloat, kDouble };

// Bytes of one voxel.
size_t voxel_bytes(VoxelType type);
// "uint8", "float", ...

// A segmented or measured image in space. Lengths are the file's, for medical images millimetres; x runs to the
// patient's left, y to the back, z to the head (LPS, the convention of DICOM and ITK).
struct Volume {
    std::array<uint32_t, 3> size{};                                             // voxels
    Vec3d origin = Vec3d::Zero();                                               // middle of voxel (0, 0, 0)
    std::array<Vec3d, 3> step{Vec3d::UnitX(), Vec3d::UnitY(), Vec3d::UnitZ()};  // to the next voxel along each index
    VoxelType type = VoxelType::kUint8;
    std::string voxels;  // x fastest, little endian; size[0] * size[1] * size[2] values
};

// Place of a point given in voxel indices.
Vec3d place_of_index(const Volume& volume, const Vec3d& index);

// Volume of one voxel; signed_voxel_volume is negative where the three steps are left-handed (a mirrored image).
double signed_voxel_volume(const Volume& volume);
double voxel_volume(const Volume& volume);

// The distinct values and how many voxels have them, ascending; at most `most` of them (0 means it is no label map).
std::vector<std::pair<double, uint64_t>> count_values(const Volume& volume, size_t most = 4096);

// Chosen voxels inside the box around them, enlarged by a frame of voxels that are not chosen (and may lie outside of
// the volume).
struct VoxelMask {
    std::array<int64_t, 3> first{};  // voxel of the volume that inside[0] stands for
    std::array<uint32_t, 3> size{};  // voxels, frame included
    std::vector<uint8_t> inside;     // 1 = chosen, x fastest
    uint64_t count = 0;              // of them
};

// Chooses the voxels with value `label`, or of value `threshold` and above. `frame` >= 1 voxels. An empty mask (count
// 0, no voxels) when there are none. A voxel that is not a number is never chosen.
VoxelMask select_label(const Volume& volume, double label, uint32_t frame);
VoxelMask select_above(const Volume& volume, double threshold, uint32_t frame);

// Voxels hang together across faces (6-connectivity): what meets only along an edge or at a corner is apart, as the
// contour keeps it apart. Keeps the largest piece, of equal ones the first; returns the sizes of all, largest first.
std::vector<uint64_t> keep_largest_piece(VoxelMask& mask);

}  // namespace trocar
