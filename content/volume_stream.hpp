#pragma once
#include <cstdint>
#include <string>

#include "content/volume.hpp"
namespace trocar {

inline constexpr uint64_t kVoxelBytesLimit = uint64_t{1} << 32;  // of one volume

// What a reader in a child process writes: this header, then the voxels. Little endian, nothing between.
struct VolumeStreamHeader {
    char magic[8] = {'t', 'r', 'o', 'c', 'a', 'r', 'v', 'l'};
    uint32_t version = 1;
    uint32_t type = 0;         // VoxelType
    uint64_t size[3] = {};     // voxels
    double origin[3] = {};     // LPS, as Volume
    double spacing[3] = {};    // positive
    double direction[9] = {};  // unit vector of index x, of y, of z
    uint64_t voxel_bytes = 0;  // that follow
};
static_assert(sizeof(VolumeStreamHeader) == 168);

// Trusts nothing: magic, version and type, sizes against each other and the bytes there, every number finite, spacing
// positive, directions of length one that span space. Throws InputError with the reason, without a file name.
Volume decode_volume_stream(std::string bytes);

}  // namespace trocar
