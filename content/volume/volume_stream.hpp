#pragma once
#include <cstdint>
#include <string>

#include "content/volume/volume.hpp"
namespace trocar {

inline constexpr uint64_t kVoxelBytesLimit = uint64_t{1} << 32;  // per volume

// Output of a reader in a child process: this header, then the voxels. Little endian, unpadded.
struct VolumeStreamHeader {
    char magic[8] = {'t', 'r', 'o', 'c', 'a', 'r', 'v', 'l'};
    uint32_t version = 2;
    uint32_t type = 0;         // a VoxelType
    uint64_t size[3] = {};     // voxels
    double origin[3] = {};     // LPS, as in Volume
    double spacing[3] = {};    // positive
    double direction[9] = {};  // unit vectors of index x, y and z
    uint64_t layers = 1;       // values of a voxel
    uint64_t voxel_bytes = 0;  // size of the following data
};
static_assert(sizeof(VolumeStreamHeader) == 176);

// Validates everything: magic, version and type, sizes against each other and the available bytes, every
// number finite, spacing positive, directions of unit length and linearly independent. Throws InputError with
// the reason, without a file name.
Volume decode_volume_stream(std::string bytes);

}  // namespace trocar
