#pragma once
#include <cstdint>
#include <span>
#include <vector>
namespace trocar {

// The bytes in zlib's format (RFC 1950). Level 1 (fastest) to 12 (smallest). Same bytes for the same input.
std::vector<uint8_t> zlib_compress(std::span<const uint8_t> bytes, int level);

}  // namespace trocar
